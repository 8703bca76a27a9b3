"""Cameras on one body: relative poses as unknowns of the reduced system's border, exposures as observations.

Knows nothing of who took the photographs, and tests nothing: that is in adjustment.
`exposures.taking_part`, `exposures.exposure_factors`.
"""
