"""Files for those who come to the repository from outside: they say what the project says elsewhere."""

import re
import tomllib
from pathlib import Path
from typing import Any

import pytest
import yaml
from platforms import EXTRAS, PYTHONS

ROOT = Path(__file__).resolve().parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
FORMS = sorted((ROOT / ".github" / "ISSUE_TEMPLATE").glob("*.yml"))


def workflow(name: str) -> Any:
    return yaml.safe_load((ROOT / ".github" / "workflows" / name).read_text(encoding="utf-8"))


def test_the_citation_is_of_this_version_and_licence() -> None:
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert (cited["version"], cited["license"], cited["title"]) == (
        PROJECT["version"], PROJECT["license"], PROJECT["name"],
    )  # fmt: skip


def test_every_python_and_system_is_tested_by_the_two_commands() -> None:
    jobs = workflow("test.yml")["jobs"]
    for job in jobs.values():
        assert tuple(job["strategy"]["matrix"]["python"]) == PYTHONS
    commands = [step["run"] for step in jobs["make"]["steps"] if "run" in step]
    assert commands == ["make demo", "make test"]
    systems = " ".join(jobs["make"]["strategy"]["matrix"]["os"])
    assert all(name in systems for name in ("ubuntu", "arm", "macos", "intel"))
    assert jobs["windows"]["runs-on"].startswith("windows")
    assert PYTHONS[0] == PROJECT["requires-python"].removeprefix(">=")


def test_the_extras_that_are_looked_at_are_those_that_there_are() -> None:
    assert set(EXTRAS) <= set(PROJECT["optional-dependencies"])


def test_a_release_has_no_secrets_and_is_of_its_tag() -> None:
    text = (ROOT / ".github" / "workflows" / "release.yml").read_text(encoding="utf-8")
    assert "secrets." not in text
    jobs = workflow("release.yml")["jobs"]
    assert jobs["publish"]["permissions"] == {"id-token": "write"}
    assert jobs["publish"]["needs"] == "build"
    check = next(step["run"] for step in jobs["build"]["steps"] if step.get("name") == "The tag is the version")
    pattern = re.search(r'"version = .*"', check)
    assert pattern is not None
    assert f'version = "{PROJECT["version"]}"' in (ROOT / "pyproject.toml").read_text(encoding="utf-8").splitlines()


@pytest.mark.parametrize("form", FORMS, ids=[form.stem for form in FORMS])
def test_forms_ask_for_what_they_name_once(form: Path) -> None:
    made = yaml.safe_load(form.read_text(encoding="utf-8"))
    assert made["name"]
    assert made["description"]
    names = [field["id"] for field in made["body"]]
    assert len(names) == len(set(names))
    assert any(field.get("validations", {}).get("required") for field in made["body"])


CONDA_NAMES = {
    "laspy[lazrs]": "laspy",
    "matplotlib": "matplotlib-base",
    "opencv-python-headless": "py-opencv",
    "typing-extensions": "typing_extensions",
}
"""What conda-forge calls a package otherwise than PyPI does."""


def test_the_recipe_needs_what_the_project_needs() -> None:
    recipe = yaml.safe_load((ROOT / "recipe" / "recipe.yaml").read_text(encoding="utf-8"))
    assert recipe["context"]["version"] == PROJECT["version"]
    assert f">={recipe['context']['python_min']}" == PROJECT["requires-python"]
    assert recipe["about"]["license"] == PROJECT["license"]
    assert recipe["about"]["summary"] == PROJECT["description"]
    wanted = {"python >=${{ python_min }}", "lazrs-python >=0.6"}
    for needed in PROJECT["dependencies"]:
        name, least = re.match(r"([\w\[\]-]+)>=([\w.]+)", needed).groups()  # type: ignore[union-attr]
        wanted.add(f"{CONDA_NAMES.get(name, name).lower()} >={least}")
    assert set(recipe["requirements"]["run"]) == wanted


def test_the_recipe_is_one_of_rattler_build() -> None:
    rattler = pytest.importorskip("rattler_build", reason="py-rattler-build reads recipes as conda-forge does")
    stage = rattler.Stage0Recipe.from_file(ROOT / "recipe" / "recipe.yaml")
    (variant,) = stage.render(rattler.VariantConfig())
    made = variant.recipe
    assert (made.package.name, str(made.package.version)) == (PROJECT["name"], PROJECT["version"])
