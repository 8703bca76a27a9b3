"""A processing node that WebODM and PyODM choose from their list: NodeODM's tasks, done by photogram.

Computes nothing itself: a task is a folder with a project file, and a process that runs the commands of a terminal.
`command.serve`, `node.Node`, `server.NodeServer`, `options.OPTIONS`.
"""
