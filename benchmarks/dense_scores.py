"""The scores of a file of dense heights against a known surface, or beside another program's cloud.

    python benchmarks/dense_scores.py FOLDER HEIGHTS.tif [--sigma SIGMA.tif] [--source SOURCE.tif] [--cloud CLOUD]

FOLDER is a simulated survey (its truth.json holds the seed from which everything is made again: scene, cameras, poses)
or shared/data/dtu_phantom4. What the scores are: benchmarks/lib/dense_scores.py; of a survey with canopy those by kind
of ground stand below, by level with --source (benchmarks/lib/canopy_scores.py).
"""

import argparse
from pathlib import Path

from lib.canopy_scores import canopy_scores, map_cover, table
from lib.dense_scores import agreement, score
from lib.dense_truth import simulated_survey, truth_of

from photogram.files.clouds.points import read_cloud
from photogram.files.maps.rasters import read_codes, read_raster
from photogram.grid import MapGrid


def main() -> None:
    """Print the scores of a file of heights."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folder", type=Path, help="a simulated survey, or shared/data/dtu_phantom4")
    parser.add_argument("heights", type=Path, help="GeoTIFF of heights in the map")
    parser.add_argument("--sigma", type=Path, help="GeoTIFF of their standard deviations")
    parser.add_argument("--source", type=Path, help="GeoTIFF of the codes of their levels")
    parser.add_argument("--cloud", type=Path, help="another program's cloud to compare with: agreement, not accuracy")
    arguments = parser.parse_args()
    heights, _ = read_raster(arguments.heights)
    sigma = None if arguments.sigma is None else read_raster(arguments.sigma)[0]
    if (arguments.folder / "truth.json").is_file():
        truth = truth_of(arguments.folder, heights.cell_m)
        found = score(heights, truth, sigma)
        for name, value in {**vars(found), **{f"edges: {k}": v for k, v in vars(found.edges).items()}}.items():
            if name != "edges":
                print(f"{name:24}{value:>14,}" if isinstance(value, int) else f"{name:24}{value:14.4f}")
        survey = None if (arguments.folder / "surface_truth.tif").is_file() else simulated_survey(arguments.folder)
        if survey is not None and survey.scene.cover is not None:
            source = None if arguments.source is None else read_codes(arguments.source, MapGrid.of(heights).whole)
            print(table(canopy_scores(heights, map_cover(survey, truth), sigma, source)))
    if arguments.cloud is not None:
        for name, value in vars(agreement(heights, read_cloud(arguments.cloud))).items():
            print(f"{name:24}{value}")


if __name__ == "__main__":
    main()
