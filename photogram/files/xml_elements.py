"""XML of others as elements with their lines: without document types, and no deeper than programs write."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from xml.sax import SAXException, SAXParseException
from xml.sax.handler import ContentHandler
from xml.sax.xmlreader import AttributesImpl, Locator

from defusedxml import DefusedXmlException
from defusedxml.sax import parseString

from photogram.errors import PhotogramError
from photogram.wording import printable, shortened

_DEEPEST = 50
MOST_ELEMENTS = 2_000_000
"""Of one document: those of 30 000 photographs, and 1 GB of memory."""


@dataclass(slots=True)
class Element:
    """An element of XML; ``line`` is that of its start in ``file``."""

    tag: str
    attributes: Mapping[str, str]
    file: Path
    line: int
    children: list[Element] = field(default_factory=list)
    texts: list[str] = field(default_factory=list)

    @property
    def place(self) -> str:
        """Its file and line, as errors begin with them."""
        return f"{self.file}:{self.line}"

    @property
    def text(self) -> str:
        """Its own text, without that of its children."""
        return "".join(self.texts).strip()

    def all(self, *path: str) -> Iterator[Element]:
        """Give the elements at the end of a path of tags."""
        if not path:
            yield self
            return
        for child in self.children:
            if child.tag == path[0]:
                yield from child.all(*path[1:])

    def first(self, *path: str) -> Element | None:
        """Return the first element at the end of a path of tags, None where there is none."""
        return next(self.all(*path), None)

    def below(self, tag: str) -> Iterator[Element]:
        """Give the elements of a tag at any depth."""
        for child in self.children:
            if child.tag == tag:
                yield child
            yield from child.below(tag)


class _TooMuch(SAXException):
    """Elements are more, or lie deeper in one another, than programs write."""


class _Builder(ContentHandler):
    """Builds the elements with their lines, which ElementTree does not keep."""

    def __init__(self, file: Path) -> None:
        super().__init__()
        self.root = Element("", {}, file, 1)
        self._open = [self.root]
        self._place: Locator | None = None
        self._count = 0

    def setDocumentLocator(self, locator: Locator) -> None:  # noqa: N802  # SAX's own names
        self._place = locator

    def startElement(self, name: str, attrs: AttributesImpl) -> None:  # noqa: N802
        self._count += 1
        if len(self._open) > _DEEPEST:
            raise _TooMuch("elements lie too deep in one another")
        if self._count > MOST_ELEMENTS:
            raise _TooMuch(f"it has more than {MOST_ELEMENTS} elements")
        line = self._place.getLineNumber() if self._place else 1
        element = Element(name, dict(attrs.items()), self.root.file, line or 1)
        self._open[-1].children.append(element)
        self._open.append(element)

    def endElement(self, name: str) -> None:  # noqa: ARG002, N802
        self._open.pop()

    def characters(self, content: str) -> None:
        self._open[-1].texts.append(content)


def elements_of(data: bytes, path: Path, error: type[PhotogramError], remedy: str) -> Element:
    """Return the root of the elements of an XML document: its only child is the document's element.

    Raises ``error`` with ``path``, the line and ``remedy`` where the data are not XML or have a document type, through
    which XML can do harm.
    """
    builder = _Builder(path)
    try:
        parseString(data, builder, forbid_dtd=True)
    except SAXParseException as cause:
        raise error(
            f"{path}:{cause.getLineNumber() or 1}: is not valid XML ({printable(cause.getMessage())}): {remedy}"
        ) from cause
    except (SAXException, DefusedXmlException, ValueError, LookupError) as cause:
        raise error(f"{path}:1: is XML that is not read ({printable(shortened(str(cause)))}): {remedy}") from cause
    return builder.root
