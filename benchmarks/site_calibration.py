"""Site calibrations of simulated pairs: whose error is named, who is accused wrongly, and whether the sigmas hold.

    python benchmarks/site_calibration.py [SITES] [--seed 0]                 default: 200

Each site has 5 to 12 pairs at random places, 1 to 6 km wide, in a local grid that is turned by any angle, scaled by up
to 300 ppm and inclined by up to 100 mm per kilometre; sigmas of a pair are 12 mm along each axis and 20 mm in height.
Each is calibrated without a blunder, and with one pair 0.2 m off in a random direction in plan, or up or down.

Rows: how many calibrations accuse nobody; name the wrong pair and no other; name several that the others cannot tell
apart, the wrong one among them; miss it; accuse an innocent. Then the errors of the parameters over their sigmas,
which have a standard deviation of 1 where the sigmas are right, and the share within two sigmas. Last the farthest that
a point of a site comes off on its way through PROJ to the local grid and back, and from the estimated parameters.
"""

from dataclasses import replace

import numpy as np
from lib import study
from pyproj import Transformer

from photogram.geodesy.frames import map_from_crs
from photogram.local_grids.calibration import (
    CalibrationSettings,
    SiteCalibration,
    calibrate,
    radii_m,
    slopes_design,
)
from photogram.local_grids.definition import UNITS, local_grid, site_map
from photogram.local_grids.pairs import SitePairs

SEMI_MAJOR_M, SEMI_MINOR_M = 6378137.0, 6356752.3142
SIGMA_M = np.array([0.012, 0.020])
BLUNDER_M = 0.2
GEODETIC = "EPSG:4326"
Array = np.ndarray


class Site:
    """A simulated site: its truth and its pairs, with noise."""

    def __init__(self, rng: np.random.Generator) -> None:
        n = int(rng.integers(5, 13))
        self.middle = np.array([rng.uniform(-120.0, 150.0), rng.uniform(-50.0, 65.0)])
        self.radii = radii_m(float(self.middle[1]), SEMI_MAJOR_M, SEMI_MINOR_M)
        half = (
            500.0
            * rng.uniform(1.0, 6.0)
            / np.array([self.radii[1] * np.cos(np.deg2rad(self.middle[1])), self.radii[0]])
        )
        self.place = self.middle + np.rad2deg(half) * rng.uniform(-1.0, 1.0, (n, 2))
        self.map = site_map(GEODETIC, self.middle)
        self.turn, self.scale = rng.uniform(-np.pi, np.pi), 1.0 + rng.uniform(-3e-4, 3e-4)
        self.origin = rng.uniform(-1e5, 1e5, 2)
        self.plane = np.array([rng.uniform(-60.0, 60.0), *rng.uniform(-1e-4, 1e-4, 2)])
        height = rng.uniform(0.0, 200.0, n)
        local = np.column_stack([self.local(self.x(self.place)), height + self.change(self.place)])
        local[:, :2] += rng.normal(0.0, SIGMA_M[0], (n, 2))
        local[:, 2] += rng.normal(0.0, SIGMA_M[1], n)
        every = np.ones(n, dtype=bool)
        names = tuple(f"P{i}" for i in range(n))
        self.pairs = SitePairs(names, self.place, height, local, np.tile(SIGMA_M, (n, 1)), every, every)

    def x(self, place: Array) -> Array:
        """Return places on the map about the site."""
        flat = np.column_stack([place, np.zeros(len(place))])
        return np.asarray(map_from_crs(GEODETIC, self.map, flat)[:, :2])

    def local(self, x: Array) -> Array:
        """Return easting and northing in the true local grid."""
        z = self.scale * np.exp(1j * self.turn) * (x[:, 0] + 1j * x[:, 1])
        return np.asarray(self.origin + np.column_stack([z.real, z.imag]))

    def change(self, place: Array) -> Array:
        """Return the true local minus ellipsoidal heights."""
        return np.asarray(slopes_design(place, self.middle, self.radii) @ self.plane)

    def calibrated(self, pairs: SitePairs) -> SiteCalibration:
        """Return the calibration of pairs."""
        return calibrate(pairs, self.x, self.middle, self.radii, CalibrationSettings())

    def normalised(self, found: SiteCalibration) -> list[float]:
        """Return the errors of all parameters over their sigmas."""
        plan, height = found.plan, found.height
        assert height is not None
        here = plan.local_m(plan.centre_m[None])[0] - self.local(plan.centre_m[None])[0]
        turn = np.angle(np.exp(1j * (plan.rotation_rad - self.turn)))
        errors = np.array([*here, turn, plan.scale - self.scale]) / plan.sigma
        slopes = np.array([height.offset_m, height.slope_north, height.slope_east]) - self.plane
        return [*errors.tolist(), *(slopes / height.sigma).tolist()]

    def loop_m(self, found: SiteCalibration) -> tuple[float, float]:
        """Return how far a grid of points comes off through PROJ and back, and from the parameters."""
        wkt = local_grid("site", GEODETIC, self.middle, found.plan, found.height, UNITS["m"])
        there = Transformer.from_crs("EPSG:4979", wkt, always_xy=True)
        local = np.column_stack(there.transform(*self.place.T, self.pairs.height_m))
        back = np.column_stack(there.transform(*local.T, direction="INVERSE"))
        assert found.height is not None
        plane = np.array([found.height.offset_m, found.height.slope_north, found.height.slope_east])
        heights = self.pairs.height_m + slopes_design(self.place, self.middle, self.radii) @ plane
        own = np.column_stack([found.plan.local_m(self.x(self.place)), heights])
        degrees = np.deg2rad(np.abs(back[:, :2] - self.place).max()) * SEMI_MAJOR_M
        return max(degrees, float(np.abs(back[:, 2] - self.pairs.height_m).max())), float(np.abs(local - own).max())


def moved(site: Site, rng: np.random.Generator, part: str) -> tuple[SitePairs, int]:
    """Return the pairs with one that is wrong, and which."""
    local, index = site.pairs.local_m.copy(), int(rng.integers(len(site.pairs)))
    if part == "height":
        local[index, 2] += BLUNDER_M * rng.choice([-1.0, 1.0])
    else:
        a = rng.uniform(0.0, 2.0 * np.pi)
        local[index, :2] += BLUNDER_M * np.array([np.cos(a), np.sin(a)])
    return replace(site.pairs, local_m=local), index


def outcome(found: SiteCalibration, index: int | None, part: str) -> str:
    """Return what a calibration says of a pair that is wrong, or of none."""
    if not found.suspicions:
        return "nobody"
    for suspicion in found.suspicions:
        if suspicion.part != part or index not in suspicion.pairs:
            return "an innocent"
    return "it alone" if found.suspicions[0].pairs == (index,) else "it among others"


def main() -> None:
    """Print the tables."""
    parser = study.parser(__doc__, 200)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    with study.recorded(given.json):
        show(given.seeds, given.seed)


def show(numbers: range, seed: int) -> None:
    """Print the tables of sites."""
    said = ("nobody", "it alone", "it among others", "an innocent")
    table = {part: dict.fromkeys(said, 0) for part in ("none", "plan", "height")}
    errors, loops = [], []
    for number in numbers:
        rng = np.random.default_rng([seed, number])
        site = Site(rng)
        good = site.calibrated(site.pairs)
        table["none"][outcome(good, None, "none")] += 1
        errors.append(site.normalised(good))
        loops.append(site.loop_m(good))
        for part in ("plan", "height"):
            pairs, index = moved(site, rng, part)
            table[part][outcome(site.calibrated(pairs), index, part)] += 1
    rows = study.Table("wrong pair     ", "accuses nobody", *said[1:])
    for part, row in table.items():
        name = "none" if part == "none" else f"{BLUNDER_M:g} m in {part}"
        rows.row(name, *(row[word] for word in said))
    print()
    z = np.array(errors)
    rows = study.Table("parameter    ", "error over sigma: standard deviation", "within 2 sigma")
    names = ("easting", "northing", "rotation", "scale", "height offset", "slope north", "slope east")
    for name, column in zip(names, z.T, strict=True):
        rows.row(name, f"{study.rms(column):.2f}", f"{study.shares_within(column)[1]:.1%}")
    print()
    back, off = np.array(loops).max(axis=0)
    print(f"Through PROJ and back: {back * 1e6:.3f} µm at most; from the parameters: {off * 1e6:.3f} µm.")


if __name__ == "__main__":
    main()
