"""Site calibration: a local grid fitted to points that are known in it and by GNSS.

Plan: a map projection about the middle of the site, or a given map, and a plane similarity of it (x, y) (Ghilani 2017,
sec. 18.3; IOGP 373-7-2, sec. 4.4.1):

    E = E₀ + k (x cos α − y sin α),   N = N₀ + k (x sin α + y cos α)

Height: H = h + a + s_φ ρ₀ (φ − φ₀) + s_λ ν₀ (λ − λ₀) cos φ, an inclined plane under the local heights, with the radii
of curvature ρ₀ and ν₀ of the ellipsoid at the middle ("Vertical Offset and Slope", EPSG:1046; IOGP 373-7-2, sec.
4.6.3). Both are adjusted by least squares under the stated standard deviations; a pair that contradicts the others is
named where one alone explains the contradiction.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.stats import chi2

from photogram.arrays import FloatArray, IntArray
from photogram.errors import ControlPointError
from photogram.local_grids.pairs import SitePairs
from photogram.local_grids.tested_fit import TestedFit, fit
from photogram.wording import percent, things

HeightModel = Literal["plane", "offset", "none"]
HEIGHT_PARAMETERS = {"plane": 3, "offset": 1, "none": 0}

SIGNIFICANCE = 0.002
"""Of all tests of a calibration together, before a pair is named; the k-th pair is tested at this over k²."""

LIKELIER = 1000.0
"""How many times likelier one pair must explain a contradiction than any other, to be named alone."""

MOST_WRONG = 0.34
"""Share of the pairs that are named at most: where more contradict, it is the stated sigmas that are wrong."""

LEAST_WIDTH = 0.01
"""Width of the points over their length, below which they are taken for a line."""

_CONVERGED, _MOST_ITERATIONS = 1e-14, 20


@dataclass(frozen=True)
class CalibrationSettings:
    """What is estimated."""

    scale: float | None = None
    """Scale of the similarity that is held; None to estimate it."""
    heights: HeightModel = "plane"
    """What is estimated of the heights: an inclined plane, its offset alone, or nothing."""


@dataclass(frozen=True, eq=False)
class PlaneSimilarity:
    """What takes x and y of a map to easting and northing of a local grid."""

    origin_m: FloatArray
    """Easting and northing (2,) in the local grid of x = y = 0."""
    rotation_rad: float
    """Turn of the local grid against the map, α: counter-clockwise from the map's axes to the local ones' images."""
    scale: float
    """Scale k: a length in the local grid over that on the map."""

    def local_m(self, map_m: FloatArray) -> FloatArray:
        """Return easting and northing (N, 2) in the local grid of x and y (N, 2)."""
        c, s = self.scale * np.cos(self.rotation_rad), self.scale * np.sin(self.rotation_rad)
        return np.asarray(self.origin_m + map_m @ np.array([[c, s], [-s, c]]))


@dataclass(frozen=True, eq=False)
class PlanFit(PlaneSimilarity):
    """The similarity in plan that was estimated."""

    centre_m: FloatArray
    """Middle of the pairs on the map (2,), about which the parameters are estimated."""
    sigma: FloatArray
    """Standard deviations of the origin (m), rotation (rad) and scale at the middle of the pairs (4,); 0 of what is
    held."""
    fit: TestedFit
    """Observations are easting and northing of the pairs in plan, one after the other."""


@dataclass(frozen=True, eq=False)
class HeightFit:
    """The plane under the local heights; angles of slope in radians."""

    middle_deg: FloatArray
    """Longitude and latitude (2,) where the offset holds."""
    offset_m: float
    """Local minus ellipsoidal height there."""
    slope_north: float
    """How much that rises per metre northwards."""
    slope_east: float
    """How much that rises per metre eastwards."""
    sigma: FloatArray
    """Standard deviations of offset (m) and slopes (3,); 0 of what is held."""
    fit: TestedFit
    """Observations are the heights of the pairs in height."""


@dataclass(frozen=True)
class Suspicion:
    """A pair that contradicts the others, or several of which one does."""

    pairs: tuple[int, ...]
    """Their numbers; one where it is named."""
    part: Literal["plan", "height"]
    """What contradicts."""
    off_m: tuple[float, ...]
    """By how much each is off: its local coordinates minus what the others predict, a length in plan, signed in
    height."""
    probability: float
    """Probability of a contradiction as large by chance, in one test."""
    explains: bool
    """Whether all others agree without the first."""


@dataclass(frozen=True, eq=False)
class SiteCalibration:
    """A calibrated site. Residuals are fitted minus given, in m."""

    pairs: SitePairs
    """The pairs, all of them."""
    used: SitePairs
    """The pairs, where those that were named do not serve any more."""
    plan: PlanFit
    """Similarity in plan."""
    height: HeightFit | None
    """Plane under the heights, None where nothing was estimated."""
    residual_m: FloatArray
    """Residuals (N, 3) of all pairs, used or not; NaN where a coordinate is unknown."""
    suspicions: tuple[Suspicion, ...]
    """Pairs that contradict the others."""
    warnings: tuple[str, ...]
    """What is weak."""


def radii_m(latitude_deg: float, semi_major_m: float, semi_minor_m: float) -> tuple[float, float]:
    """Return the radii of curvature of an ellipsoid along the meridian and across it (Torge 2001, eq. 4.13–4.14)."""
    e2 = 1.0 - (semi_minor_m / semi_major_m) ** 2
    w = 1.0 - e2 * np.sin(np.deg2rad(latitude_deg)) ** 2
    return float(semi_major_m * (1.0 - e2) / w**1.5), float(semi_major_m / np.sqrt(w))


def slopes_design(place_deg: FloatArray, middle_deg: FloatArray, radii: tuple[float, float]) -> FloatArray:
    """Return the design (N, 3) of offset, slope to the north and slope to the east at longitudes and latitudes (N, 2),
    as EPSG:1046 has it."""
    lon, lat = np.deg2rad(place_deg - middle_deg).T
    north = radii[0] * lat
    east = radii[1] * lon * np.cos(np.deg2rad(place_deg[:, 1]))
    return np.column_stack([np.ones(len(place_deg)), north, east])


def _width(points: FloatArray) -> float:
    """Return the width of points (N, 2) over their length, 0 where they lie in a line."""
    if len(points) < 2:
        return 0.0
    lengths = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return float(lengths[-1] / lengths[0]) if len(lengths) > 1 and lengths[0] > 0.0 else 0.0


def _start(map_m: FloatArray, local_m: FloatArray) -> tuple[float, float]:
    """Return rotation and scale of a similarity in closed form, from centred points (N, 2)."""
    z, w = map_m @ np.array([1.0, 1j]), local_m @ np.array([1.0, 1j])
    ratio = np.vdot(z, w) / np.vdot(z, z).real
    return float(np.angle(ratio)), float(np.abs(ratio))


def _plan_design(map_m: FloatArray, rotation_rad: float, scale: float, free_scale: bool) -> FloatArray:
    """Return the design (2N, 3 or 4) of origin, rotation and logarithm of the scale at centred points (N, 2)."""
    c, s = scale * np.cos(rotation_rad), scale * np.sin(rotation_rad)
    turned = map_m @ np.array([[c, s], [-s, c]])
    A = np.zeros((len(map_m), 2, 4 if free_scale else 3))
    A[:, 0, 0] = A[:, 1, 1] = 1.0
    A[:, 0, 2], A[:, 1, 2] = -turned[:, 1], turned[:, 0]
    if free_scale:
        A[:, :, 3] = turned
    return A.reshape(2 * len(map_m), -1)


def fit_plan(map_m: FloatArray, local_m: FloatArray, sigma_m: FloatArray, scale: float | None) -> PlanFit:
    """Return the similarity that takes points (N, 2) of a map to the local grid (N, 2), of N ≥ 2 different points with
    standard deviations (N,); ``scale`` is held where it is given."""
    centre = map_m.mean(axis=0)
    x, target = map_m - centre, local_m - local_m.mean(axis=0)
    rotation, free = _start(x, target)
    k = free if scale is None else scale
    shift, sigma = np.zeros(2), np.repeat(sigma_m, 2)
    for _ in range(_MOST_ITERATIONS):
        A = _plan_design(x, rotation, k, scale is None)
        turned = k * x @ np.array([[np.cos(rotation), np.sin(rotation)], [-np.sin(rotation), np.cos(rotation)]])
        fitted = fit(A, (target - turned - shift).ravel(), sigma)
        step = fitted.parameter
        shift, rotation = shift + step[:2], rotation + float(step[2])
        if scale is None:
            k *= float(np.exp(step[3]))
        if np.abs(step[2:]).max() < _CONVERGED:
            break
    at_centre = local_m.mean(axis=0) + shift
    c, s = k * np.cos(rotation), k * np.sin(rotation)
    origin = at_centre - np.array([c * centre[0] - s * centre[1], s * centre[0] + c * centre[1]])
    sigmas = np.sqrt(np.diag(fitted.covariance))
    sigmas = np.append(sigmas[:3], sigmas[3] * k if scale is None else 0.0)
    rotation = float((rotation + np.pi) % (2.0 * np.pi) - np.pi)
    return PlanFit(origin, rotation, k, centre, sigmas, fitted)


def fit_heights(pairs: SitePairs, middle_deg: FloatArray, radii: tuple[float, float], model: HeightModel) -> HeightFit:
    """Return the plane, or its offset alone, under the local heights of the pairs in height."""
    own = pairs.in_height
    A = slopes_design(pairs.place_deg[own], middle_deg, radii)[:, : HEIGHT_PARAMETERS[model]]
    fitted = fit(A, pairs.local_m[own, 2] - pairs.height_m[own], pairs.sigma_m[own, 1])
    parameter = np.pad(fitted.parameter, (0, 3 - len(fitted.parameter)))
    sigma = np.pad(np.sqrt(np.diag(fitted.covariance)), (0, 3 - len(fitted.parameter)))
    offset, north, east = parameter.tolist()
    return HeightFit(middle_deg, offset, north, east, sigma, fitted)


# ---- what can be fitted ----------------------------------------------------------------------------------------------


def _check(pairs: SitePairs, map_m: FloatArray, settings: CalibrationSettings) -> tuple[str, ...]:
    """Return what is weak. Raises ControlPointError where too little is given."""
    plan = np.flatnonzero(pairs.in_plan)
    if len(plan) < 2:
        raise ControlPointError(
            f"a calibration in plan needs two pairs with easting and northing at least, found {len(plan)}: give more"
        )
    reach = np.ptp(map_m[plan], axis=0).max()
    if reach < 1.0 or np.ptp(pairs.local_m[plan, :2], axis=0).max() < 1.0:
        raise ControlPointError("the pairs in plan lie at one place, within 1 m: a turn cannot be found: give others")
    warnings = []
    redundancy = 2 * len(plan) - (4 if settings.scale is None else 3)
    if redundancy == 0:
        warnings.append(
            "two pairs fix the similarity without redundancy: residuals are 0 and prove nothing; measure a third pair, "
            "or hold the scale"
        )
    if settings.heights == "none":
        return tuple(warnings)
    high = np.flatnonzero(pairs.in_height)
    needed = HEIGHT_PARAMETERS[settings.heights]
    if len(high) < needed:
        less = "estimate the offset alone" if len(high) else "calibrate in plan alone"
        raise ControlPointError(
            f"heights: {settings.heights} needs {things(needed, 'pair')} with both heights, found {len(high)}: give "
            f"more, or {less}"
        )
    if settings.heights == "plane":
        width = _width(map_m[high])
        if width < LEAST_WIDTH:
            raise ControlPointError(
                "the pairs in height lie in a line, about which a plane can turn: give one beside it, or estimate the "
                "offset alone"
            )
        if width < 10 * LEAST_WIDTH:
            warnings.append(
                f"the pairs in height lie almost in a line (width {percent(width)} of the length): heights beside it "
                "are weak"
            )
    if len(high) == needed:
        warnings.append(
            f"{things(needed, 'pair')} fix the heights without redundancy: their residuals are 0 and prove nothing"
        )
    return tuple(warnings)


# ---- who contradicts -------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Candidate:
    """A part of a pair that may be wrong."""

    pair: int
    part: Literal["plan", "height"]
    group: IntArray
    fit: TestedFit

    @property
    def statistic(self) -> float:
        return self.fit.group_statistic(self.group)

    @property
    def probability(self) -> float:
        statistic = self.statistic
        return 1.0 if np.isnan(statistic) else float(chi2.sf(statistic, len(self.group)))

    @property
    def off_m(self) -> float:
        """Local coordinates minus what the others predict: a length in plan, signed in height."""
        difference, _ = self.fit.left_out(self.group)
        return float(-difference[0] if len(self.group) == 1 else np.hypot(*difference))


def _candidates(pairs: SitePairs, plan: PlanFit, height: HeightFit | None) -> list[_Candidate]:
    candidates = [
        _Candidate(int(i), "plan", np.array([2 * row, 2 * row + 1]), plan.fit)
        for row, i in enumerate(np.flatnonzero(pairs.in_plan))
    ]
    if height is not None:
        candidates += [
            _Candidate(int(i), "height", np.array([row]), height.fit)
            for row, i in enumerate(np.flatnonzero(pairs.in_height))
        ]
    return candidates


def _suspicion(candidates: list[_Candidate], level: float) -> Suspicion | None:
    """Return who explains the strongest contradiction, None where there is none at a significance."""
    worst = min(candidates, key=lambda c: c.probability, default=None)
    if worst is None or worst.probability >= level / len(candidates):
        return None
    rivals = [
        c
        for c in candidates
        if c.part == worst.part and c is not worst and worst.statistic - c.statistic < 2.0 * np.log(LIKELIER)
    ]
    named = [worst, *sorted(rivals, key=lambda c: -c.statistic)]
    left, degrees = worst.fit.weighted_square - worst.statistic, worst.fit.degrees_of_freedom - len(worst.group)
    explains = degrees <= 0 or bool(chi2.sf(left, degrees) > level)
    return Suspicion(
        tuple(c.pair for c in named), worst.part, tuple(c.off_m for c in named), worst.probability, explains
    )


# ---- the calibration -------------------------------------------------------------------------------------------------


def calibrate(
    pairs: SitePairs,
    map_of: Callable[[FloatArray], FloatArray],
    middle_deg: FloatArray,
    radii: tuple[float, float],
    settings: CalibrationSettings | None = None,
) -> SiteCalibration:
    """Return the calibration of a site, without the pairs that are named as wrong.

    ``map_of`` takes longitudes and latitudes (N, 2) to the map that the similarity starts from (N, 2), m;
    ``middle_deg`` (2,) is where the height plane has its offset, ``radii`` those of the ellipsoid there, along the
    meridian and across it. A pair is left out only where it alone explains what contradicts; where others could as
    well, nothing is left out and all of them are given. Raises ControlPointError where the pairs do not determine what
    the settings ask for.
    """
    wanted = settings or CalibrationSettings()
    map_m = map_of(pairs.place_deg)
    used, suspicions = pairs, list[Suspicion]()
    warnings = _check(pairs, map_m, wanted)
    most = int(MOST_WRONG * len(pairs))
    plan, height = _fits(used, map_m, middle_deg, radii, wanted)
    first = plan, height
    while True:
        suspicion = _suspicion(_candidates(used, plan, height), SIGNIFICANCE / (len(suspicions) + 1) ** 2)
        if suspicion is None:
            break
        suspicions.append(suspicion)
        if len(suspicion.pairs) > 1 and suspicion.explains:
            break
        if len(suspicion.pairs) > 1 or len({s.pairs for s in suspicions}) > max(most, 1):
            used, suspicions = pairs, []
            plan, height = first
            warnings = (*warnings, _all_contradict(plan, height))
            break
        used = used.without(suspicion.pairs[0], plan=suspicion.part == "plan", height=suspicion.part == "height")
        plan, height = _fits(used, map_m, middle_deg, radii, wanted)
    if len(suspicions) and used is not pairs:
        warnings = _check(used, map_m, wanted)
    return SiteCalibration(
        pairs, used, plan, height, _residuals(pairs, map_m, plan, height, radii), tuple(suspicions), warnings
    )


def _fits(
    pairs: SitePairs, map_m: FloatArray, middle_deg: FloatArray, radii: tuple[float, float], wanted: CalibrationSettings
) -> tuple[PlanFit, HeightFit | None]:
    own = pairs.in_plan
    plan = fit_plan(map_m[own], pairs.local_m[own, :2], pairs.sigma_m[own, 0], wanted.scale)
    if wanted.heights == "none":
        return plan, None
    return plan, fit_heights(pairs, middle_deg, radii, wanted.heights)


def _all_contradict(plan: PlanFit, height: HeightFit | None) -> str:
    parts = []
    for name, tested in (("plan", plan.fit), ("height", None if height is None else height.fit)):
        if tested is not None and tested.degrees_of_freedom > 0:
            factor = np.sqrt(tested.weighted_square / tested.degrees_of_freedom)
            parts.append(f"{factor:.1f} times in {name}")
    return (
        "so many pairs contradict each other that none is named: residuals are larger than the stated standard "
        f"deviations explain, {' and '.join(parts)}: check datum, units, the order of columns, and the "
        "standard deviations"
    )


def _residuals(
    pairs: SitePairs, map_m: FloatArray, plan: PlanFit, height: HeightFit | None, radii: tuple[float, float]
) -> FloatArray:
    residual = np.full((len(pairs), 3), np.nan)
    residual[:, :2] = plan.local_m(map_m) - pairs.local_m[:, :2]
    if height is not None:
        A = slopes_design(pairs.place_deg, height.middle_deg, radii)
        change = A @ np.array([height.offset_m, height.slope_north, height.slope_east])
        residual[:, 2] = pairs.height_m + change - pairs.local_m[:, 2]
    return residual


def _own_sigmas(calibration: SiteCalibration, map_m: FloatArray, radii: tuple[float, float]) -> FloatArray:
    """Return standard deviations (N, 3) of residuals of pairs that do not serve: of the fit at each, and of the pair
    itself where it states one."""
    plan, height, pairs = calibration.plan, calibration.height, calibration.pairs
    stated = np.nan_to_num(pairs.sigma_m) ** 2
    C = plan.fit.covariance
    A = _plan_design(map_m - plan.centre_m, plan.rotation_rad, plan.scale, len(C) == 4)
    variance = np.full((len(pairs), 3), np.nan)
    variance[:, :2] = np.einsum("nu,uv,nv->n", A, C, A).reshape(-1, 2) + stated[:, :1]
    if height is not None:
        A = slopes_design(pairs.place_deg, height.middle_deg, radii)[:, : len(height.fit.covariance)]
        variance[:, 2] = np.einsum("nu,uv,nv->n", A, height.fit.covariance, A) + stated[:, 1]
    return np.asarray(np.sqrt(variance))


def predictions(
    calibration: SiteCalibration, map_m: FloatArray, radii: tuple[float, float]
) -> tuple[FloatArray, FloatArray]:
    """Return predicted minus given (N, 3) of each pair as all others have it, and standard deviations of that (N, 3);
    NaN where nothing else determines it. A pair that does not serve is predicted by all that do.

    ``map_m`` (N, 2) are the pairs on the map that the similarity starts from, ``radii`` as of ``calibrate``.
    """
    used = calibration.used
    difference, sigma = calibration.residual_m.copy(), _own_sigmas(calibration, map_m, radii)
    parts = [(used.in_plan, calibration.plan.fit, slice(0, 2), 2)]
    if calibration.height is not None:
        parts.append((used.in_height, calibration.height.fit, slice(2, 3), 1))
    for serving, tested, axes, size in parts:
        for row, i in enumerate(np.flatnonzero(serving)):
            difference[i, axes], covariance = tested.left_out(np.arange(size * row, size * row + size))
            sigma[i, axes] = np.sqrt(np.diag(covariance))
    return difference, np.where(np.isnan(difference), np.nan, sigma)
