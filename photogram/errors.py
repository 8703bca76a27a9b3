"""Errors that a user can fix.

    PhotogramError
    ├── ProjectError        project.yaml says something that cannot be
    ├── SettingError        a setting is out of its range
    ├── ImageError          a photograph is missing, damaged or unfit
    ├── ControlPointError   ground points or their marks contradict each other or the photographs
    ├── FrameError          coordinate reference systems and positions that do not fit together
    ├── OrientationError    a photograph cannot be oriented
    ├── AdjustmentError     the adjustment cannot be solved, or did not converge
    ├── SurfaceError        points and heights are no surface, or not enough of one for what is asked
    ├── WorkspaceError      the folder of intermediate results cannot be used
    │   └── DamagedStageError   a file of a complete stage is not what the stage wrote
    ├── ReportError         the report cannot be made or printed
    └── ExchangeError       a file of another program cannot be read, or cannot hold what is to be written

A message says what is wrong, where, what was found, and what to do. Anything else that is raised is a defect of
photogram.
"""

from __future__ import annotations

import math
from pathlib import Path


class PhotogramError(Exception):
    """Root of all errors that a user can fix."""


class ProjectError(PhotogramError, ValueError):
    """The project file says something that cannot be."""


class ImageError(PhotogramError, ValueError):
    """A photograph is missing, damaged or unfit."""


class ControlPointError(PhotogramError, ValueError):
    """Ground points or their marks contradict each other or the photographs."""


class FrameError(PhotogramError, ValueError):
    """Coordinate reference systems and positions that do not fit together."""


class OrientationError(PhotogramError, ValueError):
    """A photograph cannot be oriented from what is known of it."""


class AdjustmentError(PhotogramError, ArithmeticError):
    """The adjustment cannot be solved, or did not converge."""


class SurfaceError(PhotogramError, ValueError):
    """Points and heights are no surface, or not enough of one for what is asked of it."""


class WorkspaceError(PhotogramError, OSError):
    """The folder of intermediate results cannot be read or written."""


class DamagedStageError(WorkspaceError):
    """A file of a complete stage is missing or is not what the stage wrote; the stage has to be made again."""

    def __init__(self, stage: str, path: Path, what: str) -> None:
        super().__init__(f"{path}: {what}: run photogram adjust, which runs the stage {stage} again")
        self.stage, self.path, self.what = stage, path, what

    def __reduce__(self) -> tuple[type[DamagedStageError], tuple[str, Path, str]]:
        return type(self), (self.stage, self.path, self.what)


class ReportError(PhotogramError, OSError):
    """The report cannot be made or printed."""


class ExchangeError(PhotogramError, ValueError):
    """A file of another program cannot be read, or cannot hold what is to be written."""


class SettingError(PhotogramError, ValueError):
    """A setting cannot be what it is: ``key`` is its name, ``text`` says what it must be and what was found."""

    def __init__(self, key: str, text: str) -> None:
        super().__init__(f"{key}: {text}")
        self.key, self.text = key, text

    def __reduce__(self) -> tuple[type[SettingError], tuple[str, str]]:
        return type(self), (self.key, self.text)


def check_range(key: str, value: float, low: float, high: float = math.inf) -> None:
    """Raise SettingError unless ``low`` ≤ ``value`` ≤ ``high``."""
    if not low <= value <= high:
        limits = f"at least {low:g}" if high == math.inf else f"from {low:g} to {high:g}"
        raise SettingError(key, f"must be {limits}, found {value:g}")


def check_positive(key: str, value: float) -> None:
    """Raise SettingError unless ``value`` is a finite number above 0."""
    if not 0.0 < value < math.inf:
        raise SettingError(key, f"must be a finite number above 0, found {value:g}")
