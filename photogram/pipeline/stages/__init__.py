"""The stages of a survey, from photographs to products: each an object that does, says, costs and hands over.

Each reads its inputs from the run, calls the rooms below, and stores its outputs; none runs another.
`order.BEFORE_RESULTS`; `photographs.PHOTOGRAPHS`, `tie_points.TIE_POINTS`, `adjustment.ADJUSTMENT`, `dense.DENSE`.
"""
