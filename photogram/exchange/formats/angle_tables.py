"""Tables of orientations as text: a photograph a line, its projection centre and three angles in degrees.

The first line is a comment with the columns, the angles and the frame: other programs know these angles by the same
names and count them otherwise.
"""

from collections.abc import Callable
from pathlib import Path

from photogram.arrays import FloatArray
from photogram.camera import gimbal_from_rotation, omega_phi_kappa_deg
from photogram.errors import ExchangeError
from photogram.exchange.formats.writing import check_writable, unoriented_photographs
from photogram.files.atomic import write_whole
from photogram.files.solutions.solution import ForeignSolution
from photogram.wording import printable

_OMEGA_PHI_KAPPA = (
    "name x y z omega phi kappa, degrees: R = Rx(omega) Ry(phi) Rz(kappa) leads from the image frame, x right, y up, "
    "z backward, to"
)
_YAW_PITCH_ROLL = (
    "name x y z yaw pitch roll, degrees: yaw clockwise from y, pitch above the horizon (-90 looks straight down), roll "
    "right side down, of the optical axis in"
)
_DIGITS = 12


def write_omega_phi_kappa(path: Path, solution: ForeignSolution) -> tuple[str, ...]:
    """Write a table ``name x y z omega phi kappa`` of the oriented photographs; returns sentences about what it leaves
    out.

    Angles are those of Kraus 2007, sec. 2.1. Raises ExchangeError where a name has blanks or a pose is not finite, or
    coordinates are geocentric, whose angles mean nothing; WorkspaceError where the file cannot be written.
    """
    return _write(path, solution, _OMEGA_PHI_KAPPA, omega_phi_kappa_deg)


def write_yaw_pitch_roll(path: Path, solution: ForeignSolution) -> tuple[str, ...]:
    """Write a table ``name x y z yaw pitch roll`` of the oriented photographs, as ``write_omega_phi_kappa``.

    Angles are those of photogram.camera.rotation_from_gimbal (ISO 1151-2); of a photograph that looks straight down the
    roll is 0.
    """
    return _write(path, solution, _YAW_PITCH_ROLL, gimbal_from_rotation)


def _write(
    path: Path, solution: ForeignSolution, columns: str, angles: Callable[[FloatArray], FloatArray | tuple[float, ...]]
) -> tuple[str, ...]:
    check_writable(path, solution)
    if solution.frame == "geocentric":
        raise ExchangeError(
            f"{path}: coordinates are geocentric, where these angles mean nothing: transform the solution into a map"
        )
    lines = [f"# {columns} {_frame(solution)}"]
    for photograph in solution.photographs:
        if photograph.pose is None:
            continue
        if len(photograph.name.split()) != 1 or photograph.name.startswith("#"):
            raise ExchangeError(
                f"{path}: {photograph.name!r} has blanks, which end a column, or begins a comment: rename it"
            )
        values = (*photograph.pose.position_world_m, *angles(photograph.pose.rotation_world_from_camera))
        lines.append(" ".join([photograph.name, *(f"{float(value):.{_DIGITS}f}" for value in values)]))
    write_whole(path, "\n".join(lines) + "\n")
    return (
        *unoriented_photographs(solution),
        "Cameras, tie points and ground points: the table is of orientations.",
    )


def _frame(solution: ForeignSolution) -> str:
    """Return the frame of the coordinates in words, on one line."""
    if solution.frame == "map":
        return f"the map {printable(' '.join((solution.crs or 'without a name').split()))}"
    if solution.origin_lla is not None:
        latitude, longitude, height = solution.origin_lla
        return f"east, north, up at latitude {latitude!r}, longitude {longitude!r}, ellipsoidal height {height!r} m"
    return "local coordinates x, y, z"
