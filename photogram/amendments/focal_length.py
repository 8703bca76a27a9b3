"""The focal length where its source and the photographs contradict each other: what it is, and how well that is known.

What is known beforehand of a focal length is a long-tailed distribution: most tags and calibrations are right within
their standard deviation, some are wrong by 5 to 20 % (a 35 mm equivalent by the width, a crop taken for the whole
sensor, a zoom lens, an edited picture). What photographs say of it is as good as their formal standard deviation only
if the camera model holds: a rolling shutter or a correction within the camera, which all photographs share, moves the
focal length of a block that looks straight down by many times that. It shows where parts of the pictures that ought to
agree are adjusted by themselves: the scatter of their focal lengths, beyond what their standard deviations explain, is
the error of the model. The two are put together as a mixture of normal distributions, whose mean and variance are kept.
"""

from collections.abc import Iterator, Sequence

import numpy as np
from scipy.stats import norm

from photogram.arrays import BoolArray, FloatArray
from photogram.results import FocalLength, PhotographsSay
from photogram.survey import TiePoints

WRONG_TAG = 0.1
"""The probability that the source of a focal length is wrong beyond its standard deviation."""

WRONG_BY = 0.2
"""Standard deviation of such a wrong focal length, in itself."""

SHARE = 0.6
"""Part of a picture that is adjusted by itself, of its width, its height or its observations by radius."""

FEWEST_PARTS = 3

SHARED = 2.0
"""What moves the focal length of the whole, over what sets its parts apart: they overlap, and share most of it."""


def without_prior(focal_px: float, sigma_px: float, prior_px: float, prior_sigma_px: float) -> tuple[float, float]:
    """Return an estimate and its standard deviation without the prior N(``prior_px``, ``prior_sigma_px``) in it; an
    infinite standard deviation where nothing but the prior determines it."""
    information = 1.0 / sigma_px**2 - 1.0 / prior_sigma_px**2
    if information <= 1e-6 / prior_sigma_px**2:
        return focal_px, float("inf")
    return (focal_px / sigma_px**2 - prior_px / prior_sigma_px**2) / information, float(1.0 / np.sqrt(information))


def settled(
    given_px: Sequence[float], given_sigma_px: float, says: PhotographsSay, evidence: float = 0.0
) -> FocalLength:
    """Return the focal length by its source and by the photographs together.

    ``given_px`` are the readings of the source, the one in use first, each with ``given_sigma_px``; ``evidence`` is the
    logarithm of the likelihood of control points that were left out one after the other, of the photographs' focal
    length over the source's. Mean and variance of the posterior of a mixture prior (Bishop 2006, sec. 2.3.9).
    """
    wrong_px = WRONG_BY * given_px[0]
    means = np.array([*given_px, given_px[0]])
    sigmas = np.array([given_sigma_px] * len(given_px) + [wrong_px])
    prior = np.array([(1.0 - WRONG_TAG) / len(given_px)] * len(given_px) + [WRONG_TAG])
    spread = np.hypot(sigmas, says.sigma_px)
    log_weight = np.log(prior) + norm.logpdf(says.focal_px, means, spread)
    log_weight[-1] += evidence
    weight = np.exp(log_weight - log_weight.max())
    weight /= weight.sum()
    share = says.sigma_px**2 / spread**2
    centre = says.focal_px + share * (means - says.focal_px)
    mean = float(weight @ centre)
    variance = float(weight @ (share * sigmas**2 + (centre - mean) ** 2))
    return FocalLength(mean, float(np.sqrt(variance)), float(weight[-1]))


def picture_parts(ties: TiePoints, own: BoolArray, width_px: int, height_px: int) -> Iterator[BoolArray]:
    """Yield the observations (N,) of parts of the pictures of a camera, whose observations are ``own`` (N,), beside all
    those of the other cameras: left, right, upper, lower, inner and outer part."""
    x, y = (ties.pixel[:, 0] + 0.5) / width_px, (ties.pixel[:, 1] + 0.5) / height_px
    radius = np.hypot((x - 0.5) * width_px, (y - 0.5) * height_px)
    inner, outer = np.quantile(radius[own], [SHARE, 1.0 - SHARE]) if own.any() else (0.0, 0.0)
    for part in (x < SHARE, x > 1.0 - SHARE, y < SHARE, y > 1.0 - SHARE, radius < inner, radius > outer):
        yield ~own | part


def model_sigma_px(whole_px: float, whole_sigma_px: float, parts_px: FloatArray, sigmas_px: FloatArray) -> float:
    """Return the standard deviation of the camera model's error in a focal length, from those of parts of the pictures
    (K,) with their formal standard deviations (K,); infinite where there are fewer than FEWEST_PARTS.

    A part that is contained in the whole differs from it by the difference of their variances (Hausman 1978); what the
    mean square of the differences exceeds that by is the model's, and SHARED times that is taken for the whole.
    """
    if len(parts_px) < FEWEST_PARTS:
        return float("inf")
    by_chance = np.maximum(sigmas_px**2 - whole_sigma_px**2, 0.0)
    weight = 1.0 / sigmas_px**2
    excess = float(weight @ ((parts_px - whole_px) ** 2 - by_chance) / weight.sum())
    doubt = float(np.sqrt(2.0 / len(parts_px)) * (weight @ by_chance) / weight.sum())
    return SHARED * float(np.sqrt(excess)) if excess > 2.0 * doubt else 0.0
