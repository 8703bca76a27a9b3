"""Positions of projection centres: listed in the project, in files of other programs, or in the photographs' tags.

Reads and matches them by name; which of them counts for a photograph, `measured_positions` decides.
`entries`, `matching`, `frozen.frozen_positions`.
"""
