"""What lies on disk: the work folder with its stages, its checksums, and the results of a run as objects.

Knows no stage of its own and no order; never removes what photogram did not make.
`workspace.Workspace`, `run.Run`.
"""
