"""Two surveys of one site: what has changed between them, and how surely.

Prints and draws nothing: `photogram.cli` and `photogram.report` do. What epochs say of their errors is never guessed.
`surface_change.compare_surfaces` and `cloud_change.compare_clouds`.
"""
