"""Targets in photographs: their kind, their centre to a fraction of a pixel, and the covariance of the centre.

Opens no files and knows no cameras: it is given grey values, and marks are weighted elsewhere.
`measurement.snap` near a rough place, `measurement.propose` without one, `matching.match_centre` where no kind fits.
"""
