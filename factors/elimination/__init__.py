"""The bundle engine: normal equations by elimination of tie points, damped steps, covariances; free of GTSAM.

Takes the terms of control, GNSS and calibration as they come from the factors; its referee is GTSAM.
`bundle.adjust_bundle`.
"""
