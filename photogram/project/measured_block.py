"""The survey as it was measured: photographs, ground points and cameras in one frame, before anything is oriented."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from photogram.camera import rotation_from_gimbal
from photogram.errors import ProjectError
from photogram.frames import LocalFrame
from photogram.project.project import Project
from photogram.survey import Block, ControlPoints, Photograph, TiePoints

NO_TIE_POINTS = TiePoints(
    *(np.zeros(0, dtype=np.int64),) * 3,
    np.zeros((0, 2)),
    np.zeros(0),
    np.zeros((0, 3)),
    np.zeros((0, 3), dtype=np.uint8),
)


def _frame(project: Project, tags: Sequence[Mapping[str, Any]]) -> LocalFrame:
    # not the check points: they take no part in anything, the origin of the frame included
    positions = [p.control_map_m for p in project.control_points if p.role == "control"]
    positions += [np.array(t["gnss_map_m"]) for t in tags if t["gnss_map_m"] is not None]
    known = np.isfinite(positions).reshape(-1, 3)
    if not known.any(axis=0).all():
        raise ProjectError(
            f"{project.path}: neither control points nor GNSS positions: nothing says where the survey is; "
            "give control_points, or photographs with GNSS tags"
        )
    middle = np.nanmean(positions, axis=0)
    return LocalFrame.near(
        project.crs, np.where(known, positions, middle), project.world_kind, project.heights.map_geoid
    )


def _photograph(project: Project, frame: LocalFrame, index: int, tags: Mapping[str, Any]) -> Photograph:
    source = project.photographs[index]
    gnss = None if tags["gnss_map_m"] is None else frame.world_from_map(np.array([tags["gnss_map_m"]]))[0]
    attitude = None
    if tags["attitude_deg"] is not None:
        place = np.zeros(3) if gnss is None else gnss
        attitude = frame.rotation_world_from_true(place) @ rotation_from_gimbal(*tags["attitude_deg"])
    if gnss is not None and tags.get("lever_arm_enu_m") is not None:
        gnss = gnss + frame.rotation_world_from_true(gnss) @ np.array(tags["lever_arm_enu_m"])
    arm = tags.get("lever_arm_camera_m")
    return Photograph(
        source.name,
        source.camera,
        source.path,
        source.flight,
        None,
        gnss,
        None if gnss is None else np.array(tags["gnss_sigma_m"]),
        attitude,
        None if attitude is None else float(np.deg2rad(source.attitude_sigma_deg)),
        tags["height_above_ground_m"],
        lever_arm_camera_m=None if arm is None else np.array(arm),
    )


def _on_originals(points: ControlPoints, project: Project, tags: Sequence[Mapping[str, Any]]) -> ControlPoints:
    """Return ground points whose marks in copies of a photograph are moved to the photograph itself, unless the point
    is marked there already."""
    names = {photograph.name: i for i, photograph in enumerate(project.photographs)}
    original = np.array([names[t.get("copy_of") or t["name"]] for t in tags], dtype=np.int64)
    own = original[points.mark_photograph] == points.mark_photograph
    order = np.argsort(~own, kind="stable")  # marks in the photograph itself come before those in its copies
    place = np.column_stack([original[points.mark_photograph], points.mark_point])[order]
    kept = np.sort(order[np.unique(place, axis=0, return_index=True)[1]])
    return replace(
        points,
        mark_photograph=original[points.mark_photograph[kept]],
        mark_point=points.mark_point[kept],
        mark_pixel=points.mark_pixel[kept],
        mark_sigma_px=points.mark_sigma_px[kept],
    )


def measured_block(project: Project, tags: Sequence[Mapping[str, Any]]) -> Block:
    """Return the block as the project and the photographs' tags give it: no poses, no tie points. A photograph that is
    there twice has its marks once."""
    frame = _frame(project, tags)
    photographs = tuple(_photograph(project, frame, i, t) for i, t in enumerate(tags))
    points = project.control_points_in(frame)
    if any(t.get("copy_of") for t in tags):
        points = _on_originals(points, project, tags)
    return Block(
        frame,
        project.cameras,
        photographs,
        (None,) * len(photographs),
        NO_TIE_POINTS,
        points,
        project.gnss_offset_sigma_m,
    )
