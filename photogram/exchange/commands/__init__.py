"""The commands that read and write other programs' solutions: names, arguments and help.

Import nothing that takes time; the work is imported when a command runs.
One module for each command: `audit`, `export`, `import_solution`.
"""
