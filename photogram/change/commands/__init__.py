"""The command that compares two epochs: names, arguments and help.

Imports nothing that takes time; the work is imported when the command runs.
`compare`.
"""
