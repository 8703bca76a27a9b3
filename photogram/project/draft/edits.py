"""One value of a project file changed in its text: comments, order and everything else stay as a person wrote them."""

import json
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import yaml

from photogram.errors import ProjectError
from photogram.files.atomic import replacing
from photogram.project.document import Document, compose_text, read_text

_PLAIN = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
Scalar = str | float | bool
Value = Scalar | Sequence[float]

Key = Sequence[str | int]
"""Names of blocks, and numbers of list items from 0, down to a value."""


def write_values(
    path: Path, values: Mapping[tuple[str | int, ...], Value | None], check: Callable[[Path], object]
) -> None:
    """Set several values, or take out those that are None, all or none: where one cannot be set, or ``check`` raises of
    the new file, it stays as it was.

    Raises ProjectError where the file cannot be read, is not YAML, or a block above a value is none; WorkspaceError
    where it cannot be written; and what ``check`` raises.
    """
    before = text = read_text(path)
    for key, value in values.items():
        text = with_value(text, key, value, path)
    if text == before:
        return
    _put(path, text)
    try:
        check(path)
    except BaseException:
        _put(path, before)
        raise


def _put(path: Path, text: str) -> None:
    with replacing(path) as partial:
        partial.write_text(text, encoding="utf-8")


def with_value(text: str, key: Key, value: Value | None, path: Path) -> str:
    """Return the text of a project file with a value set, or taken out where it is None, with blocks that are empty
    then. Raises ProjectError as ``write_values``; ``path`` stands in the message."""
    changed = _without(text, key, path) if value is None else _changed(text, list(key), value, path)
    expected = _values(text, path)
    _set(expected, list(key), list(value) if isinstance(value, Sequence) and not isinstance(value, str) else value)
    if _values(changed, path) != expected:
        raise ProjectError(f"{path}: {'.'.join(map(str, key))} cannot be set in this form of YAML: write it by hand")
    return changed


def _without(text: str, key: Key, path: Path) -> str:
    """Return the text without an entry, and without the blocks that hold nothing else."""
    node, chain = compose_text(text, path), list[tuple[yaml.MappingNode, int]]()
    for name in key:
        if isinstance(name, int):
            node, chain = _item(node, name), []
            continue
        entry = _entry(node, name)
        if entry is None or not isinstance(node, yaml.MappingNode):
            return text
        chain.append((node, next(n for n, (k, _) in enumerate(node.value) if k is entry[0])))
        node = entry[1]
    while len(chain) > 1 and len(chain[-1][0].value) == 1:
        chain.pop()
    block, number = chain[-1]
    name, value = block.value[number]
    if not block.flow_style:
        start = text.rfind("\n", 0, name.start_mark.index) + 1
        end = text.find("\n", _end(value))
        return text[:start] + ("" if end < 0 else text[end + 1 :])
    if number:
        return text[: block.value[number - 1][1].end_mark.index] + text[value.end_mark.index :]
    return text[: name.start_mark.index] + text[block.value[1][0].start_mark.index :]


def _end(node: yaml.Node) -> int:
    """Return where a value ends: a block of lines at the end of its last value, before comments that follow."""
    if isinstance(node, yaml.CollectionNode) and not node.flow_style and node.value:
        last = node.value[-1]
        return _end(last[1] if isinstance(last, tuple) else last)
    return int(node.end_mark.index)


def _changed(text: str, key: list[str | int], value: Value, path: Path) -> str:
    node: yaml.Node | None = compose_text(text, path)
    for depth, name in enumerate(key):
        if isinstance(name, int):
            node = _item(node, name)
            continue
        if node is None or (isinstance(node, yaml.ScalarNode) and node.value == "" and depth):
            break
        if not isinstance(node, yaml.MappingNode):
            above = ".".join(map(str, key[:depth]))
            raise ProjectError(f"{path}: {above} is no block, so {name} has no place in it")
        entry = _entry(node, name)
        if entry is None:
            return _inserted(text, node, [str(part) for part in key[depth:]], value)
        node = entry[1]
        if depth == len(key) - 1:
            return _replaced(text, node, value)
    return _inserted(text, compose_text(text, path), [str(part) for part in key], value)


def _values(text: str, path: Path) -> dict[str, object]:
    value = Document.of_text(text, path).value
    assert isinstance(value, dict)
    return value


def _entry(node: yaml.Node | None, name: str) -> tuple[yaml.Node, yaml.Node] | None:
    if not isinstance(node, yaml.MappingNode):
        return None
    return next(((k, v) for k, v in node.value if isinstance(k, yaml.ScalarNode) and k.value == name), None)


def _item(node: yaml.Node | None, number: int) -> yaml.Node | None:
    """Return an item of a list, None where there is none."""
    there = isinstance(node, yaml.SequenceNode) and number < len(node.value)
    return node.value[number] if there and node is not None else None


def _set(block: dict[str, object], key: list[str | int], value: object) -> None:
    name, *rest = key
    held = block.get(str(name))
    if isinstance(held, list) and rest and isinstance(rest[0], int):
        if rest[0] < len(held):
            _set(held[rest[0]], rest[1:], value)
        return
    name = str(name)
    if not rest and value is not None:
        block[name] = value
    elif not rest:
        block.pop(name, None)
    elif value is not None or isinstance(block.get(name), dict):
        inner: dict[str, object] = dict(held) if isinstance(held, dict) else {}
        before = len(inner)
        _set(inner, rest, value)
        if inner or not before:
            block[name] = inner
        else:
            del block[name]


def _written(value: Value) -> str:
    """Return a value in a form that means the same in any YAML: JSON."""
    plain = list(value) if isinstance(value, Sequence) and not isinstance(value, str) else value
    return json.dumps(plain, ensure_ascii=not str(value).isprintable())


def _name(name: str) -> str:
    """Return the name of an entry as it is where no YAML takes it for anything else, else in quotes."""
    return name if _PLAIN.fullmatch(name) and yaml.safe_load(name) == name else _written(name)


def _replaced(text: str, node: yaml.Node, value: Value) -> str:
    """Return the text with a value replaced."""
    start, end = node.start_mark.index, node.end_mark.index
    gap = "" if text[start - 1 : start].isspace() else " "
    return text[:start] + gap + _written(value) + text[end:]


def _inserted(text: str, node: yaml.Node | None, key: list[str], value: Value) -> str:
    """Return the text with an entry, and the blocks above it that are missing, at the end of a block."""
    if isinstance(node, yaml.MappingNode) and node.flow_style and node.value:
        end = node.value[-1][1].end_mark.index
        inner = _written(value)
        for name in reversed(key[1:]):
            inner = f"{{{_name(name)}: {inner}}}"
        return f"{text[:end]}, {_name(key[0])}: {inner}{text[end:]}"
    indent = node.value[0][0].start_mark.column if isinstance(node, yaml.MappingNode) and node.value else 0
    lines = [f"{' ' * (indent + 2 * n)}{_name(name)}:" for n, name in enumerate(key)]
    lines[-1] += f" {_written(value)}"
    added = "\n".join(lines) + "\n"
    if not isinstance(node, yaml.MappingNode) or not node.value or indent == 0:
        return text + ("" if text.endswith("\n") or not text else "\n") + added
    end = text.find("\n", _end(node))
    return f"{text}\n{added}" if end < 0 else text[: end + 1] + added + text[end + 1 :]
