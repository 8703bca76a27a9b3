"""The stages of a survey, from photographs to products.

Each reads its inputs from the run, calls the rooms below, and stores its outputs; none calls another.
`photographs`, `tie_points`, `orientation`, `adjustment`, `dense`, `surface`, `orthophoto`, `comparison`, `results`.
"""
