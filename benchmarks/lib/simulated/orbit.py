"""A site photographed from two rings around it: oblique photographs that all look at a heap in its middle, and far
beyond it; and the flight straight down over the same ground."""

from collections.abc import Sequence

import numpy as np

from photogram.quality.flight_lines import Course
from photogram.simulation.scene import Builder, Material, Scene
from photogram.simulation.simulated_survey import SimulatedSurvey, SurveyPlan, simulate

DISTANCE_M = 40.0
"""From the photographs of a ring to the middle of the site."""

HEAP_FOOT_M, HEAP_TOP_M, HEAP_HEIGHT_M = 10.0, 4.0, 5.0
"""Radii and height of the heap in the middle, a frustum of a cone: faces of 40°."""

RINGS_DEG = (-45.0, -60.0)
"""Pitch of the photographs of each ring."""


def orbit_plan(width_px: int = 1600) -> SurveyPlan:
    """Return the plan of an orbit: photographs of an ordinary drone, known by their tags, and six control points."""
    return SurveyPlan(
        width_px=width_px,
        height_px=width_px * 3 // 4,
        focal_px=0.7 * width_px,
        flying_height_m=DISTANCE_M * float(np.sin(np.radians(52.5))),
        relief_m=2.0,
        buildings=4,
        trees=30,
        control_points=6,
        check_points=8,
        position_noise_m=0.3,
    )


def nadir_plan(width_px: int = 1600) -> SurveyPlan:
    """Return the plan of a flight straight down from the same distance, 15 photographs."""
    overlap = {"forward_overlap": 0.8, "side_overlap": 0.7, "flying_height_m": DISTANCE_M}
    return SurveyPlan(**{**vars(orbit_plan(width_px)), **overlap, "strips": 3, "photographs_per_strip": 5})


def rings(photographs: int, pitches_deg: Sequence[float] = RINGS_DEG) -> list[Course]:
    """Return so many photographs in rings DISTANCE_M from the middle of the site, at which they look."""
    each, courses = photographs // len(pitches_deg), list[Course]()
    for number, pitch_deg in enumerate(pitches_deg):
        down = np.radians(-pitch_deg)
        radius_m, height_m = DISTANCE_M * np.cos(down), DISTANCE_M * np.sin(down)
        for angle in 2.0 * np.pi * (np.arange(each) + number / len(pitches_deg)) / each:
            place = float(radius_m * np.sin(angle)), float(radius_m * np.cos(angle))
            heading_deg = float(np.degrees(angle)) + 180.0
            courses.append(Course(place, heading_deg, 1, 5.0, float(height_m), 90.0 + pitch_deg))
    return courses


def heaped_site(plan: SurveyPlan, seed: int, extent_m: float) -> Scene:
    """Return a site with a heap in its middle, and the buildings and trees of a plan around it."""
    builder = Builder(seed, extent_m, plan.cell_m)
    builder.ground(seed, plan.relief_m)
    window, xy = builder.window(np.zeros(2), HEAP_FOOT_M)
    rise = HEAP_HEIGHT_M / (HEAP_FOOT_M - HEAP_TOP_M)
    above = np.clip((HEAP_FOOT_M - np.linalg.norm(xy, axis=-1)) * rise, 0.0, HEAP_HEIGHT_M)
    builder.height[window] += above
    builder.material[window] = np.where(above > 0.0, Material.LITTER, builder.material[window])
    builder.taken.append((0.0, 0.0, HEAP_FOOT_M))
    for number in range(plan.buildings):
        builder.building(gabled=number % 3 != 2)
    for _ in range(plan.trees):
        builder.tree(seed + 17)
    return builder.scene(seed, 2.0 * plan.gsd_m)


def orbit_survey(seed: int, photographs: int = 24, plan: SurveyPlan | None = None) -> SimulatedSurvey:
    """Simulate an orbit of so many photographs."""
    return simulate(plan or orbit_plan(), seed, heaped_site, rings(photographs))


def nadir_survey(seed: int, plan: SurveyPlan | None = None) -> SimulatedSurvey:
    """Simulate the flight straight down over a site like that of the orbit."""
    return simulate(plan or nadir_plan(), seed, heaped_site)
