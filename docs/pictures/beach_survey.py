"""Draw the orthophoto, the surface and its standard deviation of a finished survey: docs/pictures/beach_survey.png.

Call: python docs/pictures/beach_survey.py RESULTS [OUTPUT]. The picture in the documentation shows the 18 photographs
of Brighton Beach (README), processed by photogram init and photogram adjust.
"""

import sys
from pathlib import Path

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import rasterio
from matplotlib.colors import LightSource
from matplotlib.figure import Figure
from PIL import Image
from rasterio.enums import Resampling

from photogram.arrays import FloatArray

LONGER_SIDE_PX = 620
SIGMA_PERCENTILE = 98
COLOURS = 200


def read(path: Path, bands: list[int]) -> tuple[FloatArray, float]:
    """Return bands (bands, rows, columns) of a raster, downsampled, NaN for no data, and the side of a cell in m."""
    with rasterio.open(path) as dataset:
        step = max(dataset.width, dataset.height) / LONGER_SIDE_PX
        shape = (len(bands), round(dataset.height / step), round(dataset.width / step))
        values = dataset.read(bands, out_shape=shape, resampling=Resampling.average, masked=True)
        return values.astype(np.float64).filled(np.nan), dataset.transform.a * step


def draw(results: Path) -> Figure:
    """Return the figure of three panels."""
    photo, _ = read(results / "deliverables/orthophoto.tif", [1, 2, 3])
    height, cell_m = read(results / "deliverables/dsm.tif", [1])
    relative = results / "quality/dsm_sigma_relative.tif"
    sigma, _ = read(relative if relative.is_file() else results / "quality/dsm_sigma.tif", [1])
    figure, axes = plt.subplots(1, 3, figsize=(10.8, 4.3), layout="constrained")
    figure.get_layout_engine().set(h_pad=0.12)
    visible = np.isfinite(photo).all(axis=0)
    rgba = np.dstack([*np.nan_to_num(photo) / 255.0, visible.astype(float)])
    axes[0].imshow(rgba)
    low, high = np.nanpercentile(height, [1, 99])
    tint = mpl.colormaps["viridis"](np.clip((height[0] - low) / (high - low), 0, 1))[..., :3]
    filled = np.where(np.isfinite(height[0]), height[0], np.nanmedian(height[0]))
    shade = LightSource(315, 45).shade_rgb(tint, filled, blend_mode="soft", vert_exag=2.0, dx=cell_m, dy=cell_m)
    shade[~np.isfinite(height[0])] = 1.0
    axes[1].imshow(shade)
    colours = mpl.cm.ScalarMappable(mpl.colors.Normalize(0.0, high - low), "viridis")
    label = "height above the lowest ground, m"
    figure.colorbar(colours, ax=axes[1], orientation="horizontal", shrink=0.8, pad=0.02, label=label)
    most = np.nanpercentile(sigma, SIGMA_PERCENTILE)
    shown = axes[2].imshow(100 * sigma[0], cmap="magma_r", vmin=0, vmax=100 * most)
    label = "predicted standard deviation, cm"
    figure.colorbar(shown, ax=axes[2], orientation="horizontal", shrink=0.8, pad=0.02, label=label)
    for ax, title in zip(axes, ("Orthophoto", "Surface model", "Its standard deviation"), strict=True):
        ax.set_title(title)
        ax.set_axis_off()
    return figure


if __name__ == "__main__":
    target = Path(sys.argv[2]) if len(sys.argv) > 2 else Path(__file__).with_suffix(".png")
    draw(Path(sys.argv[1])).savefig(target, dpi=90)
    with Image.open(target) as drawn:
        small = drawn.convert("RGB").quantize(COLOURS, dither=Image.Dither.NONE)
    small.save(target, optimize=True)
