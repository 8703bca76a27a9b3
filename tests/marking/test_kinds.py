"""What a measured centre states."""

import numpy as np
import pytest

from photogram.marking.targets.kinds import Kind, MeasuredCentre


def test_sigmas_are_the_roots_of_the_variances() -> None:
    own = MeasuredCentre(Kind.CROSS, np.zeros(2), np.diag([0.04, 0.09]), 0.9, 20.0, 100.0)
    np.testing.assert_allclose(own.sigma_px, [0.2, 0.3])


def test_wrong_shapes_are_refused() -> None:
    with pytest.raises(ValueError, match="centre_px"):
        MeasuredCentre(Kind.CROSS, np.zeros(3), np.eye(2), 0.9, 20.0, 100.0)
    with pytest.raises(ValueError, match="covariance_px2"):
        MeasuredCentre(Kind.CROSS, np.zeros(2), np.eye(3), 0.9, 20.0, 100.0)
