"""What `photogram compare` does."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from rich.markup import escape
from rich.table import Table

from photogram.change.cloud_change import CloudRequest, compare_clouds
from photogram.change.m3c2 import M3C2Settings
from photogram.change.reference_comparison import compare_files_to_reference, write_comparison
from photogram.change.surface_change import SurfaceRequest, compare_surfaces
from photogram.change.work.tables import show_cloud_change, show_surface_change
from photogram.errors import ProjectError
from photogram.files.triangulations.reading import READERS
from photogram.quality.cloud_comparison import Comparison
from photogram.terminal.console import console, steps
from photogram.volumes.stable_ground import Motion
from photogram.volumes.surfaces import SURFACE_SUFFIXES, StatedSigma, in_survey

FIGURES: dict[str, Callable[[Comparison], str]] = {
    "points after the filter": lambda c: str(c.cloud_to_surface.points),
    "removed by the filter": lambda c: str(c.removed),
    "height over the surface: mean, m": lambda c: f"{c.cloud_to_surface.mean_m:.4f}",
    "standard deviation, m": lambda c: f"{c.cloud_to_surface.std_m:.4f}",
    "median, m": lambda c: f"{c.cloud_to_surface.median_m:.4f}",
    "NMAD, m": lambda c: f"{c.cloud_to_surface.nmad_m:.4f}",
    "to the nearest point: mean, m": lambda c: f"{c.cloud_to_cloud.mean_m:.4f}",
    "to the nearest point: standard deviation, m": lambda c: f"{c.cloud_to_cloud.std_m:.4f}",
}


RIM = Path("rim")
"""In place of a reference: planes through the rims of the polygons."""


@dataclass(frozen=True)
class Options:
    """The options of the command beside its clouds and its reference, as they are given."""

    method: Literal["height", "mesh", "m3c2"] = "height"
    polygons: Path | None = None
    stable: Path | None = None
    coregister: Motion | None = None
    sigma: tuple[float, float] | None = None
    reference_sigma: tuple[float, float] | None = None
    correlation_m: float | None = None
    polygon_sigma_m: float = 0.0
    radius_m: float | None = None
    normal_radius_m: float | None = None
    spacing_m: float | None = None
    max_distance_m: float = M3C2Settings().depth_m
    parts: tuple[str, ...] = ()


def run(clouds: list[Path], reference: Path, output: Path, sor: bool, options: Options | None = None) -> None:
    """Compare clouds with a reference, or two epochs; show the figures and write them and a picture."""
    options = options or Options()
    readable = (*SURFACE_SUFFIXES, *READERS)
    surfaces = [path for path in clouds if path.is_dir() or path.suffix.lower() in readable]
    if options.method != "height":
        _epochs_of_clouds(clouds, reference, output, options)
    elif surfaces:
        _epochs_of_surfaces(clouds, reference, output, options)
    elif options != Options():
        raise ProjectError(
            "differences of heights to a cloud take none of the options of two epochs: give two surfaces (GeoTIFF, or "
            "folders of results), or choose --method m3c2 or mesh"
        )
    else:
        _against_reference(clouds, reference, output, sor)


def _stated(sigma: tuple[float, float] | None) -> StatedSigma | None:
    return None if sigma is None else StatedSigma(*sigma)


def _one(clouds: list[Path]) -> Path:
    if len(clouds) > 1:
        raise ProjectError(f"two epochs are compared, {len(clouds)} files and a reference were given: name one")
    return clouds[0]


def _epochs_of_surfaces(clouds: list[Path], reference: Path, output: Path, options: Options) -> None:
    if (options.radius_m, options.normal_radius_m, options.spacing_m) != (None, None, None):
        raise ProjectError("scales are those of M3C2, which compares clouds: add --method m3c2, or leave them out")
    earlier = None if reference == RIM else reference
    request = SurfaceRequest(
        _one(clouds), earlier, options.polygons, options.stable, options.coregister, _stated(options.sigma),
        _stated(options.reference_sigma), options.correlation_m, options.polygon_sigma_m, parts=options.parts,
    )  # fmt: skip
    with steps("Comparison") as progress:
        change = compare_surfaces(request, output, progress)
    show_surface_change(change)
    _say_written(output, ("difference.tif", "difference_sigma.tif", "change.tif"), bool(change.volumes))


def run_volume(surface: Path, polygons: Path, base: str, output: Path, polygon_sigma_m: float) -> None:
    """Measure volumes of polygons over their rims, a height or a surface; show them, and write what `compare` does."""
    try:
        level_m = float(base)
    except ValueError:
        level_m = None
    earlier = None if level_m is not None or Path(base) == RIM else Path(base)
    request = SurfaceRequest(surface, earlier, polygons, outline_sigma_m=polygon_sigma_m, level_m=level_m)
    with steps("Volumes") as progress:
        change = compare_surfaces(request, output, progress)
    show_surface_change(change)
    _say_written(output, ("difference.tif", "difference_sigma.tif", "change.tif"), bool(change.volumes))


def _epochs_of_clouds(clouds: list[Path], reference: Path, output: Path, options: Options) -> None:
    if options.polygons is not None:
        raise ProjectError("volumes are those of surfaces: give GeoTIFFs, or folders of results, without --method")
    scales = M3C2Settings(options.radius_m, options.normal_radius_m, options.spacing_m, options.max_distance_m)
    later, earlier = (in_survey(path, "dense.laz") for path in (_one(clouds), reference))
    request = CloudRequest(
        later, earlier, "mesh" if options.method == "mesh" else "m3c2", options.stable, options.coregister,
        _stated(options.sigma), _stated(options.reference_sigma), options.correlation_m, scales,
    )  # fmt: skip
    with steps("Comparison") as progress:
        change = compare_clouds(request, output, progress)
    show_cloud_change(change)
    _say_written(output, ("distances.laz",), False)


def _say_written(output: Path, names: tuple[str, ...], volumes: bool) -> None:
    every = [*names, *(["volumes.csv"] if volumes else []), "comparison.json", "comparison.png"]
    console.print(f"Written: {escape(', '.join(str(output / name) for name in every))}", soft_wrap=True)


def _against_reference(clouds: list[Path], reference: Path, output: Path, sor: bool) -> None:
    with steps("Comparison") as progress:
        results = compare_files_to_reference(clouds, reference, sor=sor, progress=progress)
    table = Table(title=f"Differences from {escape(reference.name)}")
    table.add_column("figure")
    for name in results:
        table.add_column(escape(name), justify="right")
    for title, figure in FIGURES.items():
        table.add_row(title, *(figure(result) for result in results.values()))
    console.print(table)
    for name, result in results.items():
        if result.doubt:
            console.print(f"[yellow]warning[/yellow] {escape(f'{name} against {result.doubt}')}", soft_wrap=True)
    written = ", ".join(map(str, write_comparison(output, results)))
    console.print(f"Written: {escape(written)}", soft_wrap=True)
