"""Local grids of sites: their calibration by points known in the grid and by GNSS, and their definition for PROJ.

Reads no files; `definition` alone makes CRS, which every other room only names.
`pairs.SitePairs`, `calibration.calibrate`, `definition.local_grid`.
"""
