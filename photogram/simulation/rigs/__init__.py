"""Cameras on one body, flown over a simulated terrain, with their true relative pose.

Adjusts nothing, and uses no estimate as truth.
`two_cameras.simulate_two_cameras`.
"""
