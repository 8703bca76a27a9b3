"""Files of two epochs: polygons, clouds to compare, and what a comparison writes.

Reads and writes; compares nothing.
`polygon_files`, `compared_clouds`, `change_files`.
"""
