"""Which systems and Pythons photogram installs on from wheels alone, and how much is downloaded.

    python tests/platforms.py                or: make platforms

Nothing is installed: `pip install --dry-run --only-binary=:all:` resolves the dependencies of pyproject.toml for each
system and Python, and each extra by itself. pip evaluates the markers of the running interpreter whatever --platform
says, so those of pyproject.toml are evaluated here, for the system that is asked for; those of the dependencies' own
dependencies are not (on Windows Typer brings colorama beside what is counted, 0.03 MB). What does not resolve is named
and left out, so that all of it is found. Needs a network, and some minutes.
"""

import json
import re
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from urllib.parse import unquote, urlsplit
from urllib.request import Request, urlopen

from packaging.requirements import Requirement

ROOT = Path(__file__).resolve().parents[1]
PYTHONS = ("3.11", "3.12", "3.13", "3.14")
EXTRAS = ("matlab", "change", "heic", "cluster")


@dataclass(frozen=True)
class System:
    """A system by the tags of its wheels, the ones that pip does not know to follow from another, and by what markers
    call it."""

    name: str
    tags: tuple[str, ...]
    sys_platform: str
    platform_system: str
    os_name: str
    machine: str

    def markers(self, python: str) -> dict[str, str]:
        """Return the environment of markers for a Python."""
        return {
            "sys_platform": self.sys_platform,
            "platform_system": self.platform_system,
            "os_name": self.os_name,
            "platform_machine": self.machine,
            "python_version": python,
            "python_full_version": f"{python}.0",
            "implementation_name": "cpython",
            "platform_python_implementation": "CPython",
            "extra": "",
        }


def _linux(machine: str) -> tuple[str, ...]:
    return (*(f"manylinux_2_{n}_{machine}" for n in range(28, 16, -1)), f"manylinux2014_{machine}")


SYSTEMS = (
    System("Windows, x86-64", ("win_amd64",), "win32", "Windows", "nt", "AMD64"),
    System("macOS 14, ARM", ("macosx_14_0_arm64",), "darwin", "Darwin", "posix", "arm64"),
    System("macOS 14, Intel", ("macosx_14_0_x86_64",), "darwin", "Darwin", "posix", "x86_64"),
    System("macOS 15, Intel", ("macosx_15_0_x86_64",), "darwin", "Darwin", "posix", "x86_64"),
    System("Linux, x86-64 (glibc 2.28)", _linux("x86_64"), "linux", "Linux", "posix", "x86_64"),
    System("Linux, ARM (glibc 2.28)", _linux("aarch64"), "linux", "Linux", "posix", "aarch64"),
)


@dataclass(frozen=True)
class Resolved:
    """The wheels that would be installed, by name, with their bytes, and what has none."""

    wheels: dict[str, int]
    missing: tuple[str, ...]

    @property
    def megabytes(self) -> float:
        """Return how much is downloaded."""
        return sum(self.wheels.values()) / 1e6


@cache
def size_bytes(address: str) -> int:
    """Return the size of a wheel."""
    parts = urlsplit(address)
    if parts.scheme == "file":
        return Path(unquote(parts.path)).stat().st_size
    with urlopen(Request(address, method="HEAD"), timeout=60) as answer:
        return int(answer.headers["Content-Length"])


def wanted(lines: Sequence[str], system: System, python: str) -> list[str]:
    """Return the requirements that hold on a system, without their markers."""
    kept = []
    for requirement in map(Requirement, lines):
        if requirement.marker is None or requirement.marker.evaluate(system.markers(python)):
            requirement.marker = None
            kept.append(str(requirement))
    return kept


def resolved(requirements: Sequence[str], system: System, python: str) -> Resolved:
    """Resolve requirements for a system and a Python. Raises SystemExit with what pip says where it fails for another
    reason than a missing wheel."""
    left, missing = list(requirements), list[str]()
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.json"
        while left:
            call = [sys.executable, "-m", "pip", "install", "--dry-run", "--quiet", "--ignore-installed"]
            call += ["--disable-pip-version-check", "--only-binary=:all:", "--python-version", python]
            call += [word for tag in system.tags for word in ("--platform", tag)]
            call += ["--target", f"{folder}/none", "--report", str(report), *left]
            done = subprocess.run(call, capture_output=True, text=True)
            if done.returncode == 0:
                items = json.loads(report.read_text(encoding="utf-8"))["install"]
                wheels = {item["metadata"]["name"]: size_bytes(item["download_info"]["url"]) for item in items}
                return Resolved(wheels, tuple(missing))
            lost = re.search(r"No matching distribution found for ([\w.\[\]-]+)", done.stderr)
            gone = [line for line in left if lost and _name(line) == _name(lost[1])]
            if not gone:
                if len(left) == 1 and lost:
                    return Resolved({}, (*missing, f"{_name(left[0])} (for want of {lost[1]})"))
                raise SystemExit(f"{system.name}, Python {python}: {done.stderr[-2000:]}")
            missing += [_name(line) for line in gone]
            left = [line for line in left if line not in gone]
    return Resolved({}, tuple(missing))


def _name(requirement: str) -> str:
    return re.split(r"[^\w.-]", requirement)[0].lower().replace("_", "-")


def main() -> None:
    """Print the tables."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    print("| system | Python | wheels | MB | largest, MB | no wheels for | extras without wheels |")
    print("|---|---|---|---|---|---|---|")
    for system in SYSTEMS:
        for python in PYTHONS:
            found = resolved(wanted(project["dependencies"], system, python), system, python)
            extras = []
            for extra in EXTRAS:
                lines = wanted(project["optional-dependencies"][extra], system, python)
                if resolved(lines, system, python).missing:
                    extras.append(extra)
            largest = sorted(found.wheels, key=found.wheels.__getitem__, reverse=True)[:3]
            said = ", ".join(f"{name} {found.wheels[name] / 1e6:.0f}" for name in largest)
            print(
                f"| {system.name} | {python} | {len(found.wheels)} | {found.megabytes:.0f} | {said} "
                f"| {', '.join(found.missing) or '–'} | {', '.join(extras) or '–'} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
