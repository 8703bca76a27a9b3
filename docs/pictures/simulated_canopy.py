"""Make docs/pictures/simulated_canopy.png: a wood and a pond of the survey with canopy, each in two photographs.

python docs/pictures/simulated_canopy.py
"""

from pathlib import Path

import numpy as np
from PIL import Image

from photogram.arrays import ByteArray, FloatArray
from photogram.camera import project_points
from photogram.simulation.cover.leaves import PlantKind
from photogram.simulation.rendering import render
from photogram.simulation.scene import Material
from photogram.simulation.simulated_survey import SimulatedSurvey, canopy_plan, simulate

SEED = 2
HALF = np.array([170, 90])


def window(survey: SimulatedSurvey, number: int, corner: FloatArray) -> ByteArray:
    """Return the part of a photograph around a pixel (2,)."""
    picture = render(survey.scene, survey.truth.camera, survey.truth.poses[number], seed=number, exposure=number)
    (u0, v0), (u1, v1) = (corner - HALF).astype(int), (corner + HALF).astype(int)
    return picture[v0:v1, u0:u1]


def two_windows(survey: SimulatedSurvey, place: FloatArray) -> ByteArray:
    """Return the surroundings of a place (2,) in the two photographs that show it nearest to their middles."""
    camera = survey.truth.camera
    point = np.append(place, survey.scene.height(place[None]))[None]
    pixel = np.array([project_points(camera, pose, point)[0] for pose in survey.truth.poses])
    off = np.linalg.norm(pixel - camera.principal_point_px, axis=1)
    off[~np.all((pixel > HALF) & (pixel < [camera.width_px, camera.height_px] - HALF), axis=1)] = np.inf
    chosen = np.argsort(off)[:2]
    return np.hstack([window(survey, int(n), pixel[n]) for n in chosen])


def main() -> None:
    """Render four windows and write the picture."""
    survey = simulate(canopy_plan(), SEED)
    scene, cover = survey.scene, survey.scene.cover
    if cover is None:
        raise SystemExit("the plan has no cover")
    crowns = [
        cover.leaves.centre_m[cover.leaves.plant == n].mean(axis=0)[:2]
        for n in np.flatnonzero(cover.plants.kind == PlantKind.CROWN)
    ]
    apart = np.linalg.norm(np.array(crowns)[:, None] - np.array(crowns), axis=2)
    wood = crowns[int(np.argmax((apart < 10.0).sum(axis=1)))]
    row, column = np.nonzero(scene.material == Material.WATER)
    pond = np.array([column.mean(), row.mean()]) * scene.cell_m + [scene.west_m, scene.south_m]
    picture = np.vstack([two_windows(survey, place) for place in (wood, pond)])
    Image.fromarray(picture).save(Path(__file__).with_suffix(".png"), optimize=True)


if __name__ == "__main__":
    main()
