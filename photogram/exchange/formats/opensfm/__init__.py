"""Reconstructions of OpenSfM and OpenDroneMap, read and written.

Knows WGS 84 and no other datum: measured positions are longitude, latitude and ellipsoidal height.
`reconstructions.read_opensfm` and `reconstructions.write_opensfm`.
"""
