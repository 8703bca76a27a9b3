"""Figures that several rooms need, each defined once: ground sampling distance, round lengths, covariances of marks.

They know surveys and numbers; no surfaces, settings or files.
Enter: `ground_sampling.ground_sampling_m`, `round_lengths.round_near`.
"""
