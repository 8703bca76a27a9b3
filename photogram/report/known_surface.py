"""Numbers of a known surface: how far the ground is from it, and whether it gives the heights of the survey."""

from photogram.report.record.known_surface import KnownSurfaceRecord
from photogram.report.values import finite, finites
from photogram.results import Adjustment

PREVAILS = 3.0
"""Times the standard deviation of the surface as a whole, from which on positions say little of heights beside it."""


def known_surface_numbers(result: Adjustment) -> KnownSurfaceRecord | None:
    """Return the numbers of the known surface of a survey, None without one."""
    made = result.decisions.known_surface
    if made is None:
        return None
    gives = made.adopted and gives_heights(result)
    sentence = f"{made.sentence[0].upper()}{made.sentence[1:]}."
    if gives:
        sentence += (
            " The datum of the heights is that of the surface: no control point has a height, and positions tell "
            f"heights less well than it does. As a whole heights are right to {made.above_sigma_m[0]:.2f} m at best."
        )
    if made.common_assumed:
        sentence += f" That all of it is off by {made.common_sigma_m:g} m together is assumed: enter common_sigma_m."
    return {
        "name": made.name,
        "used": made.adopted,
        "points": made.used,
        "set_aside": made.set_aside,
        "mean_m": finite(made.mean_m),
        "rms_m": finite(made.rms_m),
        "scatter": finite(made.scatter),
        "above_m": finites(made.above_m),
        "above_sigma_m": finites(made.above_sigma_m),
        "edge_m": finite(made.edge_m),
        "sigma_m": made.sigma_m,
        "common_sigma_m": made.common_sigma_m,
        "common_sigma_assumed": made.common_assumed,
        "chi2": finite(made.statistic),
        "p": finite(made.p),
        "gives_heights": gives,
        "sentence": sentence,
    }


def gives_heights(result: Adjustment) -> bool:
    """Return whether the heights of a block come from its known surface rather than from anything else."""
    block, surface = result.block, result.block.known_surface
    if surface is None or block.control_points.used[:, 2].any():
        return False
    own = [p.gnss_sigma_m[2] for p in block.photographs if p.gnss_sigma_m is not None]
    if not own:
        return True
    positions_m = float((sum(s**-2.0 for s in own) ** -1.0 + block.gnss_offset_sigma_m[2] ** 2) ** 0.5)
    return positions_m > PREVAILS * float(surface.common_sigma_m[0])
