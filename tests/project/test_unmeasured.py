"""What nothing measured though tags give it."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from photogram.files.photographs.tags import PhotographTags
from photogram.gnss import UNKNOWN_M
from photogram.project.measured.measured_block import PhotographNote
from photogram.project.measured.unmeasured import withdraw_placeholders
from photogram.project.project import Project, ProjectPhotograph

PLACED = PhotographTags(
    make="A", model="one", latitude_deg=46.0, longitude_deg=7.0, height_m=0.0, height_above_take_off_m=1.0,
    gimbal_yaw_deg=0.0, gimbal_pitch_deg=0.0, gimbal_roll_deg=0.0,
)  # fmt: skip
TAGS = [replace(PLACED, latitude_deg=46.0 + 1e-4 * i) for i in range(4)]


def noted(source: str, **own: Any) -> tuple[list[PhotographNote], list[ProjectPhotograph]]:
    photographs = [ProjectPhotograph(f"{i}.JPG", Path(f"{i}.JPG"), 0, **own) for i in range(4)]
    notes = [
        {
            "name": p.name, "gnss_map_m": [0.0, 10.0 * i, 0.0], "gnss_sigma_m": [2.0, 2.0, 3.0], "gnss_source": source,
            "attitude_deg": [0.0, 0.0, 0.0], "height_above_ground_m": 1.0,
        }
        for i, p in enumerate(photographs)
    ]  # fmt: skip
    return cast(list[PhotographNote], notes), photographs


def withdrawn(notes: list[PhotographNote], photographs: list[ProjectPhotograph]) -> list[PhotographNote]:
    withdraw_placeholders(cast(Project, SimpleNamespace(photographs=photographs)), notes, TAGS)
    return notes


def test_placeholders_of_tags_are_withdrawn_and_the_plan_stays() -> None:
    for i, note in enumerate(withdrawn(*noted("tags"))):
        assert note["gnss_map_m"] == [0.0, 10.0 * i, 0.0]
        assert note["gnss_sigma_m"] == [2.0, 2.0, UNKNOWN_M]
        assert note["attitude_deg"] is None
        assert note["height_above_ground_m"] is None


@pytest.mark.parametrize("source", ["project", "positions.csv"])
def test_what_the_project_itself_says_stays(source: str) -> None:
    own = noted(source, attitude_deg=(0.0, 0.0, 0.0), height_above_ground_m=1.0)
    for note in withdrawn(*own):
        assert note["gnss_sigma_m"] == [2.0, 2.0, 3.0]
        assert note["attitude_deg"] == [0.0, 0.0, 0.0]
        assert note["height_above_ground_m"] == 1.0
