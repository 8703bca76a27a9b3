"""Tables on disk: control points, marks and camera positions as other programs write them.

Returns rows with their file and line; decides nothing about roles, heights or priority.
`surveyed_points`, `control_files` and `position_files`.
"""
