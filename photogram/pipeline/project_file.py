"""Where the project file lies that is given by its folder, and what lies beside it."""

from os.path import isdir  # false, not an exception, for a name that cannot be
from pathlib import Path

PROJECT_FILE = Path("project.yaml")
"""What a project file is called in a folder that is given in its place, or in the working one."""

GEO_TXT = "geo.txt"
"""OpenDroneMap's table of the positions of cameras, in the folder of the photographs or above it."""


def project_file(given: Path) -> Path:
    """Return the project file that is given: itself, or that of a folder."""
    return given / PROJECT_FILE if isdir(given) else given
