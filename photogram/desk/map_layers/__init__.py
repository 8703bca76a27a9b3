"""What the map of the results shows beside their rasters: comparisons with designs and other surveys, contour lines.

Computes nothing itself: `photogram.change` compares, as `photogram compare` does, and the page reads the same files.
`kept_comparisons.KeptComparisons`, `choosing.surfaces_in`, `contour_layer.contour_layer`.
"""
