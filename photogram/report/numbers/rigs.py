"""Numbers of cameras on one body: relative poses as adjusted, and the reliability of their exposures."""

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np
from scipy.spatial.transform import Rotation

from photogram.adjustment.rigs.exposure_tests import rig_reliabilities
from photogram.report.record.rigs import BandRecord, RigRecord
from photogram.report.values import all_finite, finite
from photogram.results import Adjustment
from photogram.survey import Block

NO_BANDS: Mapping[str, BandRecord] = MappingProxyType({})
_ROTATION, _OFFSET = slice(0, 3), slice(3, 6)


def rig_numbers(result: Adjustment, measured: Block, bands: Mapping[str, BandRecord] = NO_BANDS) -> list[RigRecord]:
    """Return the relative poses of a block as it was ``measured``, beside what is adjusted, with how the ``bands`` of
    companions lie on their masters, by camera."""
    records = []
    for k, (rig, stated, reliability) in enumerate(
        zip(result.block.rigs, measured.rigs, rig_reliabilities(result), strict=True)
    ):
        variance = np.diag(result.tests.exposures.relative_covariance[k])
        sigma = np.sqrt(np.where(np.isfinite(variance), np.clip(variance, 0.0, None), np.nan))
        pose = rig.pose if reliability.exposures else None
        angles = None
        if pose is not None:
            turn = Rotation.from_matrix(pose.rotation_master_from_companion)
            angles = [float(angle) for angle in turn.as_euler("XYZ", degrees=True)]
        record: RigRecord = {
            "camera": rig.name,
            "master": rig.master,
            "exposures": reliability.exposures,
            "rejected": [
                name
                for (name, _), own in zip(rig.exposures, rig.exposure_sigma, strict=True)
                if not np.isfinite(own).all()
            ],
            "offset_m": None if pose is None else all_finite(pose.offset_m),
            "offset_sigma_m": all_finite(sigma[_OFFSET]),
            "rotation_deg": angles,
            "rotation_sigma_deg": all_finite(np.rad2deg(sigma[_ROTATION])),
            "offset_given": bool(np.isfinite(stated.sigma[_OFFSET]).all()),
            "rotation_given": bool(np.isfinite(stated.sigma[_ROTATION]).all()),
            "offset_redundancy": finite(float(reliability.redundancy[_OFFSET].mean())),
            "rotation_redundancy": finite(float(reliability.redundancy[_ROTATION].mean())),
            "offset_mdb_m": finite(float(reliability.detectable[_OFFSET].max())),
            "rotation_mdb_deg": finite(float(np.rad2deg(reliability.detectable[_ROTATION].max()))),
            "largest_w": finite(float(reliability.largest_w.max())),
        }
        if rig.name in bands:
            record["registration"] = bands[rig.name]
        records.append(record)
    return records
