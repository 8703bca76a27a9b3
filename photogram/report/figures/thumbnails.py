"""The small pictures of the page's first screen: what was flown, and what was made of it, without axes and words."""

import io

import numpy as np
from PIL import Image

from photogram.arrays import ByteArray
from photogram.report.figures.page_figures import PageFigure
from photogram.report.figures.style import data_uri, shaded_relief
from photogram.report.numbers.dense_surface import OrthophotoPicture
from photogram.survey import Raster

LONGER_SIDE_PX = 560
JPEG_QUALITY = 82
NO_DATA_RGB = (0xE4, 0xE8, 0xEA)
ORTHOPHOTO, SURFACE = "thumbnail orthophoto", "thumbnail surface"
_OF_ORTHOPHOTO = "Orthophoto", "The orthophoto, small"
_OF_SURFACE = "Surface model", "The surface model, shaded and tinted by height"
THUMBNAIL_TEXTS = (*_OF_ORTHOPHOTO, *_OF_SURFACE)
"""What stands under them and for them, which the page says in its language."""


def thumbnails(orthophoto: OrthophotoPicture | None, surface: Raster | None) -> list[PageFigure]:
    """Return orthophoto and surface (heights in m, NaN in holes) as small pictures, where there are such."""
    figures = []
    if orthophoto is not None:
        figures.append(PageFigure(ORTHOPHOTO, *_OF_ORTHOPHOTO, _uri(orthophoto.rgba)))
    if surface is not None and np.isfinite(surface.values).any():
        relief = (255.0 * shaded_relief(surface)[0] + 0.5).astype(np.uint8)
        figures.append(PageFigure(SURFACE, *_OF_SURFACE, _uri(relief)))
    return figures


def _uri(rgba: ByteArray) -> str:
    """Return a picture (rows, columns, 4), no longer than LONGER_SIDE_PX, on the ground of maps as a data URI."""
    picture = Image.fromarray(np.ascontiguousarray(rgba))
    flat = Image.alpha_composite(Image.new("RGBA", picture.size, (*NO_DATA_RGB, 255)), picture).convert("RGB")
    scale = LONGER_SIDE_PX / max(flat.size)
    flat = flat.resize([max(1, round(scale * side)) for side in flat.size], Image.Resampling.LANCZOS)
    stream = io.BytesIO()
    flat.save(stream, "JPEG", quality=JPEG_QUALITY)
    return data_uri("jpeg", stream.getvalue())
