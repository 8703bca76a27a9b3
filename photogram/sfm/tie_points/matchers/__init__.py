"""Nearest descriptors of two photographs, a matcher for each metric in which descriptors are compared.

Knows no key points and no photographs, only rows of bytes.
`euclidean.Euclidean`, `hamming.Hamming`; what a matcher must have: `nearest.Matcher`.
"""
