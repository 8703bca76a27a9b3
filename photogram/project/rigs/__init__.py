"""Cameras on one body in a project: what the file says of them, and which photographs are one exposure.

Estimates nothing, and opens no photograph.
`entries.check_rigs`, `entries.rigs_of`, `grouping.grouped`.
"""
