"""What the map of the results shows: rasters, residuals, contour lines, tiles under it, comparisons with others.

Computes no comparison itself: `photogram.change` compares, as `photogram compare` does, and the page reads the same
files. `layers.layers`, `residuals.residuals`, `basemap.basemap`, `kept_comparisons.KeptComparisons`.
"""
