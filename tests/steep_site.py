"""A frustum with steep faces that is photographed from all sides, and what is known of its heights beforehand."""

from dataclasses import dataclass, replace
from functools import cache

import cv2
import numpy as np

from photogram.arrays import BoolArray, Float32Array, FloatArray
from photogram.camera import Camera, Pose, oriented_by
from photogram.geodesy.frames import LocalFrame
from photogram.grid import MapGrid, Verticals, Window, verticals
from photogram.simulation.rendering import render
from photogram.simulation.scene import Scene as Site
from photogram.simulation.scene import make_scene
from photogram.surface.dense.pyramid import RANGE_STEPS, Level, Prior
from photogram.surface.dense.tile_matching import Scene
from photogram.surface.views import Views

EAST_M, NORTH_M, BASE_M = 600000.0, 5800000.0, 100.0
GSD_M, CELL_M, STEP_M = 0.1, 0.2, 0.25
HEIGHT_M, FOOT_M = 8.0, 8.0
"""Height of the frustum, and how far its foot is from its middle."""

CAMERA = Camera("steep", 300, 300, 420.0, np.array([151.0, 148.0]), np.array([-0.03, 0.01, 0.0, 0.0]))
GREY = np.array([0.299, 0.587, 0.114])


@dataclass(frozen=True, eq=False)
class SteepSite:
    """A square frustum on level ground, all faces of which have the same ``slope``; nine photographs of it without
    noise from 42 m, pixels of GSD_M on the ground, and the grid of the finest level around it."""

    slope: float
    site: Site
    frame: LocalFrame
    views: Views
    pictures: tuple[Float32Array, ...]
    level: Level

    def picture(self, view: int, reduction: int) -> Float32Array:
        """Return a picture, whole or of half the size."""
        return self.pictures[view + len(self.views) * {1: 0, 2: 1}[reduction]]

    @property
    def scene(self) -> Scene:
        """Return what is matched."""
        return Scene(self.frame, self.views, self.picture)

    def lines(self, window: Window) -> Verticals:
        """Return the vertical lines over a window."""
        return verticals(self.frame, self.level.grid, window)

    def truth_m(self, window: Window) -> Float32Array:
        """Return the true heights (rows, columns) over the base."""
        foot = self.lines(window).foot_world_m
        height = self.site.height(foot[..., :2].reshape(-1, 2)).reshape(window.shape)
        return height.astype(np.float32)

    def on_faces(self, window: Window, inset_m: float = 0.4) -> BoolArray:
        """Return which cells (rows, columns) lie on a face, farther than so many metres from its edges."""
        foot = self.lines(window).foot_world_m
        across, along = (np.sort(np.abs(foot[..., :2]), axis=-1)[..., k] for k in (1, 0))
        inside = FOOT_M - HEIGHT_M / self.slope + inset_m
        on = (across > inside) & (across < FOOT_M - inset_m) & (across - along > inset_m)
        return np.asarray(on, dtype=np.bool_)

    def prior(self, window: Window) -> Prior:
        """Return what a coarser level may know: nothing but level ground around the frustum, and how high that is."""
        truth = self.truth_m(window)
        foot = self.lines(window).foot_world_m
        near = np.abs(foot[..., :2]).max(axis=-1) < FOOT_M + 0.5
        beyond = np.float32(RANGE_STEPS * STEP_M)
        low = np.where(near, np.float32(-1.0), truth - beyond).astype(np.float32)
        high = np.where(near, np.float32(HEIGHT_M + 1.0), truth + beyond).astype(np.float32)
        surface = np.where(near, np.float32(0.5 * HEIGHT_M), truth).astype(np.float32)
        return Prior(low, high, surface, np.ones(window.shape, bool))


def _towards(position: FloatArray, aim: FloatArray) -> FloatArray:
    """Return the rotation, world from camera, of a photograph taken towards a place with its top to the north."""
    axis = (aim - position) / np.linalg.norm(aim - position)
    right = np.cross(axis, [0.0, 1.0, 0.0])
    right /= np.linalg.norm(right)
    return np.column_stack([right, np.cross(axis, right), axis])


@cache
def steep_site(face_deg: float) -> SteepSite:
    """Return the site with faces of a slope, made once."""
    slope = float(np.tan(np.radians(face_deg)))
    flat = make_scene(5, 64.0, 0.25, relief_m=0.0, buildings=0, trees=0, finest_wavelength_m=0.3)
    row, column = np.mgrid[: flat.height_m.shape[0], : flat.height_m.shape[1]]
    away = np.maximum(np.abs(flat.west_m + flat.cell_m * column), np.abs(flat.south_m + flat.cell_m * row))
    height = np.clip((FOOT_M - away) * slope, 0.0, HEIGHT_M).astype(np.float32)
    site = replace(flat, height_m=height)
    poses = []
    for east in (-8.0, 0.0, 8.0):
        for north in (-8.0, 0.0, 8.0):
            position = np.array([east, north, 42.0 + 0.05 * east])
            poses.append(Pose(_towards(position, np.array([0.3 * east, 0.3 * north, 2.0])), position))
    coloured = [render(site, CAMERA, pose, seed=n, noise_dn=0.0) for n, pose in enumerate(poses)]
    pictures = [(rgb @ GREY).astype(np.float32) for rgb in coloured]
    views = Views(np.arange(len(poses)), oriented_by([CAMERA], np.zeros(len(poses), np.int64), poses))
    frame = LocalFrame("EPSG:25832", (EAST_M, NORTH_M, BASE_M), "grid")
    grid = MapGrid(EAST_M - 12.0, NORTH_M + 12.0, CELL_M, 120, 120)
    level = Level(grid, 1, GSD_M / CELL_M, STEP_M)
    return SteepSite(slope, site, frame, views, (*pictures, *map(cv2.pyrDown, pictures)), level)
