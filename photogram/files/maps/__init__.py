"""Maps on disk: Cloud Optimized GeoTIFFs, contour lines, and how their coordinate reference systems are written.

Reads and writes; resamples nothing.
`rasters.read_raster`, `cogs`, `contour_files.write_contours`.
"""
