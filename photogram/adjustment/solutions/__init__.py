"""Solutions of a block: what may still become unknown, the result of an adjustment, and alternatives to it.

Solves again what has been solved, and never chooses the observations of tie points.
`ended.adjustment_of` gives the result; `alternatives.alternative` that of other measurements.
"""
