"""Surveys with known truth: flown, measured and photographed on a made site, from a seed and nothing else.

``simulate`` makes a small survey with a scene that can be rendered; ``simulate_block`` makes the observations of a
block of hundreds of photographs without rendering, on the bare terrain. Every error has a stated standard deviation,
see photogram.simulation.flight.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from photogram.arrays import ByteArray
from photogram.camera import Camera
from photogram.geodesy.frames import LocalFrame
from photogram.quality.flight_lines import Course
from photogram.simulation.covered_site import make_covered_scene
from photogram.simulation.flight import (
    Truth,
    candidates,
    fly,
    footprints,
    measure_control,
    observe,
    place_control,
)
from photogram.simulation.observations import SimulatedBlock, simulate_block
from photogram.simulation.rendering import render
from photogram.simulation.scene import Scene, make_scene, paint_targets, surface_raster, target_reach
from photogram.simulation.survey_plan import (
    CoveredPlan,
    SurveyPlan,
    canopy_plan,
    demonstration_plan,
    rtk_plan,
    whole_survey_plan,
)
from photogram.survey import ControlPoints, Photograph, Raster

__all__ = [
    "CoveredPlan",
    "SimulatedBlock",
    "SimulatedSurvey",
    "SurveyPlan",
    "Truth",
    "canopy_plan",
    "demonstration_plan",
    "render_photographs",
    "rtk_plan",
    "simulate",
    "simulate_block",
    "truth_surface",
    "whole_survey_plan",
]


@dataclass(frozen=True, eq=False)
class SimulatedSurvey:
    """A survey and its scene: what a surveyor holds (approximate camera, photographs, control points) and the truth."""

    plan: SurveyPlan
    seed: int
    frame: LocalFrame
    scene: Scene
    approximate_camera: Camera
    photographs: tuple[Photograph, ...]
    control_points: ControlPoints
    truth: Truth

    def __repr__(self) -> str:
        return f"<SimulatedSurvey, seed {self.seed}: {len(self.photographs)} photographs, {self.control_points!r}>"


def made_site(plan: SurveyPlan, seed: int, extent_m: float) -> Scene:
    """Return the site of a plan, a square of side ``extent_m``."""
    site = (extent_m, plan.cell_m, plan.relief_m, plan.buildings, plan.trees)
    if isinstance(plan, CoveredPlan):
        return make_covered_scene(seed, *site, finest_wavelength_m=2 * plan.gsd_m, plan=plan.cover)
    return make_scene(seed, *site, finest_wavelength_m=2 * plan.gsd_m)


def simulate(
    plan: SurveyPlan,
    seed: int,
    site: Callable[[SurveyPlan, int, float], Scene] = made_site,
    courses: list[Course] | None = None,
) -> SimulatedSurvey:
    """Fly and measure a plan over a made site; the photographs themselves come from ``render_photographs``.

    ``site`` makes it from the plan, the seed and its side in m; ``courses`` are flown in place of its strips. Marks are
    what the photographs show: points outside of them or hidden by the scene have none. Raises ValueError when a
    photograph sees too few control points for the plan, or looks above the horizon.
    """
    rng = np.random.default_rng([seed, 0])
    flight = fly(plan, rng, courses)
    reach = np.abs(footprints(flight, -plan.relief_m)).max()
    bare = site(plan, seed, float(np.ceil(2 * reach / 10 + 1) * 10))
    place = candidates(flight, rng)
    place = place[bare.open_ground(place, target_reach(bare, plan.target_radius_m))]
    candidate = np.column_stack([place, bare.height(place)])
    seen = observe(flight, candidate, 25.0, bare).table(len(flight.poses), len(candidate))
    scene = paint_targets(bare, place_control(plan, candidate, seen)[:, :2], plan.target_radius_m)
    position = scene.targets_world_m
    marks = observe(flight, position, 1.5 * plan.target_radius_m / plan.gsd_m, scene)
    control = measure_control(flight, position, marks, rng)
    return SimulatedSurvey(
        plan, seed, plan.frame, scene, flight.approximate, flight.photographs, control, flight.truth(position)
    )


def render_photographs(survey: SimulatedSurvey, *, noise_dn: float = 2.0) -> Iterator[tuple[str, ByteArray]]:
    """Yield the name and the pixels (height_px, width_px, 3), red, green, blue, of each photograph of a survey."""
    for number, (photograph, pose) in enumerate(zip(survey.photographs, survey.truth.poses, strict=True)):
        seed, camera = survey.seed * 100_003 + number, survey.truth.camera
        yield photograph.name, render(survey.scene, camera, pose, seed=seed, noise_dn=noise_dn, exposure=number)


def truth_surface(survey: SimulatedSurvey, cell_m: float) -> Raster:
    """Return the surface of the whole site in the map frame, roofs and trees included; NaN off the site."""
    return surface_raster(survey.scene, survey.frame, cell_m)
