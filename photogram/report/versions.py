"""Versions of everything that a result depends on."""

import platform
from importlib.metadata import PackageNotFoundError, version

import cv2
import numpy as np
import scipy

from photogram.geodesy.crs import proj_version


def versions() -> dict[str, str | None]:
    """Return the versions of Python and of the libraries that compute; None where a library does not say."""
    return {
        "python": platform.python_version(),
        "gtsam": _installed("gtsam"),
        "opencv": cv2.__version__,
        "proj": proj_version(),
        "numpy": np.__version__,
        "scipy": scipy.__version__,
        "numba": _installed("numba"),
    }


def _installed(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None
