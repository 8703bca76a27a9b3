"""The packets of tags in a photograph, taken apart: EXIF as numbered tags, XMP as named properties."""

import re
import struct
import warnings
import zlib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from threading import Lock
from xml.etree.ElementTree import Element, ParseError

from defusedxml import DefusedXmlException
from defusedxml.ElementTree import fromstring
from PIL import ExifTags, Image

from photogram.wording import printable, shortened

Tags = dict[int, object]

LARGEST_XMP = 4_000_000
"""In bytes; cameras write some thousand."""

DAMAGE = (
    OSError,
    SyntaxError,
    ValueError,
    TypeError,
    AttributeError,
    LookupError,
    ArithmeticError,
    EOFError,
    RuntimeError,
    struct.error,
    zlib.error,
)
"""What Pillow and the parser of XML raise where a file is damaged."""

_RDF = "http://www.w3.org/1999/02/22-rdf-syntax-ns#"
_NAME = re.compile(r"(?:\{([^}]*)\})?(.*)")
_RECORDING = Lock()


class Properties(Mapping[str, str]):
    """XMP properties by their names, in whatever case these are written; of several of a name the first counts."""

    def __init__(self, named: Iterable[tuple[str, str]]) -> None:
        """Take names and values."""
        self._values: dict[str, str] = {}
        for name, value in named:
            self._values.setdefault(name.casefold(), value)

    def __getitem__(self, name: str) -> str:
        """Return a value."""
        return self._values[name.casefold()]

    def __iter__(self) -> Iterator[str]:
        """Return the names in small letters."""
        return iter(self._values)

    def __len__(self) -> int:
        """Return the number of properties."""
        return len(self._values)

    def without(self, name: str) -> "Properties":
        """Return all but one."""
        return Properties((own, value) for own, value in self.items() if own != name.casefold())


def _properties(root: Element) -> Iterator[tuple[str, str]]:
    for element in root.iter():
        yield from element.attrib.items()
        items = [item.text or "" for item in element.findall(f"./*/{{{_RDF}}}li")]
        yield element.tag, (element.text or "") if not items else ",".join(items)


def xmp_of(picture: Image.Image) -> tuple[Properties, str]:
    """Return the XMP properties by their names, and in words why there are none where they are not valid XML.

    Those of the name space Camera are called ``Camera:Yaw``, because other name spaces have a Yaw that is not the
    camera's. Lists are joined by commas.
    """
    packet = picture.info.get("xmp")
    if not isinstance(packet, bytes) or b"<" not in packet:
        return Properties(()), ""
    if len(packet) > LARGEST_XMP:
        return Properties(()), f"the XMP tags are damaged ({len(packet) / 1e6:.0f} MB), only EXIF is used"
    try:
        root = fromstring(packet[packet.index(b"<") :].rstrip(b"\0 "))  # GDAL writes xml:XMP= before the packet
    except (ParseError, DefusedXmlException, LookupError, ValueError) as error:
        return Properties(()), f"the XMP tags are not valid XML ({printable(shortened(str(error)))}), only EXIF is used"
    values = list[tuple[str, str]]()
    for qualified, text in _properties(root):
        match = _NAME.fullmatch(qualified)
        space, name = (match[1] or "", match[2]) if match else ("", qualified)
        if space != _RDF and text.strip():
            key = f"Camera:{name}" if "/camera/" in f"{space.casefold()}/" else name
            values.append((key, printable(text.strip())))
    return Properties(values), ""


@contextmanager
def recorded_warnings() -> Iterator[list[warnings.WarningMessage]]:
    """Collect the warnings of the libraries that read a file, one thread at a time, instead of printing them."""
    with _RECORDING, warnings.catch_warnings(record=True) as recorded:
        warnings.simplefilter("always")
        yield recorded


def exif_of(picture: Image.Image) -> tuple[Tags, Tags, Tags, tuple[str, ...]]:
    """Return the main, EXIF and GPS tags, and in words what Pillow found damaged in them."""
    blocks: list[Tags] = [{}, {}, {}]
    errors = []
    with recorded_warnings() as recorded:
        try:
            whole, packet = picture.getexif(), picture.info.get("exif")
            if isinstance(packet, bytes):  # once more: opening the picture may have read it, and said what is damaged
                whole = Image.Exif()
                whole.load(packet)
            blocks[0] = dict(whole)  # tags are decoded when asked for
            blocks[1] = dict(whole.get_ifd(ExifTags.IFD.Exif))
            blocks[2] = dict(whole.get_ifd(ExifTags.IFD.GPSInfo))
        except DAMAGE as error:
            errors.append(f"{error or type(error).__name__}")
    texts = dict.fromkeys(
        " ".join(text.split()).rstrip(". ") for text in [*errors, *(str(w.message) for w in recorded)]
    )
    main, exif, gps = blocks
    return main, exif, gps, tuple(f"the EXIF tags are damaged ({printable(shortened(text))})" for text in texts)
