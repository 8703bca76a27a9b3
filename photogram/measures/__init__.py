"""Figures that several rooms need, each defined once: ground sampling, round lengths, mark covariances, the vertical.

They know surveys and numbers; no surfaces, settings or files.
Enter: `ground_sampling.ground_sampling_m`, `round_lengths.round_near`.
"""
