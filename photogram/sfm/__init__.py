"""From photographs to starting values: key points, matches, tie points, resection, orientation of all photographs.

Estimates starting values only; covariances come from `adjustment`.
`orientation.orient`, `resection`; tie points come from the room `tie_points`.
"""
