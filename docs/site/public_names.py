"""The directive `public-names`: the reference of what `import photogram as pg` gives, from its table of names."""

import inspect
import re

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

import photogram as pg


def kind_of(value: object) -> tuple[str, str]:
    """Return under which title a name stands, and the directive that describes it."""
    if inspect.isroutine(value):
        return "Functions", "autofunction"
    if inspect.isclass(value) and issubclass(value, Exception):
        return "Errors", "autoexception"
    return ("Classes", "autoclass") if inspect.isclass(value) else ("Others", "autodata")


def reference() -> str:
    """Return the reference in MyST."""
    titles: dict[str, list[str]] = {"Functions": [], "Classes": [], "Errors": [], "Others": []}
    for name in sorted(set(pg.__all__) - {"__version__"}):
        value = getattr(pg, name)
        title, directive = kind_of(value)
        place = f"{value.__module__}.{value.__qualname__}" if title != "Others" else f"photogram.{name}"
        options = "\n   :members:\n   :undoc-members:" if directive == "autoclass" else ""
        titles[title].append(f"### {name}\n\n```{{eval-rst}}\n.. {directive}:: {place}{options}\n```\n")
    return "\n".join("\n".join([f"## {title}\n", *parts]) for title, parts in titles.items() if parts)


ARRAYS = {
    "float64": "FloatArray",
    "float32": "Float32Array",
    "int64": "IntArray",
    "uint8": "ByteArray",
    "bool": "BoolArray",
}
"""What the code calls an array by the type of its elements (`photogram.arrays`)."""


def with_named_arrays(signature: str | None) -> str | None:
    """Return a signature or a type in which arrays have the names that the code gives them."""
    if signature is None:
        return None
    written_out = (
        r"~?(?:numpy\.)?ndarray\[tuple\[~?(?:typing\.)?Any, \.\.\.\], ~?(?:numpy\.)?dtype\[~?(?:numpy\.)?(\w+)\]\]"
    )
    return re.sub(written_out, lambda found: ARRAYS.get(found[1], found[0]), signature)


def _name_arrays(*event: str | None) -> tuple[str | None, str | None]:
    *_, signature, returned = event
    return with_named_arrays(signature), with_named_arrays(returned)


class PublicNames(SphinxDirective):
    """Puts the reference where it stands."""

    def run(self) -> list[nodes.Node]:
        """Return the nodes of the reference."""
        return self.parse_text_to_nodes(reference(), allow_section_headings=True)


def setup(app: Sphinx) -> None:
    """Register the directive, and what names arrays."""
    app.add_directive("public-names", PublicNames)
    app.connect("autodoc-process-signature", _name_arrays)
