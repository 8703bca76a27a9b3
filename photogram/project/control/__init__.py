"""Ground points of a project from files: which files, where their points lie in the map, and their marks.

Estimates nothing, and opens no photograph.
`points.read_point_files`, `points.ProjectControlPoint`, `mark_entries.mark_entries`.
"""
