"""What report.json says of GNSS positions: how many took part and how good they are, whether flights are off together,
which lever arm was counted, and what must be known before they are believed."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.stats import chi2

from photogram.adjustment.common_errors import ResidualLeverArm
from photogram.adjustment.gnss_offsets import OffsetTest, estimated_offset_test, implied_offset_test
from photogram.arrays import FloatArray
from photogram.project.measured.measured_block import PhotographNote
from photogram.project.measured.measured_positions import position_note
from photogram.quality.asprs import AXES
from photogram.report.numbers.numbers import gnss_residual_m
from photogram.report.record.positions import (
    CommonErrorRecord,
    DatumRecord,
    FlightRecord,
    GnssRecord,
    LeverArmLeftRecord,
    LeverArmRecord,
    UnusedPositionRecord,
)
from photogram.report.values import finites
from photogram.results import Adjustment, CommonErrorEstimate
from photogram.survey import CommonErrorKind, Photograph
from photogram.wording import some, things

Notes = Sequence[PhotographNote]
"""By photograph, what the first stage has noted of it."""

BEYOND_PRIOR = 3.29
"""An offset of more prior sigmas contradicts its prior."""
LARGE_OFFSET_M = 5.0
"""An offset beyond what antennas, base stations and receivers without corrections usually make, whatever is flown: it
is for geoids and wrong bases, metres to tens of metres off. What contradicts a better prior is judged by BEYOND_PRIOR.
"""


def _flights(result: Adjustment) -> tuple[list[str], FloatArray]:
    """Return the flights with positions, and which photographs (N,) take part with theirs."""
    photographs, poses = result.block.photographs, result.block.poses
    used = np.array(
        [p.gnss_world_m is not None and pose is not None for p, pose in zip(photographs, poses, strict=True)],
        dtype=bool,
    )
    return sorted({p.flight for p, u in zip(photographs, used, strict=True) if u}), used


def _figures(values: FloatArray) -> str:
    return "(" + ", ".join(f"{v:+.3f}" for v in values) + ")"


def _sigmas(values: FloatArray) -> str:
    return "(" + ", ".join(f"{v:.3f}" for v in values) + ")"


def _p(p: float) -> str:
    return "p < 0.001" if p < 0.001 else f"p = {p:.3f}"


def _beyond(offset: FloatArray, prior: FloatArray) -> list[str]:
    """Return the axes along which an offset contradicts its prior; an axis fixed at zero cannot."""
    return [name for name, o, s in zip(AXES, offset, prior, strict=True) if s > 0 and abs(o) > BEYOND_PRIOR * s]


def _offset_sentence(flight: str, offset: FloatArray, sigma: FloatArray, prior: FloatArray, test: OffsetTest) -> str:
    """Return what an estimated offset says; all figures in m along easting, northing and height."""
    if not test.degrees:
        return (
            f"Flight {flight}: a common offset cannot be tested: only its prior determines it, control points "
            "are needed."
        )
    figures = f"off together by {_figures(offset)} ± {_sigmas(sigma)} m in easting, northing and height"
    verdict = f"(χ² = {test.chi2:.1f} with {test.degrees} degrees of freedom, {_p(test.p)})"
    if not test.significant:
        return f"Flight {flight}: the GNSS positions are not significantly {figures} {verdict}."
    beyond = _beyond(offset, prior)
    sentence = f"Flight {flight}: the GNSS positions are {figures} {verdict}"
    if beyond:
        axis = int(np.argmax(np.abs(offset) / np.where(prior > 0, prior, np.inf)))
        return (
            f"{sentence}: in {' and '.join(beyond)} that exceeds the prior, {abs(offset[axis]) / prior[axis]:.0f} "
            "times its sigma: look for another height system, base station or lever arm, or give a larger "
            "gnss.offset_sigma_m."
        )
    if np.max(np.abs(offset)) > LARGE_OFFSET_M:
        return (
            f"{sentence}: it is estimated and removed, more than an antenna explains: look for another height system "
            "(heights in the project file), a wrong base station or wrong control points."
        )
    return f"{sentence}: the base station, the lever arm or the height system; it is estimated and removed."


def _fixed_sentence(flight: str, mean: FloatArray, offset: FloatArray, sigma: FloatArray, test: OffsetTest) -> str:
    """Return what the residuals of a flight say whose offset is fixed at zero."""
    if not test.degrees:
        return (
            f"Flight {flight}: only its GNSS positions define its datum; a common offset cannot be detected "
            "without control points."
        )
    verdict = f"(χ² = {test.chi2:.1f} with 3 degrees of freedom, {_p(test.p)})"
    figures = f"{_figures(offset)} ± {_sigmas(sigma)} m in easting, northing and height"
    if not test.significant:
        return f"Flight {flight}: control and GNSS agree, an offset would be {figures} {verdict}."
    return (
        f"Flight {flight}: control and GNSS contradict each other: residuals of {_figures(mean)} m on average, and "
        f"an offset of {figures} {verdict} would be estimated: check base station, height system and lever "
        "arm, or give gnss.offset_sigma_m to estimate it."
    )


def _flight_numbers(result: Adjustment, flight: str, used: FloatArray) -> FlightRecord:
    """Return the numbers of one flight; ``used`` (N,) are the photographs whose positions took part."""
    block = result.block
    members = used & np.array([p.flight == flight for p in block.photographs], dtype=bool)
    residual = gnss_residual_m(result)[members]
    mean = residual.mean(axis=0)
    axes = block.frame.rotation_world_from_map(np.zeros(3))
    estimated = flight in result.estimates.flights
    offset, covariance = np.full(3, np.nan), np.full((3, 3), np.nan)
    if estimated:
        f = result.estimates.flights.index(flight)
        offset = axes.T @ result.estimates.offset_world_m[f]
        covariance = axes.T @ result.covariances.offset_m2[f] @ axes
        prior = np.maximum(block.gnss_offset_sigma_m, 1e-6)
        test = estimated_offset_test(offset, covariance, prior)
        sentence = _offset_sentence(flight, offset, np.sqrt(np.diag(covariance)), block.gnss_offset_sigma_m, test)
    else:
        if flight in result.decisions.flights_without_offset:
            f = result.decisions.flights_without_offset.index(flight)
            offset = axes.T @ result.tests.implied_offset_world_m[f]
            covariance = axes.T @ result.tests.implied_offset_covariance_m2[f] @ axes
        test = implied_offset_test(offset, covariance)
        sentence = _fixed_sentence(flight, mean, offset, np.sqrt(np.diag(covariance)), test)
    known = bool(test.degrees)
    return {
        "n": int(members.sum()),
        "estimated": estimated,
        "offset_m": offset.tolist() if estimated or known else None,
        "sigma_m": np.sqrt(np.diag(covariance)).tolist() if estimated or known else None,
        "chi2": test.chi2 if known else None,
        "degrees_of_freedom": test.degrees,
        "p": test.p if known else None,
        "p_axes": finites(test.p_axes),
        "significant": test.significant if known else None,
        "beyond_prior": estimated and bool(_beyond(offset, block.gnss_offset_sigma_m)),
        "mean_residual_m": mean.tolist(),
        "rms_residual_m": np.sqrt(np.mean(residual**2, axis=0)).tolist(),
        "sentence": sentence,
    }


def _not_used(photographs: Sequence[Photograph], used: FloatArray, notes: Notes) -> list[UnusedPositionRecord]:
    """Return the photographs without a part of their own in GNSS, and why."""
    missing = list[UnusedPositionRecord]()
    for photograph, takes_part, note in zip(photographs, used, notes, strict=True):
        if takes_part:
            continue
        if note.get("copy_of"):
            reason = f"the same photograph as {note['copy_of']}"
        elif note.get("gnss_frozen"):
            reason = "the receiver had stopped updating, or is slower than the camera: a position of another time"
        elif photograph.gnss_world_m is None and note.get("gnss_map_m") is not None:
            reason = "rejected: it contradicts all other observations"
        elif photograph.gnss_world_m is None:
            reason = "no position in the project, in a position file or in its tags"
        else:
            reason = f"not oriented, so its position ({note.get('gnss_source', 'project')}) is not used"
        missing.append({"photograph": photograph.name, "reason": reason})
    return missing


def _arms(photographs: Sequence[Photograph], used: FloatArray, notes: Notes) -> dict[str, LeverArmRecord] | None:
    """Return by flight how many positions were brought to the camera by a lever arm, and how."""
    arms: dict[str, list[tuple[Literal["world", "camera"], float]]] = {}
    for photograph, takes_part, note in zip(photographs, used, notes, strict=True):
        kept = arms.setdefault(photograph.flight, [])
        enu_m, camera_m = note.get("lever_arm_enu_m"), note.get("lever_arm_camera_m")
        if takes_part and enu_m is not None:
            kept.append(("world", float(np.linalg.norm(enu_m))))
        if takes_part and camera_m is not None:
            kept.append(("camera", float(np.linalg.norm(camera_m))))
    counted: dict[str, LeverArmRecord] = {
        flight: {
            "n": len(kept),
            "axes": Counter(axes for axes, _ in kept).most_common(1)[0][0],
            "length_m": float(np.mean([length_m for _, length_m in kept])),
        }
        for flight, kept in arms.items()
        if kept
    }
    return counted or None


def _left_arm(result: Adjustment) -> tuple[LeverArmLeftRecord | None, str]:
    """Return the lever arm that the positions show beside the one that is counted, and the warning it deserves."""
    tests = result.tests
    arm = ResidualLeverArm(tests.residual_lever_arm_m, tests.residual_lever_arm_sigma_m, tests.residual_lever_arm_p)
    if not np.isfinite(arm.p):
        return None, ""
    body, spread = _in_body(arm.arm_camera_m, arm.sigma_m)
    numbers: LeverArmLeftRecord = {
        "forward_right_down_m": finites(body),
        "sigma_m": finites(spread),
        "p": arm.p,
        "significant": arm.significant,
    }
    if not arm.significant:
        return numbers, ""
    if any(common.error.kind == "lever_arm" for common in result.decisions.common_errors):
        return numbers, (
            f"Beside the lever arm that is estimated and removed, {_arm_words(body, spread)} (nadir view; {_p(arm.p)}) "
            "are left, which differ between flights or cameras: give each its own gnss.lever_arm_m."
        )
    return numbers, (
        f"The GNSS positions have errors that rotate with the camera ({_p(arm.p)}): a lever arm from "
        f"antenna to camera of {_arm_words(body, spread)} (nadir view) is not applied: give gnss.lever_arm_m, or "
        "correct it."
    )


def _in_body(arm_camera_m: FloatArray, sigma_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return a lever arm (3,) along the camera's axes of a nadir view, and its sigmas, as forward, right, down."""
    right, backward, down = arm_camera_m
    return np.array([-backward, right, down]), sigma_m[[1, 0, 2]]


def _arm_words(body_m: FloatArray, sigma_m: FloatArray) -> str:
    return ", ".join(
        f"{x:+.3f} ± {s:.3f} m {name}"
        for name, x, s in zip(("forward", "right", "down"), body_m, sigma_m, strict=True)
        if np.isfinite(x)
    )


_UNITS: dict[CommonErrorKind, tuple[Literal["deg", "m", "s"], float]] = {
    "attitude": ("deg", float(np.degrees(1.0))),
    "lever_arm": ("m", 1.0),
    "time_offset": ("s", 1.0),
    "drift": ("m", 1.0),
}


@dataclass(frozen=True)
class _ShownTest:
    """Statistic, degrees of freedom and p of an error against zero."""

    chi2: float
    degrees: int
    p: float


def _shown_test(common: CommonErrorEstimate) -> _ShownTest:
    """Return the test of an error with the sigmas that are shown beside it, which count what was held.

    The decision to estimate it was tested without that (``adjustment.decisions``). Attitudes keep that test: their
    sigmas have the prior's part.
    """
    known = np.isfinite(common.estimate)
    if common.error.kind == "attitude" or not common.degrees or not known.any():
        return _ShownTest(common.chi2, common.degrees, common.p)
    variance, U = np.linalg.eigh(common.covariance[np.ix_(known, known)])
    told = variance > 1e-9 * variance.max()
    statistic = float(np.sum((U[:, told].T @ common.estimate[known]) ** 2 / variance[told]))
    return _ShownTest(statistic, int(told.sum()), float(chi2.sf(statistic, told.sum())))


def _common_sentence(common: CommonErrorEstimate, camera: str) -> str:
    """Return what an estimated common error says; ``camera`` is its name where there are several."""
    error, p = common.error, _p(_shown_test(common).p)
    estimate, sigma = common.estimate, np.sqrt(np.diag(common.covariance))
    whose = (f" of flight {error.flight}" if error.flight is not None else "") + camera
    if error.kind == "attitude":
        figures = ", ".join(f"{np.degrees(v):+.2f} ± {np.degrees(s):.2f}" for v, s in zip(estimate, sigma, strict=True))
        off = f"off together by {figures}° about the camera's x, y and z axes"
        if not common.degrees:
            return f"Whether the measured attitudes{whose} are off together is not determined."
        if not common.significant:
            return f"The measured attitudes{whose} are not significantly {off} ({p})."
        return f"The measured attitudes{whose} are {off} ({p}): compass or boresight; it is estimated and removed."
    if error.kind == "lever_arm":
        words = _arm_words(*_in_body(estimate, sigma))
        text = f"The GNSS positions{camera} show a lever arm from antenna to camera of {words} (nadir view; {p})"
    elif error.kind == "time_offset":
        later = "after" if estimate[0] > 0 else "before"
        text = (
            f"The photographs{camera} are exposed {1000.0 * abs(estimate[0]):.0f} ± {1000.0 * sigma[0]:.0f} ms {later} "
            f"the epochs of their GNSS positions ({p})"
        )
    else:
        text = (
            f"The GNSS positions{whose} drift by {_figures(estimate)} ± {_sigmas(sigma)} m in easting, northing and "
            f"height over the flight ({p})"
        )
    also = (
        f"; {common.as_well} explains them nearly as well: the two are held together as one" if common.as_well else ""
    )
    return f"{text}: estimated and removed{also}."


def common_error_numbers(result: Adjustment) -> list[CommonErrorRecord]:
    """Return the common errors that were estimated, beside the offsets of flights."""
    block, numbers = result.block, list[CommonErrorRecord]()
    for common in result.decisions.common_errors:
        if common.error.kind == "known_surface":  # it is no error of positions
            continue
        unit, factor = _UNITS[common.error.kind]
        name = None if common.error.camera is None else block.cameras[common.error.camera].name
        sigma = np.sqrt(np.diag(common.covariance))
        known, shown = bool(common.degrees), _shown_test(common)
        numbers.append(
            {
                "kind": common.error.kind,
                "flight": common.error.flight,
                "camera": name,
                "photographs": common.photographs,
                "unit": unit,
                "estimate": finites(factor * common.estimate),
                "sigma": finites(factor * sigma),
                "chi2": shown.chi2 if known else None,
                "degrees_of_freedom": shown.degrees,
                "p": shown.p if known else None,
                "significant": common.significant if known else None,
                "as_well": common.as_well,
                "sentence": _common_sentence(common, f" of {name}" if name and len(block.cameras) > 1 else ""),
            }
        )
    return numbers


def _least(sigmas_m: Sequence[Sequence[float]]) -> str:
    """Return the smallest of standard deviations (n, 3) along each axis, in words."""
    return ", ".join(f"{s:.3g}" for s in np.min(sigmas_m, axis=0))


def _warnings(notes: Notes, used: FloatArray) -> list[str]:
    """Return what the sources of the positions give reason to warn of."""
    taken = [note for note, u in zip(notes, used, strict=True) if u]
    warnings = []
    for solution, one in (("float", "float solution"), ("single", "single (autonomous) solution")):
        claimed = [
            (n["name"], stated, believed)
            for n in taken
            if n.get("gnss_solution") == solution
            and (stated := n.get("gnss_stated_sigma_m")) is not None
            and (believed := n["gnss_sigma_m"]) is not None
        ]
        if claimed:
            names = [name for name, _, _ in claimed]
            stated_m, believed_m = _least([s for _, s, _ in claimed]), _least([b for _, _, b in claimed])
            several = one.replace("solution", "solutions", 1)
            warnings.append(
                f"{things(len(claimed), one, several)} ({some(names)}) stated with "
                f"{stated_m} m, weighted with {believed_m} m or more: centimetres need fixed ambiguities."
            )
    without = [n["name"] for n in taken if n.get("gnss_lacks_lever_arm")]
    if without:
        warnings.append(
            f"{things(len(without), 'position')} ({some(without)}) of the antenna, and no lever arm to the camera: "
            "give lever_arms: FILE.MRK with the file, or gnss.lever_arm_m."
        )
    frozen = [n["name"] for n in notes if n.get("gnss_frozen")]
    if frozen:
        warnings.append(
            f"{things(len(frozen), 'photograph')} ({some(frozen)}) with the GNSS position of another time: "
            "the receiver had stopped updating, or is slower than the camera; these positions were not used."
        )
    sources = Counter(n.get("gnss_source") for n in taken)
    if len(sources) > 1 and "tags" in sources:
        left = [n["name"] for n in taken if n.get("gnss_source") == "tags"]
        if any(s not in ("tags", "project") for s in sources):
            warnings.append(
                f"{things(len(left), 'photograph')} ({some(left)}) in no position file: the position in the "
                "tags was used."
            )
    return warnings


def _large(offset_m: Sequence[float | None] | None) -> bool:
    return any(o is not None and abs(o) > LARGE_OFFSET_M for o in offset_m or ())


def _unknown(name: str) -> PhotographNote:
    """Return the note of a photograph of which nothing is known but its name."""
    return {
        "name": name,
        **position_note(None),
        "height_is_ellipsoidal": None,
        "attitude_deg": None,
        "time": None,
        "velocity_m_s": None,
        "capture": None,
        "height_above_ground_m": None,
    }


def _datum(sigma_m: float) -> DatumRecord | None:
    """Return what is accepted of the way into the datum of the map, None where nothing is."""
    if sigma_m == 0.0:
        return None
    return {
        "sigma_m": sigma_m,
        "sentence": (
            f"The GNSS positions come from another datum than that of the map: an error of {sigma_m:g} m (1 sigma) in "
            "easting and northing, common to all of them, is accepted (datum_accuracy_m) and counted in all predicted "
            "standard deviations."
        ),
    }


def gnss_numbers(result: Adjustment, notes: Notes = ()) -> GnssRecord:
    """Return ``gnss`` of report.json; ``notes`` are those of the photographs, in their order, or none."""
    photographs = result.block.photographs
    notes = notes or [_unknown(p.name) for p in photographs]
    names, used = _flights(result)
    flights = {flight: _flight_numbers(result, flight, used) for flight in names}
    arm, arm_warning = _left_arm(result)
    solutions = Counter(
        str(note.get("gnss_solution", "unknown")) for note, takes_part in zip(notes, used, strict=True) if takes_part
    )
    control = sum(role == "control" for role in result.block.control_points.role)
    lost = _not_used(photographs, used, notes)
    sentence = (
        f"{things(int(used.sum()), 'GNSS position')} and {things(control, 'control point')} were adjusted together"
    )
    sentence += f"; {things(len(lost), 'photograph')} without a position." if lost else "."
    doubtful = [
        f["sentence"]
        for f in flights.values()
        if f["significant"] and (f["beyond_prior"] or not f["estimated"] or _large(f["offset_m"]))
    ]
    return {
        "sentence": sentence,
        "positions_used": int(used.sum()),
        "control_points_used": control,
        "flights": flights,
        "solutions": {kind: solutions[kind] for kind in ("fix", "float", "single", "unknown")},
        "sources": dict(Counter(str(n.get("gnss_source", "project")) for n, u in zip(notes, used, strict=True) if u)),
        "lever_arm_m": _arms(photographs, used, notes),
        "lever_arm_left": arm,
        "datum": _datum(result.block.datum_sigma_m),
        "common_errors": common_error_numbers(result),
        "not_used": lost,
        "warnings": doubtful + ([arm_warning] if arm_warning else []) + _warnings(notes, used),
    }
