"""Volumes of polygons between two surfaces or over a base, with their standard deviations.

Guesses nothing of what surfaces do not say of their errors, and knows no project, stage or report.
`measured_volumes`, `volumes`, `differences`, `rim_base`.
"""
