"""Triangulated surfaces (TIN) of other programs, designs above all: LandXML and DXF, one module each.

Reads triangles and what the file says of units, map grid and heights; puts them on no grid and assumes nothing.
`triangulation.Triangulation`, `land_xml.read_land_xml`, `drawing.read_drawing`, `reading.read_triangulation`.
"""
