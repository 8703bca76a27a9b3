"""The front door: every public name resolves, says what it takes and returns, and is listed; importing it is quick."""

import ast
import importlib
import inspect
import re
import subprocess
import sys
import textwrap
from itertools import pairwise
from pathlib import Path

import pytest

import photogram as pg

SOURCE = Path(pg.__file__)
STUB = SOURCE.with_suffix(".pyi")
NAMES = [name for name in pg.__all__ if name != "__version__"]
ARRAYS = re.compile(r"FloatArray|IntArray|ByteArray|BoolArray|NDArray")
SHAPE = re.compile(r"\([A-Za-z]\w*( \+ 1)?(, ?[\w ]+)*,?\)|\(\d+( [A-Z])?(, \d+( [A-Z])?)*,?\)")
UNIT = re.compile(r"\bm\b|\bpx\b|pixels?\b|\brad\b|_m\b|_px\b|_rad\b|metres")


def places() -> dict[str, str]:
    """Return the module of every public name as the stub has it."""
    tree = ast.parse(STUB.read_text(encoding="utf-8"))
    lines = [node for node in tree.body if isinstance(node, ast.ImportFrom)]
    return {alias.name: f"photogram.{line.module}" for line in lines for alias in line.names}


def test_the_stub_lists_what_it_imports() -> None:
    (listed,) = [
        node.value
        for node in ast.parse(STUB.read_text(encoding="utf-8")).body
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__"
    ]
    assert ast.literal_eval(listed) == sorted([*places(), "__version__"])
    assert sorted(pg.__all__) == ast.literal_eval(listed)


def test_nothing_imports_for_type_checkers_alone() -> None:
    root = SOURCE.parents[1]
    sources = [p for tree in ("photogram", "factors", "cli") for p in (root / tree).rglob("*.py")]
    assert [p for p in sources if "TYPE_CHECKING" in p.read_text(encoding="utf-8")] == []


@pytest.mark.parametrize(("former", "present"), sorted(pg._FORMER_NAMES.items()))  # type: ignore[attr-defined]
def test_names_of_the_last_version_say_what_they_are_called_now(former: str, present: str) -> None:
    with pytest.warns(DeprecationWarning, match=rf"photogram\.{former} is called photogram\.{present} now"):
        assert getattr(pg, former) is getattr(pg, present)


@pytest.mark.parametrize("name", NAMES)
def test_a_name_resolves_and_is_documented(name: str) -> None:
    found = getattr(pg, name)
    assert found is getattr(importlib.import_module(places()[name]), name)
    assert name in dir(pg)
    text = inspect.getdoc(found)
    assert text is not None
    assert not text.startswith(f"{name}("), "dataclasses' own docstring says nothing"
    assert text.split("\n\n")[0].rstrip().endswith("."), "the purpose, in a sentence"


def documented_fields(kind: type) -> dict[str, str]:
    """Return the docstrings that stand below the fields of a class, by field."""
    (tree,) = ast.parse(textwrap.dedent(inspect.getsource(kind))).body
    assert isinstance(tree, ast.ClassDef)
    return {
        ast.unparse(above.target): str(below.value.value)
        for above, below in pairwise(tree.body)
        if isinstance(above, ast.AnnAssign)
        and isinstance(below, ast.Expr)
        and isinstance(below.value, ast.Constant)
        and isinstance(below.value.value, str)
    }


@pytest.mark.parametrize("name", NAMES)
def test_what_takes_or_holds_arrays_says_shapes_and_units(name: str) -> None:
    found, fields = getattr(pg, name), dict[str, str]()
    if inspect.isclass(found):
        notes = {field: str(note) for field, note in vars(found).get("__annotations__", {}).items()}
        held, fields = list(notes.values()), documented_fields(found)
        if fields:
            arrays = [field for field, note in notes.items() if ARRAYS.search(note)]
            assert [field for field in arrays if not SHAPE.search(fields[field])] == [], "arrays without a shape"
    else:
        held = [str(parameter.annotation) for parameter in inspect.signature(found).parameters.values()]
        held.append(str(inspect.signature(found).return_annotation))
    if not any(ARRAYS.search(note) for note in held):
        return
    text = "\n".join([inspect.getdoc(found) or "", *(f"{field}: {said}" for field, said in fields.items())])
    assert SHAPE.search(text), f"{name} says no shape"
    assert UNIT.search(text), f"{name} says no unit"


@pytest.mark.parametrize("name", [n for n in NAMES if inspect.isfunction(getattr(pg, n))])
def test_a_function_says_what_it_raises(name: str) -> None:
    found = getattr(pg, name)
    text, source = inspect.getdoc(found) or "", inspect.getsource(found)
    if re.search(r"^\s+raise \w", source, re.M):
        assert re.search(r"[Rr]aises", text), f"{name} raises, and does not say so"


@pytest.mark.parametrize("name", [n for n in NAMES if inspect.isfunction(getattr(pg, n))])
def test_nobody_has_to_follow_the_progress_of_a_function(name: str) -> None:
    progress = inspect.signature(getattr(pg, name)).parameters.get("progress")
    assert progress is None or progress.default is not progress.empty


def test_every_fault_that_a_user_can_mend_is_at_the_door() -> None:
    errors = importlib.import_module("photogram.errors")
    kinds = {n for n, k in vars(errors).items() if inspect.isclass(k) and issubclass(k, pg.PhotogramError)}
    assert kinds <= set(NAMES)


def test_no_name_hides_a_module() -> None:
    modules = {p.stem for p in SOURCE.parent.iterdir() if p.stem != "__init__"}
    assert modules & set(NAMES) == set()


def test_an_unknown_name_is_an_ordinary_mistake() -> None:
    with pytest.raises(AttributeError, match="No photogram attribute adjusst"):
        pg.adjusst  # type: ignore[attr-defined]  # noqa: B018


def test_importing_imports_nothing_that_computes() -> None:
    program = (
        "import sys, time; start = time.process_time(); import photogram; "
        "print(time.process_time() - start, *sorted({name.partition('.')[0] for name in sys.modules}))"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, timeout=60)
    seconds, *modules = done.stdout.split()
    assert not {"numpy", "numba", "cv2", "gtsam", "rasterio", "scipy"} & set(modules)
    assert float(seconds) < 0.2


def test_the_main_types_show_themselves_in_a_line() -> None:
    import numpy as np

    camera = pg.Camera("wide", 400, 300, 600.0, np.array([199.5, 149.5]))
    pose = pg.Pose(np.diag([1.0, -1.0, -1.0]), np.array([1.0, 2.0, 40.0]))
    frame = pg.LocalFrame("EPSG:25832", (600000.0, 5800000.0, 100.0))
    photograph = pg.Photograph("a.jpg", 0, gnss_world_m=np.zeros(3), gnss_sigma_m=np.ones(3))
    none = np.zeros(0, np.int64)
    ties = pg.TiePoints(
        np.array([0]),
        np.array([0]),
        np.array([0]),
        np.zeros((1, 2)),
        np.ones(1),
        np.zeros((1, 3)),
        np.zeros((1, 3), np.uint8),
    )
    ground = pg.ControlPoints(
        ("P1", "P2"),
        ("control", "check"),
        np.zeros((2, 3)),
        np.ones((2, 3)),
        none,
        none,
        np.zeros((0, 2)),
        np.zeros((0, 2, 2)),
    )
    block = pg.Block(frame, (camera,), (photograph,), (pose,), ties, ground)
    shown = {
        camera: "<Camera wide: 400 × 300 px, brown, f 600.00 px>",
        pose: "<Pose at 1.000, 2.000, 40.000 m (world)>",
        frame: "<LocalFrame tangent in EPSG:25832, origin 600000.00, 5800000.00, 100.00 m>",
        photograph: "<Photograph a.jpg: camera 0, flight 1, GNSS measured>",
        ties: "<TiePoints: 1 point, 1 observation>",
        ground: "<ControlPoints: 1 control point, 1 check point, 0 marks>",
        block: "<Block: 1 photograph (1 oriented), 1 camera, 1 tie point, 2 ground points>",
        pg.PointCloud(np.zeros((3, 3)), sigma_m=np.ones((3, 3))): "<PointCloud: 3 points, with sigma>",
        pg.Raster(
            np.array([[1.0, np.nan]], np.float32), 0.0, 0.0, 0.5
        ): "<Raster: 1 × 2 cells of 0.5 m, 50\u202f% with data>",
    }
    for value, line in shown.items():
        assert repr(value) == line
    named = pg.Camera("<script>", 400, 300, 600.0, np.zeros(2))
    assert "&lt;script&gt;" in pg.Block(frame, (named,), (), (), ties, ground)._repr_html_()
