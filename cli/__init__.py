"""The command line: arguments, progress, exit codes.

No mathematics: what a command computes, the rooms compute.
`main.main`, `registry`; rooms `commands` and `work`.
"""
