"""The pictures of docs/dense-matching.md, of a simulated survey with its results and its truth.

    python docs/pictures/dense_matching.py RESULTS TRUTH.tif WEST SOUTH EAST NORTH NORTHING

draws the part of the map between the four edges, and a profile from west to east at NORTHING.
"""

import sys
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import rasterio
from matplotlib.colors import LightSource
from matplotlib.figure import Figure
from PIL import Image
from rasterio.windows import from_bounds

HERE = Path(__file__).parent
MEASURED, FILLED = 1, 2


def read(path: Path, box: tuple[float, float, float, float]) -> np.ndarray:
    """Return the bands (B, rows, columns) of a raster between west, south, east and north, NaN for no data."""
    with rasterio.open(path) as raster:
        window = from_bounds(*box, raster.transform).round_offsets().round_lengths()
        values = raster.read(window=window)
        if raster.nodata is None or values.dtype == np.uint8:
            return values
        return np.where(values == raster.nodata, np.nan, values)


def save(figure: Figure, path: Path) -> None:
    """Write a figure with 33 steps of each colour, which makes the file small."""
    figure.savefig(path, dpi=85)
    plt.close(figure)
    with Image.open(path) as picture:
        coarse = picture.convert("RGB").point([min(round(v / 8) * 8, 255) for v in range(256)] * 3)
    coarse.save(path, optimize=True)


def draw_maps(results: Path, box: tuple[float, float, float, float]) -> None:
    """Draw the surface with its filled cells, its standard deviations, and the orthophoto."""
    west, south, east, north = box
    filled, sigma = (read(results / name, box)[0] for name in ("dsm_filled.tif", "dsm_sigma.tif"))
    source = read(results / "quality/dsm_source.tif", box)[0]
    picture = np.moveaxis(read(results / "deliverables/orthophoto.tif", box), 0, -1)
    with rasterio.open(results / "deliverables/dsm.tif") as raster:
        cell_m = raster.res[0]
    extent = (0.0, east - west, 0.0, north - south)
    figure, ((*axes,), bars) = plt.subplots(2, 3, figsize=(10, 5.2), height_ratios=[1, 0.04], layout="constrained")
    shade = LightSource(315, 45).hillshade(np.nan_to_num(filled, nan=np.nanmedian(filled)), dx=cell_m, dy=cell_m)
    image = axes[0].imshow(np.where(np.isnan(filled), np.nan, filled), cmap="viridis", extent=extent)
    axes[0].imshow(shade, cmap="gray", vmin=0, vmax=1, alpha=0.35, extent=extent)
    axes[0].imshow(np.where(source == FILLED, 1.0, np.nan), cmap="Oranges", vmin=0, vmax=1.6, extent=extent)
    axes[0].imshow(np.where(source == 0, 1.0, np.nan), cmap="gray", vmin=0, vmax=1, extent=extent)
    axes[0].set_title("heights (orange: filled)")
    figure.colorbar(image, cax=bars[0], orientation="horizontal", label="m")
    low, high = np.nanpercentile(1000 * sigma, [1, 99.5])
    image = axes[1].imshow(1000 * sigma, cmap="cividis", vmin=low, vmax=high, extent=extent)
    axes[1].set_title("predicted standard deviation")
    figure.colorbar(image, cax=bars[1], orientation="horizontal", label="mm")
    axes[2].imshow(picture, extent=extent, interpolation="antialiased")
    axes[2].set_title("orthophoto")
    bars[2].axis("off")
    for axis in axes:
        axis.set_xlabel("m")
    save(figure, HERE / "dense_building.png")


def draw_profile(results: Path, truth: Path, box: tuple[float, float, float, float], northing: float) -> None:
    """Draw the truth, what was measured and what was filled along a line from west to east."""
    west, _, east, _ = box

    def along(path: Path) -> tuple[np.ndarray, np.ndarray]:
        with rasterio.open(path) as raster:
            row, first = raster.index(west, northing)
            values = raster.read(1)[row, first : raster.index(east, northing)[1]]
            place = raster.xy(row, first)[0] + np.arange(len(values)) * raster.res[0] - west
        return place, np.where(values == -9999.0, np.nan, values)

    figure, axes = plt.subplots(2, 1, figsize=(9, 5.2), sharex=True, layout="constrained", height_ratios=[3, 1.2])
    at, height = along(truth)
    axes[0].plot(at, height, color="0.55", lw=3, label="true surface (simulated)")
    place, filled = along(results / "deliverables/dsm_filled.tif")
    kind = along(results / "quality/dsm_source.tif")[1]
    measured = np.where(kind == MEASURED, filled, np.nan)
    axes[0].plot(place, np.where(kind == FILLED, filled, np.nan), ".", color="#e69f00", ms=5, label="filled")
    axes[0].plot(place, measured, ".", color="#0072b2", ms=4, label="measured")
    axes[0].set_ylabel("height, m")
    axes[0].legend(loc="upper right")
    sigma = 1000 * along(results / "quality/dsm_sigma.tif")[1]
    off = 1000 * (measured - np.interp(place, at, height))
    axes[1].fill_between(place, -2 * sigma, 2 * sigma, step="mid", color="#56b4e9", alpha=0.5, label="± 2 predicted σ")
    axes[1].plot(place, off, ".", color="#0072b2", ms=3, label="measured − true")
    axes[1].set_ylim(-100, 140)
    axes[1].set_ylabel("mm")
    axes[1].set_xlabel("m, from west to east")
    axes[1].legend(loc="upper right", ncols=2)
    save(figure, HERE / "dense_profile.png")


def main() -> None:
    """Draw both pictures."""
    results, truth = Path(sys.argv[1]), Path(sys.argv[2])
    west, south, east, north, northing = (float(text) for text in sys.argv[3:8])
    draw_maps(results, (west, south, east, north))
    draw_profile(results, truth, (west, south, east, north), northing)


if __name__ == "__main__":
    main()
