"""Coordinate reference systems, height systems, and the local frame that a survey is computed in.

Every point goes through PROJ; knows nothing of photographs. The one place of the core that imports it.
`crs.map_units`, `frames.LocalFrame`, `height_systems`.
"""
