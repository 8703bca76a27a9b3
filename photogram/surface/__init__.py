"""Surfaces and products from adjusted blocks: DSM, DTM, contour lines, dense matching, orthophoto.

Works on tiles; reads photographs through the callbacks it is given and writes no files.
`tin_dsm`, `dsm`, `dtm`, `contours.contour_lines`; rooms `dense` and `ortho`.
"""
