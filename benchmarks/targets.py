"""Centres of targets in rendered photographs, by kind, and what is taken for a target where there is none.

    python benchmarks/targets.py [--count 60] [--bare 1000] [--seed 0] [--processes 1] [--data DATA]

Targets of each kind are 8 to 60 px wide, tilted by up to 60°, blurred by 0.3 to 2 px, with noise of 2 to 4 DN and JPEG
of quality 85 to 95, on ground with texture; every pixel is the mean of 64 points in perspective. A click is up to 3 px
off in column and row, on a chequered board no further than leaves no doubt which corner is meant.

Columns: targets that must be found, which are at least 10 px wide (a code: a field at least 3 px along its shorter
side), and the share of them that is; wrong centres, more than 2 px off; RMS of a coordinate where the blur is at most
0.8 px, and above, of centres that are not wrong; shares of coordinates within 1, 2 and 3 standard deviations, of all
centres, wrong ones too. Then OpenCV from the same click: the RMS of cornerSubPix; the RMS of its detector for the kind,
and how many that finds: SimpleBlobDetector, goodFeaturesToTrack with cornerSubPix, or ArucoDetector with refined
corners.

False centres are counted in patches of 72 x 72 px without a target: one `snap` at the middle of each, and one
`propose`. With --data as many patches of real photographs without targets are asked too.

Times are those of one processor: of `snap` for each target above, of `propose` for patches of 320 x 320 px with four
targets on each kind of ground. At the end stands what is asked of all this, and whether it is held.
"""

import argparse
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from lib.shared_data import SHARED_DATA
from lib.target_pictures import FOCAL_PX, SHAPES, TEXTURES, Picture, bare, crowded, render

from photogram.marking.targets.measurement import propose, snap

WRONG_PX = 2.0
SHARP_PX = 0.8
SHARP_RMS_PX, BLURRED_RMS_PX = 0.1, 0.3
WITHIN, WITHIN_POINTS, KIND_POINTS = (68.3, 95.4, 99.7), 3.0, 15.0
"""Shares of a normal distribution within 1, 2 and 3 standard deviations, %; how far those of all kinds together may be
from them, and those of one kind."""
FOUND = 95.0
SNAP_S, PROPOSE_S = 0.2, 0.3
KINDS = {
    "checker disc": ("checker", "chequered"),
    "checker square": ("checker", "chequered"),
    "april": ("coded",),
    "aruco": ("coded",),
}
"""What a target may be called; the others by their own name only."""
FIELDS = {"april": 10, "aruco": 8}
"""Fields along the side of a code, its white rim included."""


@dataclass(frozen=True, eq=False)
class Trial:
    """What one target gave: its picture's figures, the error (2,) and standard deviations (2,), or none; OpenCV's."""

    width_px: float
    tilt_deg: float
    blur_px: float
    kind: str
    error_px: np.ndarray | None
    sigma_px: np.ndarray | None
    corner_px: np.ndarray
    detector_px: np.ndarray | None
    seconds: float
    must_be_found: bool

    @property
    def is_wrong(self) -> bool:
        """Whether a centre was found that is not the target's."""
        return self.error_px is not None and float(np.hypot(*self.error_px)) > WRONG_PX

    @property
    def is_right(self) -> bool:
        """Whether the target's centre was found."""
        return self.error_px is not None and not self.is_wrong


def open_cv(picture: Picture, click: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
    """Return the errors of cornerSubPix from a click, and of OpenCV's detector for the kind, None if it finds none."""
    grey = picture.grey
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 60, 1e-3)
    place = click.astype(np.float32).reshape(1, 1, 2).copy()
    corner = cv2.cornerSubPix(grey, place, (5, 5), (-1, -1), criteria).reshape(2).astype(np.float64)
    centres: list[np.ndarray] = []
    if picture.shape in ("circle", "ring"):
        for colour in (0, 255):
            blobs = cv2.SimpleBlobDetector.Params()
            blobs.filterByColor, blobs.blobColor = True, colour
            blobs.filterByConvexity = blobs.filterByInertia = False
            blobs.minArea, blobs.maxArea, blobs.minThreshold = 15.0, 4000.0, 10.0
            centres += [np.array(point.pt) for point in cv2.SimpleBlobDetector.create(blobs).detect(grey)]
    elif picture.shape in FIELDS:
        options = cv2.aruco.DetectorParameters()
        options.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
        family = cv2.aruco.DICT_APRILTAG_36h11 if picture.shape == "april" else cv2.aruco.DICT_4X4_50
        detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(family), options)
        centres = [np.asarray(c, np.float64).reshape(4, 2).mean(axis=0) for c in detector.detectMarkers(grey)[0]]
    elif picture.shape in ("checker disc", "checker square", "chequered"):
        points = cv2.goodFeaturesToTrack(grey, 30, 0.05, 3)
        near = [] if points is None else [p for p in points.reshape(-1, 2) if np.hypot(*(p - click)) < 8.0]
        start = np.array(near or [click], np.float32).reshape(-1, 1, 2)
        centres = list(cv2.cornerSubPix(grey, start, (4, 4), (-1, -1), criteria).reshape(-1, 2).astype(np.float64))
    if not centres:
        return corner - picture.centre_px, None
    best = min(centres, key=lambda c: float(np.hypot(*(c - click))))
    return corner - picture.centre_px, best - picture.centre_px


def trial(shape: str, seed: int, index: int) -> Trial:
    """Return what one rendered target gives."""
    rng = np.random.default_rng([seed, SHAPES.index(shape), index])
    width = float(np.exp(rng.uniform(np.log(8.0), np.log(60.0))))
    tilt, blur = float(rng.uniform(0, 60)), float(rng.uniform(0.3, 2.0))
    picture = render(rng, shape, width, tilt, blur)
    room = min(1.0, width * np.cos(np.deg2rad(tilt)) / 24.0) if shape == "chequered" else 1.0
    click = picture.centre_px + room * rng.uniform(-3, 3, 2)
    began = time.process_time()
    found = snap(picture.grey, click, focal_px=FOCAL_PX)
    seconds = time.process_time() - began
    corner, detector = open_cv(picture, click)
    error = None if found is None else found.centre_px - picture.centre_px
    sigma = None if found is None else found.sigma_px
    kind = "" if found is None else found.kind.value
    return Trial(width, tilt, blur, kind, error, sigma, corner, detector, seconds, must_be_found(shape, width, tilt))


def false_centres(kind: str, seed: int, index: int) -> tuple[str, int, int]:
    """Return a texture, and how many centres snap and propose find in a patch of it."""
    grey = bare(np.random.default_rng([seed, TEXTURES.index(kind), index]), kind, 72)
    return kind, int(snap(grey, np.array([36.0, 36.0])) is not None), len(propose(grey))


def real_patches(data: Path, count: int, seed: int) -> list[np.ndarray]:
    """Return patches of photographs of meadows, without targets: of dtu_phantom4/images in a folder of shared data."""
    rng, patches = np.random.default_rng(seed), []
    names = sorted((data / "dtu_phantom4" / "images").glob("*.JPG"))
    if not names:
        raise SystemExit(f"{data / 'dtu_phantom4' / 'images'}: holds no photographs (*.JPG)")
    for name in names:
        grey = np.asarray(cv2.imread(str(name), cv2.IMREAD_GRAYSCALE), np.uint8)
        for _ in range(-(-count // len(names))):
            v, u = rng.integers(0, grey.shape[0] - 72), rng.integers(0, grey.shape[1] - 72)
            patches.append(grey[v : v + 72, u : u + 72].copy())
    return patches[:count]


def proposing_s(kind: str, seed: int) -> float:
    """Return how long propose takes for a patch of a texture with four targets."""
    grey = crowded(np.random.default_rng([seed, TEXTURES.index(kind)]), kind, 320)
    began = time.process_time()
    propose(grey, FOCAL_PX)
    return time.process_time() - began


def must_be_found(shape: str, width_px: float, tilt_deg: float) -> bool:
    """Return whether a target is so large that it must be found."""
    if shape in FIELDS:
        return width_px * float(np.cos(np.deg2rad(tilt_deg))) >= 3.0 * FIELDS[shape]
    return width_px >= 10.0


def rms(errors: list[np.ndarray]) -> float:
    """Return the RMS of a coordinate over centres that are not wrong."""
    good = [e for e in errors if np.hypot(*e) <= WRONG_PX]
    return float(np.sqrt(np.mean(np.square(good)))) if good else np.nan


@dataclass(frozen=True)
class Figures:
    """What the targets of a kind, or of all, gave."""

    wide: int
    found: float
    wrong: int
    sharp_px: float
    blurred_px: float
    within: tuple[float, float, float]


def figures(trials: list[Trial]) -> Figures:
    """Return the figures of a kind, or of all."""
    wide = [t for t in trials if t.must_be_found]
    errors = [(t.error_px, t.blur_px) for t in trials if t.error_px is not None]
    ratio = np.abs([t.error_px / t.sigma_px for t in trials if t.error_px is not None and t.sigma_px is not None])
    one, two, three = (100.0 * float(np.mean(ratio <= n)) if ratio.size else np.nan for n in (1, 2, 3))
    return Figures(
        len(wide),
        100.0 * float(np.mean([t.is_right for t in wide])) if wide else np.nan,
        sum(t.is_wrong for t in trials),
        rms([e for e, blur in errors if blur <= SHARP_PX]),
        rms([e for e, blur in errors if blur > SHARP_PX]),
        (one, two, three),
    )


def row(name: str, trials: list[Trial]) -> str:
    """Return the figures of a kind, or of all, as a row of the table."""
    own = figures(trials)
    detected = [t.detector_px for t in trials if t.detector_px is not None]
    share = 100 * sum(np.hypot(*e) <= WRONG_PX for e in detected) / len(trials)
    within = " ".join(f"{share:5.1f}" for share in own.within)
    return (
        f"{name:<17}{own.wide:>5}{own.found:>8.1f}{own.wrong:>7}{own.sharp_px:>8.3f}{own.blurred_px:>9.3f}"
        f"   {within:<18}"
        f"{rms([t.corner_px for t in trials]):>8.3f}{rms(detected):>9.3f}{share:>8.0f}"
    )


def verdicts(trials: dict[str, list[Trial]], false: dict[str, int], proposing: list[float]) -> list[str]:
    """Return what is asked, what was measured, and whether it is held, a line each; ``false`` are the false centres by
    what was asked, ``proposing`` the seconds of propose."""
    kinds = {kind: figures(own) for kind, own in trials.items()}
    whole = [t for own in trials.values() for t in own]
    pooled, snapping = figures(whole), np.array([t.seconds for t in whole])
    lines: list[str] = []

    def ask(what: str, measured: str, is_held: bool) -> None:
        lines.append(f"{'held    ' if is_held else 'NOT held'}  {what}: {measured}")

    def worst(of: Callable[[Figures], float], sign: float) -> tuple[str, float]:
        known = {kind: of(own) for kind, own in kinds.items() if np.isfinite(of(own))}
        kind = max(known, key=lambda k: sign * known[k])
        return kind, known[kind]

    def off(own: Figures) -> float:
        return max(abs(a - b) for a, b in zip(own.within, WITHIN, strict=True))

    for name, limit, of in (
        (f"blur at most {SHARP_PX} px", SHARP_RMS_PX, lambda own: own.sharp_px),
        (f"blur above {SHARP_PX} px", BLURRED_RMS_PX, lambda own: own.blurred_px),
    ):
        kind, value = worst(of, 1.0)
        ask(
            f"RMS of a coordinate at most {limit} px, {name}",
            f"{value:.3f} px for the worst kind, {kind}",
            value <= limit,
        )
    within = ", ".join(f"{share:.1f}" for share in pooled.within)
    ask(f"shares within 1, 2, 3 sigma, all kinds, {WITHIN_POINTS:.0f} points about 68.3, 95.4, 99.7 %", f"{within} %",
        off(pooled) <= WITHIN_POINTS)  # fmt: skip
    kind, value = worst(off, 1.0)
    ask(f"shares within sigmas of each kind, {KIND_POINTS:.0f} points about these",
        f"{value:.1f} points for the worst kind, {kind}", value <= KIND_POINTS)  # fmt: skip
    kind, value = worst(lambda own: own.found, -1.0)
    lacking = [k for k, own in kinds.items() if own.found < FOUND]
    ask(f"at least {FOUND:.0f} % of each kind found", f"{value:.1f} % for the worst kind, {kind}; all kinds "
        f"{pooled.found:.1f} %; below: {', '.join(lacking) or 'none'}", not lacking)  # fmt: skip
    large = sum(t.is_wrong for t in whole if t.must_be_found)
    ask("no wrong centre", f"{pooled.wrong} of {len(whole)} targets, {large} of them among the "
        f"{pooled.wide} that must be found", pooled.wrong == 0)  # fmt: skip
    named = {kind: [t.kind in KINDS.get(kind, (kind,)) for t in own if t.must_be_found and t.is_right]
             for kind, own in trials.items()}  # fmt: skip
    shares = {kind: 100.0 * float(np.mean(own)) for kind, own in named.items() if own}
    kind = min(shares, key=lambda k: shares[k])
    ask(f"at least {FOUND:.0f} % of those that must be found are called what they are",
        f"{shares[kind]:.1f} % for the worst kind, {kind}", shares[kind] >= FOUND)  # fmt: skip
    for what, count in false.items():
        ask(f"no false centre, {what}", str(count), count == 0)
    ask(f"snap within {SNAP_S} s", f"mean {snapping.mean():.3f}, 95 % {np.quantile(snapping, 0.95):.3f}, longest "
        f"{snapping.max():.3f} s", float(np.quantile(snapping, 0.95)) <= SNAP_S)  # fmt: skip
    ask(f"propose of 320 x 320 px within {PROPOSE_S} s", f"mean {np.mean(proposing):.3f}, longest "
        f"{max(proposing):.3f} s", max(proposing) <= PROPOSE_S)  # fmt: skip
    return lines


def measured_targets(pool: ProcessPoolExecutor, count: int, seed: int) -> dict[str, list[Trial]]:
    """Print the table of targets, and return what each gave by kind."""
    print(f"{'kind':<17}{'wide':>5}{'found %':>8}{'wrong':>7}{'sharp':>8}{'blurred':>9}   {'within 1, 2, 3 σ %':<18}"
          f"{'subPix':>8}{'detector':>9}{'its %':>8}")  # fmt: skip
    trials: dict[str, list[Trial]] = {}
    for shape in SHAPES:
        list(pool.map(trial, [shape], [seed], [0]))  # a kernel may be compiled first
        trials[shape] = list(pool.map(trial, [shape] * count, [seed] * count, range(count)))
        print(row(shape, trials[shape]), flush=True)
    print(row("all kinds", [t for own in trials.values() for t in own]), flush=True)
    return trials


def asked_without_targets(pool: ProcessPoolExecutor, bare_count: int, seed: int, data: Path | None) -> dict[str, int]:
    """Print the table of ground without targets, and return the false centres by what was asked."""
    each = -(-bare_count // len(TEXTURES))
    total = {"snap": 0, "propose": 0}
    print(f"\n{'ground':<17}{'patches':>8}{'snap':>6}{'propose':>9}")
    for kind in TEXTURES:
        counts = list(pool.map(false_centres, [kind] * each, [seed] * each, range(each)))
        snapped, proposed = sum(c[1] for c in counts), sum(c[2] for c in counts)
        total["snap"], total["propose"] = total["snap"] + snapped, total["propose"] + proposed
        print(f"{kind:<17}{each:>8}{snapped:>6}{proposed:>9}", flush=True)
    false = {f"{what}, {each * len(TEXTURES)} rendered patches": count for what, count in total.items()}
    if data:
        patches = real_patches(data, bare_count, seed)
        snapped = sum(s is not None for s in pool.map(snap, patches, [np.array([36.0, 36.0])] * len(patches)))
        proposed = sum(len(p) for p in pool.map(propose, patches))
        print(f"{'photographs':<17}{len(patches):>8}{snapped:>6}{proposed:>9}")
        false |= {f"snap, {len(patches)} real patches": snapped, f"propose, {len(patches)} real patches": proposed}
    return false


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=60, help="targets of each kind")
    parser.add_argument("--bare", type=int, default=1000, help="patches without a target")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--data", type=Path, help=f"folder of shared data with photographs, for instance {SHARED_DATA}")
    options = parser.parse_args()
    with ProcessPoolExecutor(options.processes) as pool:
        trials = measured_targets(pool, options.count, options.seed)
        false = asked_without_targets(pool, options.bare, options.seed, options.data)
        proposing = list(pool.map(proposing_s, TEXTURES, [options.seed] * len(TEXTURES)))
    print()
    print("\n".join(verdicts(trials, false, proposing)))


if __name__ == "__main__":
    main()
