"""Shutters that read a picture row by row, in an adjustment: read-out times, and how photographs moved meanwhile.

Projects nothing: that is in `projection`.
`rolling_shutter.renewed`, `rolling_shutter.readouts`, `own_velocities.departures`.
"""
