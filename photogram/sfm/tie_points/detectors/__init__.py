"""Detectors of key points: each is a module, which `features.detector` of a project file names, and its `DETECTOR`.

Holds nothing but detectors: what several of them share lies in the room around.
`sift`, `sift_opencv`, `orb`; what a detector must have says the module detector in the room around.
"""
