"""What a measured centre states."""

import numpy as np
import pytest

from photogram.marking.targets.kinds import TITLES, Kind, MeasuredCentre, title_of


def test_sigmas_are_the_roots_of_the_variances() -> None:
    own = MeasuredCentre(Kind.CROSS, np.zeros(2), np.diag([0.04, 0.09]), 0.9, 20.0, 100.0)
    np.testing.assert_allclose(own.sigma_px, [0.2, 0.3])


def test_wrong_shapes_are_refused() -> None:
    with pytest.raises(ValueError, match="centre_px"):
        MeasuredCentre(Kind.CROSS, np.zeros(3), np.eye(2), 0.9, 20.0, 100.0)
    with pytest.raises(ValueError, match="covariance_px2"):
        MeasuredCentre(Kind.CROSS, np.zeros(2), np.eye(3), 0.9, 20.0, 100.0)


def test_every_kind_has_a_title_and_other_words_are_their_own() -> None:
    assert set(TITLES) == set(Kind)
    assert title_of("checker") == "checker target"
    assert (title_of("raw"), title_of("imported")) == ("raw", "imported")
