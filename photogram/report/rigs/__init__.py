"""Cameras on one body in the report: their relative poses and how well their exposures are tested.

Estimates nothing, and draws nothing.
`rig_numbers.rig_numbers`.
"""
