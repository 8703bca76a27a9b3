"""Where the project file lies that is given by its folder."""

from os.path import isdir  # false, not an exception, for a name that cannot be
from pathlib import Path

PROJECT_FILE = Path("project.yaml")
"""What a project file is called in a folder that is given in its place, or in the working one."""


def project_file(given: Path) -> Path:
    """Return the project file that is given: itself, or that of a folder."""
    return given / PROJECT_FILE if isdir(given) else given
