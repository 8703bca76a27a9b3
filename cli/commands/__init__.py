"""The commands: names, arguments and help.

Import nothing that takes time; the work is imported when a command runs.
One module for each command: `adjust`, `check`, `init` and so on.
"""
