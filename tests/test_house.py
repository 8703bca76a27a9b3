"""The rooms of the house: how large they are, what they say of themselves, where each module is tested, what may cross
their borders, and which libraries each may import."""

import ast
import importlib
import re
import sys
from collections.abc import Mapping
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
SOURCES = ("photogram", "factors", "cli")
MOST_MODULES = 15
TABLE = Path(__file__).with_name("covered_by.txt")
WINGS = (
    "change",
    "delivery",
    "desk",
    "donation",
    "exchange",
    "local_grids",
    "marking",
    "node",
    "simulation",
    "teaching",
    "verification",
)
COMMANDS = (
    "cli",
    "terminal",
    *(f"{wing}.{room}" for wing in ("change", "exchange", "simulation") for room in ("commands", "work")),
    *(
        f"{wing}.command"
        for wing in ("delivery", "desk", "donation", "local_grids", "marking", "node", "teaching", "verification")
    ),
    *(f"{wing}.work" for wing in ("delivery", "desk", "donation", "local_grids", "marking", "node", "teaching")),
)
LIBRARIES: dict[str, tuple[str, ...]] = {
    "babel": ("languages",),
    "contourpy": ("surface.contours",),
    "defusedxml": ("files.xml_elements", "files.photographs", "files.triangulations"),
    "distributed": ("pipeline.store.cluster",),
    "ezdxf": ("delivery.drawing", "files.triangulations"),
    "gtsam": ("factors.elimination.gtsam_solver", "factors.reference"),
    "jinja2": ("report", "exchange.audit.page"),
    "laspy": ("files.clouds", "change.files"),
    "lazrs": ("files.clouds",),
    "llvmlite": ("compilation", "sfm.tie_points.matchers.byte_distances"),
    "matio": ("files.matlab",),
    "matplotlib": ("report", "simulation.planning.figures", "teaching.figures"),
    "numba": ("compilation", "sfm.tie_points.matchers.byte_distances"),
    "pillow_heif": ("files.photographs.heic",),
    "psutil": ("background.runs", "machine", "pipeline.store.memory"),
    "pyogrio": ("files.maps",),
    "pyproj": ("geodesy", "local_grids.definition"),
    "python_multipart": ("node.forms",),
    "rasterio": ("files.maps", "files.photographs"),
    "rich": COMMANDS,
    "starlette": ("desk", "loopback", "marking.page.addresses", "node"),
    "typer": COMMANDS,
    "uvicorn": ("loopback.socket_server",),
    "yaml": ("project.document", "project.draft.edits"),
}
"""Libraries that stay in few places: the modules and rooms that import them, and nothing else does."""
PAGES = [*sorted((ROOT / "docs").glob("*.md")), *(ROOT / n for n in ("README.md", "DESIGN.md", "CONTRIBUTING.md"))]


def modules() -> dict[str, Path]:
    """Return the path of every module of the three trees by its dotted name, rooms aside."""
    paths = [p for tree in SOURCES for p in sorted((ROOT / tree).rglob("*.py")) if p.name != "__init__.py"]
    dotted = [".".join(p.relative_to(ROOT).with_suffix("").parts) for p in paths]
    return {n if n.startswith("photogram.") else f"photogram.{n}": p for n, p in zip(dotted, paths, strict=True)}


def rooms() -> list[Path]:
    """Return the __init__.py of every room."""
    return [p for tree in SOURCES for p in sorted((ROOT / tree).rglob("__init__.py"))]


def covered() -> dict[str, list[str]]:
    """Return the table of modules that a test of another name covers: the test, and the module between them if any."""
    rows = [line.split() for line in TABLE.read_text(encoding="utf-8").splitlines() if line and line[0] != "#"]
    return {module: rest for module, *rest in rows}


def imports(path: Path, name: str) -> bool:
    """Return whether a file imports a module."""
    text, (parent, _, module) = path.read_text(encoding="utf-8"), name.rpartition(".")
    return re.search(rf"\b{re.escape(name)}\b|from {re.escape(parent)} import [^\n]*\b{module}\b", text) is not None


def own_tests(name: str) -> list[Path]:
    """Return the tests that bear a module's name, in the folder of its room."""
    parts = name.split(".")[1:]
    folder = parts[0] if len(parts) > 1 else "ground_floor"
    return [p for p in (ROOT / "tests" / folder).glob("test_*.py") if p.stem == f"test_{parts[-1]}"]


@pytest.mark.parametrize("room", rooms(), ids=lambda p: p.parent.relative_to(ROOT).as_posix())
def test_a_room_is_small_and_says_what_it_is_for(room: Path) -> None:
    held = [p for p in room.parent.glob("*.py") if p.name != "__init__.py"]
    assert len(held) <= MOST_MODULES
    text = ast.get_docstring(ast.parse(room.read_text(encoding="utf-8")))
    assert text is not None
    if room.parent.name == "photogram":
        return
    assert len(text.splitlines()) == 4, "a line for what it is, an empty one, what it must not do, where to enter"
    name = ".".join(room.parent.relative_to(ROOT).parts)
    package = name if name.startswith("photogram") else f"photogram.{name}"
    for entry in re.findall(r"`([\w.]+)`", text.splitlines()[-1]):
        module, *definition = entry.split(".")
        if package == "photogram.factors.reference":
            pytest.importorskip("gtsam")
        found = importlib.import_module(f"{package}.{module}")
        assert not definition or hasattr(found, definition[0]), entry


@pytest.mark.parametrize("name", modules())
def test_every_module_has_a_test_of_its_name_or_stands_in_the_table(name: str) -> None:
    table = covered()
    if own_tests(name):
        assert name not in table, "the table lists what has no test of its name"
        return
    assert name in table, f"write tests/<room>/test_{name.split('.')[-1]}.py, or name the test that covers it"
    test, *between = table[name]
    assert (ROOT / test).is_file()
    if ".commands." in name or name.endswith(".command"):
        return  # run as a command
    for user in between:
        assert imports(modules()[user], name)
    assert between or imports(ROOT / test, name)


def test_the_table_lists_no_module_that_is_gone() -> None:
    assert set(covered()) <= set(modules())


@cache
def parsed(text: str) -> ast.Module:
    """Return the tree of a module's text."""
    return ast.parse(text)


@cache
def sources() -> dict[str, str]:
    """Return the text of every module by its dotted name, and of every room by that of its ``__init__``."""
    named = {
        **modules(),
        **{".".join(["photogram", *p.relative_to(ROOT).parts]).replace("photogram.photogram", "photogram")[:-3]: p
           for p in rooms()},
    }  # fmt: skip
    return {name: path.read_text(encoding="utf-8") for name, path in named.items()}


@cache
def libraries_of(text: str) -> set[str]:
    """Return the top-level names of what a module imports, wherever in it."""
    nodes = list(ast.walk(parsed(text)))
    plain = {alias.name.split(".")[0] for node in nodes if isinstance(node, ast.Import) for alias in node.names}
    return plain | {n.module.split(".")[0] for n in nodes if isinstance(n, ast.ImportFrom) and n.module is not None}


def test_libraries_stay_in_their_rooms() -> None:
    users = {name: libraries_of(text) for name, text in sources().items()}
    for library, places in LIBRARIES.items():
        rooms_of_it = [f"photogram.{place}" for place in places]
        importing = [name for name, imported in users.items() if library in imported]
        allowed = {name: [r for r in rooms_of_it if name == r or name.startswith(f"{r}.")] for name in importing}
        assert [name for name, by in allowed.items() if not by] == [], f"{library} is imported elsewhere"
        unused = set(rooms_of_it) - {room for by in allowed.values() for room in by}
        assert unused == set() or places is COMMANDS, f"{library} is not imported there: correct the table"


def test_every_library_is_in_the_table_or_common() -> None:
    """A library of the package that no row names is one that many rooms use."""
    common = {
        *("cv2", "markupsafe", "numpy", "photogram", "PIL", "pydantic", "pydantic_core", "scipy", "shapely"),
        *("lazy_loader", "threadpoolctl", "typing_extensions"),
    }
    imported = {library for text in sources().values() for library in libraries_of(text)}
    assert imported - set(sys.stdlib_module_names) - common == set(LIBRARIES)


def types_said(node: ast.AST) -> list[ast.expr]:
    """Return what a definition says of types: of a function's parameters and result, of a class's public members."""
    if isinstance(node, ast.AnnAssign):
        return [node.annotation]
    if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
        a = node.args
        every = [
            *a.posonlyargs,
            *a.args,
            *a.kwonlyargs,
            *([a.vararg] if a.vararg else []),
            *([a.kwarg] if a.kwarg else []),
        ]
        return [note for note in [*(arg.annotation for arg in every), node.returns] if note is not None]
    if isinstance(node, ast.ClassDef):
        members = [(member, name) for member in node.body for name in defined(member)]
        shown = [member for member, name in members if name[0] != "_" or name in ("__init__", "__call__")]
        return [*node.bases, *(note for member in shown for note in types_said(member))]
    return []


def defined(node: ast.AST) -> list[str]:
    """Return the names that a statement defines."""
    if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
        return [node.name]
    targets = node.targets if isinstance(node, ast.Assign) else [node.target] if isinstance(node, ast.AnnAssign) else []
    return [target.id for target in targets if isinstance(target, ast.Name)]


def mappings_of_anything(text: str) -> set[str]:
    """Return the public names of a module that take, give or hold a mapping to ``Any``, under whatever alias."""
    tree, said = parsed(text), r"\b(?:[dD]ict|\w*Mapping)\[str, Any\]"
    while True:
        aliases = {
            name
            for node in tree.body
            if isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None
            for name in defined(node)
            if isinstance(node.value, ast.Name | ast.Subscript | ast.BinOp) and re.search(said, ast.unparse(node.value))
        }
        wider = "|".join([r"\b(?:[dD]ict|\w*Mapping)\[str, Any\]", *(rf"\b{name}\b" for name in sorted(aliases))])
        if wider == said:
            break
        said = wider
    named = {
        name
        for node in tree.body
        for name in defined(node)
        if any(re.search(said, ast.unparse(a)) for a in types_said(node))
    }
    return {name for name in named | aliases if name[0] != "_"}


def used_names(text: str, module: str) -> set[str]:
    """Return the names of a module that a text imports, or takes from the module itself."""
    tree, (room, _, own) = parsed(text), module.rpartition(".")
    names, called = set[str](), {module}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module == module:
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module == room:
            called |= {alias.asname or alias.name for alias in node.names if alias.name == own}
        elif isinstance(node, ast.Import):
            called |= {alias.asname for alias in node.names if alias.name == module and alias.asname}
    taken = [node for node in ast.walk(tree) if isinstance(node, ast.Attribute)]
    return names | {node.attr for node in taken if ast.unparse(node.value) in called}


def untyped_crossings(texts: Mapping[str, str]) -> list[str]:
    """Return who uses a mapping of anything from another room, of modules given by name and text."""
    found = []
    for module, text in texts.items():
        untyped, room = mappings_of_anything(text), module.rpartition(".")[0]
        for user, own in texts.items() if untyped else ():
            if user.rpartition(".")[0] != room:
                found += [f"{user}: {module}.{name}" for name in sorted(untyped & used_names(own, module))]
    return found


def test_no_mapping_of_anything_crosses_a_border() -> None:
    assert untyped_crossings(sources()) == []


@pytest.mark.parametrize(
    "text",
    [
        "def f(x: dict[str, Any]) -> None: ...",
        "def f(*, x: list[Mapping[str, Any]] | None = None) -> None: ...",
        "async def f() -> dict[str, Any]: ...",
        "Json = dict[str, Any]\nNotes = list[Json]\ndef f() -> Notes: ...",
        "f = dict[str, Any]",
        "f: dict[str, Any] = {}",
        "class f:\n    def m(self) -> dict[str, Any]: ...",
        "class f:\n    def __init__(self, x: dict[str, Any]) -> None: ...",
        "class f:\n    x: MutableMapping[str, Any]",
        "class f(dict[str, Any]): ...",
    ],
)
@pytest.mark.parametrize(
    "use",
    [
        "from photogram.lower.a import f",
        "if TYPE_CHECKING:\n    from photogram.lower.a import f",
        "from photogram.lower import a\na.f",
        "import photogram.lower.a as low\nlow.f",
        "import photogram.lower.a\nphotogram.lower.a.f",
    ],
)
def test_a_mapping_of_anything_that_crosses_is_found(text: str, use: str) -> None:
    lower = "photogram.lower.a"
    assert untyped_crossings({lower: text, "photogram.upper.b": use}) == [f"photogram.upper.b: {lower}.f"]
    assert untyped_crossings({lower: text, "photogram.lower.b": use}) == []


@pytest.mark.parametrize(
    "text",
    [
        "def f(x: dict[str, int]) -> None:\n    y: dict[str, Any] = {}",
        "def _g(x: dict[str, Any]) -> None: ...\ndef f() -> None: ...",
        "class f:\n    def _m(self) -> dict[str, Any]: ...",
    ],
)
def test_a_mapping_of_anything_within_a_module_may_stay(text: str) -> None:
    assert untyped_crossings({"photogram.lower.a": text, "photogram.b": "from photogram.lower.a import f"}) == []


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_paths_of_modules_in_the_docs_exist(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    paths = set(re.findall(r"(?<![\w/.])((?:photogram|factors|cli|tests|benchmarks)/[\w/]+\.py)\b", text))
    assert [p for p in sorted(paths) if not (ROOT / p).is_file()] == []
    dotted = set(re.findall(r"(?<![\w/])(photogram(?:\.[a-z_]\w*)+)", text))
    assert [d for d in sorted(dotted) if not resolves(d)] == []


def resolves(dotted: str) -> bool:
    """Return whether a dotted name is a module, a room, or something that one of them defines."""
    parts = dotted.split(".")
    if parts[-1] in ("yaml", "py", "json", "egg", "lock", "txt"):
        return True
    for count in range(len(parts), 0, -1):
        try:
            found: object = importlib.import_module(".".join(parts[:count]))
        except ModuleNotFoundError:
            continue
        for part in parts[count:]:
            if not hasattr(found, part):
                return False
            found = getattr(found, part)
        return True
    return False
