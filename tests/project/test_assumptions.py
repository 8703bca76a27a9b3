"""What `photogram init` assumes because nothing states it."""

from dataclasses import replace
from types import MappingProxyType

import numpy as np
import pytest

from photogram.project.draft.assumptions import assumptions
from photogram.project.draft.cameras import TaggedCamera
from photogram.project.draft.control import ControlFile
from photogram.project.draft.draft import DraftHeights, DraftPhotograph, ProjectDraft
from photogram.project.draft.positions import Gnss
from photogram.project.draft.shutters import Shutter
from photogram.survey import Role

CAMERA = TaggedCamera(
    "drone", 4000, 3000, 3000.0, (1999.5, 1499.5), (0.0, 0.0, 0.0), (0.0, 0.0), (90.0, *(0.0,) * 10), "EXIF 24 mm", "",
    shutter=Shutter(0.033, 0.012, "a table"),
)  # fmt: skip
GNSS = Gnss("without stated accuracy", (2.0, 2.0, 3.0))
DRAFT = ProjectDraft(
    "EPSG:25832", "UTM 32N", "", (CAMERA,), (DraftPhotograph("a.jpg", "drone", "1", GNSS, has_attitude=True),),
    (3.0, 3.0, 30.0), "", "", DraftHeights(), gnss_kinds=MappingProxyType({"without stated accuracy": 1}),
)  # fmt: skip
LIST = ControlFile("gcp.csv", "control", np.zeros((3, 3)))


def of(draft: ProjectDraft) -> dict[str, tuple[str, str]]:
    return {a.what: (a.value, a.becomes) for a in assumptions(draft)}


def test_everything_that_nothing_states_is_named_with_what_becomes_of_it() -> None:
    said = of(replace(DRAFT, control=(LIST,)))
    assert said["heights"][1].startswith("the photographs tell by how much")
    assert said["focal length of drone"] == ("3000 ± 90 px, EXIF 24 mm", "estimated; a contradiction is reported")
    assert said["read-out time of drone"][0] == "33 ± 12 ms"
    assert said["GNSS positions"][0] == "2 m in plan, 3 m in height"
    assert said["what a flight's positions are off by together"] == ("3, 3, 30 m", "estimated by the control points")
    assert said["attitudes"][0] == "2°"
    assert said["points of gcp.csv"] == ("0.03, 0.03, 0.05 m", "estimated from what they scatter by")
    assert said["marks of gcp.csv"][0] == "1 px"
    assert len(said) == 8


@pytest.mark.parametrize("role", ["control", "check"])
def test_what_is_stated_is_not_assumed(role: Role) -> None:
    file = replace(LIST, role=role, sigma_m=(0.01, 0.01, 0.02), has_marks=False)
    known = replace(CAMERA, sigmas=(0.0,) * 11, shutter=None)
    stated = replace(
        DRAFT, cameras=(known,), control=(file,), height_systems=DraftHeights("ellipsoidal", known=True), gnss_kinds={},
        photographs=(DraftPhotograph("a.jpg", "drone", "1", None, has_attitude=False),),
    )  # fmt: skip
    assert of(stated) == {}


def test_without_control_nothing_tells_what_positions_have_in_common() -> None:
    said = of(DRAFT)
    assert said["what a flight's positions are off by together"][1].startswith("undetermined")
    assert said["heights"][1] == "the results name no height system"
    checks = of(replace(DRAFT, control=(replace(LIST, role="check"),)))
    assert checks["points of gcp.csv"][1] == "not used for accuracy"
