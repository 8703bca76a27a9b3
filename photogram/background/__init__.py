"""Work that takes hours, each in a process of its own: whoever started it may end, and another may look on.

Knows nothing of surveys, and of commands only how they are called.
`runs.Runs`, whose processes `runner` starts.
"""
