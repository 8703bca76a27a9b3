"""Tie points: key points of photographs, pairs worth matching, matches, and points joined over many photographs.

Knows no positions of points in space, but for guided matching, which is given the block.
`features.find_features`, `pairs.select_pairs`, `matching.match_pair`, `tracks.join_matches`.
"""
