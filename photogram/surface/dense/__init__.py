"""Dense heights: correlation of many photographs on the ground, semi-global regularisation, refinement.

Keeps no height without its standard deviation; memory grows with a tile, not with the survey.
`tile_matching.match_block`, `pyramid.plan_levels`.
"""
