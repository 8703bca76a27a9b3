"""Straight courses of a flight: where photographs are taken, and which way they look."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from photogram.arrays import FloatArray


@dataclass(frozen=True)
class Course:
    """One strip of ``photographs`` at distances of ``base_m``, its middle above ``middle_world_m`` (east, north).

    Flown towards ``heading_deg`` (clockwise from north of the world) at the height ``height_world_m``, cameras looking
    forward by ``tilt_deg`` from straight down; ``setback_m`` moves them back, so that what they look at stays.
    """

    middle_world_m: tuple[float, float]
    heading_deg: float
    photographs: int
    base_m: float
    height_world_m: float
    tilt_deg: float = 0.0
    setback_m: float = 0.0

    def poses(self) -> tuple[FloatArray, FloatArray]:
        """Return rotations world from camera (n, 3, 3) and projection centres (n, 3); pictures are level across."""
        heading, tilt = np.radians(self.heading_deg), np.radians(self.tilt_deg)
        forward = np.array([np.sin(heading), np.cos(heading), 0.0])
        right, down = np.array([forward[1], -forward[0], 0.0]), np.array([0.0, 0.0, -1.0])
        axis = np.cos(tilt) * down + np.sin(tilt) * forward
        along = (np.arange(self.photographs) - (self.photographs - 1) / 2) * self.base_m - self.setback_m
        middle = np.array([*self.middle_world_m, self.height_world_m])
        rotation = np.column_stack([right, np.cross(axis, right), axis])
        return np.tile(rotation, (self.photographs, 1, 1)), middle + along[:, None] * forward


def flown(courses: list[Course]) -> tuple[FloatArray, FloatArray]:
    """Return the poses of all courses, one after the other: rotations (N, 3, 3) and projection centres (N, 3)."""
    poses = [course.poses() for course in courses]
    return np.concatenate([R for R, _ in poses]), np.concatenate([C for _, C in poses])
