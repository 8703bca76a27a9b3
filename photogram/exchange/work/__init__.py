"""What the commands do that read and write other programs' solutions.

Compute nothing that a notebook could want.
One module for each command: `audit`, `export`, `import_solution`.
"""
