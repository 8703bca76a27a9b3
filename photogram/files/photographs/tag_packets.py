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

_SPACES = (
    ("/camera/", "Camera:"),
    ("/exif/", "exif:"),
    ("/drone-skydio/", "Skydio:"),
    ("/drone-yuneec/", "Yuneec:"),
)
"""Parts of the addresses of name spaces whose names mean something else in others, and what stands before these."""

_ALIASES = {
    **{f"Skydio:CameraOrientationNED:{axis}": f"Gimbal{axis}Degree" for axis in ("Yaw", "Pitch", "Roll")},
    **{f"Skydio:VehicleOrientationNED:{axis}": f"Flight{axis}Degree" for axis in ("Yaw", "Pitch", "Roll")},
    **{f"Yuneec:Gimbal{axis}": f"Gimbal{axis}Degree" for axis in ("Yaw", "Pitch", "Roll")},
    **{f"Yuneec:Drone{axis}": f"Flight{axis}Degree" for axis in ("Yaw", "Pitch", "Roll")},
    **{f"Camera{axis}Degree": f"Gimbal{axis}Degree" for axis in ("Yaw", "Pitch", "Roll")},  # Parrot
    **{f"Drone{axis}Degree": f"Flight{axis}Degree" for axis in ("Yaw", "Pitch", "Roll")},  # Parrot
    "GpsLongtitude": "GpsLongitude",  # older firmware of DJI and Autel
    "Skydio:Latitude": "GpsLatitude",
    "Skydio:Longitude": "GpsLongitude",
    "Skydio:AbsoluteAltitude": "AbsoluteAltitude",
    "Skydio:RelativeAltitude": "RelativeAltitude",
    "Skydio:GpsHorizontalAccuracy": "Camera:GPSXYAccuracy",
    "Skydio:GpsVerticalAccuracy": "Camera:GPSZAccuracy",
    "Skydio:VertCS": "Camera:VertCS",
    "Yuneec:AboveHomeAltitude": "RelativeAltitude",
}
"""Names by which other makers call what has a name of DJI's or Pix4D's, in the same convention, and these."""

_RDF = "http://www.w3.org/1999/02/22-rdf-syntax-ns#"
_NAME = re.compile(r"(?:\{([^}]*)\})?(.*)")
_RECORDING = Lock()


class Properties(Mapping[str, str]):
    """XMP properties by their names, in whatever case these are written; of several of a name the first counts."""

    def __init__(self, named: Iterable[tuple[str, str]]) -> None:
        """Take names and values."""
        self._values: dict[str, str] = {}
        self._written: dict[str, str] = {}
        for name, value in named:
            self._values.setdefault(name.casefold(), value)
            self._written.setdefault(name.casefold(), name)
        for alias, name in _ALIASES.items():
            if alias.casefold() in self._values:
                self._values.setdefault(name.casefold(), self._values.pop(alias.casefold()))

    def __getitem__(self, name: str) -> str:
        """Return a value."""
        return self._values[name.casefold()]

    def __iter__(self) -> Iterator[str]:
        """Return the names in small letters."""
        return iter(self._values)

    def __len__(self) -> int:
        """Return the number of properties."""
        return len(self._values)

    def written(self, name: str) -> str:
        """Return a name as the file writes it."""
        return self._written.get(name.casefold(), name)

    def without(self, name: str) -> "Properties":
        """Return all but one."""
        return Properties((self.written(own), value) for own, value in self.items() if own != name.casefold())


def _properties(element: Element, within: str = "") -> Iterator[tuple[str, str]]:
    """Yield the names and values of an element and what is in it; those in a structure follow its name and a colon."""
    space, name = _named(element.tag)
    items = [item.text or "" for item in element.findall(f"./*/{{{_RDF}}}li")]
    inside = "" if (space, name) == (_RDF, "RDF") else within  # whatever stands around it is no structure
    if space != _RDF:
        full = f"{within}{_before(space) if not within else ''}{name}"
        inside = f"{full}:"
        yield full, (element.text or "") if not items else ",".join(items)
    for qualified, value in element.attrib.items():
        space, name = _named(qualified)
        if space != _RDF:
            yield f"{inside}{_before(space) if not inside else ''}{name}", value
    for child in element if not items else ():
        yield from _properties(child, inside)


def _named(qualified: str) -> tuple[str, str]:
    """Return the address of a name's space, and the name."""
    match = _NAME.fullmatch(qualified)
    return (match[1] or "", match[2]) if match else ("", qualified)


def _before(space: str) -> str:
    return next((prefix for part, prefix in _SPACES if part in f"{space.casefold()}/"), "")


def xmp_of(picture: Image.Image) -> tuple[Properties, str]:
    """Return the XMP properties by their names, and in words why there are none where they are not valid XML.

    Those of the name space Camera are called ``Camera:Yaw``, because other name spaces have a Yaw that is not the
    camera's, those in a structure ``Structure:Name``. Lists are joined by commas, and what other makers call otherwise
    has the name of DJI or Pix4D.
    """
    packet = picture.info.get("xmp")
    if not isinstance(packet, bytes) or b"<" not in packet:
        return Properties(()), ""
    if len(packet) > LARGEST_XMP:
        return Properties(()), f"the XMP tags are damaged ({len(packet) / 1e6:.0f} MB), only EXIF is used"
    try:
        root = fromstring(packet[packet.index(b"<") :].rstrip(b"\0 "))  # GDAL writes xml:XMP= before the packet
        named = [(name, printable(text.strip())) for name, text in _properties(root) if text.strip()]
    except (ParseError, DefusedXmlException, LookupError, ValueError, RecursionError) as error:
        return Properties(()), f"the XMP tags are not valid XML ({printable(shortened(str(error)))}), only EXIF is used"
    return Properties(named), ""


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
