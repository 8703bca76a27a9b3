"""Settings: ranges that hold at construction, and what a field says of itself; every class of settings of a project."""

from dataclasses import MISSING, dataclass, replace
from typing import Annotated, Any, Literal

import pytest

from photogram.change.m3c2 import M3C2Settings
from photogram.errors import SettingError
from photogram.project.project import SECTIONS
from photogram.settings.settings import Default, Setting, Settings, Title, Within, settings_of
from photogram.simulation.planning.flight_plan import FlightPlan

KINDS = (*SECTIONS.values(), M3C2Settings, FlightPlan)


@dataclass(frozen=True)
class Length(Settings):
    length_m: Annotated[float, Within(0.5, 8, "m"), "How long it is.", Title("length")] = 1.0
    loss: Annotated[Literal["huber", "cauchy"], "How it is judged."] = "huber"


@dataclass(frozen=True)
class Shape(Length):
    width_m: Annotated[float | None, Within(0, 8, "m"), "How wide it is.", Default("its length")] = None
    count: Annotated[int, Within(2, 9, or_zero=True), "How many there are."] = 2


def test_a_range_says_what_it_holds() -> None:
    assert str(Within(1e-5, 1e4, "m", or_zero=True)) == "0, or from 1e-05 to 10000 m"
    assert Within(1, 2, or_zero=True).holds(0)
    assert not Within(1, 2).holds(0)
    assert not Within(1, 2).holds(float("nan"))


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"length_m": 0.4}, "length_m: must be from 0.5 to 8 m, found 0.4"),
        ({"length_m": float("nan")}, "length_m: must be from 0.5 to 8 m, found nan"),
        ({"width_m": 9}, "width_m: must be from 0 to 8 m, found 9"),
        ({"count": 1}, "count: must be 0, or from 2 to 9, found 1"),
        ({"loss": "hubber"}, "loss: must be huber or cauchy, found 'hubber'"),
    ],
)
def test_a_value_out_of_range_is_refused_at_construction(values: dict[str, Any], message: str) -> None:
    with pytest.raises(SettingError) as error:
        Shape(**values)
    assert str(error.value) == message
    with pytest.raises(SettingError):
        replace(Shape(), **values)


def test_values_in_range_are_kept() -> None:
    assert Shape(8.0, "cauchy", None, 0) == Shape(length_m=8, loss="cauchy", width_m=None, count=0)


def test_a_field_says_everything_of_a_setting() -> None:
    length, loss, width, count = settings_of(Shape)
    assert length == Setting("length_m", float, 1.0, Within(0.5, 8, "m"), "length", "How long it is.", "")
    assert (length.unit, loss.unit, count.unit) == ("m", "", "")
    assert (loss.choices, length.choices) == (("huber", "cauchy"), ())
    assert (width.kind, width.default, width.default_words, width.title) == (
        float | None,
        None,
        "its length",
        "width m",
    )


@pytest.mark.parametrize("kind", KINDS)
def test_every_setting_has_a_default_a_sentence_and_a_number_a_range(kind: type[Settings]) -> None:
    kind()  # the defaults lie in their ranges
    for setting in settings_of(kind):
        assert setting.default is not MISSING
        assert setting.sentence.endswith("."), setting.name
        assert bool(setting.default_words) == (setting.default is None), setting.name
        assert (setting.within is not None) == (setting.kind in (float, int, float | None)), setting.name


@pytest.mark.parametrize("kind", KINDS)
def test_the_unit_of_a_setting_is_that_of_its_name(kind: type[Settings]) -> None:
    units = {"_m": "m", "_px": "px", "_deg": "°", "_dn": "grey values", "_cells": "cells"}
    for setting in settings_of(kind):
        named = [unit for suffix, unit in units.items() if setting.name.endswith(suffix)]
        assert setting.within is None or not named or setting.unit == named[0], setting.name
