"""The stages of a survey, from photographs to products.

Each reads its inputs from the run, calls the rooms below, and stores its outputs; none calls another.
They are listed, in their order, in `photogram.pipeline.pipeline`.
"""
