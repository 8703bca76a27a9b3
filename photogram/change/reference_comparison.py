"""Clouds in files compared with a reference: a surface or a cloud."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from photogram.errors import ProjectError
from photogram.files.atomic import make_folder
from photogram.files.clouds.points import read_cloud
from photogram.files.npz_json import write_json
from photogram.pipeline.stages.comparison import read_reference
from photogram.quality.cloud_comparison import Comparison, compare_to_reference, triangulate
from photogram.report.figures.style import comparison_figure, save_picture
from photogram.survey import PointCloud
from photogram.wording import Progress, silent

FIGURES, PICTURE = "comparison.json", "comparison.png"


def compare_files_to_reference(
    clouds: Sequence[Path | str], reference: Path | str, *, sor: bool = True, progress: Progress = silent
) -> dict[str, Comparison]:
    """Return the comparison of each cloud (.txt, .csv, .xyz, .las, .laz) with a reference, by the names of their files.

    ``reference`` is a surface (GeoTIFF) or a cloud, which is triangulated; ``sor`` removes statistical outliers first.
    Raises ProjectError where two clouds have one name or a file cannot be used.
    """
    paths, given = [Path(cloud) for cloud in clouds], Path(reference)
    titles = [path.stem for path in paths]
    if len(set(titles)) < len(titles):
        raise ProjectError(f"two clouds have the name {max(titles, key=titles.count)!r}: rename one")
    total = len(paths) + 2
    progress(0, total, f"reading {given.name}")
    read = read_reference(given)
    progress(1, total, f"triangulating {given.name}" if isinstance(read, PointCloud) else "")
    surface = triangulate(read) if isinstance(read, PointCloud) else read
    results = {}
    for number, path in enumerate(paths, 2):
        progress(number, total, path.name)
        results[path.stem] = compare_to_reference(read_cloud(path), surface, sor)
    progress(total, total, "")
    return results


def write_comparison(folder: Path | str, results: Mapping[str, Comparison]) -> tuple[Path, Path]:
    """Write the figures of a comparison and their picture into a folder; returns their paths. Raises WorkspaceError
    where they cannot be written."""
    figures, picture = Path(folder) / FIGURES, Path(folder) / PICTURE
    make_folder(Path(folder))
    write_json(
        figures,
        {
            name: {"removed": r.removed, "cloud_to_surface": r.cloud_to_surface, "cloud_to_cloud": r.cloud_to_cloud}
            for name, r in results.items()
        },
    )
    save_picture(comparison_figure(results), picture)
    return figures, picture
