"""The container file, as far as it can be checked without building it: files, versions, user, command."""

import json
import re
import shlex
import tomllib
from typing import Any

import pytest
from test_house import ROOT
from typer.main import get_command

from photogram.cli import main  # noqa: F401 - its commands register
from photogram.cli.app import app
from photogram.node.command import PORT

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


def instructions() -> list[tuple[str, str]]:
    """Return the instructions of the file, each on one line, comments left out."""
    text = (ROOT / "Containerfile").read_text(encoding="utf-8")
    lines = "\n".join(line for line in text.splitlines() if not line.startswith("#")).replace("\\\n", " ").splitlines()
    pairs = (line.split(maxsplit=1) for line in lines if line.strip())
    return [(name, value) for name, value in pairs]


def stages() -> list[list[tuple[str, str]]]:
    found: list[list[tuple[str, str]]] = []
    for name, value in instructions():
        if name == "FROM":
            found.append([])
        found[-1].append((name, value))
    return found


def of(name: str) -> list[str]:
    """Return the values of an instruction in the last stage."""
    return [value for own, value in stages()[-1] if own == name]


def test_the_image_is_built_in_two_stages_of_one_python_that_photogram_runs_on() -> None:
    assert len(stages()) == 2
    bases = {re.sub(r" AS \w+$", "", stage[0][1]) for stage in stages()}
    assert len(bases) == 1, "the environment of one stage runs on the Python of the other"
    (version,) = re.findall(r"/python:(\d+\.\d+)-", bases.pop())
    assert f"Programming Language :: Python :: {version}" in PROJECT["project"]["classifiers"]


def test_every_file_that_is_copied_exists_and_is_not_left_out() -> None:
    listed = (ROOT / ".dockerignore").read_text(encoding="utf-8").splitlines()
    kept = {line[1:] for line in listed if line.startswith("!")}
    assert "*" in listed
    copied = [path for name, value in stages()[0] if name == "COPY" for path in value.split()[:-1]]
    assert set(copied) == kept
    assert all((ROOT / path).exists() for path in copied)


def test_what_is_copied_is_the_whole_package() -> None:
    copied = {path for name, value in stages()[0] if name == "COPY" for path in value.split()[:-1]}
    folders = PROJECT["tool"]["setuptools"]["package-dir"]
    for package in PROJECT["tool"]["setuptools"]["packages"]:
        first = ".".join(package.split(".")[:2])
        assert folders.get(first, "photogram") in copied, package
    assert PROJECT["project"]["readme"] in copied
    assert set(PROJECT["project"]["license-files"]) <= copied


def test_nothing_runs_as_root() -> None:
    (user,) = of("USER")
    assert user.isdecimal()
    assert int(user) > 0
    assert f"--uid {user} " in " ".join(of("RUN"))
    names = [name for name, _ in stages()[-1]]
    assert names.index("USER") < names.index("ENTRYPOINT")


def test_the_image_runs_the_command_that_is_installed_as_a_node_that_others_reach() -> None:
    (program,) = json.loads(of("ENTRYPOINT")[0])
    assert program in PROJECT["project"]["scripts"]
    name, *arguments = json.loads(of("CMD")[0])
    command: Any = get_command(app).commands[name]  # type: ignore[attr-defined]
    given = command.make_context(name, list(arguments)).params
    assert (given["nodeodm"], given["host"], given["port"]) == (True, "0.0.0.0", PORT)
    assert of("EXPOSE") == [str(PORT)]
    assert str(given["folder"]).startswith(f"{of('VOLUME')[0]}/")
    assert str(PORT) in of("HEALTHCHECK")[0]


@pytest.mark.parametrize("number", range(len(stages())))
def test_what_the_shell_runs_is_whole(number: int) -> None:
    for name, value in stages()[number]:
        if name == "RUN":
            assert shlex.split(value)
