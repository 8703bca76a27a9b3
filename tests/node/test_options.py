"""Options of a task: what each sets in a project, which are accepted, and what is said of the others."""

import json
from pathlib import Path

import pytest

from photogram.node.options import (
    OPTIONS,
    checked_options,
    init_arguments,
    is_on,
    option_views,
    project_lines,
    value_of,
)
from photogram.node.refusals import RequestError
from photogram.pipeline.pipeline import load_project
from photogram.project.draft.edits import write_values

PRESETS: dict[str, list[dict[str, object]]] = {
    "Default": [{"name": "auto-boundary", "value": True}, {"name": "dsm", "value": True}],
    "DSM + DTM": [{"name": n, "value": True} for n in ("auto-boundary", "dsm", "dtm")],
    "Fast Orthophoto": [{"name": "auto-boundary", "value": True}, {"name": "fast-orthophoto", "value": True}],
    "High Resolution": [
        {"name": "auto-boundary", "value": True}, {"name": "dsm", "value": True},
        {"name": "dem-resolution", "value": "2.0"}, {"name": "orthophoto-resolution", "value": "2.0"},
    ],
    "Forest": [
        {"name": "auto-boundary", "value": True}, {"name": "min-num-features", "value": "18000"},
        {"name": "feature-quality", "value": "ultra"},
    ],
    "Field": [{"name": "fast-orthophoto", "value": True}, {"name": "matcher-neighbors", "value": 4}],
}  # fmt: skip
"""Of WebODM, less the options that a node does not list, which WebODM leaves out."""


def options(**given: object) -> str:
    return json.dumps([{"name": name.replace("_", "-"), "value": value} for name, value in given.items()])


@pytest.mark.parametrize("preset", PRESETS)
def test_presets_of_webodm_are_accepted(preset: str) -> None:
    given = checked_options(json.dumps(PRESETS[preset]))
    assert list(given) == [option["name"] for option in PRESETS[preset]]


def test_what_each_option_sets(survey: Path) -> None:
    """All of them at once, in a project file that is read back."""
    given = checked_options(
        options(
            dtm=True, orthophoto_resolution="2.5", dem_resolution=10, fast_orthophoto=True, feature_quality="high",
            min_num_features="5000", matcher_neighbors=6,
        )
    )  # fmt: skip
    write_values(survey / "project.yaml", project_lines(given), load_project)
    project = load_project(survey / "project.yaml")
    assert (project.quality, project.dense.enabled, project.terrain.enabled) == ("medium", False, True)
    assert (project.orthophoto.cell_m, project.surface.cell_m) == (0.025, 0.1)
    assert (project.features.maximum, project.pairs.maximum, project.pairs.neighbours) == (5000, 6, 6)
    assert project.orthophoto.enabled
    write_values(survey / "project.yaml", project_lines(checked_options(options(skip_orthophoto=1))), load_project)
    project = load_project(survey / "project.yaml")
    assert (project.orthophoto.enabled, project.dense.enabled, project.terrain.enabled) == (False, True, False)
    assert (project.quality, project.surface.cell_m, project.pairs.maximum) == ("high", None, 16)


def test_what_goes_to_init_and_what_is_handed_back() -> None:
    said = init_arguments(checked_options(options(crs="EPSG:25832+7837", heights="orthometric", geoid="EGM96")))
    assert (said.crs, said.heights, said.geoid, said.focal_px) == ("EPSG:25832+7837", "orthometric", "EGM96", None)
    assert init_arguments(checked_options(options(focal_px="604.5"))).focal_px == 604.5
    assert init_arguments({}).crs is None
    assert is_on({}, "dsm")
    assert not is_on(checked_options(options(dsm="false")), "dsm")


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (options(fast_ortophoto=True), "fast-ortophoto: this node has no such option: did you mean fast-orthophoto?"),
        (options(use_3dmesh=True), "use-3dmesh: this node has no such option"),
        (options(orthophoto_resolution=-1), "orthophoto-resolution: must be 0, or from 0.1 to 100000 cm, found -1"),
        (options(orthophoto_resolution="fine"), "orthophoto-resolution: fine is not of type float"),
        (options(orthophoto_resolution="nan"), "orthophoto-resolution: nan is not of type float"),
        (options(min_num_features=2.5), "min-num-features: 2.5 is not of type int"),
        (options(dsm="perhaps"), "dsm: perhaps is not of type bool"),
        (options(feature_quality="lowest"), "feature-quality: lowest is none of ultra, high, medium"),
        (options(auto_boundary=False), "auto-boundary: cannot be switched off on this node"),
        (options(crs="/etc/passwd"), "crs: /etc/passwd is not understood: EPSG:25832, for example"),
        (options(geoid="../x.gtx"), "geoid: ../x.gtx is not understood: EGM84, EGM96, EGM2008 or EPSG:5799"),
        (options(dsm=True)[:-1] + ', {"name": "dsm", "value": true}]', "dsm: is given twice"),
        ("[", "options: this is not JSON"),
        ("[" * 100_000, "options: this is not JSON"),
        ('{"dsm": true}', "options: a list is expected"),
        (options(dsm={"a": 1}), "dsm: {'a': 1} is not of type bool"),
        (options(crs="EPSG:1\n"), "crs: EPSG:1\n is not of type string"),
    ],
)
def test_what_cannot_be_is_said(given: str, said: str) -> None:
    with pytest.raises(RequestError) as caught:
        checked_options(given)
    assert said in str(caught.value)


def test_all_errors_are_said_at_once() -> None:
    with pytest.raises(RequestError, match=r"dms: .*; dem-resolution: "):
        checked_options(options(dms=True, dem_resolution=-2))


def test_options_are_listed_as_nodeodm_lists_them() -> None:
    listed = option_views()
    assert len({option["name"] for option in listed}) == len(listed)
    for view, option in zip(listed, OPTIONS, strict=True):
        assert all(isinstance(view[key], str) for key in ("name", "type", "value", "help"))
        assert (view["type"] == "enum") == isinstance(view["domain"], list)
        assert len(view["help"]) > 10
        again = checked_options(json.dumps([{"name": view["name"], "value": view["value"]}]))  # as clients send it back
        assert again[view["name"]] == option.default == value_of({}, option.name)


def test_the_default_of_what_is_a_setting_is_that_of_the_project(survey: Path) -> None:
    """But for the terrain, which ODM makes only where it is asked for."""
    bare = survey / "bare.yaml"
    text = (survey / "project.yaml").read_text(encoding="utf-8")
    bare.write_text(text[: text.index("features:")] + "comparison:" + text.split("comparison:")[1], encoding="utf-8")
    before = load_project(bare)
    write_values(bare, project_lines({}), load_project)
    after = load_project(bare)
    for section in ("features", "pairs", "dense", "surface", "orthophoto", "quality"):
        assert getattr(after, section) == getattr(before, section), section
