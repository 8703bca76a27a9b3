"""Verification: a finished survey's figures derived again from its observations, by mathematics of its own.

Its mathematics import NumPy and the standard library alone, no line of the engine; they decide nothing.
`check.verify_report` compares report.json with what follows from observations.npz.
"""
