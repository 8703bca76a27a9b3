"""The draft of a project, made from the tags of its photographs; nothing here reads or writes a file."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from photogram.arrays import BoolArray, FloatArray
from photogram.errors import FrameError, ProjectError
from photogram.files.photographs.tags import PhotographTags, damage_by_kind
from photogram.files.tables.position_files import PositionRow
from photogram.geodesy.crs import NO_CRS, WGS84, height_system_of, projected_crs, vertical_of
from photogram.geodesy.height_systems import HeightSystem, is_gnss_ellipsoid
from photogram.gnss import Sigma3
from photogram.project.draft.cameras import (
    CameraKey,
    TaggedCamera,
    camera_key,
    camera_names,
    tagged_camera,
)
from photogram.project.draft.control import ControlFile, fitting_zones, in_fitting_grid, in_fitting_order
from photogram.project.draft.positions import (
    Gnss,
    GnssKind,
    gnss_of,
    gnss_stated,
    gnss_with,
    height_reference,
    offset_prior,
)
from photogram.project.draft.rigs import DraftRig, draft_rigs
from photogram.project.draft.sites import (
    Exposure,
    gap_between_sites_m,
    group_sites,
    local_metres,
    middle_of,
    separate_flights,
    utm_crs,
)
from photogram.project.positions.frozen import frozen_positions
from photogram.wording import some

_OUTSIDE_AREA_DEG = 4.0
_RARE_SHARE, _RARE = 0.1, 3


@dataclass(frozen=True)
class TaggedPhotograph:
    """A photograph that can be used, by its name in the project, and its tags."""

    name: str
    tags: PhotographTags


@dataclass(frozen=True)
class LeftOut:
    """A photograph that is not to be used, and why."""

    name: str
    reason: str


@dataclass(frozen=True)
class OtherSite:
    """Photographs of another place: ``distance_m`` from the middle of the ones that are kept."""

    longitude_deg: float
    latitude_deg: float
    distance_m: float
    names: tuple[str, ...]


@dataclass(frozen=True)
class DraftPhotograph:
    """A photograph of the project; ``gnss`` is None where neither its tags nor a file give a position. ``listed`` says
    that a file gives it, with its standard deviations."""

    name: str
    camera: str
    flight: str
    gnss: Gnss | None
    has_attitude: bool
    listed: bool = False


@dataclass(frozen=True)
class DraftPositions:
    """A file of positions beside the photographs, as the project names it: its rows by the names of the photographs, or
    the ``error`` for which it is not used; ``is_table`` where it is a table of positions of the camera, ``degrees``
    longitude, latitude and height by the lines of its rows, where they are known."""

    path: str
    rows: Mapping[str, PositionRow] = field(default_factory=dict)
    error: str = ""
    is_table: bool = False
    degrees: Mapping[int, tuple[float, float, float]] = field(default_factory=dict)


@dataclass(frozen=True)
class DraftMasks:
    """The folder of masks beside the photographs, as the project names it: how many photographs have one, or the
    ``error`` for which it is not used."""

    path: str
    photographs: int = 0
    error: str = ""


@dataclass(frozen=True)
class Wishes:
    """What the user asks for beside the photographs, and what lies beside them; ``focal_px`` is the focal length of the
    camera whose tags give none, ``focal_px_of`` that of cameras by their names, ``heights`` is the system of the ground
    points."""

    crs: str | None = None
    focal_px: float | None = None
    focal_px_of: Mapping[str, float] = field(default_factory=dict)
    control: tuple[ControlFile, ...] = ()
    heights: HeightSystem | None = None
    geoid: str | None = None
    positions: tuple[DraftPositions, ...] = ()
    masks: DraftMasks | None = None


@dataclass(frozen=True)
class DraftHeights:
    """What heights are counted from: those of all results, of GNSS and of the ground points, None where nobody says;
    ``known`` where nothing is left to be said."""

    output: HeightSystem | None = None
    gnss: HeightSystem | None = None
    control_points: HeightSystem | None = None
    geoid: str | None = None
    known: bool = False


@dataclass(frozen=True)
class ProjectDraft:
    """A project to be written; ``heights`` says in words from what the heights of the positions are counted,
    ``warnings`` what is doubtful about the photographs that are used."""

    crs: str
    crs_name: str
    crs_reason: str
    cameras: tuple[TaggedCamera, ...]
    photographs: tuple[DraftPhotograph, ...]
    offset_sigma_m: Sigma3
    offset_reason: str
    heights: str
    height_systems: DraftHeights
    control: tuple[ControlFile, ...] = ()
    other_sites: tuple[OtherSite, ...] = ()
    left_out: tuple[LeftOut, ...] = ()
    gnss_kinds: Mapping[GnssKind, int] = field(default_factory=dict)
    positions: tuple[DraftPositions, ...] = ()
    warnings: tuple[str, ...] = ()
    masks: DraftMasks | None = None
    rigs: tuple[DraftRig, ...] = ()
    others: tuple[str, ...] = ()
    """Files beside the photographs that nothing reads."""
    tags_passed_over: tuple[str, ...] = ()
    """Names of the XMP tags of positions, attitudes and accuracies that nothing reads."""
    unsearched: tuple[str, ...] = ()
    """Folders within theirs that were not searched, and how many pictures each holds."""

    @property
    def left_out_for(self) -> dict[str, list[str]]:
        """The names of the photographs that are left out, by the reason."""
        reasons: dict[str, list[str]] = {}
        for photograph in self.left_out:
            reasons.setdefault(photograph.reason, []).append(photograph.name)
        return reasons

    @property
    def flights(self) -> int:
        """The number of flights."""
        return len({p.flight for p in self.photographs})


# ---- map grid ------------------------------------------------------------------------------------------------------


def named(crs: str) -> tuple[str, str]:
    """Return a CRS as the project names it, by its EPSG code where it has one, and in words."""
    grid = projected_crs(crs)
    code = None if crs.upper().startswith("EPSG:") else grid.to_epsg()
    if code is None:
        return crs, str(grid.name)
    return f"EPSG:{code}", str(projected_crs(f"EPSG:{code}").name)


def _check_place(crs: str, middle: tuple[float, float] | None, file: ControlFile | None = None) -> None:
    """Raise ProjectError where the photographs lie far outside the area of a map grid, with the zone in which the
    points of the ``file`` that names it lie among them."""
    area = projected_crs(crs).area_of_use
    if area is None or middle is None or area.west > area.east:
        return
    longitude, latitude = middle
    margin = _OUTSIDE_AREA_DEG
    if (
        not area.west - margin <= longitude <= area.east + margin
        or not area.south - margin <= latitude <= area.north + margin
    ):
        remedy = f"give the map grid of the site, {utm_crs(longitude, latitude)} for example"
        fitting = fitting_zones(file, crs, middle) if file is not None else []
        if fitting:
            remedy = f"write {' or '.join(fitting)} into the file, as its points lie among the photographs there"
        raise ProjectError(
            f"{'crs' if file is None else file.path}: {crs} ({projected_crs(crs).name}) is valid for longitude "
            f"{area.west:g} to {area.east:g}, latitude {area.south:g} to {area.north:g}; the photographs lie at "
            f"{longitude:.4f}, {latitude:.4f}: {remedy}"
        )


def _choose_crs(wishes: Wishes, middle: tuple[float, float] | None) -> tuple[str, str, str]:
    """Return the CRS, its name, and why it."""
    if wishes.crs == NO_CRS:
        return NO_CRS, "local frame", "as asked for"
    if wishes.crs is not None:
        crs, name = named(wishes.crs)
        _check_place(crs, middle)
        return crs, name, "as asked for"
    for file in wishes.control:
        if file.crs is None:
            continue
        try:
            crs, name = named(file.crs)
        except FrameError:
            continue  # geographic, or in feet: its points are transformed to the map grid chosen below
        _check_place(crs, middle, file)
        return crs, name, f"the one of {file.path}"
    if middle is None and not wishes.control:
        return NO_CRS, "local frame", "neither the tags nor ground points say where the photographs were taken"
    if middle is None:
        raise ProjectError(
            "the photographs have no positions in their tags, so no map grid can be proposed: give one with "
            "--crs EPSG:…, or --crs none where the ground points are in a Cartesian system of their own"
        )
    own, name = named(utm_crs(*middle))
    where = f"longitude {middle[0]:.4f}, latitude {middle[1]:.4f}"
    files = [in_fitting_grid(file, own, middle, is_proposed=True) for file in wishes.control]
    grids = {file.grid or own: file for file in files if file.crs is None and not file.geographic}
    grids.pop(WGS84, None)
    if len(grids) != 1 or own in grids:
        return own, name, f"the UTM zone of the photographs, at {where}"
    ((crs, file),) = grids.items()
    return (
        *named(crs),
        f"the zone in which the points of {file.path} lie among the photographs, at {where}; in the photographs' own, "
        f"{own}, they would lie {file.off_m / 1000:.0f} km away",
    )


def _height_systems(wishes: Wishes, crs: str, tags: Sequence[PhotographTags]) -> DraftHeights:
    """Return what tags, files and wishes say of the heights."""
    if crs == NO_CRS:
        return DraftHeights()
    ellipsoidal = {t.height_is_ellipsoidal for t in tags if t.height_m is not None}
    gnss: HeightSystem | None = "ellipsoidal" if ellipsoidal == {True} else None
    if vertical_of(crs) is not None:
        return DraftHeights("orthometric", None, wishes.heights, wishes.geoid, known=True)
    named = {
        wishes.heights if file.crs is None else height_system_of(file.crs)[0] or wishes.heights
        for file in wishes.control
    }
    control = named.pop() if len(named) == 1 else None
    output = wishes.heights or control or (gnss if not wishes.control else None)
    own = output != "ellipsoidal" or is_gnss_ellipsoid(projected_crs(crs))
    known = output is not None and own and (output == "ellipsoidal" or wishes.geoid is not None)
    return DraftHeights(output if known else None, gnss, wishes.heights, wishes.geoid, known)


# ---- photographs ---------------------------------------------------------------------------------------------------

_KINDS = {"thermal": "a thermal picture", "panorama": "a panorama", "fisheye": "taken with a fisheye lens"}


def _usable(photographs: Sequence[TaggedPhotograph]) -> tuple[list[TaggedPhotograph], list[LeftOut]]:
    """Return the photographs that are processed, thermal ones where there are no others, and those that are not."""
    kind = "frame" if any(p.tags.kind == "frame" for p in photographs) else "thermal"
    left_out = [
        LeftOut(p.name, f"{_KINDS[p.tags.kind]}, photogram processes frame photographs only")
        for p in photographs
        if p.tags.kind not in ("frame", kind)
    ]
    return [p for p in photographs if p.tags.kind in ("frame", kind)], left_out


def _degrees(photographs: Sequence[TaggedPhotograph]) -> FloatArray:
    """Return longitude and latitude (N, 2) of the photographs, NaN where there are none."""
    known = [(p.tags.longitude_deg, p.tags.latitude_deg) for p in photographs]
    return np.array([[np.nan if x is None else x for x in pair] for pair in known]).reshape(-1, 2)


def _located(place_deg: FloatArray) -> BoolArray:
    return np.asarray(np.isfinite(place_deg).all(axis=1))


def _local(place_deg: FloatArray) -> FloatArray:
    """Return places (N, 2) in metres east and north of their middle, NaN where there are none."""
    known, position_m = _located(place_deg), np.full(place_deg.shape, np.nan)
    if known.any():
        position_m[known] = local_metres(*place_deg[known].T)
    return position_m


def _main_site(photographs: Sequence[TaggedPhotograph]) -> tuple[list[TaggedPhotograph], list[OtherSite], float]:
    """Return the photographs of the largest site and those without a position, the other sites, and the gap between
    sites."""
    place = _degrees(photographs)
    known = np.flatnonzero(_located(place))
    if not len(known):
        return list(photographs), [], gap_between_sites_m(np.zeros((0, 2)))
    position_m = local_metres(*place[known].T)
    gap_m = gap_between_sites_m(position_m)
    labels = np.zeros(len(photographs), dtype=np.int64)
    labels[known] = group_sites(position_m, gap_m)
    here = np.median(position_m[labels[known] == 0], axis=0)
    others = []
    for site in range(1, int(labels.max()) + 1):
        members = [int(i) for i in np.flatnonzero(labels == site)]
        there = np.median(position_m[labels[known] == site], axis=0)
        names = tuple(photographs[i].name for i in members)
        others.append(OtherSite(*middle_of(*place[members].T), float(np.hypot(*(there - here))), names))
    return [p for p, site in zip(photographs, labels, strict=True) if site == 0], others, gap_m


def _depth(tags: PhotographTags) -> str:
    return f" and {tags.bits} bits" if tags.bits > 8 else ""


def _one_of(count: int) -> str:
    return f"one of {count}" if count > 1 else "the only one"


def _cameras(
    photographs: Sequence[TaggedPhotograph], given_focal_px: float | None, focal_px_of: Mapping[str, float]
) -> tuple[dict[CameraKey, TaggedCamera], list[LeftOut]]:
    """Return the cameras by their keys, and the photographs of cameras that took next to none."""
    members: dict[CameraKey, list[TaggedPhotograph]] = {}
    for photograph in photographs:
        members.setdefault(camera_key(photograph.tags), []).append(photograph)
    most = max(len(group) for group in members.values())
    rare = {key for key, group in members.items() if len(group) < _RARE and len(group) <= _RARE_SHARE * most}
    left_out = [
        LeftOut(
            p.name,
            f"{_one_of(len(group))} of {p.tags.width_px} × {p.tags.height_px} px{_depth(p.tags)} by "
            f"{p.tags.model or 'a camera'}, "
            "too few for a self-calibration",
        )
        for key, group in members.items()
        if key in rare
        for p in group
    ]
    keys = sorted(members.keys() - rare, key=lambda key: (-len(members[key]), members[key][0].name))
    for key in keys[1:]:
        # damaged tags make a camera of their own, which must not end the draft of all others
        any_px = next(iter(focal_px_of.values()), given_focal_px)
        if len(members[key]) < _RARE and tagged_camera("", [p.tags for p in members[key]], any_px) is None:
            rare.add(key)
            reason = "its tags give no focal length, and its camera has too few photographs to estimate it"
            left_out += [LeftOut(p.name, reason) for p in members[key]]
    keys = [key for key in keys if key not in rare]
    names = camera_names(keys, [members[key][0].tags for key in keys])
    tags = [[p.tags for p in members[key]] for key in keys]
    strange = sorted(focal_px_of.keys() - set(names))
    if strange:
        raise ProjectError(f"--focal-px {strange[0]}=…: no camera is called so; the cameras are {', '.join(names)}")
    cameras = [tagged_camera(name, group, focal_px_of.get(name)) for name, group in zip(names, tags, strict=True)]
    bare = [name for name, camera in zip(names, cameras, strict=True) if camera is None]
    if given_focal_px is not None and len(bare) > 1:
        each = " ".join(f"--focal-px {name}=…" for name in bare)
        raise ProjectError(
            f"--focal-px {given_focal_px:g}: the tags of {len(bare)} cameras give no focal length, which is hardly the "
            f"same: give {each}"
        )
    if given_focal_px is not None and (len(cameras) == 1 or None in cameras):
        wanted = [len(cameras) == 1 or camera is None for camera in cameras]
        cameras = [
            tagged_camera(name, group, given_focal_px) if want else camera
            for name, group, camera, want in zip(names, tags, cameras, wanted, strict=True)
        ]
    elif given_focal_px is not None:
        raise ProjectError(
            f"--focal-px: the tags give the focal lengths of all {len(cameras)} cameras ({', '.join(names)}): "
            "omit the option and change the focal length of one in the project file"
        )
    unknown = [
        f"{name} ({members[key][0].name})" for key, name, c in zip(keys, names, cameras, strict=True) if c is None
    ]
    if unknown:
        raise ProjectError(
            f"the tags do not give the focal length of {', '.join(unknown)}: give it in pixels with --focal-px, the "
            "focal length in mm times the width of the picture in pixels over the width of the sensor in mm"
        )
    return {key: camera for key, camera in zip(keys, cameras, strict=True) if camera is not None}, left_out


def _frozen(photographs: Sequence[TaggedPhotograph]) -> set[str]:
    """Return the names of the photographs whose tags repeat a position, because the receiver had stopped."""
    heights_m = [p.tags.height_m or 0.0 for p in photographs]
    position_m = np.column_stack([_local(_degrees(photographs)), heights_m])
    frozen = frozen_positions(position_m, [p.tags.time for p in photographs], [p.tags.capture for p in photographs])
    return {p.name for p, stopped in zip(photographs, frozen, strict=True) if stopped}


def _gnss(
    photographs: Sequence[TaggedPhotograph], rows: Mapping[str, PositionRow]
) -> tuple[list[Gnss | None], list[str]]:
    """Return how good the position of each photograph is, that of its row in a file before that of its tags, and the
    names of those whose tags are not used because the receiver had stopped."""
    frozen = _frozen([p for p in photographs if p.name not in rows])
    # where all are, the project still needs a standard deviation for them
    unused = frozen if len(frozen) < len(photographs) else set[str]()
    gnss = list[Gnss | None]()
    for photograph in photographs:
        row = rows.get(photograph.name)
        if row is not None:
            gnss.append(gnss_with(row.solution, row.sigma_m) or gnss_stated(row.sigma_m))
        else:
            gnss.append(None if photograph.name in unused else gnss_of(photograph.tags))
    return gnss, [p.name for p in photographs if p.name in frozen]


def _warnings(photographs: Sequence[TaggedPhotograph], frozen: Sequence[str]) -> tuple[str, ...]:
    """Return in words what is doubtful about photographs that are used."""
    damaged = damage_by_kind([(p.name, p.tags.damage) for p in photographs])
    words = [f"{some(names)}: {text}" for text, names in damaged]
    if frozen:
        words.append(
            f"{some(frozen)}: {len(frozen)} photographs have the GNSS position of another time, which is not "
            "used: the receiver had stopped updating, or is slower than the camera"
        )
    return tuple(words)


def _aircraft(photographs: Sequence[TaggedPhotograph]) -> list[str]:
    """Return what carried every photograph: its camera's body, one and the same for cameras with identifiers of
    exposures in common."""
    bodies = ["\0".join(str(part) for part in (p.tags.make, p.tags.model, p.tags.serial)) for p in photographs]
    carrier = {body: body for body in bodies}
    first: dict[str, str] = {}
    for photograph, body in zip(photographs, bodies, strict=True):
        if photograph.tags.capture is not None:
            one, other = carrier[first.setdefault(photograph.tags.capture, body)], carrier[body]
            if one != other:
                carrier = {b: one if c == other else c for b, c in carrier.items()}
    return [carrier[body] for body in bodies]


def flights_of(photographs: Sequence[TaggedPhotograph], gap_m: float | None = None) -> list[str]:
    """Return the flight of every photograph, by pauses and by gaps of ``gap_m``, those between sites if not given."""
    position_m = _local(_degrees(photographs))
    known = _located(position_m)
    if gap_m is None:
        gap_m = gap_between_sites_m(position_m[known])
    exposures = [
        Exposure(p.name, body, p.tags.time, (float(x[0]), float(x[1])) if there else None)
        for p, body, x, there in zip(photographs, _aircraft(photographs), position_m, known, strict=True)
    ]
    return separate_flights(exposures, gap_m)


def _used(files: Sequence[DraftPositions], names: set[str]) -> tuple[DraftPositions, ...]:
    """Return the files with the rows of the photographs ``names``; without rows, and an error, those not to be used."""
    claims = Counter(name for file in files for name in file.rows if name in names)
    used = []
    for file in files:
        rows = {name: row for name, row in file.rows.items() if name in names}
        twice = sorted(name for name in rows if claims[name] > 1)
        error = file.error
        if twice:
            error = (
                f"{twice[0]} and others also have a position in another such file: put each flight in its own folder"
            )
        elif not rows and not error:
            error = "none of its photographs is used"
        used.append(replace(file, rows={} if error else rows, error=error))
    return tuple(used)


def draft_project(
    photographs: Sequence[TaggedPhotograph], unreadable: Sequence[LeftOut], wishes: Wishes
) -> ProjectDraft:
    """Return the draft of a project of these photographs, in their order.

    Raises ProjectError where no photograph is left, a focal length or the map grid is not known, or the map grid is
    not one of the site; FrameError where there is no such map grid.
    """
    usable, left_out = _usable(photographs)
    left_out = [*unreadable, *left_out]
    if not usable:
        reasons = "; ".join(f"{p.name}: {p.reason}" for p in left_out[:3])
        raise ProjectError(
            f"none of the {len(left_out)} photographs can be used: {reasons}" + ("; …" if len(left_out) > 3 else "")
        )
    here, others, gap_m = _main_site(usable)
    cameras, rare = _cameras(here, wishes.focal_px, wishes.focal_px_of)
    kept = [p for p in here if camera_key(p.tags) in cameras]
    positions = _used(wishes.positions, {p.name for p in kept})
    rows = {name: row for file in positions for name, row in file.rows.items()}
    gnss, frozen = _gnss(kept, rows)
    place = _degrees(kept)
    known = _located(place)
    middle = middle_of(*place[known].T) if known.any() else None
    if middle is not None:
        grid = wishes.crs or utm_crs(*middle)
        wishes = replace(wishes, control=tuple(in_fitting_order(file, grid, middle) for file in wishes.control))
    crs, crs_name, crs_reason = _choose_crs(wishes, middle)
    control = tuple(in_fitting_grid(file, crs, middle, is_proposed=False) for file in wishes.control)
    if crs == NO_CRS:
        gnss = [None] * len(kept)
        needed = "GNSS positions need a map grid: give it with --crs EPSG:…"
        positions = tuple(
            DraftPositions(file.path, error="; ".join(filter(None, (file.error, needed)))) for file in positions
        )
    offset, offset_reason = offset_prior(gnss, any(file.role == "control" for file in wishes.control))
    pixels = {camera.name: camera.width_px * camera.height_px for camera in cameras.values()}
    angles = [(p.tags.gimbal_yaw_deg, p.tags.gimbal_pitch_deg, p.tags.gimbal_roll_deg) for p in kept]
    listed = [
        DraftPhotograph(
            p.name,
            cameras[camera_key(p.tags)].name,
            flight,
            g,
            None not in attitude,
            p.name in rows and rows[p.name].sigma_m is not None,
        )
        for p, flight, g, attitude in zip(kept, flights_of(kept, gap_m), gnss, angles, strict=True)
    ]
    return ProjectDraft(
        crs=crs,
        crs_name=crs_name,
        crs_reason=crs_reason,
        cameras=tuple(cameras.values()),
        photographs=tuple(listed),
        offset_sigma_m=offset,
        offset_reason=offset_reason,
        heights=height_reference([p.tags for p in kept]),
        height_systems=_height_systems(wishes, crs, [p.tags for p in kept]),
        control=control,
        other_sites=tuple(others),
        left_out=(*left_out, *rare),
        gnss_kinds=dict(Counter(g.kind for g in gnss if g is not None).most_common()),
        positions=positions,
        warnings=_warnings(kept, frozen),
        tags_passed_over=tuple(dict.fromkeys(name for p in kept for name in p.tags.passed_over)),
        masks=wishes.masks,
        rigs=draft_rigs([p.camera for p in listed], [p.tags.capture for p in kept], pixels),
    )
