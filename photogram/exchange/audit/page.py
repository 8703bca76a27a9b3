"""audit.html: another program's result and photogram's, side by side, in one file without a script.

Shows tables of words and figures that are finished; counts nothing.
"""

from dataclasses import dataclass

from jinja2 import StrictUndefined

from photogram.report.page import PAGE_FONT, templates


@dataclass(frozen=True)
class FigureRow:
    """A figure of theirs, of further programs, of photogram with their weights, and of photogram with its own."""

    name: str
    theirs: str
    same: str
    ours: str
    beside: tuple[str, ...] = ()

    @property
    def cells(self) -> tuple[str, ...]:
        """Return the figures in the order of the columns."""
        return self.theirs, *self.beside, self.same, self.ours


@dataclass(frozen=True)
class CalibrationRow:
    """A parameter of interior orientation: theirs, ours with its standard deviation, their difference over that, and
    the parameters it is hardly told from."""

    camera: str
    parameter: str
    theirs: str
    ours: str
    sigma: str
    off_sigmas: str
    correlated: str
    beside: tuple[str, ...] = ()
    """Of further programs."""
    beside_off_sigmas: tuple[str, ...] = ()

    @property
    def programs(self) -> tuple[tuple[str, str], ...]:
        """Return value and difference of each program."""
        return (self.theirs, self.off_sigmas), *zip(self.beside, self.beside_off_sigmas, strict=True)


@dataclass(frozen=True)
class PoseRow:
    """A photograph's exterior orientation, a program's minus ours: position, m, rotation about the camera's axes,
    degrees, and both over their predicted covariance."""

    photograph: str
    program: str
    position: str
    rotation: str
    sigmas: str


@dataclass(frozen=True)
class AuditTables:
    """All that an audit shows."""

    program: str
    about: str
    figures: tuple[FigureRow, ...]
    calibrations: tuple[CalibrationRow, ...]
    poses: tuple[PoseRow, ...]
    """The photograph that differs most first."""
    contradictions: tuple[str, ...]
    """What contradicts the rest, or the result that was made of it."""
    left_out: tuple[str, ...]
    """What the program's figures do not say."""
    beside: tuple[str, ...] = ()
    """Further programs, in the order of their columns."""
    checks: tuple[FigureRow, ...] = ()
    """Check points, adjusted minus surveyed: easting, northing, height."""
    precision: tuple[FigureRow, ...] = ()
    """Standard deviations, where a program states its own."""
    precision_scaled: str = ""
    """What those of the programs and of the columns are multiplied by."""

    @property
    def programs(self) -> tuple[str, ...]:
        """Return the audited program and the further ones."""
        return self.program, *self.beside

    @property
    def columns(self) -> tuple[str, ...]:
        """Return what the columns of figures are of."""
        weights = f"weights of {self.program}" if self.beside else "their weights"
        return *self.programs, f"photogram, {weights}", "photogram, blunders rejected, sigmas estimated"


MOST_POSES = 60
"""Photographs that the page shows; audit.json has all of them."""


def audit_page(tables: AuditTables, version: str) -> str:
    """Return the page of an audit, made by photogram ``version``."""
    environment = templates(StrictUndefined)
    environment.globals.update(page_font=PAGE_FONT)
    template = environment.get_template("audit.html.jinja")
    names = list(dict.fromkeys(row.photograph for row in tables.poses))
    return template.render(
        audit=tables,
        poses=[(name, [row for row in tables.poses if row.photograph == name]) for name in names[:MOST_POSES]],
        photographs=len(names),
        precision=tables.precision[: 2 * MOST_POSES],
        version=version,
    )
