"""Two surveys of one site: what has changed between them, and how surely.

What epochs say of their errors is never guessed. Rooms: `files`, `commands`, `work`.
`surface_change.compare_surfaces` and `cloud_change.compare_clouds`.
"""
