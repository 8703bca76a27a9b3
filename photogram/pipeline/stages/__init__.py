"""The stages of a survey, from photographs to products.

Each reads its inputs from the run, calls the rooms below, and stores its outputs; none calls another.
`stages`, `dense`, `surface`, `orthophoto`, `results`.
"""
