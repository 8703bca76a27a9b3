"""Maps on disk: Cloud Optimized GeoTIFFs, contour lines, polygons, and how their reference systems are written.

Reads and writes; resamples nothing.
`rasters.read_raster`, `polygon_files.read_polygons`, `cogs`, `contour_files.write_contours`, `point_files`.
"""
