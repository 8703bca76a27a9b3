"""What the commands do: call the library, show progress and results.

Compute nothing that a notebook could want.
One module for each command: `adjust`, `check`, `init` and so on.
"""
