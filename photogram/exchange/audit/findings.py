"""What an audit found, in sentences: what is wrong with the other program's result, and what its figures leave out."""

import numpy as np

from photogram.exchange.audit.audit import Audit
from photogram.projection import CAMERA_PARAMETERS, CameraParameter
from photogram.quality.prediction_test import leave_one_out, predicted_against_achieved
from photogram.wording import some, things

SIGNIFICANT = 3.29
"""Standard deviations that chance alone exceeds once in a thousand times."""

UNLIKE = 1.2
"""Ratio from which an assumed and an estimated standard deviation are said to differ."""
MOST_NAMED = 5

_OF_TIES = ("key_points", "transferred")


def contradictions(audit: Audit) -> tuple[str, ...]:
    """Return what contradicts the rest of the measurements, or the result that was made of them, the gravest first."""
    sentences = [blunder.sentence for blunder in audit.ours.blunders]
    tested = predicted_against_achieved(audit.ours.result)
    sentences += [_capital(suspect.sentence) for suspect in (tested.suspects if tested else ())]
    sentences += _calibration(audit)
    bend = audit.bend
    if bend is not None and abs(bend.dome_m) > SIGNIFICANT * bend.sigma_m:
        sentences.append(
            f"The block is bent: their heights at its edge lie {bend.dome_m:+.3f} m over its middle beside ours, "
            f"{abs(bend.dome_m) / bend.sigma_m:.1f} standard deviations of the dome that their own measurements leave"
        )
    far = [p for p in audit.poses if p.sigmas > SIGNIFICANT]
    if far:
        worst = sorted(far, key=lambda p: -p.sigmas)
        names = some([f"{p.photograph} ({p.sigmas:.1f})" for p in worst], MOST_NAMED)
        sentences.append(
            f"{things(len(far), 'exterior orientation')} of {len(audit.poses)} differ from ours by more than "
            f"{SIGNIFICANT} standard deviations: {names}"
        )
    return tuple(sentences)


def _calibration(audit: Audit) -> list[str]:
    sentences = []
    for camera, off, sigmas in zip(audit.solution.cameras, audit.parameters, audit.parameter_sigmas, strict=True):
        for k in np.flatnonzero(np.abs(np.nan_to_num(sigmas)) > SIGNIFICANT).tolist():
            p = CAMERA_PARAMETERS[k]
            unit = f" {p.unit}" if p.unit else ""
            theirs = float(camera.parameters[k])
            given = f"theirs is {theirs:.{p.digits}f}{unit}" if theirs else "their model does without"
            sentences.append(
                f"{_begun(p)} of camera {camera.name}: {given}, their own measurements give "
                f"{theirs - off[k]:.{p.digits}f}{unit}, {abs(sigmas[k]):.1f} sigma away"
            )
    return sentences


def _begun(parameter: CameraParameter) -> str:
    """Return a parameter as a sentence begins with it: k1 stays k1."""
    words = parameter.words
    return words if words == parameter.name else _capital(words)


def _capital(words: str) -> str:
    return words[:1].upper() + words[1:]


def left_out(audit: Audit) -> tuple[str, ...]:
    """Return what the program's figures do not say and the measurements tell."""
    sentences = [sentence.removesuffix(".") for sentence in audit.solution.left_out]
    for other in audit.solutions[1:]:
        sentences += [f"Of {other.program}: {sentence.removesuffix('.')}" for sentence in other.left_out]
    result = audit.ours.result
    sigma = np.sqrt(np.einsum("nkk->nk", result.covariances.position_m2))
    known = np.isfinite(sigma).all(axis=1)
    unit = "m" if result.block.has_scale else "units"
    if known.any():
        middle = np.median(sigma[known], axis=0)
        sentences.append(
            f"How well the projection centres are known: {middle[0]:.3g}, {middle[1]:.3g} {unit} in plan and "
            f"{middle[2]:.3g} {unit} in height (medians of predicted standard deviations)"
        )
    control, check = audit.theirs.control, audit.theirs.check
    if control.n and not check.n:
        sentences.append(
            f"Accuracy: {things(control.n, 'control point')} were fitted; their RMSE, {control.rmse_h_m:.3f} m in "
            f"plan and {control.rmse_v_m:.3f} m in height, says how well they were, not how good the block is"
        )
    left = leave_one_out(result)
    if left is not None:
        sentences.append(
            f"What all other observations predict for each of {things(left.n, 'control point')}: RMSE "
            f"{left.rmse_h_m:.3f} m in plan, {left.rmse_v_m:.3f} m in height; {left.worst} is the worst"
        )
    groups = result.decisions.sigmas
    for kind, of, stated, used in zip(
        groups.kind.tolist(), groups.of.tolist(), groups.stated_sigma.tolist(), groups.used_sigma.tolist(), strict=True
    ):
        if kind in _OF_TIES and not stated / UNLIKE < used < stated * UNLIKE:
            sentences.append(
                f"Weights: tie points of camera {of} scatter by {used:.3f} px where {stated:.3f} px was assumed"
            )
    stated = audit.start.block.control_points.mark_sigma_px
    if not 1.0 / UNLIKE < audit.mark_factor < UNLIKE:
        middle = float(np.median(stated))
        sentences.append(
            f"Weights: marks scatter by {middle * audit.mark_factor:.2f} px where {middle:.2f} px was assumed"
        )
    return tuple(sentences)
