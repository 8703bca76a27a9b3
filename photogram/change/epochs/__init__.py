"""Epochs of one site in one adjustment: a surface of each, and their differences with the errors of both together.

Adjusts nothing of its own.
`epochs.adjusted_epochs`, `difference_errors.difference_errors`.
"""
