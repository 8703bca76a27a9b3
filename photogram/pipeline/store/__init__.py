"""What lies on disk: the work folder with its stages and checksums, and the photographs of a run.

Knows no stage of its own and no order; never removes what photogram did not make.
`workspace.Workspace`, `run.Run`.
"""
