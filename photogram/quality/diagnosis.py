"""What a finished block is weak in: dome, focal length against height, principal point against tilt; what would help.

Measured, from points that took no part (check points, and control points as all other observations predict them), and
predicted, from the covariance of the block as a whole: the first shows what happened, the second what may happen
unseen.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components
from scipy.stats import t as student

from photogram.adjustment.solvability import POSITION_WEAK
from photogram.arrays import FloatArray
from photogram.camera import Camera
from photogram.projection import CAMERA_PARAMETERS, PARAMETERS
from photogram.quality.datum_precision import DatumPrecision, datum_precision, datum_sentence
from photogram.quality.deformation import CENTRES, DOME, GROUND, SLOPES, offset_of, parameters_of, rotations_of
from photogram.quality.prediction_test import checked_axes
from photogram.quality.residual_patterns import ResidualPattern, residual_patterns
from photogram.results import Adjustment, Deformation, LensFieldDecision
from photogram.wording import things

STRONG = 0.95  # correlation beyond which two quantities are not separable in practice
HALF = 0.7  # correlation beyond which half of the variance of a quantity comes with another
FEWEST, FEWEST_WITH_TILT = 4, 7  # points from which a dome is fitted, and fitted beside a tilt
SIGNIFICANCE = 0.001
UNDETERMINED = 0.7  # posterior over prior sigma, above which the photographs hardly determine a parameter
HELPS = 0.95  # of a sigma, to which a remedy must bring it to be of use
HIDDEN_TIMES = 1.1  # the sigma of heights, beyond which the effect of a fixed calibration is reported

REMEDIES: Mapping[str, str] = MappingProxyType(
    {
        "control_in_the_middle": "One control point in the middle of the block",
        "control_in_corners_and_middle": "Control points in the corners and the middle of the block",
        "oblique_strip": "One strip along the block with the camera tilted by 25°",
        "higher_cross_strip": "One strip across the block, 1.3 times as high",
        "rtk": "RTK instead of these GNSS positions",
    }
)


@dataclass(frozen=True)
class Dome:
    """A quadratic trend of height errors with the distance from the block's centre; NaN with too few points."""

    radius_m: float
    """Distance for which it is stated."""
    measured_m: float
    """Height error at this distance relative to the centre."""
    sigma_m: float
    """Its standard deviation."""
    significant: bool
    """Whether it is significant."""
    predicted_sigma_m: float
    """Its a-priori standard deviation."""
    points: int
    """Number of points."""
    control_points: int
    """Control points among them, predicted by all other observations."""


@dataclass(frozen=True)
class Remedy:
    """A change that was tried by covariance: sigmas in height before and after, in the middle of the block for a point
    there, else as root mean square over the block; and of the dome, all by the stated sigmas alone, without what held
    parameters and a pattern in residuals may add, which the block's own sigma of the dome includes."""

    what: str
    sigma_height_before_m: float
    sigma_height_after_m: float
    sigma_dome_before_m: float
    sigma_dome_after_m: float

    @property
    def title(self) -> str:
        """Return what would be done."""
        return REMEDIES[self.what]

    @property
    def helps(self) -> bool:
        """Return whether heights or dome become noticeably better known by it."""
        heights = self.sigma_height_after_m < HELPS * self.sigma_height_before_m
        return heights or self.sigma_dome_after_m < HELPS * self.sigma_dome_before_m

    @property
    def sentence(self) -> str:
        """Return what there is to say of it."""
        where = "there" if self.what == "control_in_the_middle" else "over the block"
        return (
            f"{self.title}: sigma of the heights {where} {self.sigma_height_before_m:.3f} m now, "
            f"{self.sigma_height_after_m:.3f} m with it; of the dome, by the stated sigmas alone, "
            f"{self.sigma_dome_before_m:.3f} m now, {self.sigma_dome_after_m:.3f} m with it"
        )


@dataclass(frozen=True, eq=False)
class FocalHeight:
    """Correlations of a camera's focal length with the block's heights, NaN where it is fixed: of the projection
    centres, of the ground, and of the GNSS offset by flight; ``height_sigma_m`` is the part of the ground's mean height
    that goes with the focal length."""

    centres: float
    ground: float
    offset: Mapping[str, float]
    height_sigma_m: float


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """Diagnosis of a block as a whole, lengths in m; ``correlation`` (12, 12) by camera, NaN for fixed parameters."""

    correlation: Mapping[str, FloatArray]
    focal_height: Mapping[str, FocalHeight]
    patterns: Mapping[str, ResidualPattern]
    dome: Dome
    datum_precision: DatumPrecision | None
    warnings: tuple[str, ...]
    remedies: tuple[Remedy, ...]
    undetermined: tuple[str, ...]

    def __repr__(self) -> str:
        counts = f"{things(len(self.warnings), 'warning')}, {things(len(self.remedies), 'remedy', 'remedies')}"
        dome = f"{self.dome.measured_m:+.4f} ± {self.dome.sigma_m:.4f} m"
        return f"<Diagnosis: {counts}, dome {dome}>"


def correlations(covariance: FloatArray) -> FloatArray:
    """Return the correlation matrix of a covariance, NaN where a variance is zero."""
    sigma = np.sqrt(np.diag(covariance))
    sigma = np.where(sigma > 0, sigma, np.nan)
    return np.asarray(covariance / np.outer(sigma, sigma))


def height_differences_m(result: Adjustment) -> tuple[FloatArray, FloatArray, FloatArray, int]:
    """Return places (n, 2) in the world, predicted − surveyed heights (n,) and their sigmas (n,) of points that took no
    part: check points first, then control points as all other observations predict them, and how many these are."""
    points, frame = result.block.control_points, result.block.frame
    check = np.flatnonzero(checked_axes(points)[:, 2] & np.isfinite(result.estimates.ground_world_m).all(axis=1))
    left = np.flatnonzero(np.isfinite(result.tests.reliability.ground_left_out_m[:, 2]))
    adjusted = frame.map_from_world(result.estimates.ground_world_m[check])
    surveyed = frame.map_from_world(points.position_world_m[check])
    own = np.hypot(np.sqrt(result.covariances.ground_m2[check, 2, 2]), points.sigma_m[check, 2])
    difference = np.concatenate([(adjusted - surveyed)[:, 2], result.tests.reliability.ground_left_out_m[left, 2]])
    sigma = np.concatenate([own, np.sqrt(result.tests.reliability.ground_left_out_covariance_m2[left, 2, 2])])
    chosen = np.concatenate([check, left])
    return result.estimates.ground_world_m[chosen, :2], difference, sigma, len(left)


def fitted_dome(
    place: FloatArray, difference_m: FloatArray, sigma_m: FloatArray, centre: FloatArray, radius_m: float
) -> tuple[float, float, bool]:
    """Return the dome of height differences (n,) at places (n, 2), its sigma, and whether it is significant.

    Weighted least squares of a + d ρ², and of a tilt besides with FEWEST_WITH_TILT points; the scatter around the fit
    gives the sigma, so that what all points have in common does not count as noise, and Student's t the limit. NaN
    where the points are too few or too much alike in their distance.
    """
    offset = (place - centre) / radius_m
    square = np.sum(offset**2, axis=1)
    n = len(place)
    if n < FEWEST:
        return float("nan"), float("nan"), False
    columns = [np.ones(n), square]
    if n >= FEWEST_WITH_TILT:
        columns += [offset[:, 0], offset[:, 1]]
    A, y = np.column_stack(columns) / sigma_m[:, None], difference_m / sigma_m
    if np.linalg.cond(A * sigma_m.min()) > 1e3:
        return float("nan"), float("nan"), False
    solution = np.linalg.lstsq(A, y, rcond=None)[0]
    freedom = n - A.shape[1]
    variance = float(np.sum((y - A @ solution) ** 2)) / freedom
    sigma = float(np.sqrt(variance * np.linalg.inv(A.T @ A)[1, 1]))
    dome = float(solution[1])
    return dome, sigma, bool(abs(dome) > student.isf(SIGNIFICANCE / 2, freedom) * sigma)


def _dome(result: Adjustment) -> Dome:
    known = result.covariances.deformation
    place, difference, sigma, left = height_differences_m(result)
    predicted = float(np.sqrt(known.covariance[DOME, DOME])) if known.known else float("nan")
    measured = float("nan")
    spread = float("nan")
    significant = False
    if known.known and len(place):
        measured, spread, significant = fitted_dome(place, difference, sigma, known.centre_world_m, known.radius_m)
    return Dome(known.radius_m, measured, spread, significant, predicted, len(place), left)


def _focal_height(known: Deformation, camera: int, cameras: int, flights: Sequence[str]) -> FocalHeight:
    correlation = correlations(known.covariance)
    f = parameters_of(camera, cameras).start
    ground = float(correlation[f, GROUND.stop - 1])
    part = abs(ground) * float(np.sqrt(known.covariance[GROUND.stop - 1, GROUND.stop - 1]))
    offset = {name: float(correlation[f, offset_of(i, cameras).stop - 1]) for i, name in enumerate(flights)}
    return FocalHeight(float(correlation[f, CENTRES.stop - 1]), ground, offset, part)


def focal_heights(known: Deformation, cameras: Sequence[Camera], flights: Sequence[str]) -> dict[str, FocalHeight]:
    """Return the correlation of each camera's focal length with heights; none where unknown."""
    if not known.known:
        return {}
    return {camera.name: _focal_height(known, c, len(cameras), flights) for c, camera in enumerate(cameras)}


def weaknesses(known: Deformation, cameras: Sequence[Camera], flights: Sequence[str]) -> list[str]:
    """Return a sentence for each weakness of a block's geometry that costs more than the precision of its tie
    points."""
    if not known.known:
        return []
    sentences, precise = [], float(known.intersection_sigma_m[2])
    for name, focal in focal_heights(known, cameras, flights).items():
        strongest = max(
            (abs(r) for r in (focal.centres, focal.ground, *focal.offset.values()) if np.isfinite(r)), default=0.0
        )
        if strongest > HALF and focal.height_sigma_m > precise:
            separable = "cannot be separated" if strongest > STRONG else "are hardly separable"
            sentences.append(
                f"The focal length of {name} and the height of the block {separable} (correlation "
                f"{strongest:.3f}): {focal.height_sigma_m:.3f} m of uncertainty in all heights results from "
                f"it, against {precise:.3f} m of intersection alone"
            )
    dome = float(np.sqrt(known.covariance[DOME, DOME]))
    if dome > precise:
        sentences.append(
            f"The block may have a dome of {dome:.3f} m (1 sigma, over {known.radius_m:.0f} m from its centre) "
            f"without any measurement showing it, while tie points are intersected to {precise:.3f} m"
        )
    placed = datum_sentence(known)
    if placed is not None:
        sentences.append(placed)
    correlation = correlations(known.covariance)
    for c, camera in enumerate(cameras):
        at, turn = parameters_of(c, len(cameras)), rotations_of(c)
        # a shift of the principal point in x is a rotation about y, and the reverse
        for name, row, column, axis in (("x", at.start + 1, turn.start + 1, 0), ("y", at.start + 2, turn.start, 1)):
            r = abs(float(correlation[row, column]))
            plan = max(abs(float(correlation[row, k])) * np.sqrt(known.covariance[k, k]) for k in (0, 1))
            if r > STRONG and plan > known.intersection_sigma_m[axis]:
                sentences.append(
                    f"The principal point of {camera.name} in {name} and the tilt of the photographs cannot "
                    f"be separated (correlation {r:.3f}): {plan:.3f} m of uncertainty in plan results from it"
                )
    return sentences


def hidden(known: Deformation) -> list[str]:
    """Return a sentence where fixed parameters hide more uncertainty of heights than intersection has."""
    freed, precise = known.freed_height_sigma_m, float(known.intersection_sigma_m[2])
    if not np.isfinite(freed).all() or not len(known.height_sigma_m):
        return []
    now, then = float(np.sqrt(np.mean(known.height_sigma_m**2))), float(freed[1])
    if not (then**2 - now**2 > precise**2 and then > HIDDEN_TIMES * now):
        return []
    return [
        "Calibration parameters are fixed, so no sigma includes them: with the uncertainty of an ordinary "
        f"calibration, heights over the block would be known to {then:.3f} m instead of {now:.3f} m, "
        f"and the dome to {freed[2]:.3f} m"
    ]


def unmodelled(
    patterns: Mapping[str, ResidualPattern], known: Deformation, fields: Sequence[LensFieldDecision]
) -> list[str]:
    """Return a sentence for each camera whose residuals show that its model leaves something out; ``fields`` say why it
    has no lens field."""
    without = {field.camera: f"; no lens field is estimated: {field.why}" for field in fields if field.why}
    slopes, dome = known.pattern_sigma_m[:2], float(known.pattern_sigma_m[2])
    effect = (
        f"what the block may follow of it tilts it by {slopes.max():.3f} m and domes it by {dome:.3f} m (1 sigma, over "
        f"{known.radius_m:.0f} m from its centre), which the predicted sigmas of heights include"
        if np.isfinite(dome)
        else "no predicted sigma includes its effect on heights"
    )
    return [
        f"Residuals in {name} share a pattern of {pattern.pattern_px:.2g} px (RMS; of their "
        f"{pattern.residual_px:.2g} px): the camera model is incomplete: an in-camera correction or a rolling "
        f"shutter, for example; {effect}{without.get(name, '')}"
        for name, pattern in patterns.items()
        if pattern.significant
    ]


def _names(cameras: Sequence[Camera], flights: Sequence[str]) -> list[str]:
    many = len(cameras) > 1
    names = [p.words + (f" of {camera.name}" if many else "") for camera in cameras for p in CAMERA_PARAMETERS]
    for flight in flights:
        of = f" of flight {flight}" if len(flights) > 1 else ""
        names += [f"GNSS offset in {axis}{of}" for axis in ("easting", "northing", "height")]
    return names


def _units(cameras: Sequence[Camera], flights: Sequence[str]) -> list[str]:
    """Return the units of the parameters in the order of their names, each with a space before it."""
    return [f" {p.unit}" if p.unit else "" for _ in cameras for p in CAMERA_PARAMETERS] + [" m"] * (3 * len(flights))


def undetermined(
    known: Deformation, cameras: Sequence[Camera], flights: Sequence[str], offset_sigma_m: FloatArray
) -> list[str]:
    """Return in words what the measurements do not determine: parameters that are hardly better known than before, what
    was held, and quantities that are correlated (|r| beyond STRONG)."""
    if not known.known:
        return []
    prior = np.concatenate([*(c.sigmas for c in cameras), np.tile(offset_sigma_m, len(flights))])
    start = parameters_of(0, len(cameras)).start
    names, units = _names(cameras, flights), _units(cameras, flights)
    sigma = np.sqrt(np.diag(known.covariance))
    sigma_share = np.divide(sigma[start:], prior, out=np.zeros_like(prior), where=np.isfinite(prior) & (prior > 0))
    weak = [
        f"{names[k]} (± {sigma[start + k]:.3g}{units[k]}; stated ± {prior[k]:.3g}{units[k]})"
        for k in np.flatnonzero(sigma_share > UNDETERMINED)
    ]
    sentences = [f"hardly determined by the observations, so the stated values remain: {', '.join(weak)}"] * bool(weak)
    freed, after = known.freed_prior.copy(), known.freed_sigma.ravel()
    # a focal length that was settled is uncertain in every figure: nothing is hidden by it
    freed[[c for c, camera in enumerate(cameras) if camera.considered_focal_sigma_px > 0], 0] = 0.0
    freed = freed.ravel()
    if freed.any():
        undetermined_names = [
            f"{names[k]} (to {after[k]:.3g}{units[k]})"
            for k in np.flatnonzero(freed)
            if after[k] > UNDETERMINED * freed[k]
        ]
        sentences.append(
            f"fixed at the given values, which nothing tests: {', '.join(names[k] for k in np.flatnonzero(freed))}; "
            + (
                f"if released, the photographs would hardly determine {', '.join(undetermined_names)}"
                if undetermined_names
                else "if released, the photographs would determine them"
            )
        )
    words, size = {start + k: name for k, name in enumerate(names)}, f"over {known.radius_m:.0f} m"
    words |= {SLOPES.start + k: f"tilt of the block to the {way} {size}" for k, way in enumerate(("east", "north"))}
    words[DOME] = f"dome of the block {size}"
    for k, axis in enumerate(("easting", "northing", "height")):
        words[GROUND.start + k] = f"{axis} of the ground"
        words[CENTRES.start + k] = f"{axis} of the projection centres"
    return sentences + [
        f"correlated (r = {r:.2f}) and not separable: "
        + ", ".join(f"{words[k]} (± {sigma[k]:.3g}{' m' if k < start else units[k - start]})" for k in group)
        for group, r in _groups(known, words, start, cameras)
    ]


def _groups(
    known: Deformation, words: Mapping[int, str], start: int, cameras: Sequence[Camera]
) -> list[tuple[list[int], float]]:
    """Return the groups of quantities that hang together by correlations beyond STRONG, with the largest in each.

    Left out: radial terms among themselves, which are always alike and harmless together, and a projection centre with
    the GNSS offset of its axis alone, which is what an unknown offset means.
    """
    index = np.array(sorted(words))
    correlation = np.nan_to_num(correlations(known.covariance)[np.ix_(index, index)])
    strong = np.abs(correlation) > STRONG
    count, label = connected_components(csr_array(strong), directed=False)
    lens = range(start, start + PARAMETERS * len(cameras))
    groups = []
    radial = {k for k in lens if CAMERA_PARAMETERS[(k - start) % PARAMETERS].key == "radial"}
    placed = {*range(CENTRES.start, CENTRES.stop), *range(lens.stop, len(known.covariance))}
    for group in range(count):
        members = np.flatnonzero(label == group)
        quantities = set(index[members].tolist())
        if len(quantities) > 1 and not quantities <= radial and not quantities <= placed:
            among = np.abs(correlation[np.ix_(members, members)])
            groups.append((sorted(quantities), float(among[~np.eye(len(members), dtype=bool)].max())))
    return groups


def remedies_of(known: Deformation) -> list[Remedy]:
    """Return what was tried, what helps most first."""
    made = []
    for name, (before, after) in zip(known.remedy.tolist(), known.remedy_sigma_m.tolist(), strict=True):
        where = 0 if name == "control_in_the_middle" else 1
        made.append((after[1], Remedy(name, before[where], after[where], before[2], after[2])))
    return [remedy for _, remedy in sorted(made, key=lambda pair: pair[0])]


def diagnose(result: Adjustment) -> Diagnosis:
    """Return what an adjusted block is weak in, and what would help: the calibration against heights, doming, what its
    measurements leave open.

    Remedies, and what is undetermined, follow from ``result.deformation``: the stage `adjustment` fills it; for another
    block ``quality.improvements.block_deformation`` does, without it nothing is said of them. Changes no estimate.
    """
    known, block = result.covariances.deformation, result.block
    dome, patterns = _dome(result), residual_patterns(result)
    if block.is_free:  # heights, shifts and tilts of a block without a datum mean nothing
        return Diagnosis(
            {c.name: correlations(result.covariances.calibration[i]) for i, c in enumerate(block.cameras)},
            {},
            patterns,
            dome,
            None,
            (*result.warnings, *unmodelled(patterns, known, result.decisions.lens_fields)),
            (),
            (),
        )
    weak = weaknesses(known, block.cameras, result.estimates.flights)
    placed = datum_sentence(known)
    warnings = (
        [w for w in result.warnings if placed is None or not w.startswith(POSITION_WEAK)]
        + hidden(known)
        + weak
        + unmodelled(patterns, known, result.decisions.lens_fields)
    )
    if dome.significant:
        warnings.append(
            "Height differences of check and tie points grow with the distance from the centre: "
            f"{dome.measured_m:+.3f} m ± "
            f"{dome.sigma_m:.3f} m at {dome.radius_m:.0f} m, from {dome.points} points; "
            f"{dome.predicted_sigma_m:.3f} m (1 sigma) were predicted"
        )
    return Diagnosis(
        {c.name: correlations(result.covariances.calibration[i]) for i, c in enumerate(block.cameras)},
        focal_heights(known, block.cameras, result.estimates.flights),
        patterns,
        dome,
        datum_precision(known),
        tuple(warnings),
        tuple(remedies_of(known)),
        tuple(undetermined(known, block.cameras, result.estimates.flights, block.gnss_offset_sigma_m)),
    )
