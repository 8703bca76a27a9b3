"""project.yaml as it is written: its keys, their types, and the line of each.

Blocks are checked by pydantic. A value that cannot be is noted with its line and read as absent, so that one reading
finds every error of a file; the messages are photogram's own.
"""

from __future__ import annotations

import dataclasses
import difflib
import json
import re
from collections.abc import Callable, Collection, Iterator, Mapping
from functools import cache, lru_cache
from pathlib import Path
from typing import Annotated, Any, ClassVar, TypeVar, get_type_hints

import yaml
from pydantic import BaseModel, ConfigDict, Field, GetJsonSchemaHandler, ValidationError, create_model
from pydantic.fields import FieldInfo
from pydantic_core import CoreSchema, ErrorDetails

from photogram.errors import ProjectError, SettingError
from photogram.files.reading import read_whole
from photogram.project.findings import Finding
from photogram.settings.settings import Default, Within
from photogram.wording import shortened

Key = tuple[str | int, ...]
"""Where a value stands in the file: keys of blocks, and numbers of list items from 0."""

EntryT = TypeVar("EntryT", bound="Entry")
SettingsT = TypeVar("SettingsT")
ValueT = TypeVar("ValueT")


MOST_BYTES = 1_000_000
"""Of a project file: some 10 000 photographs, each with its position; PyYAML takes five seconds for them."""

DEEPEST = 20
"""Of blocks within blocks; project.yaml has seven."""

MOST_ERRORS = 200
"""Named of one file; more of them have one cause."""

LONGEST_NAME = 255
"""In characters, of a key that a message repeats; no file's name is longer."""

LONGEST_NUMBER = 40
"""In characters; no figure of a survey has half as many."""


class _Loader(yaml.SafeLoader):
    """YAML 1.2's core schema: `1e-3` is a number; `no`, `12:30`, `007` and dates are texts, as names should be."""

    def __init__(self, stream: str) -> None:
        super().__init__(stream)
        self._depth = 0

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        """Compose a node, unless it lies deeper than any block of a project file."""
        self._depth += 1
        if self._depth > DEEPEST:
            mark = self.peek_event().start_mark  # type: ignore[no-untyped-call]
            raise yaml.MarkedYAMLError(problem=f"nested deeper than {DEEPEST} deep", problem_mark=mark)
        node: yaml.Node | None = super().compose_node(parent, index)
        self._depth -= 1
        return node


_Loader.yaml_implicit_resolvers = {}
for _tag, _pattern, _first in (
    ("bool", r"true|false|True|False", "tfTF"),
    ("null", r"~|null|Null|NULL|", ["~", "n", "N", ""]),
    ("int", r"-?(?:0|[1-9][0-9]*)", "-0123456789"),
    (
        "float",
        r"[-+]?(?:[0-9]+\.[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?|[-+]?[0-9]+[eE][-+]?[0-9]+|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN)",
        "-+.0123456789",
    ),
):
    _Loader.add_implicit_resolver(f"tag:yaml.org,2002:{_tag}", re.compile(f"(?:{_pattern})$"), list(_first))

_SCALARS: dict[str, Callable[[str], object]] = {
    "tag:yaml.org,2002:str": str,
    "tag:yaml.org,2002:null": lambda _: None,
    "tag:yaml.org,2002:bool": lambda text: text.lower() == "true",
    "tag:yaml.org,2002:int": int,
    "tag:yaml.org,2002:float": lambda text: float(text.lower().replace(".inf", "inf").replace(".nan", "nan")),
}


class Document:
    """The values of a YAML file, the line of each, and the errors found so far."""

    def __init__(self, path: Path) -> None:
        """Read the file. Raises ProjectError where it cannot be read or is not YAML; other errors are noted."""
        self._take(path, read_text(path))

    @staticmethod
    def of_text(text: str, path: Path) -> Document:
        """Return the document of a text, which messages call ``path``. Raises ProjectError where it is not YAML."""
        document = Document.__new__(Document)
        document._take(path, text)
        return document

    def _take(self, path: Path, text: str) -> None:
        self.path = path
        self._lines: dict[Key, int] = {(): 1}
        self._errors: dict[tuple[int, Key, str], None] = {}
        self._warnings: dict[tuple[int, Key, str, str], None] = {}
        self._seen: set[int] = set()
        self._unread: set[Key] = set()
        node = compose_text(text, path)
        self.value: object = {} if node is None else self._plain(node, ())

    def _plain(self, node: yaml.Node, key: Key) -> object:
        line = node.start_mark.line + 1
        self._lines.setdefault(key, line)
        if id(node) in self._seen:
            self._unreadable(key, "anchors and aliases (& and *) are not supported: write the values out")
            return None
        self._seen.add(id(node))
        if isinstance(node, yaml.SequenceNode):
            return [self._plain(item, (*key, i)) for i, item in enumerate(node.value)]
        if isinstance(node, yaml.MappingNode):
            return self._block(node, key)
        if not node.value.isprintable():
            text = "contains a line break or an unprintable character: write it on one line as plain text"
            self._unreadable(key, text)
            return None
        if node.tag.endswith((":int", ":float")) and len(node.value) > LONGEST_NUMBER:
            text = f"a number of {len(node.value)} characters is not a number photogram reads"
            self._unreadable(key, f"{text}: write fewer digits, or quotes around it where it is a name")
            return None
        try:
            return _SCALARS[node.tag](node.value)
        except (KeyError, ValueError):
            self._unreadable(key, f"the tag {node.tag} is not supported: write the value without it")
            return None

    def _unreadable(self, key: Key, text: str) -> None:
        self.add_error(key, text)
        self._unread.add(key)

    def _block(self, node: yaml.MappingNode, key: Key) -> dict[str, object]:
        block: dict[str, object] = {}
        for name, value in node.value:
            line = name.start_mark.line + 1
            if not isinstance(name, yaml.ScalarNode) or not name.value.isprintable():
                self.add_error(key, "a key must be plain text on one line", line)
            elif name.value in block:
                first = self._lines[(*key, name.value)]
                self.add_error((*key, name.value), f"is given twice, first in line {first}: keep one of the two", line)
            else:
                self._lines[(*key, name.value)] = line
                block[name.value] = self._plain(value, (*key, name.value))
        return block

    @property
    def base(self) -> Path:
        """The folder from which the file's relative paths are taken."""
        return self.path.absolute().parent

    def known(self, key: Key) -> Key:
        """Return the key itself, or that of the nearest block around it that the file has."""
        while key not in self._lines:
            key = key[:-1]
        return key

    def unread(self, key: Key) -> bool:
        """Whether the file has a value at ``key`` that YAML allows and photogram does not read; its error is noted."""
        return key in self._unread

    def line(self, key: Key) -> int:
        """Return the line of a value, or of the nearest block around it that the file has."""
        return self._lines[self.known(key)]

    def where(self, key: Key) -> str:
        """Return how a message calls a value: keys joined by points, list items by their name or path where they have
        one."""
        words = ""
        value = self.value
        for part in key:
            value = _inside(value, part)
            if isinstance(part, int):
                name = value.get("name", value.get("path")) if isinstance(value, dict) else None
                words += f"[{shortened(str(name), LONGEST_NAME) if isinstance(name, str | int) else f'#{part + 1}'}]"
            else:
                part = shortened(str(part), LONGEST_NAME)
                words += f".{part}" if words else part
        return words

    def at(self, key: Key) -> object:
        """Return the value at a key, None where there is none."""
        value = self.value
        for part in key:
            value = _inside(value, part)
        return value

    def has(self, *keys: Key) -> bool:
        """Return whether the file gives a value at one of these keys."""
        return any(self.at(key) is not None for key in keys)

    def add_error(self, key: Key, text: str, line: int | None = None) -> None:
        """Note what is wrong with the value at a key."""
        self._errors[(self.line(key) if line is None else line, key, text)] = None

    def add_errors_of(self, key: Key, error: Exception, path: Path, written: str) -> None:
        """Note the lines of an error of a file ``path``, which is called as the project has ``written`` it."""
        for line in str(error).splitlines():
            self.add_error(key, line.replace(f"{path}:", f"{written}:", 1))

    def warn(self, key: Key, text: str, remedy: str) -> None:
        """Note what is doubtful about the value at a key, and what to do; the file can be used in spite of it."""
        self._warnings[(self.line(key), key, text, remedy)] = None

    @property
    def warnings(self) -> tuple[Finding, ...]:
        """What has been noted as doubtful, in the order of the lines."""
        noted = sorted(self._warnings, key=lambda warning: warning[0])
        return tuple(
            Finding("warning", f"{self.path.name}:{line}", f"{self.where(key)}: {text}", remedy)
            for line, key, text, remedy in noted
        )

    @property
    def errors(self) -> int:
        """The number of errors noted so far."""
        return len(self._errors)

    def raise_errors(self) -> None:
        """Raise a ProjectError with every error noted, in the order of the lines; return if there is none."""
        if not self._errors:
            return
        lines = []
        errors = sorted(self._errors, key=lambda error: error[0])
        for line, key, text in errors[:MOST_ERRORS]:
            where = self.where(key)
            lines.append(f"{self.path}:{line}: {where}: {text}" if where else f"{self.path}:{line}: {text}")
        if len(errors) > MOST_ERRORS:
            line, more = errors[MOST_ERRORS][0], len(errors) - MOST_ERRORS
            lines.append(f"{self.path}:{line}: from this line on {more} more errors: fix those above first")
        heading = [f"{self.path} has {len(errors)} errors:"] if len(errors) > 1 else []
        raise ProjectError("\n".join(heading + lines))


def check_syntax(path: Path) -> None:
    """Check that a project file can be read and is YAML. Raises ProjectError as Document does, and costs little: a
    Document of the same text is made of what was parsed here."""
    compose_text(read_text(path), path)


@lru_cache(maxsize=1)
def compose_text(text: str, path: Path) -> yaml.Node | None:
    """Return the nodes of a text, which messages call ``path``. Raises ProjectError where it is not YAML."""
    try:
        node: yaml.Node | None = yaml.compose(text, Loader=_Loader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        where = f"{path}:{mark.line + 1}: column {mark.column + 1}: " if mark else f"{path}: "
        words = ", ".join(part for part in (error.context, error.problem) if part)
        raise ProjectError(
            f"{where}not valid YAML, {words}: check indentation (spaces), brackets, colons and quotes"
        ) from error
    except yaml.reader.ReaderError as error:
        line = text[: error.position].count("\n") + 1
        character = f"U+{ord(text[error.position]):04X}"
        raise ProjectError(f"{path}:{line}: the character {character} is not allowed in YAML: remove it") from error
    if node is not None and not isinstance(node, yaml.MappingNode):
        line = node.start_mark.line + 1
        raise ProjectError(f"{path}:{line}: a project file is a mapping of keys that begins with photogram: 1")
    return node


def read_text(path: Path) -> str:
    """Return the text of a project file. Raises ProjectError where it cannot be read or is not UTF-8."""
    try:
        return read_whole(path, MOST_BYTES).decode("utf-8-sig")
    except OSError as error:
        reason = error.strerror or type(error).__name__
        raise ProjectError(f"{path}: cannot be read ({reason}): give the path of a project.yaml") from error
    except UnicodeDecodeError as error:
        line = error.object[: error.start].count(b"\n") + 1
        byte = f"{error.object[error.start]:#04x}"
        raise ProjectError(f"{path}:{line}: byte {byte} is not UTF-8: save the file as UTF-8") from error


def _inside(value: object, part: str | int) -> object:
    if isinstance(value, dict):
        return value.get(part)
    if isinstance(value, list) and isinstance(part, int) and part < len(value):
        return value[part]
    if isinstance(value, BaseModel) or dataclasses.is_dataclass(value):
        return getattr(value, str(part), None)
    return None


def given(value: ValueT | None) -> ValueT:
    """Return a value that the checks have found present."""
    if value is None:
        raise AssertionError("a key of the project file was used before its absence was reported")
    return value


def suggestion(word: str, known: Collection[str]) -> str:
    """Return "did you mean …?", or the known words where none is near."""
    near = difflib.get_close_matches(word, known, n=1, cutoff=0.6)
    lowered = [k for k in known if k.lower() == word.lower()]
    if near or lowered:
        return f"did you mean {(lowered or near)[0]!r}?"
    return f"allowed here: {', '.join(sorted(known)) or 'none'}"


@dataclasses.dataclass(frozen=True)
class Required:
    """Marks a field that the file must give; ``what`` says what to write."""

    what: str


def described(value: object) -> str:
    """Return a value as a message names it."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int | float):
        return f"{value:.15g}" if isinstance(value, float) else shortened(str(value))
    if isinstance(value, str):
        comma = re.fullmatch(r"[-+]?\d{1,20},\d{1,20}", value)
        return f"the text {shortened(value)!r}" + (
            f" (write {value.replace(',', '.')}, with a decimal point)" if comma else ""
        )
    if isinstance(value, list | tuple):
        items = ", ".join(described(v).removeprefix("the text ") for v in value)
        return f"[{items}]" if len(value) <= 6 else f"a list of {len(value)}"
    return "nothing" if value is None else "a mapping of keys"


def _needs(field: FieldInfo) -> str:
    """Return what to write where the file must give a key, else nothing."""
    return next((mark.what for mark in field.metadata if isinstance(mark, Required)), "")


def _block_of(field: FieldInfo) -> type[Entry] | None:
    """Return what stands at a key that holds a block, None at any other."""
    kind: Any = field.annotation
    return kind if isinstance(kind, type) and issubclass(kind, Entry) else None


def _is_required(field: FieldInfo) -> bool:
    """Return whether the file must give a key: it is needed itself, or a key in its block is."""
    block = _block_of(field)
    return bool(_needs(field)) or (block is not None and any(map(_is_required, block.model_fields.values())))


def _of_key(schema: dict[str, Any], field: FieldInfo) -> dict[str, Any]:
    """Return the JSON Schema of a key with its sentence; a block may be empty, what is needed may not."""
    nothing, needed = {"type": "null"}, _needs(field)
    options = [{key: value for key, value in schema.items() if key != "default"}]
    if _block_of(field) and not _is_required(field):
        options.append(nothing)
    elif needed and "anyOf" in schema:
        shared = {key: value for key, value in options[0].items() if key != "anyOf"}
        options = [{**option, **shared} for option in schema["anyOf"] if option != nothing]
    words = [mark for mark in field.metadata if isinstance(mark, str)]
    words += [f"{needed[0].upper()}{needed[1:]}."] if needed else []
    words += [f"Default: {mark.words}." for mark in field.metadata if isinstance(mark, Default)]
    words += [f"Unit: {mark.unit}." for mark in field.metadata if isinstance(mark, Within) and mark.unit]
    default = schema.get("default")
    return {
        **(options[0] if len(options) == 1 else {"anyOf": options}),
        **({"minProperties": 1} if needed and "additionalProperties" in schema else {}),
        **({} if default is None or isinstance(default, list | dict) else {"default": default}),
        **({"description": " ".join(words)} if words else {}),
    }


class Entry(BaseModel):
    """A block of keys; an empty block is one whose keys are all absent."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False, protected_namespaces=())
    gone: ClassVar[Mapping[str, str]] = {}
    """Keys of earlier versions, and what is said of each."""

    @classmethod
    def __get_pydantic_json_schema__(cls, core: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        """Return the JSON Schema of the block: what each key is, which of them the file must give, and that a block
        within it may be empty."""
        schema = handler(core)
        block = handler.resolve_ref_schema(schema)
        block.pop("title", None)
        required = [name for name, field in cls.model_fields.items() if _is_required(field)]
        block["properties"] = {name: _of_key(block["properties"][name], f) for name, f in cls.model_fields.items()}
        return {**schema, **({"required": required} if required else {})}


_WORDS = {
    "bool_type": "must be true or false",
    "dataclass_type": "needs a mapping of keys",
    "dict_type": "needs a mapping of keys",
    "finite_number": "must be a finite number",
    "float_type": "must be a number",
    "greater_than": "must be greater than {gt:g}",
    "greater_than_equal": "must be {ge:g} or greater",
    "int_from_float": "must be a whole number",
    "int_type": "must be a whole number",
    "less_than": "must be less than {lt:g}",
    "less_than_equal": "must be {le:g} or less",
    "list_type": "must be a list",
    "literal_error": "must be {expected}",
    "enum": "must be {expected}",
    "missing": "must have another value",
    "model_type": "needs a mapping of keys",
    "string_type": "must be text",
    "too_long": "must have at most {max_length} values",
    "too_short": "must have at least {min_length} values",
    "tuple_type": "must be a list",
}
"""pydantic's kinds of errors in plain words; braces are filled from the error's own context."""

_BLOCKS = ("model_type", "dataclass_type")
_UNKNOWN = ("extra_forbidden", "unexpected_keyword_argument")


def _wording(error: ErrorDetails) -> str:
    kind, context, value = error["type"], error.get("ctx", {}), error["input"]
    if kind == "value_error":
        return str(context["error"])
    expected = str(context.get("expected", ""))
    words = error["msg"].lower()
    if kind in _WORDS:
        words = _WORDS[kind].format(**context | {"expected": expected.replace("'", "")})
    near = difflib.get_close_matches(str(value), re.findall(r"'([^']*)'", expected), n=1)
    return f"{words}, found {described(value)}" + (f": did you mean {near[0]!r}?" if near else "")


def _prune(raw: dict[str, object], key: Key, kind: str) -> None:
    """Take the value at ``key`` out of ``raw``, with the list it is part of; a whole block is emptied instead."""
    place: list[tuple[dict[str, object] | list[object], str | int]] = []
    value: object = raw
    for part in key:
        if not isinstance(value, dict | list) or (isinstance(value, dict) and part not in value):
            return  # another error has taken it out already
        place.append((value, part))
        value = value[part]  # type: ignore[index]
    if kind not in _BLOCKS:
        while isinstance(place[-1][0], list):
            place.pop()
    holder, last = place[-1]
    if kind in _BLOCKS:
        holder[last] = {}  # type: ignore[index]
    else:
        del holder[last]  # type: ignore[arg-type]


def _known_keys(block: object) -> list[str]:
    if isinstance(block, BaseModel):
        return list(type(block).model_fields)
    if dataclasses.is_dataclass(block):
        return [f.name for f in dataclasses.fields(block)]
    return []


def _missing(entry: object, key: Key) -> Iterator[tuple[Key, str]]:
    if isinstance(entry, Entry):
        for name, field in type(entry).model_fields.items():
            value = getattr(entry, name)
            if _needs(field) and (value is None or value == {}):
                yield (*key, name), _needs(field)
            yield from _missing(value, (*key, name))
    elif isinstance(entry, dict):
        for name, value in entry.items():
            yield from _missing(value, (*key, name))
    elif isinstance(entry, list):
        for i, value in enumerate(entry):
            yield from _missing(value, (*key, i))


def read_entry(document: Document, model: type[EntryT], key: Key = ()) -> EntryT:
    """Return the block at ``key``; what is wrong with it is noted in the document and read as absent."""
    value = document.at(key)
    if not isinstance(value, dict):
        if value is not None:
            document.add_error(key, f"needs a mapping of keys, found {described(value)}")
        value = {}
    # JSON because pydantic's strict mode reads JSON's lists as tuples, and Python's not
    text = json.dumps(value)
    try:
        entry = model.model_validate_json(text)
        errors = []
    except ValidationError as invalid:
        errors = invalid.errors()
        raw = json.loads(text)
        for error in errors:
            _prune(raw, document.known((*key, *error["loc"]))[len(key) :], error["type"])
        entry = model.model_validate_json(json.dumps(raw))
    wording: dict[Key, list[str]] = {}
    for error in errors:
        place = document.known((*key, *error["loc"]))
        if error["type"] in _BLOCKS and error["input"] is None:
            continue  # an empty block: its keys are absent
        text = _unknown(entry, place[len(key) :]) if error["type"] in _UNKNOWN else _wording(error)
        wording.setdefault(place, []).append(text)
    for place, texts in wording.items():
        if not document.unread(place):
            document.add_error(place, ", or ".join(dict.fromkeys(texts)))
    for place, what in _missing(entry, key):
        if not document.unread(place) and not any(place[:n] in wording for n in range(len(place) + 1)):
            document.add_error(place, f"is missing: give {what}")
    return entry


def _unknown(entry: Entry, key: Key) -> str:
    block: object = entry
    for part in key[:-1]:
        block = _inside(block, part)
    gone = block.gone.get(str(key[-1])) if isinstance(block, Entry) else None
    return gone or f"unknown key: {suggestion(str(key[-1]), _known_keys(block))}"


def settings_model(settings: type[Any]) -> type[Entry]:
    """Return the block of keys that a dataclass of settings is read from."""
    return _settings_model(settings)  # type: ignore[arg-type]  # mypy takes no class for hashable


@cache
def _settings_model(settings: type[Any]) -> type[Entry]:
    hints = get_type_hints(settings, include_extras=True)
    keys: dict[str, Any] = {}
    for field in dataclasses.fields(settings):
        if not field.init:
            continue
        if field.default_factory is not dataclasses.MISSING:
            keys[field.name] = (hints[field.name], Field(default_factory=field.default_factory))
        elif field.default is not dataclasses.MISSING:
            keys[field.name] = (hints[field.name], field.default)
        else:
            keys[field.name] = (Annotated[hints[field.name] | None, Required("this setting, it has no default")], None)
    model = create_model(settings.__name__, __base__=Entry, __doc__=settings.__doc__, **keys)
    model.gone = getattr(settings, "gone", {})
    return model


def read_settings(document: Document, name: str, settings: type[SettingsT]) -> SettingsT | None:
    """Return the section ``name`` as the dataclass ``settings``, whose fields, types and defaults are its schema.

    None where the section cannot be; its errors, those that the dataclass raises included, are noted in the document.
    """
    before = document.errors
    entry = read_entry(document, settings_model(settings), (name,))
    if document.errors > before:
        return None
    try:
        return settings(**{key: getattr(entry, key) for key in entry.model_fields_set})
    except SettingError as error:
        document.add_error((name, error.key), error.text)
        return None
