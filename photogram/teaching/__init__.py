"""Experiments for students on single steps of processing: the textbook's RANSAC, with its curves.

Takes no part in a survey.
`ransac_study`, `pair_study`, `command`.
"""
