"""Cameras on one body in an adjustment: where free relative poses start, and the tests of single exposures.

Rejects nothing: that is in amendments.gross_errors.
`rig_starts.with_rig_starts`, `exposure_tests.exposure_tests`.
"""
