"""Files that photogram reads and writes: photographs, points, rasters."""
