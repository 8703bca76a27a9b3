"""Chunks of Metashape: their similarity; all else is tested with the exports and projects that hold them."""

from __future__ import annotations

import numpy as np
from foreign import rotation_of

from photogram.camera import Camera, Pose, project
from photogram.files.exchange.metashape.metashape_chunk import Similarity


def test_a_similarity_of_points_and_poses_changes_no_pixel() -> None:
    rng = np.random.default_rng(5)
    similarity = Similarity(3.5, rotation_of(np.array([0.3, -1.2, 0.7])), np.array([100.0, -20.0, 7.0]))
    camera = Camera("a", 640, 480, 500.0, np.array([320.0, 240.0]), np.array([-0.1, 0.02, 0.0, 0.0]))
    pose = Pose(rotation_of(np.array([0.1, 0.2, -0.3])), np.array([0.5, 0.25, -4.0]))
    points = rng.uniform(-1.0, 1.0, (20, 3))
    moved = project(camera, similarity.of_pose(pose, "here"), similarity.of_points(points))
    np.testing.assert_allclose(moved, project(camera, pose, points), rtol=0, atol=1e-9)
