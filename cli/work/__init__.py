"""What the commands do: call the library, show progress and results.

Compute nothing that a notebook could want.
One module for each command of `photogram.cli.commands`.
"""
