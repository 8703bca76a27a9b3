"""What the commands do that simulate and plan surveys: call the library, show progress and results.

Compute nothing that a notebook could want.
One module for each command: `demo`, `plan`.
"""
