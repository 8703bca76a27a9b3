"""Where surfaces lie, in words: what is said where two have nothing in common."""

from dataclasses import dataclass

from photogram.grid import MapGrid


@dataclass(frozen=True)
class Extent:
    """Outer edges in the map, m."""

    west_m: float
    east_m: float
    south_m: float
    north_m: float

    @property
    def words(self) -> str:
        """Return its edges in words."""
        return f"E {self.west_m:.0f} to {self.east_m:.0f}, N {self.south_m:.0f} to {self.north_m:.0f} m"


def extent_of(grid: MapGrid) -> Extent:
    """Return where the cells of a grid lie."""
    return Extent(*grid.extent_map_m)


def no_overlap(*surfaces: tuple[str, Extent]) -> str:
    """Return a sentence that surfaces, each with what it is called, do not overlap."""
    places = "; ".join(f"{name}: {extent.words}" for name, extent in surfaces)
    return f"surfaces do not overlap: {places}: check that both are of one site and in one CRS and unit"
