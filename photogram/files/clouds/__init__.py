"""Point clouds on disk: LAS, LAZ, PLY and text.

Reads and writes; thins and compares nothing.
`points.read_cloud`, `points.write_laz`; `dense_points` writes dense clouds tile by tile, `copc` in an octree.
"""
