"""The tables of settings in the documentation, made from the fields of the settings, and that of a node's options.

    python tests/docs_tables.py

writes them anew between `<!-- settings: NAME -->` and `<!-- end of settings -->`; NAME is a section of project.yaml.
That of the options stands between `<!-- node options -->` and `<!-- end of node options -->`.
"""

import re
from pathlib import Path

from photogram.node.options import OPTIONS, option_views
from photogram.project.project import SECTIONS
from photogram.settings.settings import Setting, settings_of

DOCS = Path(__file__).resolve().parents[1] / "docs"
_TABLE = re.compile(r"(<!-- settings: (\w+) -->\n\n).*?(\n<!-- end of settings -->)", re.DOTALL)
_OPTIONS = re.compile(r"(<!-- node options -->\n\n).*?(\n<!-- end of node options -->)", re.DOTALL)


def _value(value: object) -> str:
    """Return a value as it is written in project.yaml."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int | float):
        return f"{value:.15g}".replace("e-0", "e-")
    return f"`{value}`" if value else "empty"


def _allowed(setting: Setting) -> str:
    """Return what a setting may be."""
    if setting.within is not None:
        return str(setting.within).replace("from ", "")
    if setting.choices:
        return ", ".join(_value(choice) for choice in setting.choices)
    return "true, false" if setting.kind in (bool, bool | None) else "text"


def table(section: str) -> str:
    """Return the table of the settings of a section, in Markdown."""
    rows = [
        f"| `{setting.name}` | {setting.default_words or _value(setting.default)} | {_allowed(setting)} "
        f"| {setting.sentence} |\n"
        for setting in settings_of(SECTIONS[section])
    ]
    return "| key | default | allowed | meaning |\n|---|---|---|---|\n" + "".join(rows)


def options_table() -> str:
    """Return the table of the options of a node, in Markdown."""
    rows = []
    for view, option in zip(option_views(), OPTIONS, strict=True):
        keys = ", ".join(f"`{'.'.join(map(str, key))}`" for key in option.sets(option.default)) or "–"
        allowed = ", ".join(f"`{choice}`" for choice in option.choices) or view["domain"] or "–"
        default = f"`{view['value']}`" if view["value"] else "empty"
        rows.append(f"| `{view['name']}` | {view['type']} | {default} | {allowed} | {keys} | {view['help']} |\n")
    head = "| option | type | default | allowed | sets | meaning |\n|---|---|---|---|---|---|\n"
    return head + "".join(rows)


def with_tables(text: str) -> str:
    """Return a page with the tables that its settings, or options, have now."""
    text = _OPTIONS.sub(lambda match: match[1] + options_table() + match[2], text)
    return _TABLE.sub(lambda match: match[1] + table(match[2]) + match[3], text)


def sections_shown(text: str) -> list[str]:
    """Return the sections whose tables a page has."""
    return [match[2] for match in _TABLE.finditer(text)]


if __name__ == "__main__":
    for page in sorted(DOCS.glob("*.md")):
        page.write_text(with_tables(page.read_text(encoding="utf-8")), encoding="utf-8")
