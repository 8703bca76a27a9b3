"""What a measured target is: its kind, its centre and how well the centre is known."""

from dataclasses import dataclass
from enum import Enum

import numpy as np

from photogram.arrays import FloatArray, check_shape


class Kind(Enum):
    """Kinds of target, and what is their centre.

    A board of two by two fields is a checker target; where the fields go on beyond these four, or are too large for
    their outer edges to be seen, their common corner is chequered.
    """

    CHECKER = "checker"  # a disc or square with two opposite dark quadrants: where the four meet
    CHEQUERED = "chequered"  # a chequered board: the corner that four fields share
    CROSS = "cross"  # two bars across each other, + or ×: where their axes meet
    CORNER = "corner"  # two bars that form an L: the corner on its outside, where surveyors set the rod
    CIRCLE = "circle"  # a filled circle: the centre of its ellipse
    RING = "ring"  # a ring, or concentric circles of two levels: the centre of its ellipses
    CODED = "coded"  # an AprilTag or ArUco tag: the image of its centre, where the diagonals meet
    MATCHED = "matched"  # no kind of its own: a place marked in other photographs


TITLES = {
    Kind.CHECKER: "checker target",
    Kind.CHEQUERED: "chequered board",
    Kind.CROSS: "cross",
    Kind.CORNER: "corner of two bars",
    Kind.CIRCLE: "circle",
    Kind.RING: "ring",
    Kind.CODED: "coded target",
    Kind.MATCHED: "matched",
}
"""What people read of a kind."""


def title_of(kind: str) -> str:
    """Return what people read of the kind of a mark: its title, or the word itself where it is of no target."""
    return next((title for known, title in TITLES.items() if known.value == kind), kind)


@dataclass(frozen=True, eq=False)
class MeasuredCentre:
    """The centre of a target in a patch of a photograph.

    Raises ValueError where shapes do not fit.
    """

    kind: Kind
    centre_px: FloatArray
    """Column and row (2,) of the centre; the centre of the top-left pixel is (0, 0)."""
    covariance_px2: FloatArray
    """Covariance (2, 2) of the centre, of the noise that its own pixels show."""
    quality: float
    """Share of the variance of its pixels that the fitted picture explains; of a match, the correlation."""
    size_px: float
    """Length of the target along its longer axis; of an open pattern, of the part that was fitted."""
    contrast_dn: float
    """Difference of its bright and dark levels."""
    code: tuple[str, int] | None = None
    """Family and number of a coded target."""

    def __post_init__(self) -> None:
        check_shape("centre_px", self.centre_px, (2,))
        check_shape("covariance_px2", self.covariance_px2, (2, 2))

    @property
    def sigma_px(self) -> FloatArray:
        """Standard deviations (2,) of column and row."""
        return np.sqrt(np.diag(self.covariance_px2))
