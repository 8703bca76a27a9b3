"""What a draft states of shutters: rolling ones of the table, mechanical ones, and those that are looked for."""

from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from makers import SharedData

from photogram.files.photographs.images import read_tags
from photogram.files.photographs.tags import PhotographTags
from photogram.project.draft.cameras import SIGMA_NAMES, tagged_camera
from photogram.project.draft.shutters import ALL_AT_ONCE, READOUT_MS, UNKNOWN_S, shutter_of

TAGS = PhotographTags(
    make="DJI", model="FC300S", width_px=4000, height_px=2250, focal_35mm_mm=20.0, longitude_deg=10.0,
    latitude_deg=50.0, time=datetime(2024, 6, 12, 10, 0, 0, 250000, tzinfo=UTC),
)  # fmt: skip


def test_a_known_rolling_shutter_is_a_prior_that_can_be_outvoted() -> None:
    shutter = shutter_of([TAGS] * 3)
    assert shutter is not None
    assert shutter.readout_s == 0.033
    assert 0.005 < shutter.sigma_s < 0.02
    assert "33 ms" in shutter.source


def test_the_photographs_decide_on_a_mechanical_shutter_as_on_an_unknown_one() -> None:
    mechanical = shutter_of([replace(TAGS, model="FC6310R")] * 2)
    assert mechanical is not None
    assert (mechanical.readout_s, mechanical.sigma_s) == (0.0, UNKNOWN_S)
    still = shutter_of([replace(TAGS, model="FC6310R", time=None)] * 2)
    assert still is not None
    assert (still.readout_s, still.sigma_s) == (0.0, 0.0), "nothing tells how they moved"
    unknown = shutter_of([replace(TAGS, model="X1")] * 2)
    assert unknown is not None
    assert (unknown.readout_s, unknown.sigma_s) == (0.0, UNKNOWN_S)
    assert not ALL_AT_ONCE & READOUT_MS.keys()


def test_without_motion_the_affinity_stands_in_its_place() -> None:
    still = replace(TAGS, time=None)
    assert shutter_of([still] * 3) is None
    assert shutter_of([replace(still, velocity_m_s=(1.0, 2.0, 0.0))] * 3) is not None
    assert shutter_of([TAGS]) is None, "one photograph has no neighbour"
    whole = replace(TAGS, time=datetime(2024, 6, 12, 10, tzinfo=UTC))
    assert shutter_of([whole] * 3) is None, "whole seconds tell no speed"
    affinity = [k for k, name in enumerate(SIGMA_NAMES) if name in ("b1", "b2")]
    for tags, free in (([still] * 3, True), ([TAGS] * 3, False)):
        camera = tagged_camera("c", tags, None)
        assert camera is not None
        assert all((camera.sigmas[k] > 0.0) == free for k in affinity)
        assert (camera.shutter is None) == free


def real_tags(folder: Path) -> list[PhotographTags]:
    return [read_tags(path) for path in sorted(folder.glob("*.JPG"))]


def test_real_photographs_of_a_global_shutter_are_asked_whether_it_rolls(shared_data: SharedData) -> None:
    tags = real_tags(shared_data("p4m_rtk_xmp"))
    shutter = shutter_of(tags)
    assert {t.model for t in tags} == {"FC6360"}
    assert shutter is not None
    assert (shutter.readout_s, shutter.sigma_s) == (0.0, UNKNOWN_S)
    camera = tagged_camera("c", tags, None)
    assert camera is not None
    assert not any(camera.sigmas[k] for k, name in enumerate(SIGMA_NAMES) if name in ("b1", "b2"))


def test_real_photographs_of_a_rolling_shutter_tell_that_the_drone_nearly_stopped(shared_data: SharedData) -> None:
    tags = real_tags(shared_data("brighton_beach/images"))
    shutter = shutter_of(tags)
    assert shutter is not None
    assert (shutter.readout_s, round(shutter.sigma_s, 4)) == (0.033, 0.0116)
    speeds = [np.hypot(*t.velocity_m_s[:2]) for t in tags if t.velocity_m_s is not None]
    assert len(speeds) == 18
    assert max(speeds) <= 0.5
