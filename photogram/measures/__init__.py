"""Figures that several rooms need, each defined once: the ground sampling distance, round lengths.

They know surveys and numbers; no surfaces, settings or files.
Enter: `ground_sampling.ground_sampling_m`, `round_lengths.round_near`.
"""
