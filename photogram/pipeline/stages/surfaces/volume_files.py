"""volumes.csv, and what the stage `volumes` has stored, read back."""

import csv
from collections.abc import Sequence
from dataclasses import asdict, fields
from pathlib import Path

import numpy as np

from photogram.files.atomic import replacing
from photogram.files.maps.polygon_files import read_polygons
from photogram.files.npz_json import read_arrays, read_json, read_json_as
from photogram.grid import MapGrid
from photogram.pipeline.store.run import Run
from photogram.report.figures.difference_figure import DifferencePicture
from photogram.report.record.volumes import NoVolumesRecord, VolumesRecord
from photogram.volumes.volumes import Volume, volume_words

TABLE, RECORD, PICTURE, PICTURE_GRID = "volumes.csv", "volumes.json", "picture.npz", "picture_grid.json"


def write_volumes(path: Path, volumes: Sequence[Volume]) -> None:
    """Write a line for each of some volumes, m² and m³; whole or not at all."""
    with replacing(path) as partial, partial.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.DictWriter(stream, [f.name for f in fields(Volume)], lineterminator="\n")
        writer.writeheader()
        for volume in volumes:
            writer.writerow({k: v if isinstance(v, str) else f"{v:.4f}" for k, v in asdict(volume).items()})


def volumes_record(run: Run) -> VolumesRecord | NoVolumesRecord | None:
    """Return what the stage has measured, or why nothing; None where nothing was asked for."""
    if not run.workspace.has("volumes", RECORD):
        return None
    stored = run.workspace.file("volumes", RECORD)
    if "left_out" in read_json(stored):
        return read_json_as(stored, NoVolumesRecord)
    return read_json_as(stored, VolumesRecord)


def volumes_picture(run: Run) -> DifferencePicture | None:
    """Return the picture of the polygons and their volumes, None where nothing was measured."""
    record = volumes_record(run)
    if record is None or "left_out" in record or not run.workspace.has("volumes", PICTURE):
        return None
    arrays = read_arrays(run.workspace.file("volumes", PICTURE))
    grid = MapGrid(**read_json(run.workspace.file("volumes", PICTURE_GRID)))
    polygons = read_polygons(Path(str(run.project.volumes.polygons)), run.project.crs)
    words = {v["name"]: volume_words(v["net_m3"], v["net_sigma_m3"], v["unmeasured_m2"] / v["area_m2"])
             for v in record["polygons"]}  # fmt: skip
    return DifferencePicture(
        np.asarray(arrays["difference_m"], dtype=np.float64), np.asarray(arrays["within"], dtype=bool), grid,
        [(p.name, p.polygon) for p in polygons], [], "surface", record["base_words"], words,
        "height above the base, m", np.asarray(arrays["height_m"], dtype=np.float64),
    )  # fmt: skip
