"""Surfaces that are known: distances of intersected points from them, as factors on photographs.

Observes no tie point itself, and reads no height model.
`known_surface.surface_factors` gives the factors of a block.
"""
