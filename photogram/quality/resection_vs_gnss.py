"""Why resections miss the GNSS positions: how much of it is the focal length, how much the antenna and the datum."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from photogram.arrays import FloatArray
from photogram.results import Adjustment
from photogram.sfm.resection import Resection


@dataclass(frozen=True, eq=False)
class ResectionDifference:
    """Resected minus GNSS positions of one camera and flight, split by cause; easting, northing, height."""

    camera: str
    """Name of the camera."""
    flight: str
    """Name of the flight."""
    distance_m: FloatArray
    """Lengths of the differences (n,)."""
    mean_m: FloatArray
    """Mean difference (3,)."""
    given_px: float
    """Focal length of the resections."""
    focal_px: float
    """Adjusted focal length."""
    focal_sigma_px: float
    """Its standard deviation, 0 if fixed."""
    height_m: float
    """Flying height H above ground."""
    focal_m: float
    """Effect of the focal length in height: H (given − adjusted) / adjusted."""
    offset_m: FloatArray
    """Estimated GNSS offset (3,)."""
    offset_sigma_m: FloatArray
    """Its standard deviations (3,)."""
    rest_m: FloatArray
    """Remaining mean difference (3,)."""
    scatter_m: float
    """Root mean square length of the remaining differences."""

    @property
    def sentence(self) -> str:
        """Return what there is to say of it."""
        low, high = float(self.distance_m.min()), float(self.distance_m.max())
        span = f"{low:.2f} m" if high - low < 0.005 else f"{low:.2f} to {high:.2f} m"
        change = self.given_px - self.focal_px
        offset = ", ".join(f"{v:+.2f} ± {s:.2f}" for v, s in zip(self.offset_m, self.offset_sigma_m, strict=True))
        focal_uncertainty = ", held," if self.focal_sigma_px == 0 else f" ± {self.focal_sigma_px:.1f} px"
        return (
            f"Resection with the given focal length of {self.given_px:.1f} px puts {len(self.distance_m)} photographs "
            f"{span} from their GNSS positions, on average {self.mean_m[2]:+.2f} m in height. The adjusted focal "
            f"length of {self.focal_px:.1f} px{focal_uncertainty} explains {self.focal_m:+.2f} m of it "
            f"({self.height_m:.1f} m × {change:+.1f} px / {self.focal_px:.1f} px), "
            f"the GNSS offset {offset} m (easting, northing, height); "
            f"{self.rest_m[2]:+.2f} m of it remain. In position {self.scatter_m:.2f} m RMS remain, the noise "
            "of three-point resections"
        )


def resection_differences(result: Adjustment, resections: Sequence[Resection | None]) -> list[ResectionDifference]:
    """Return the differences of all cameras and flights that have resected photographs with GNSS positions, and an
    estimated offset."""
    block = result.block
    if not len(result.covariances.deformation.given_parameters) or not len(block.tie_points):
        return []
    groups: dict[tuple[int, str], list[int]] = {}
    for i, (photograph, pose) in enumerate(zip(block.photographs, block.poses, strict=True)):
        known = photograph.gnss_world_m is not None and photograph.flight in result.estimates.flights
        if known and pose is not None and resections[i] is not None:
            groups.setdefault((photograph.camera, photograph.flight), []).append(i)
    return [_difference(result, resections, c, flight, chosen) for (c, flight), chosen in groups.items()]


def _difference(
    result: Adjustment, resections: Sequence[Resection | None], c: int, flight: str, chosen: list[int]
) -> ResectionDifference:
    block = result.block
    frame = result.block.frame
    f = result.estimates.flights.index(flight)
    axes = frame.rotation_world_from_map(np.zeros(3))
    gnss = np.array([block.photographs[i].gnss_world_m for i in chosen])
    p3p = np.array([r.p3p.position_world_m for r in (resections[i] for i in chosen) if r is not None])
    centre = np.array([pose.position_world_m for pose in (block.poses[i] for i in chosen) if pose is not None])
    difference = frame.map_from_world(p3p) - frame.map_from_world(gnss)
    height = float(np.mean(centre[:, 2]) - np.median(block.tie_points.position_world_m[:, 2]))
    given, adjusted = float(result.covariances.deformation.given_parameters[c, 0]), block.cameras[c].focal_px
    focal = height * (given - adjusted) / adjusted
    offset = axes.T @ result.estimates.offset_world_m[f]
    rest = difference - offset - np.array([0.0, 0.0, focal])
    return ResectionDifference(
        camera=block.cameras[c].name,
        flight=flight,
        distance_m=np.linalg.norm(difference, axis=1),
        mean_m=difference.mean(axis=0),
        given_px=given,
        focal_px=adjusted,
        focal_sigma_px=float(np.sqrt(result.covariances.calibration[c, 0, 0])),
        height_m=height,
        focal_m=focal,
        offset_m=offset,
        offset_sigma_m=np.sqrt(np.diag(axes.T @ result.covariances.offset_m2[f] @ axes)),
        rest_m=rest.mean(axis=0),
        scatter_m=float(np.sqrt(np.mean(np.sum(rest**2, axis=1)))),
    )
