"""Settings: a setting is one annotated field of a dataclass, and everything that is said of it follows from there.

    @dataclass(frozen=True)
    class OrthophotoSettings(Settings):
        feather_cells: Annotated[float, Within(0, 8, "cells"), "Width of a seam; 0 is a sharp one."] = 4.0

The value is checked when an object is made; the errors of project.yaml and its JSON Schema, the tables of
docs/project-file.md and the words of the report are made of the same field.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cache
from typing import Annotated, Any, ClassVar, Literal, get_args, get_origin, get_type_hints

from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic_core import CoreSchema, core_schema

from photogram.errors import SettingError
from photogram.wording import shortened


@dataclass(frozen=True)
class Choices:
    """The values that a text may have, as metadata of its type: where code finds them, so that no Literal can."""

    values: tuple[str, ...]

    def __get_pydantic_core_schema__(self, source: object, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Let pydantic take these values alone."""
        return core_schema.literal_schema(list(self.values))


@dataclass(frozen=True)
class Within:
    """The range of a number, ends included, as metadata of a type; where ``or_zero``, 0 is allowed beside it."""

    low: float
    high: float
    unit: str = ""
    or_zero: bool = False

    def holds(self, value: float) -> bool:
        """Whether the number lies in the range."""
        return self.low <= value <= self.high or (self.or_zero and value == 0)

    def __str__(self) -> str:
        zero = "0, or " if self.or_zero else ""
        return f"{zero}from {self.low:.15g} to {self.high:.15g}{f' {self.unit}' if self.unit else ''}"

    @property
    def limits(self) -> dict[str, object]:
        """The range in keywords of JSON Schema."""
        limits: dict[str, object] = {"minimum": self.low, "maximum": self.high}
        return {"if": {"not": {"const": 0}}, "then": limits} if self.or_zero else limits

    def check(self, value: float | None) -> float | None:
        """Return the number, or None where none is given. Raises ValueError where it is out of range."""
        if value is not None and not self.holds(value):
            number = f"{value:.15g}" if isinstance(value, float) else shortened(str(value))
            raise ValueError(f"must be {self}, found {number}")
        return value

    def __get_pydantic_core_schema__(self, source: object, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Let pydantic check the number once its type is right."""
        return core_schema.no_info_after_validator_function(self.check, handler(source))

    def __get_pydantic_json_schema__(self, core: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, object]:
        """Return the JSON Schema of the number."""
        return {**handler(core), **self.limits}


@dataclass(frozen=True)
class Default:
    """What a field that is None by default stands for, in words."""

    words: str


@dataclass(frozen=True)
class Title:
    """What a report calls a setting; else it is its name without unit."""

    words: str


@dataclass(frozen=True)
class Setting:
    """What an annotated field says of a setting."""

    name: str
    """Its key."""
    kind: object
    """Its type."""
    default: object
    """Its default, of that type."""
    within: Within | None
    """The range of a number."""
    title: str
    """What a report calls it."""
    sentence: str
    """What it is, in one sentence."""
    default_words: str
    """What a default of None stands for."""

    @property
    def unit(self) -> str:
        """The unit of a number, empty without one."""
        return self.within.unit if self.within else ""

    @property
    def choices(self) -> tuple[object, ...]:
        """The values of which it has one; none where it is a number, text, true or false."""
        return get_args(self.kind) if get_origin(self.kind) is Literal else ()

    def check(self, value: Any) -> None:  # noqa: ANN401
        """Raise SettingError where the value is out of range, or none of the choices."""
        if self.within:
            try:
                self.within.check(value)
            except ValueError as reason:
                raise SettingError(self.name, str(reason)) from None
        elif self.choices and value not in self.choices:
            words = f"{', '.join(map(str, self.choices[:-1]))} or {self.choices[-1]}"
            raise SettingError(self.name, f"must be {words}, found {value!r}")


def _one(marks: Sequence[object], kind: type[Any]) -> Any:  # noqa: ANN401
    return next((mark for mark in marks if isinstance(mark, kind)), None)


def settings_of(kind: type[Any]) -> tuple[Setting, ...]:
    """Return the settings that a dataclass consists of, in the order of its fields."""
    return _settings_of(kind)  # type: ignore[arg-type]  # mypy takes no class for hashable


@cache
def _settings_of(kind: type[Any]) -> tuple[Setting, ...]:
    hints = get_type_hints(kind, include_extras=True)
    settings = []
    for field in fields(kind):
        hint = hints[field.name]
        of_type, *marks = get_args(hint) if get_origin(hint) is Annotated else (hint,)
        title, words = _one(marks, Title), _one(marks, Default)
        choices = _one(marks, Choices)
        settings.append(
            Setting(
                name=field.name,
                kind=Literal[choices.values] if choices else of_type,
                default=field.default,
                within=_one(marks, Within),
                title=title.words if title else field.name.replace("_", " "),
                sentence=_one(marks, str) or "",
                default_words=words.words if words else "",
            )
        )
    return tuple(settings)


class Settings:
    """Base of the dataclasses of settings: a value out of its range is refused when an object is made."""

    gone: ClassVar[Mapping[str, str]] = {}
    """Settings of earlier versions, and what is said where a project file still has them."""

    def __post_init__(self) -> None:
        """Check every value. Raises SettingError, which names the setting, what it must be and what was found."""
        for setting in settings_of(type(self)):
            setting.check(getattr(self, setting.name))
