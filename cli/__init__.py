"""The command line: arguments, progress, exit codes.

No mathematics: what a command computes, the rooms compute.
`main.main`; rooms `commands`, `work` and `screen`.
"""
