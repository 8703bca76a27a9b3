"""A known surface as control: which tie points lie on it, how far they are from it, whether it contradicts the rest.

Opens no file, and moves no tie point to the surface.
`known_surfaces.KnownSurfaces`, of a `known_heights.KnownSurface`.
"""
