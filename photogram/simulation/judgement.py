"""A simulated survey's report against the truth that was written beside its photographs."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from photogram.files.npz_json import read_json
from photogram.report.numbers.traffic_lights import number
from photogram.report.record.report import Report, oriented


@dataclass(frozen=True)
class Judgement:
    """A simulated survey's result against its truth; errors in m, ``gsd_m`` the size of a pixel on the ground.

    Check points took no part in the adjustment; NMAD is that of a cloud's heights over the true surface.
    """

    gsd_m: float
    check_points: int
    check_rmse_plan_m: float
    check_rmse_height_m: float
    camera_rmse_m: float
    focal_error_px: float
    focal_sigma_px: float
    nmad_m: dict[str, float]

    @property
    def gain(self) -> float:
        """Return how many times closer to the truth the adjusted cloud is than the linear cloud from three views."""
        return self.nmad_m["linear_3view"] / self.nmad_m["adjusted"]


def judge(folder: Path, report: Report) -> Judgement:
    """Compare report.json of the demonstration in ``folder`` with the truth beside it."""
    truth = read_json(folder / "truth.json")
    photographs = oriented(report["photographs"])
    error = [
        np.array(photographs[name]["position_map_m"]) - np.array(position)
        for name, position in truth["positions_map_m"].items()
        if name in photographs
    ]
    camera = report["cameras"][truth["camera"]["name"]]
    check = report["check_points"]
    return Judgement(
        float(truth["gsd_m"]),
        check["n"],
        number(check["rmse_h_m"]),
        number(check["rmse_v_m"]),
        float(np.sqrt(np.mean(np.sum(np.square(error), axis=1)))),
        float(camera["focal_px"] - truth["camera"]["parameters"][0]),
        number(camera["sigma"]["focal_px"]),
        {name: cloud["nmad_m"] for name, cloud in report["clouds"].items() if cloud["nmad_m"] is not None},
    )
