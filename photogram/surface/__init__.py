"""Surfaces and products from adjusted blocks: DSM, DTM, contour lines, dense matching, orthophoto.

Works on tiles; reads photographs through the callbacks it is given and writes no files.
`surface_model`, `dense_surface`, `terrain_model`, `contours`; rooms `dense` and `ortho`.
"""
