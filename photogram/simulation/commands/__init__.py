"""The commands that simulate and plan surveys: names, arguments and help.

Import nothing that takes time; the work is imported when a command runs.
One module for each command: `demo`, `plan`.
"""
