"""The figures of report.json as they follow from a block that was derived again, under the same keys; what is not
derived has no key here. Formulae and sources: docs/verify.md.
"""

import math
from typing import Any

import numpy as np

from photogram.verification.camera import READOUT, Numbers, map_from_world
from photogram.verification.equations import gnss_misfit, images, used_marks
from photogram.verification.solution import LEAST_REDUNDANCY, Solution, Tested, tested

Figures = dict[str, Any]
AXES = ("easting", "northing", "height")
CRITICAL, NONCENTRALITY, DEGREE, NAN = 3.29, 4.132, 180.0 / math.pi, math.nan
HEIGHT, TRANSVERSE_MERCATOR = np.array([0.0, 0.0, 1.0]), 5


def beyond(chi2: float, degrees: int) -> float:
    """Return the probability of a larger χ² (Abramowitz & Stegun 1964, 26.4.4 and 26.4.5)."""
    half, odd = max(0.5 * chi2, 1e-300), 0.5 * (degrees % 2)
    terms = (math.exp((k + odd) * math.log(half) - half - math.lgamma(k + odd + 1.0)) for k in range(degrees // 2))
    return (math.erfc(math.sqrt(half)) if odd else 0.0) + sum(terms)


def listed(values: Any) -> Any:  # noqa: ANN401 - figures at any depth
    """Return figures as JSON has them, None for those that do not exist."""
    if isinstance(values, dict):
        return {key: listed(value) for key, value in values.items()}
    if isinstance(values, np.ndarray | list | tuple):
        return [listed(value) for value in values]
    plain = values.item() if isinstance(values, np.generic) else values
    return None if isinstance(plain, float) and not math.isfinite(plain) else plain


def summed_up(values: Numbers) -> tuple[int, float, float, float]:
    """Return how many of values are there, RMS, mean and standard deviation of n − 1, NaN where there are too few."""
    v = values[np.isfinite(values)]
    spread = float(v.std(ddof=1)) if len(v) > 1 else NAN
    return len(v), *((float(np.sqrt(np.mean(v**2))), float(v.mean())) if len(v) else (NAN, NAN)), spread


def of_tests(r: Numbers, w: Numbers, sigma: Numbers, unit: str) -> Figures:
    """Return redundancy numbers, w, and minimal detectable blunders δ₀ σ/√r of a measurement; nothing without any."""
    mdb = np.where(r > LEAST_REDUNDANCY, NONCENTRALITY * sigma / np.sqrt(np.maximum(r, LEAST_REDUNDANCY)), np.inf)
    figures = {"redundancy": r, "w": w, f"mdb_{unit}": mdb, "suspect": bool(np.any(np.abs(w) > CRITICAL))}
    return figures if np.isfinite(r).any() else {}


class Derived:
    """A solution in the map, and its tests of marks, control points and GNSS positions as rows of all of these, NaN
    where there is none. Geoid heights are the file's."""

    def __init__(self, s: Solution) -> None:
        """Bring a solution to the map."""
        self.s, self.a = s, s.arrays
        a, groups, ground = self.a, {group.name: group for group in s.groups}, s.ground_world_m
        self.is_grid = str(a["frame_kind"]) == "grid"
        self.has_geoid = any(np.nan_to_num(a[f"{name}_geoid_m"]).any() for name in ("centre", "ground"))
        self.is_projected = not self.is_grid and len(a["map_projection_parameter"]) == TRANSVERSE_MERCATOR
        self.is_exact = (self.is_grid or self.is_projected) and not self.has_geoid

        def spread(name: str, count: int, at: Numbers, width: int) -> Tested:
            rows = [np.full((count, *(width,) * k), np.nan) for k in (1, 1, 1, 2)]
            for row, value in zip(rows, tested(groups[name], s.tests) if name in groups else (), strict=False):
                row[at] = value
            return Tested(*rows)

        self.control = spread("control", len(ground), np.flatnonzero(a["ground_is_control"]), 3)
        self.gnss = spread("gnss", len(a["gnss_world_m"]), np.flatnonzero(np.isfinite(a["gnss_world_m"][:, 0])), 3)
        self.marks = spread("marks", len(a["mark_point"]), used_marks(a, a["ground_is_control"])[0], 2)
        self.sigma = np.where(a["ground_controlled"] & np.isfinite(a["ground_sigma_m"]), a["ground_sigma_m"], np.nan)
        for values in self.control[:3]:
            values[np.isnan(self.sigma)] = np.nan
        self.left_out = self.control.left_out * self.sigma
        self.left_spread = self.control.spread * self.sigma[:, :, None] * self.sigma[:, None, :]
        m, _ = used_marks(a, np.asarray(np.isfinite(ground).all(axis=1)))
        self.residual = np.full((len(a["mark_point"]), 2), np.nan)
        seen, places = a["mark_photograph"][m], ground[a["mark_point"][m]]
        self.residual[m] = images(a, s.columns, seen, a["mark_pixel_px"][m], places).residual
        self.centre = self.to_map("centre", a["centre_world_m"])
        self.surveyed = self.to_map("ground_surveyed", a["ground_surveyed_world_m"])
        self.adjusted = self.to_map("ground", ground)
        self.known, self.off = np.isfinite(self.surveyed).all(axis=1), self.adjusted - self.surveyed
        self.checked = ~a["ground_controlled"] & ~np.isinf(a["ground_sigma_m"]) & np.isfinite(self.off)

    def to_map(self, name: str, world: Numbers) -> Numbers:
        """Return places (n, 3), of what the file calls by a ``name``, in the map; of another projection than Transverse
        Mercator by map coordinates and axes that the file states beside them."""
        a, raised = self.a, np.nan_to_num(self.a[f"{name}_geoid_m"])[:, None] * HEIGHT
        if self.is_projected:
            projection = a["map_ellipsoid_m"], a["map_projection_parameter"], a["frame_origin_geodetic_rad_m"]
            return np.asarray(map_from_world(*projection, world) - raised)
        if self.is_grid:
            above = a.get("frame_origin_geodetic_rad_m", a["frame_origin_map_m"])[2] - a["frame_origin_map_m"][2]
            return np.asarray(world + a["frame_origin_map_m"] + above * HEIGHT - raised)
        off = np.einsum("nji,nj->ni", a[f"{name}_map_axes"], world - a[f"{name}_world_m"])
        return np.asarray(a[f"{name}_map_m"] + off)

    def axes_at(self, name: str, world: Numbers) -> Numbers:
        """Return the directions (n, 3, 3) of easting, northing and up: of steps of 10 m, the nearest rotation."""
        if not self.is_projected:
            return np.asarray(self.a[f"{name}_map_axes"])
        steps = [self.to_map(name, world + 10.0 * e) - self.to_map(name, world - 10.0 * e) for e in np.eye(3)]
        U, _, Vt = np.linalg.svd(np.nan_to_num(np.stack(steps, axis=2)))
        return np.asarray((U @ Vt).transpose(0, 2, 1))

    def photographs(self) -> Figures:
        """Return the figures of photographs, by name; ω, φ, κ of Rx(ω) Ry(φ) Rz(κ) (Kraus 2007, sec. 2.1)."""
        a, s, figures, C, R = self.a, self.s, Figures(), self.a["centre_world_m"], self.a["rotation_world_from_camera"]
        axes, off = self.axes_at("centre", C), self.centre - self.to_map("centre", C - gnss_misfit(a)[0])
        keys = ("redundancy", "w", "mdb_m", "suspect")
        for i, name in enumerate(a["photograph_name"].tolist()):
            own, turned = s.shown[6 * i : 6 * i + 6, 6 * i : 6 * i + 6], R[i].T @ axes[i]
            T, camera = turned.T * np.array([1.0, -1.0, -1.0]), int(a["photograph_camera"][i])
            pairs = ((-T[1, 2], T[2, 2]), (T[0, 2], math.hypot(T[0, 0], T[0, 1])), (-T[0, 1], T[0, 0]))
            points = a["tie_point_world_m"][a["tie_point"][a["tie_photograph"] == i]]
            gnss = of_tests(self.gnss.redundancy[i], self.gnss.w[i], a["gnss_sigma_m"][i], "m")
            figures[name] = {
                "camera": str(a["camera_name"][camera]), "registered": True, "position_map_m": self.centre[i],
                "sigma_m": np.sqrt(np.diagonal(turned.T @ own[3:, 3:] @ turned)), "tie_points": len(points),
                "sigma_attitude_deg": DEGREE * np.sqrt(np.diagonal(own)[:3]), "rotation_camera_from_map": turned,
                "omega_phi_kappa_deg": [DEGREE * math.atan2(y, x) for y, x in pairs],
                **{f"gnss_{key}": gnss.get(key) for key in keys},
            }  # fmt: skip
            if self.is_exact:  # of no other map two places beside each other
                figures[name]["gnss_residual_m"] = off[i] if np.isfinite(off[i]).all() else None
            if len(points):
                gsd = np.median((points - C[i]) @ R[i][:, 2]) / a["camera_parameter"][camera, 0]
                figures[name]["gsd_m"] = float(gsd)
        return figures

    def cameras(self) -> tuple[Figures, Figures]:
        """Return the figures of cameras, and those of their free parameters together, by name; not the standard
        deviation of a read-out time, which is raised by what velocities scatter by, nor the prior of one that was held,
        or of a focal length that is considered."""
        a, s, figures, together = self.a, self.s, Figures(), Figures()
        names, (owner, parameter) = a["camera_parameter_name"].tolist(), s.columns.parameter.T
        for c, name in enumerate(a["camera_name"].tolist()):
            q, prior, size = a["camera_parameter"][c], a["camera_prior_sigma"][c], a["camera_size_px"][c].tolist()
            own = np.flatnonzero((owner == c) & (parameter <= READOUT))
            k, at = parameter[own], s.columns.lens + own
            spread = np.sqrt(np.diagonal(s.shown)[at])
            priors = dict(zip(names, prior.tolist(), strict=False))
            sigma = dict.fromkeys(names) | dict(zip([names[n] for n in k.tolist()], spread.tolist(), strict=True))
            figures[name] = {
                "model": str(a["camera_model"][c]), "focal_px": q[0], "principal_point_px": q[1:3], "radial": q[3:7],
                "tangential": q[7:9], "affinity": q[9:11], "readout_s": q[READOUT], "sigma": sigma,
                "width_px": size[0], "height_px": size[1], "prior_sigma": priors,
            }  # fmt: skip
            if prior[READOUT] > 0.0:
                del sigma[names[READOUT]]
            else:
                del priors[names[READOUT]]
                correlation = s.shown[np.ix_(at, at)] / np.outer(spread, spread)
                together[name] = {"value": q[k], "sigma": spread, "correlation": correlation}
            if a["considered_focal_sigma_px"][c] > 0.0:
                del priors["focal_px"]
        return figures, together

    def adjustment(self) -> Figures:
        """Return what the adjustment says of itself."""
        a, s, offsets, axes = self.a, self.s, Figures(), self.a["map_axes_world"]
        rays, square = np.bincount(a["tie_point"]), np.sum(s.normal.residual**2, axis=1)
        for k, flight in enumerate(a["gnss_offset_flight"].tolist()):
            own = slice(s.columns.offset + 3 * k, s.columns.offset + 3 * k + 3)
            sigma = np.sqrt(np.diagonal(axes.T @ s.shown[own, own] @ axes))
            offsets[flight] = {"offset_m": axes.T @ a["gnss_offset_world_m"][k], "sigma_m": sigma}
        figures = {
            "sigma0": math.sqrt(s.squares / s.redundancy) if s.redundancy > 0 else None, "redundancy": s.redundancy,
            "reprojection_rms_px": float(np.sqrt(square.mean())) if len(square) else None, "tie_points": len(rays),
            "tie_points_by_rays": {str(n): int(np.count_nonzero(rays == n)) for n in np.unique(rays)},
            "observations": len(square), "gnss_offsets": offsets,
        }  # fmt: skip
        every = not len(a["photograph_not_oriented_name"])
        return figures | ({"discarded_observations": len(a["rejected_sigma_px"])} if every else {})

    def block(self, photographs: Figures) -> Figures:
        """Return what describes the block as a whole."""
        rows = [p.get("gnss_residual_m") for p in photographs.values()]
        off = np.array([[NAN] * 3 if row is None else row for row in rows])
        n, p = len(self.a["tie_point"]), len(self.a["tie_point_world_m"])
        rms = {"plan": np.hypot(off[:, 0], off[:, 1]), "height": off[:, 2], "three_d": np.linalg.norm(off, axis=1)}
        return {
            "registered": len(off), "tie_points": p, "observations": n, "mean_track_length": n / p if p else None,
            "gsd_m": float(np.median([f["gsd_m"] for f in photographs.values() if "gsd_m" in f] or [NAN])),
            "gnss_residual_rms_m": {k: summed_up(v)[1] for k, v in rms.items()} if self.is_exact else {},
        }  # fmt: skip

    def ground_points(self, each: dict[int, Figures]) -> Figures:
        """Return the figures of ground points, by name, those of their marks by photograph; with z and distance of
        ``each`` that was checked."""
        a, axes, points = self.a, self.axes_at("ground", self.s.ground_world_m), Figures()
        for g in np.flatnonzero(self.known).tolist():
            own, there, r = slice(3 * g, 3 * g + 3), bool(np.isfinite(self.off[g]).all()), self.control.redundancy[g]
            sigma = np.sqrt(np.diagonal(axes[g].T @ self.s.ground_joint_m2[own, own] @ axes[g]))
            names = a["photograph_name"][a["mark_photograph"]]
            point = of_tests(r, self.control.w[g], self.sigma[g], "m") | each.get(g, {}) | {
                "surveyed_map_m": self.surveyed[g], "adjusted_map_m": self.adjusted[g] if there else None,
                "residual_m": self.off[g] if there else None, "sigma_m": sigma if there else None,
                "marks": {str(names[m]): self.mark(m) for m in np.flatnonzero(a["mark_point"] == g).tolist()},
            }  # fmt: skip
            if np.isfinite(a["ground_sigma_m"][g]).all() and not a["ground_sigma_assumed"][g]:
                point["surveyed_sigma_m"] = a["ground_sigma_m"][g]
            off, spread, n = self.left_out[g], self.left_spread[g], np.flatnonzero(np.isfinite(self.left_out[g]))
            if "mdb_m" in point:
                point["effect_m"] = point["mdb_m"] * (1.0 - r)
            if len(n):
                value = float(off[n] @ np.linalg.solve(spread[np.ix_(n, n)], off[n]))
                point["chi2"] = {"value": value, "dof": len(n), "p": beyond(value, len(n))}
                point |= {"left_out_m": off, "left_out_sigma_m": np.sqrt(np.diagonal(spread))}
            points[str(a["ground_name"][g])] = point
        return points

    def mark(self, m: int) -> Figures:
        """Return the figures of a mark."""
        mark, covariance = {"pixel": self.a["mark_pixel_px"][m]}, self.a["mark_covariance_px2"][m]
        if not np.isfinite(covariance).all():
            return mark
        L, (u, v, uv) = np.linalg.cholesky(covariance), (covariance[0, 0], covariance[1, 1], covariance[0, 1])
        mark |= of_tests(self.marks.redundancy[m], self.marks.w[m], np.diagonal(L), "px") | {"left_out": False}
        mark["residual_px"] = self.residual[m] if np.isfinite(self.residual[m]).all() else None
        if not self.a["mark_sigma_assumed"][self.a["mark_point"][m]]:
            mark["sigma_px"] = math.sqrt(0.5 * (u + v))
            if u != v or uv != 0.0:
                mark["semi_axes_px"] = np.sqrt(np.linalg.eigvalsh(covariance)[::-1])
                mark["direction_deg"] = 0.5 * DEGREE * math.atan2(2.0 * uv, u - v)
        return mark

    def accuracy(self) -> tuple[Figures, Figures, list[Figures]]:
        """Return the differences of the check points summed up; the sums of the ASPRS standard (Edition 2, sec. 7.3 to
        7.5 and 7.11), of points that check the plan by both axes; and what of these the verdict repeats."""
        a, off = self.a, np.where(self.checked, self.off, np.nan)
        whole = [summed_up(column) for column in off.T]
        plain = {
            "n": int(self.checked.any(axis=1).sum()), "n_axis": [row[0] for row in whole],
            "rmse_m": [row[1] for row in whole], "mean_m": [row[2] for row in whole],
            "rmse_h_m": math.hypot(whole[0][1], whole[1][1]), "rmse_v_m": whole[2][1],
        }  # fmt: skip
        off[~np.isfinite(off[:, :2]).all(axis=1), :2] = np.nan
        sigma = np.where(a["ground_sigma_assumed"][:, None], np.nan, a["ground_sigma_m"])
        rows, there = [summed_up(column) for column in off.T], np.isfinite(off)
        e, n, h = (math.sqrt(np.mean(sigma[there[:, k], k] ** 2)) if there[:, k].any() else NAN for k in range(3))
        fit, survey = (math.hypot(rows[0][1], rows[1][1]), rows[2][1]), (math.hypot(e, n), h)
        both, figures = (math.hypot(fit[0], survey[0]), math.hypot(fit[1], survey[1])), list[Figures]()
        named = {"n_h": rows[0][0], "n_v": rows[2][0], "rmse_3d_m": math.hypot(*both)}
        for k, letter in enumerate("hv"):
            named |= {f"fit_rmse_{letter}_m": fit[k], f"survey_rmse_{letter}_m": survey[k], f"rmse_{letter}_m": both[k]}
            figures.append({"n": rows[2 * k][0], "rmse_m": fit[k], "survey_m": survey[k], "asprs_rmse_m": both[k]})
        keys = ("n", "rmse_m", "mean_m", "sd_m")
        axes = {name: dict(zip(keys, row, strict=True)) for name, row in zip(AXES, rows, strict=True)}
        return plain, named | {"axes": axes}, figures

    def prediction(self) -> tuple[Figures | None, dict[int, Figures]]:
        """Return the check points against their predicted covariance, None without any; z and distance of each."""
        a, rows, each = self.a, np.flatnonzero(self.checked.ravel()), dict[int, Figures]()
        if not len(rows):
            return None, each
        turn, d = np.kron(np.eye(len(self.off)), a["map_axes_world"])[:, rows], self.off.ravel()[rows]
        joint = turn.T @ np.nan_to_num(self.s.ground_joint_m2) @ turn + np.diag(a["ground_sigma_m"].ravel()[rows] ** 2)
        z, axes = np.full(self.off.shape, np.nan), Figures()
        z.reshape(-1)[rows] = d / np.sqrt(np.diagonal(joint))
        for g in np.flatnonzero(self.checked.any(axis=1)).tolist():
            own = np.flatnonzero(rows // 3 == g)
            distance = math.sqrt(d[own] @ np.linalg.solve(joint[np.ix_(own, own)], d[own]))
            each[g] = {"z": z[g], "mahalanobis": distance}
        for name, column in zip(AXES, z.T, strict=True):
            own, (n, rms, mean, _) = np.abs(column[np.isfinite(column)]), summed_up(column)
            within = {f"within_{k}": float(np.mean(own <= k)) if n else None for k in (1, 2, 3)}
            axes[name] = {"n": n, "mean_z": mean, "rms_z": rms, **within}
        value = float(d @ np.linalg.solve(joint, d))
        chi2 = {"value": value, "dof": len(rows), "p": beyond(value, len(rows))}
        return {"n": len(each), "axes": axes, "chi2": chi2}, each

    def leave_one_out(self) -> Figures | None:
        """Return what everything else predicts for the control points, summed up; None where it tells nothing."""
        k = np.flatnonzero(np.isfinite(self.left_out).all(axis=1) & self.known)
        if not len(k):
            return None
        off, z = self.left_out[k], self.left_out[k] / np.sqrt(np.einsum("kii->ki", self.left_spread[k]))
        rmse, worst = np.sqrt(np.mean(off**2, axis=0)), int(np.argmax(np.linalg.norm(off, axis=1)))
        farthest = {"name": str(self.a["ground_name"][k[worst]]), "left_out_m": off[worst], "z": z[worst]}
        return {
            "n": len(k), "rmse_m": rmse, "mean_m": off.mean(axis=0), "rmse_h_m": math.hypot(rmse[0], rmse[1]),
            "rmse_v_m": float(rmse[2]), "rms_z": np.sqrt(np.mean(z**2, axis=0)), "max": farthest,
        }  # fmt: skip

    def variance_components(self) -> Figures:
        """Return r and √(vᵀPv/r) of the groups of observations; tie points have the redundancy that others leave. Not
        of attitudes some of whose headings are not known, nor of tie points beside these."""
        a, s, sums = self.a, self.s, dict[str, Numbers]()
        for group in s.groups:
            covariance = s.tests if group.name in ("marks", "control", "gnss", "distances") else s.fixed
            r, v = tested(group, covariance).redundancy, group.residual
            if group.name in ("control", "gnss"):
                used = np.isfinite(self.sigma[a["ground_is_control"]] if group.name == "control" else v)
                for name, k in ((f"{group.name}_plan", [0, 1]), (f"{group.name}_height", [2])):
                    there = used[:, k]
                    sums[name] = np.array([there.sum(), r[:, k][there].sum(), np.sum(v[:, k] ** 2)])
            else:
                own = np.array([v.size, r.sum(), np.sum(v**2)])
                sums[group.name] = sums.get(group.name, 0.0) + own
        left = np.array([2 * len(a["tie_point"]), s.redundancy, s.squares])
        sums["tie_points"] = left - sum(row * np.array([0.0, 1.0, 1.0]) for row in sums.values())
        if np.any(~a["attitude_heading_known"] & np.isfinite(a["attitude_sigma_rad"])):
            sums = {name: row for name, row in sums.items() if name not in ("attitude", "tie_points")}
        figures: Figures = {}
        for name, (n, r, square) in sums.items():
            factor = math.sqrt(square / r) if r >= 1.0 else NAN
            figures[name] = {"observations": int(n), "redundancy": float(r), "sigma_factor": factor}
            figures[name]["sigma_factor_sd"] = factor / math.sqrt(2.0 * r) if r >= 1.0 else NAN
        return {name: row for name, row in figures.items() if row["observations"]}

    def all(self) -> Figures:
        """Return all figures that are derived, as report.json has them."""
        photographs, (plain, asprs, verdict) = self.photographs(), self.accuracy()
        (prediction, each), (cameras, together) = self.prediction(), self.cameras()
        figures = {
            "photographs": photographs, "cameras": cameras, "adjustment": self.adjustment(),
            "block": self.block(photographs), "control_points": self.ground_points(each), "check_points": plain,
            "asprs": asprs, "predicted_against_achieved": prediction, "leave_one_out": self.leave_one_out(),
            "variance_components": self.variance_components(), "world": {"origin_map_m": self.a["frame_origin_map_m"]},
            "diagnosis": {"cameras": together}, "verdict": {"figures": [] if self.a["network_is_free"] else verdict},
        }  # fmt: skip
        return {key: listed(value) for key, value in figures.items()}
