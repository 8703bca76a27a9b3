"""How layers of a QGIS project are drawn: renderers, symbols and labels, as elements of its XML (QGIS 3)."""

from collections.abc import Mapping, Sequence
from xml.etree.ElementTree import Element, SubElement

MULTIPLY, NORMAL = "6", "0"
"""Blend modes of a layer."""

HEIGHT_RAMP = ("38,84,124", "87,154,133", "226,214,150", "176,122,72", "245,240,235")
SIGMA_RAMP = ("255,255,229", "254,217,142", "254,153,41", "217,95,14", "127,39,4")
"""Colours from the least to the greatest value."""

_FULL = ",255"


def picture_renderer() -> Element:
    """Return how a picture of red, green, blue and alpha is drawn."""
    return Element(
        "rasterrenderer",
        {"type": "multibandcolor", "redBand": "1", "greenBand": "2", "blueBand": "3", "alphaBand": "4", "opacity": "1"},
    )


def ramp_renderer(colours: Sequence[str], low: float, high: float, decimals: int) -> Element:
    """Return how a band is drawn in colours from ``low`` to ``high``, linear between them."""
    renderer = Element(
        "rasterrenderer",
        {
            "type": "singlebandpseudocolor",
            "band": "1",
            "alphaBand": "-1",
            "opacity": "1",
            "classificationMin": f"{low:.6g}",
            "classificationMax": f"{high:.6g}",
        },
    )
    shader = SubElement(SubElement(renderer, "rastershader"), "colorrampshader")
    shader.attrib |= {"colorRampType": "INTERPOLATED", "classificationMode": "1", "clip": "0"}
    shader.attrib |= {"minimumValue": f"{low:.6g}", "maximumValue": f"{high:.6g}"}
    step = (high - low) / (len(colours) - 1)
    for number, colour in enumerate(colours):
        value = low + number * step
        shown = "#" + "".join(f"{int(part):02x}" for part in colour.split(","))
        SubElement(
            shader,
            "item",
            {"value": f"{value:.9g}", "label": f"{value:.{decimals}f}", "color": shown, "alpha": "255"},
        )
    return renderer


def codes_renderer(codes: Sequence[tuple[int, str, tuple[int, int, int]]]) -> Element:
    """Return how a band of codes is drawn, each code with its title and colour; others are transparent."""
    renderer = Element("rasterrenderer", {"type": "paletted", "band": "1", "alphaBand": "-1", "opacity": "1"})
    palette = SubElement(renderer, "colorPalette")
    for code, title, colour in codes:
        shown = "#" + "".join(f"{part:02x}" for part in colour)
        SubElement(palette, "paletteEntry", {"value": str(code), "label": title, "color": shown, "alpha": "255"})
    return renderer


def hillshade_renderer() -> Element:
    """Return how heights are drawn as relief, lit from the north-west."""
    return Element(
        "rasterrenderer",
        {
            "type": "hillshade",
            "band": "1",
            "alphaBand": "-1",
            "opacity": "1",
            "azimuth": "315",
            "angle": "45",
            "zfactor": "1",
            "multidirection": "1",
        },
    )


def line(colour: str, width_mm: float) -> Element:
    """Return the symbol of a line."""
    return _symbol("line", "SimpleLine", {"line_color": colour + _FULL, "line_width": f"{width_mm:g}"})


def outline(colour: str, width_mm: float) -> Element:
    """Return the symbol of an area of which the outline alone is drawn."""
    drawn = {"style": "no", "outline_color": colour + _FULL, "outline_width": f"{width_mm:g}"}
    return _symbol("fill", "SimpleFill", drawn)


def marker(shape: str, colour: str, size_mm: float) -> Element:
    """Return the symbol of a point: ``triangle``, ``circle`` or another shape of QGIS."""
    drawn = {"name": shape, "color": colour + _FULL, "size": f"{size_mm:g}", "outline_color": "255,255,255" + _FULL}
    return _symbol("marker", "SimpleMarker", drawn)


def _symbol(kind: str, layer: str, properties: Mapping[str, str]) -> Element:
    symbol = Element("symbol", {"type": kind, "name": "0", "alpha": "1", "clip_to_extent": "1", "force_rhr": "0"})
    drawn = SubElement(symbol, "layer", {"class": layer, "enabled": "1", "locked": "0", "pass": "0"})
    options = SubElement(drawn, "Option", {"type": "Map"})
    for name, value in properties.items():
        SubElement(options, "Option", {"type": "QString", "name": name, "value": value})
        SubElement(drawn, "prop", {"k": name, "v": value})  # read by QGIS before 3.20
    return symbol


def single(symbol: Element) -> Element:
    """Return a renderer that draws everything with a symbol."""
    renderer = Element("renderer-v2", {"type": "singleSymbol", "enableorderby": "0"})
    SubElement(renderer, "symbols").append(symbol)
    return renderer


def by_value(field: str, classes: Sequence[tuple[str, str, Element]]) -> Element:
    """Return a renderer that draws each value of a field, with its title, with a symbol of its own."""
    renderer = Element("renderer-v2", {"type": "categorizedSymbol", "attr": field, "enableorderby": "0"})
    categories, symbols = SubElement(renderer, "categories"), SubElement(renderer, "symbols")
    for number, (value, title, symbol) in enumerate(classes):
        named = {"render": "true", "symbol": str(number), "value": value, "label": title, "type": "string"}
        SubElement(categories, "category", named)
        symbol.set("name", str(number))
        symbols.append(symbol)
    return renderer


def labels(expression: str, colour: str, size_pt: float, *, along_line: bool) -> Element:
    """Return labels that show an expression, beside points or on lines, with a white edge."""
    labelling = Element("labeling", {"type": "simple"})
    settings = SubElement(labelling, "settings")
    style = {
        "fieldName": expression,
        "isExpression": "1",
        "fontSize": f"{size_pt:g}",
        "fontSizeUnit": "Point",
        "fontFamily": "Sans",
        "textColor": colour + _FULL,
        "textOpacity": "1",
    }
    text = SubElement(settings, "text-style", style)
    edge = {"bufferDraw": "1", "bufferSize": "0.8", "bufferSizeUnits": "MM", "bufferColor": "255,255,255" + _FULL}
    SubElement(text, "text-buffer", {**edge, "bufferOpacity": "1"})
    # 2 is along a line, and 1 of its flags on it; 6 is around a point, the best of several places
    placing = {"placement": "2", "placementFlags": "9"} if along_line else {"placement": "6", "dist": "1"}
    SubElement(settings, "placement", placing)
    SubElement(settings, "rendering", {"drawLabels": "1", "obstacle": "0"})
    return labelling
