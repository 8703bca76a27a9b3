"""What measured numbers of a project file may be, from what is physically possible: beyond it is a slip of the pen or
a unit.

The ranges are wide: they refuse what cannot be, not what is unusual.
"""

from photogram.files import text_lines
from photogram.settings.settings import Within

PIXELS = Within(1, 200_000, "px")
FOCAL_PX = Within(1, 1_000_000, "px")
POSITION_M = Within(-1e8, 1e8, "m")
POSITION = Within(-1e9, 1e9)
"""In the unit of any map."""

SIGMA_M = Within(*text_lines.SIGMA_M, "m")
OFFSET_SIGMA_M = Within(*text_lines.SIGMA_M, "m", or_zero=True)
SIGMA_PX = Within(*text_lines.SIGMA_PX, "px")
PLACE_PX = Within(-1e6, 1e6, "px")
LEVER_ARM_M = Within(-10_000, 10_000, "m")
"""Of a slip of millimetres, which is named where the arm is looked at, not here."""

ANGLE_DEG = Within(-360, 360, "°")
ANGLE_SIGMA_DEG = Within(1e-4, 180, "°")
FLYING_HEIGHT_M = Within(0.1, 50_000, "m")
DISTORTION = Within(-1e9, 1e9)
"""Of any lens at all; project_checks has the range that a camera's own picture leaves."""

LENGTH_M = Within(1e-4, 1e5, "m")
"""Of a measured distance."""

TOLERANCE_S = Within(1e-6, 3600, "s")
"""Between photographs of one exposure."""

RISE_M = Within(-10_000, 10_000, "m")
"""Of a levelled height difference."""

FREEDOM = Within(1e-12, 1e6)
"""Prior standard deviations of camera parameters, in px or without unit."""

READOUT_S = Within(-2, 2, "s")
"""Time in which a camera reads a picture, negative upwards; no shutter that flies takes a second."""
