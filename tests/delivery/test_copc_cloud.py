"""dense.copc.laz of a finished survey, against the dense.laz of its results."""

from dataclasses import replace
from pathlib import Path

import laspy
import numpy as np
from delivered import handed_over

from photogram.delivery.clouds.copc_cloud import write_copc_cloud
from photogram.delivery.hand_over import deliver
from photogram.files.clouds.dense_points import DensePoints, write_dense_laz
from photogram.grid import MapGrid


def test_the_points_are_those_of_the_results(finished_survey: Path, tmp_path: Path) -> None:
    (delivered,) = deliver(finished_survey, ["copc"], tmp_path)
    given, copied = (laspy.read(path) for path in (finished_survey / "results/deliverables/dense.laz", delivered.path))
    one, other = (np.sort(cloud.points.array, order=cloud.points.array.dtype.names) for cloud in (given, copied))
    np.testing.assert_array_equal(one, other)
    assert delivered.holds.startswith(f"{len(given)} points in ")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["checksums.sha256", "dense.copc.laz"]


def test_without_a_cloud_nothing_is_written(tmp_path: Path) -> None:
    path, bare = tmp_path / "dense.copc.laz", handed_over()
    assert write_copc_cloud(path, bare) == ("", ("Dense cloud: there is none.",))
    why = replace(bare, absent={"dense cloud": "dense.enabled is false"})
    assert write_copc_cloud(path, why) == ("", ("Dense cloud: dense.enabled is false.",))

    def write_none(cloud: Path) -> bool:
        write_dense_laz(cloud, MapGrid(0.0, 0.0, 1.0, 2, 2), bare.crs, list[DensePoints]())
        return True

    empty = replace(bare, write_cloud=write_none)
    assert write_copc_cloud(path, empty) == ("", ("Dense cloud: no cell of the surface has a height and a colour.",))
    assert list(tmp_path.iterdir()) == []
