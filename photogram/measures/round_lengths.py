"""Round lengths: what people expect of cells, contour intervals, scale bars and colour scales."""

import numpy as np

STEPS = (1.0, 2.0, 5.0)
CELL_STEPS = (1.0, 1.25, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0)
LIMIT_STEPS = (1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 10.0)


def round_near(length: float, steps: tuple[float, ...] = STEPS) -> float:
    """Return the one of ``steps`` times a power of ten whose ratio to a positive length is nearest to 1."""
    decade = np.floor(np.log10(length))
    candidates = [step * 10.0 ** (decade + shift) for shift in (0, 1) for step in steps]
    return float(f"{min(candidates, key=lambda candidate: abs(np.log(candidate / length))):.3g}")


def round_down(length: float) -> float:
    """Return the largest of STEPS times a power of ten that does not exceed a positive length."""
    decade = 10.0 ** np.floor(np.log10(length) + 1e-12)
    return float(f"{max(step * decade for step in STEPS if step * decade <= length * (1 + 1e-12)):.1g}")


def round_up(length: float) -> float:
    """Return the least of LIMIT_STEPS times a power of ten that is not below a positive length."""
    decade = 10.0 ** np.floor(np.log10(length))
    return float(decade * min(step for step in LIMIT_STEPS if step * decade >= length * (1 - 1e-9)))
