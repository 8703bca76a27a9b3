"""The libraries that come with the page: whole, with their licences, and asking nothing of anybody else."""

import re

import pytest
from vendored import FOLDER, PACKAGES


@pytest.mark.parametrize("package", PACKAGES)
def test_every_library_lies_there_with_its_licence(package: str) -> None:
    files = PACKAGES[package].values()
    assert [name for name in files if not (FOLDER / name).is_file()] == []
    licence = next(FOLDER / name for name in files if "LICENSE" in name).read_text(encoding="utf-8")
    assert re.search("Redistribution and use|Permission is hereby granted", licence)


def test_nothing_else_lies_there_and_nothing_names_a_map_of_its_source() -> None:
    listed = {name for files in PACKAGES.values() for name in files.values()}
    assert {path.name for path in FOLDER.iterdir()} == listed
    assert [path.name for path in FOLDER.glob("*.js") if b"sourceMappingURL" in path.read_bytes()[-200:]] == []
    assert '"10.11.0"' in (FOLDER / "ol.js").read_text(encoding="utf-8")
