"""Points of a site that are known twice: by GNSS or in a map, and in the local grid."""

from __future__ import annotations

from dataclasses import dataclass, replace

from photogram.arrays import BoolArray, FloatArray, check_shape


@dataclass(frozen=True, eq=False)
class SitePairs:
    """Pairs (N) of geodetic and local coordinates, with what each serves for."""

    name: tuple[str, ...]
    """Names (N,)."""
    place_deg: FloatArray
    """Longitude and latitude (N, 2)."""
    height_m: FloatArray
    """Ellipsoidal heights (N,), NaN where unknown."""
    local_m: FloatArray
    """Easting, northing and height in the local grid (N, 3), NaN where unknown."""
    sigma_m: FloatArray
    """Standard deviations (N, 2) of the difference of the two, in plan (along each axis) and in height."""
    in_plan: BoolArray
    """Which determine easting and northing (N,)."""
    in_height: BoolArray
    """Which determine the height (N,)."""

    def __post_init__(self) -> None:
        n = len(self.name)
        check_shape("place_deg", self.place_deg, (n, 2))
        check_shape("height_m", self.height_m, (n,))
        check_shape("local_m", self.local_m, (n, 3))
        check_shape("sigma_m", self.sigma_m, (n, 2))
        check_shape("in_plan", self.in_plan, (n,))
        check_shape("in_height", self.in_height, (n,))

    def __len__(self) -> int:
        return len(self.name)

    def __repr__(self) -> str:
        return f"<SitePairs: {len(self)}, {int(self.in_plan.sum())} in plan, {int(self.in_height.sum())} in height>"

    def without(self, index: int, *, plan: bool, height: bool) -> SitePairs:
        """Return the pairs with one that no longer serves for ``plan``, or for ``height``."""
        in_plan, in_height = self.in_plan.copy(), self.in_height.copy()
        in_plan[index] &= not plan
        in_height[index] &= not height
        return replace(self, in_plan=in_plan, in_height=in_height)
