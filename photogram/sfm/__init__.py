"""From photographs to starting values: key points, matches, tie points, resection, orientation of all photographs.

Estimates starting values only; covariances come from `adjustment`.
`features.find_features`, `matching.match_pair`, `tracks.join_matches`, `orientation.orient`.
"""
