"""What an adjustment by itself takes into its model: common errors, read-out times, sigmas that nobody has stated."""

from collections.abc import Iterator

import numpy as np
from scipy.stats import chi2

from photogram.results import SIGMA_TITLES, Adjustment, Decision
from photogram.wording import uncapitalised


def decided_by_adjustment(result: Adjustment) -> Iterator[Decision]:
    """Yield what was decided within an adjustment."""
    decisions = result.decisions
    for common in decisions.common_errors:
        error = common.error
        if error.kind == "known_surface":  # photogram.amendments.surfaces says what it is off by
            continue
        of = [f"flight {error.flight}"] if error.flight is not None else []
        about = " of ".join([f"common {error.kind.replace('_', ' ')}", *of])
        rivals = (common.as_well,) if common.as_well else ()
        size = ""
        if error.kind == "attitude":
            size = f"{np.rad2deg(np.linalg.norm(common.estimate)):.1f}° "
        sentence = f"{about}: {size}estimated from {common.photographs} photographs, and removed"
        yield Decision(about, True, sentence, common.chi2, common.degrees, common.p, rivals)
    # of a block without rolling shutters nothing was looked for, and there are none
    for camera, readout_s, sigma_s in zip(
        result.block.cameras, decisions.readout_s, decisions.readout_sigma_s, strict=False
    ):
        if np.isfinite(readout_s) and sigma_s > 0.0:
            rolling = camera.readout_s != 0.0
            about, statistic = f"rolling shutter of {camera.name}", float((readout_s / sigma_s) ** 2)
            size = f"{1e3 * readout_s:.1f} ± {1e3 * sigma_s:.1f} ms"
            sentence = f"{about}: {f'a read-out time of {size}' if rolling else f'none, {size} are not significant'}"
            yield Decision(about, rolling, sentence, statistic, 1, float(chi2.sf(statistic, 1)))
    sigmas = decisions.sigmas
    for kind, of, stated, used, factor in zip(
        sigmas.kind.tolist(), sigmas.of.tolist(), sigmas.stated_sigma.tolist(), sigmas.used_sigma.tolist(),
        sigmas.factor.tolist(), strict=True,
    ):  # fmt: skip
        unit = "px" if kind in ("key_points", "transferred", "photograph", "marks") else "m"
        about = f"standard deviation of {uncapitalised(SIGMA_TITLES[kind])}, {of}"
        changed = factor != 1.0
        after = f"{used:.3g} {unit} are used" if changed else "used as it is"
        yield Decision(about, changed, f"{about}: {stated:.3g} {unit} stated or assumed, {after}")
