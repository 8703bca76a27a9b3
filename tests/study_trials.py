"""Trials of test_study.py, in a module of its own: other processes import it by its name."""

import os
import time


def late_first(seed: int) -> tuple[int, str]:
    """Return a seed squared and its process's number of threads, the first one last."""
    time.sleep(0.5 if seed == 0 else 0.0)
    return seed**2, os.environ["OPENBLAS_NUM_THREADS"]


def spoilt(seed: int) -> int:
    """Return a seed, but not 1."""
    if seed == 1:
        raise ValueError("no survey with the seed 1")
    return seed
