"""The wheel: one name at its top level, everything in it, and the same from a clone that has lost its links."""

import builtins
import re
import shutil
import subprocess
import sys
import sysconfig
import tomllib
import venv
import zipfile
from pathlib import Path

import pytest

import photogram

ROOT = Path(__file__).resolve().parents[2]
SOURCES = ("photogram", "factors", "cli", "__init__.py", "pyproject.toml", "README.md", "LICENSE")


def build(source: Path, target: Path) -> Path:
    """Build the wheel of a source tree as pip does for a user."""
    command = [sys.executable, "-m", "pip", "wheel", str(source), "--no-deps", "--wheel-dir", str(target)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    if done.returncode and "No matching distribution found for setuptools" in done.stdout + done.stderr:
        pytest.skip("pip cannot fetch setuptools: no network")
    assert done.returncode == 0, done.stdout + done.stderr
    wheels = list(target.iterdir())
    assert [w.name for w in wheels] == [f"photogram-{photogram.__version__}-py3-none-any.whl"]
    return wheels[0]


def copy_sources(target: Path) -> Path:
    """Copy what a clone holds of the package, so that building leaves nothing behind in the repository."""
    target.mkdir()
    for name in SOURCES:
        if (ROOT / name).is_dir():
            ignored = shutil.ignore_patterns("__pycache__")
            shutil.copytree(ROOT / name, target / name, symlinks=True, ignore=ignored)
        else:
            shutil.copy(ROOT / name, target / name)
    return target


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("packaging")
    return build(copy_sources(folder / "clone"), folder / "wheel")


def contents(wheel: Path) -> set[str]:
    with zipfile.ZipFile(wheel) as archive:
        return set(archive.namelist())


def test_links_stand_in_the_repository() -> None:
    for name in ("factors", "cli"):
        assert (ROOT / "photogram" / name).readlink() == Path("..") / name


def test_top_level_is_photogram_alone(wheel: Path) -> None:
    information = f"photogram-{photogram.__version__}.dist-info"
    assert {name.split("/")[0] for name in contents(wheel)} == {"photogram", information}


def test_every_module_is_in_the_wheel(wheel: Path) -> None:
    own = {p.relative_to(ROOT).as_posix() for p in (ROOT / "photogram").rglob("*.py") if "__pycache__" not in p.parts}
    below = [p for folder in ("factors", "cli") for p in (ROOT / folder).rglob("*.py")]
    linked = {f"photogram/{p.relative_to(ROOT).as_posix()}" for p in below}
    assert len(linked) > 10
    modules = {name for name in contents(wheel) if name.endswith(".py")}
    assert modules == own | linked
    assert "photogram/py.typed" in contents(wheel)


def test_wheel_holds_the_templates_of_the_report(wheel: Path) -> None:
    own = {f"photogram/report/templates/{p.name}" for p in (ROOT / "photogram/report/templates").iterdir()}
    assert {"report.html.jinja", "page.css"} <= {Path(name).name for name in own}
    assert own <= contents(wheel)


def test_wheel_names_its_licence_and_its_command(wheel: Path) -> None:
    information = f"photogram-{photogram.__version__}.dist-info"
    with zipfile.ZipFile(wheel) as archive:
        metadata = archive.read(f"{information}/METADATA").decode()
        entry_points = archive.read(f"{information}/entry_points.txt").decode()
        assert archive.read(f"{information}/licenses/LICENSE") == (ROOT / "LICENSE").read_bytes()
    assert "License-Expression: Apache-2.0" in metadata
    assert "photogram = photogram.cli.main:main" in entry_points


def test_clone_without_links_builds_the_same(wheel: Path, tmp_path: Path) -> None:
    clone = copy_sources(tmp_path / "clone")
    for name in ("factors", "cli"):
        (clone / "photogram" / name).unlink()
    other = build(clone, tmp_path / "wheel")
    with zipfile.ZipFile(wheel) as one, zipfile.ZipFile(other) as two:
        assert sorted(one.namelist()) == sorted(two.namelist())
        modules = [name for name in one.namelist() if name.endswith((".py", "py.typed"))]
        assert all(one.read(name) == two.read(name) for name in modules)


@pytest.mark.survey
def test_wheel_runs_outside_the_repository(wheel: Path, tmp_path: Path) -> None:
    site = tmp_path / "site"
    install = [sys.executable, "-m", "pip", "install", "--no-deps", "--no-index", "--target", str(site), str(wheel)]
    subprocess.run(install, check=True, capture_output=True, timeout=300)
    environment = {"PYTHONPATH": str(site), "PATH": "/usr/bin:/bin", "HOME": str(tmp_path)}

    def run(*command: str) -> str:
        done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=120)
        assert done.returncode == 0, done.stderr
        return done.stdout

    where = "import photogram, photogram.factors, photogram.cli as c; print(photogram.__file__, c.__file__, sep='\\n')"
    assert all(Path(line).is_relative_to(site) for line in run(sys.executable, "-c", where).split())
    command = str(site / "bin" / "photogram")
    assert run(sys.executable, command, "--version") == f"photogram {photogram.__version__}\n"
    assert "adjust" in run(sys.executable, command, "--help")


@pytest.fixture
def other_python(tmp_path: Path) -> Path:
    """The Python of an environment that has all libraries of this one, and no photogram."""
    folder = tmp_path / "venv"
    venv.create(folder)
    (site,) = folder.rglob("site-packages")
    (site / "libraries.pth").write_text(sysconfig.get_paths()["purelib"] + "\n", encoding="utf-8")
    return next(path for name in ("bin/python", "Scripts/python.exe") if (path := folder / name).exists())


def pip(python: Path, *arguments: object) -> None:
    command = [sys.executable, "-m", "pip", "--python", str(python), *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stdout + done.stderr


USED = """
import numpy as np
import photogram
import photogram.cli.main
from photogram.surface.ortho.resampling import catmull_rom
catmull_rom(0.5, np.zeros(4))
print(photogram.__version__, photogram.__file__)
"""


@pytest.mark.survey
def test_a_wheel_a_clone_and_a_wheel_follow_each_other(wheel: Path, other_python: Path, tmp_path: Path) -> None:
    """Compiled code kept among the files of a wheel stayed behind, a folder without ``__init__.py`` that was found
    before the clone: cannot import name '__version__'."""
    clone, (site,) = copy_sources(tmp_path / "clone"), (tmp_path / "venv").rglob("site-packages")
    for source, place in ((wheel, site), (clone, clone), (wheel, site)):
        options = ("--editable",) if source is clone else ("--no-index", "--force-reinstall")
        pip(other_python, "install", "--no-deps", *options, source)
        done = subprocess.run(
            [other_python, "-E", "-c", USED], cwd=tmp_path, capture_output=True, text=True, timeout=120
        )
        assert done.stdout.split() == [photogram.__version__, str(place / "photogram/__init__.py")], done.stderr
    kinds = {path.suffix for path in (site / "photogram").rglob("*") if path.is_file() and "__pycache__" in path.parts}
    assert kinds == {".pyc"}
    pip(other_python, "uninstall", "--yes", "photogram")
    assert [path.name for path in site.iterdir() if "photogram" in path.name] == []


def test_a_script_beside_a_clone_finds_the_package(tmp_path: Path) -> None:
    clone = copy_sources(tmp_path / "photogram")
    script = tmp_path / "script.py"
    script.write_text("import photogram as pg, photogram.factors\nprint(pg.__version__, pg.__file__)\n")
    done = subprocess.run([sys.executable, "-E", script], capture_output=True, text=True, timeout=60)
    assert done.stdout.split() == [photogram.__version__, str(clone / "photogram/__init__.py")], done.stderr


def test_no_name_at_the_door_is_one_of_pythons_own() -> None:
    assert set(photogram.__all__) & set(dir(builtins)) == set()


def test_the_version_is_that_of_the_head_of_the_changelog() -> None:
    """Fingerprints of stages contain it: two states of the program with different results must not share one."""
    head = re.search(r"^## \[([\d.]+)\]", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.M)
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert head is not None
    assert head[1] == photogram.__version__ == project["version"]
