"""Observations of poses, points and other unknowns, linearised by arrays: alike ones together, with their Jacobians.

Knows no block and no layout of the normal equations; needs no GTSAM, which is the referee in its tests.
`alike.Factors`, `alike.together`, `poses.PositionFactors`, `poses.AttitudeFactors`, `poses.DistanceFactors`.
"""
