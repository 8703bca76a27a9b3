"""Straight courses of a flight: where photographs are taken, and which way they look."""

from dataclasses import dataclass

import numpy as np

from photogram.arrays import FloatArray


@dataclass(frozen=True)
class Course:
    """One planned strip."""

    middle_world_m: tuple[float, float]
    """Its middle (east, north)."""
    heading_deg: float
    """Direction of flight, clockwise from north of the world."""
    photographs: int
    """Number of photographs."""
    base_m: float
    """Distance between them."""
    height_world_m: float
    """Flying height."""
    tilt_deg: float = 0.0
    """Forward tilt of the cameras from nadir."""
    setback_m: float = 0.0
    """Backward shift, so that tilted cameras show the same ground."""

    @property
    def forward(self) -> FloatArray:
        """Return the direction of flight (3,) in the world."""
        heading = np.radians(self.heading_deg)
        return np.array([np.sin(heading), np.cos(heading), 0.0])

    def poses(self) -> tuple[FloatArray, FloatArray]:
        """Return rotations world from camera (n, 3, 3) and projection centres (n, 3); pictures are level across."""
        tilt, forward = np.radians(self.tilt_deg), self.forward
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
