"""Run the demo and tests with the oldest versions of all libraries that pyproject.toml allows, or with the newest.

    python tests/versions.py oldest
    python tests/versions.py newest --python python3.13

Each end has an environment of its own in build/versions, so that continuous integration can do one at a time.
"""

import argparse
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Literal

from packaging.requirements import Requirement

ROOT = Path(__file__).resolve().parents[1]
LOOKED_AT = ("numpy", "opencv-python-headless", "gtsam", "numba", "pyproj", "rasterio", "scipy", "pydantic", "typer")
"""Libraries whose versions are shown."""
TESTS = ("adjustment", "factors", "files", "geodesy", "project", "sfm", "surface", "surveys/test_resume.py")
"""Of the rooms that call these libraries most."""
TOOLS = (
    *("hypothesis", "jsonschema", "markdown-it-py", "pillow-heif", "pypdf"),
    *("pytest", "pytest-xdist", "rio-cogeo", "selenium"),
)
"""What these tests need beside the libraries. The extra `test` has more, some of which need newer ones."""

End = Literal["oldest", "newest"]


def constraints(end: End) -> list[str]:
    """Return what pip must hold to: each library at the lowest version that is allowed, or nothing."""
    if end == "newest":
        return []
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    held = []
    for needed in project["dependencies"]:
        wanted = Requirement(needed)
        lowest = next(each.version for each in wanted.specifier if each.operator == ">=")
        held.append(f"{wanted.name}=={lowest}" if lowest.count(".") > 1 else f"{wanted.name}=={lowest}.*")
    return held


def main() -> None:
    """Make the environment, show its versions, run demo and tests in it."""
    parser = argparse.ArgumentParser(description="Run the demo and tests at one end of the allowed versions.")
    parser.add_argument("end", choices=("oldest", "newest"))
    parser.add_argument("--python", default=sys.executable, help="the interpreter (default: this one)")
    asked = parser.parse_args()
    folder = ROOT / "build" / "versions" / asked.end
    folder.mkdir(parents=True, exist_ok=True)
    environment, held = folder / "environment", folder / "constraints.txt"
    held.write_text("\n".join(constraints(asked.end)) + "\n", encoding="utf-8")
    subprocess.run([asked.python, "-m", "venv", "--clear", environment], check=True)
    python = environment / ("Scripts" if sys.platform == "win32" else "bin") / "python"
    install = [python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--constraint", held]
    subprocess.run([*install, ROOT, *TOOLS], check=True)
    shown = subprocess.run(
        [python, "-m", "pip", "list", "--format", "freeze"], check=True, capture_output=True, text=True
    )
    for line in shown.stdout.splitlines():
        if line.partition("==")[0].lower() in LOOKED_AT:
            print(line, flush=True)
    shutil.rmtree(folder / "demo", ignore_errors=True)
    command = "from photogram.cli.main import main; main()"
    subprocess.run([python, "-c", command, "demo", folder / "demo"], check=True, cwd=folder)
    tests = [ROOT / "tests" / name for name in TESTS]
    subprocess.run([python, "-m", "pytest", "-q", "-n", "auto", "-p", "no:cacheprovider", *tests], check=True, cwd=ROOT)


if __name__ == "__main__":
    main()
