"""Flights that are planned, and what accuracy is predicted for them.

Predicts from geometry and stated sigmas alone; renders no photographs.
`flight_plan`, `prediction.predict_accuracy`.
"""
