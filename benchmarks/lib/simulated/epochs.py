"""Two epochs of one simulated site: the same ground and texture, a heap and a pit more in the later one, flown anew."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from photogram.arrays import FloatArray
from photogram.simulation.scene import Scene
from photogram.simulation.simulated_survey import SimulatedSurvey, SurveyPlan, made_site, simulate

EXTENT_M = 420.0
"""Side of the site, wide enough for every flight over it."""


@dataclass(frozen=True)
class Mound:
    """A change of the ground: a smooth mound of some height, a pit where that is negative."""

    east_m: float
    north_m: float
    radius_m: float
    height_m: float

    def at(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return its height at places of the world."""
        r = np.hypot(x - self.east_m, y - self.north_m) / self.radius_m
        return np.asarray(np.where(r < 1.0, self.height_m * 0.5 * (1.0 + np.cos(np.pi * np.minimum(r, 1.0))), 0.0))


def change_m(mounds: tuple[Mound, ...], x: FloatArray, y: FloatArray) -> FloatArray:
    """Return by how much the ground rises between the epochs at places of the world."""
    return np.asarray(sum((mound.at(x, y) for mound in mounds), np.zeros(np.shape(x))))


def _site(ground: int, mounds: tuple[Mound, ...]) -> Callable[[SurveyPlan, int, float], Scene]:
    def site(plan: SurveyPlan, seed: int, extent_m: float) -> Scene:  # noqa: ARG001 - the ground has a seed of its own
        scene = made_site(plan, ground, EXTENT_M)
        rows, columns = scene.height_m.shape
        x, y = np.meshgrid(
            scene.west_m + np.arange(columns) * scene.cell_m, scene.south_m + np.arange(rows) * scene.cell_m
        )
        return replace(scene, height_m=(scene.height_m + change_m(mounds, x, y)).astype(np.float32))

    return site


def simulate_epochs(plan: SurveyPlan, seed: int, mounds: tuple[Mound, ...]) -> tuple[SimulatedSurvey, SimulatedSurvey]:
    """Return an earlier and a later survey of one site, of which the later has mounds more."""
    earlier = simulate(plan, 1000 * seed + 1, _site(seed, ()))
    return earlier, simulate(plan, 1000 * seed + 2, _site(seed, mounds))
