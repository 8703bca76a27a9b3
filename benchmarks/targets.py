"""Centres of targets in rendered photographs, by kind, and what is taken for a target where there is none.

    python benchmarks/targets.py [--count 60] [--bare 1000] [--seed 0] [--processes 1] [--data DATA]

Targets of each kind are 8 to 60 px wide, tilted by up to 60°, blurred by 0.3 to 2 px, with noise of 2 to 4 DN and JPEG
of quality 85 to 95, on ground with texture; every pixel is the mean of 64 points in perspective. A click is up to 3 px
off in column and row, on a chequered board no further than leaves no doubt which corner is meant.

Columns: share found where a target is at least 10 px wide (a code: a field at least 3 px along its shorter side); RMS
of a coordinate where the blur is at most 0.8 px, and above; shares of coordinates within 1, 2 and 3 standard
deviations. Then OpenCV from the same click: the RMS of cornerSubPix; the RMS of its detector for the kind, and how many
that finds: SimpleBlobDetector, goodFeaturesToTrack with cornerSubPix, or ArucoDetector with refined corners. A centre
more than 2 px off counts as wrong.

False centres are counted in patches without a target: one `snap` at the middle of each, and one `propose`. With --data
as many patches of real photographs without targets are asked too.
"""

from __future__ import annotations

import argparse
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from lib.shared_data import SHARED_DATA
from lib.target_pictures import SHAPES, TEXTURES, Picture, bare, render

from photogram.targets.measurement import propose, snap

WRONG_PX = 2.0
SHARP_PX = 0.8
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
    elif picture.shape in ("quartered disc", "quartered square", "chequered"):
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
    found = snap(picture.grey, click)
    corner, detector = open_cv(picture, click)
    error = None if found is None else found.centre_px - picture.centre_px
    sigma = None if found is None else found.sigma_px
    return Trial(width, tilt, blur, "" if found is None else found.kind.value, error, sigma, corner, detector)


def false_centres(kind: str, seed: int, index: int) -> tuple[str, int, int]:
    """Return a texture, and how many centres snap and propose find in a patch of it."""
    grey = bare(np.random.default_rng([seed, TEXTURES.index(kind), index]), kind, 72)
    return kind, int(snap(grey, np.array([36.0, 36.0])) is not None), len(propose(grey))


def real_patches(data: Path, count: int, seed: int) -> list[np.ndarray]:
    """Return patches of photographs of meadows, without targets."""
    rng, patches = np.random.default_rng(seed), []
    names = sorted((data / "dtu_phantom4" / "images").glob("*.JPG"))
    for name in names:
        grey = np.asarray(cv2.imread(str(name), cv2.IMREAD_GRAYSCALE), np.uint8)
        for _ in range(-(-count // len(names))):
            v, u = rng.integers(0, grey.shape[0] - 72), rng.integers(0, grey.shape[1] - 72)
            patches.append(grey[v : v + 72, u : u + 72].copy())
    return patches[:count]


def rms(errors: list[np.ndarray]) -> str:
    """Return the RMS of a coordinate over centres that are not wrong, and how many are wrong or lack."""
    good = [e for e in errors if np.hypot(*e) <= WRONG_PX]
    return f"{np.sqrt(np.mean(np.square(good))):.3f}" if good else "–"


def is_wide(shape: str, own: Trial) -> bool:
    """Return whether a target is so large that it must be found."""
    if shape in FIELDS:
        return own.width_px * float(np.cos(np.deg2rad(own.tilt_deg))) >= 3.0 * FIELDS[shape]
    return own.width_px >= 10.0


def row(shape: str, trials: list[Trial]) -> str:
    """Return the figures of a kind."""
    wide = [t for t in trials if is_wide(shape, t)]
    right = [t for t in trials if t.error_px is not None and np.hypot(*t.error_px) <= WRONG_PX]
    wrong = [t for t in trials if t.error_px is not None and np.hypot(*t.error_px) > WRONG_PX]
    ratio = np.abs(
        [t.error_px / t.sigma_px for t in right if t.error_px is not None and t.sigma_px is not None]
    ).ravel()
    within = " ".join(f"{100 * np.mean(ratio <= n):5.1f}" for n in (1, 2, 3)) if len(ratio) else "–"
    sharp = [t.error_px for t in right if t.blur_px <= SHARP_PX and t.error_px is not None]
    blurred = [t.error_px for t in right if t.blur_px > SHARP_PX and t.error_px is not None]
    share = np.mean([t in right for t in wide]) if wide else np.nan
    detected = [t.detector_px for t in trials if t.detector_px is not None]
    return (
        f"{shape:<17}{len(wide):>5}{100 * share:>8.1f}{len(wrong):>7}{rms(sharp):>8}{rms(blurred):>9}   {within:<18}"
        f"{rms([t.corner_px for t in trials]):>8}{rms(detected):>9}"
        f"{100 * sum(np.hypot(*e) <= WRONG_PX for e in detected) / len(trials):>8.0f}"
    )


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=60, help="targets of each kind")
    parser.add_argument("--bare", type=int, default=1000, help="patches without a target")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--data", type=Path, help=f"folder of real photographs, for instance {SHARED_DATA}")
    options = parser.parse_args()
    print(f"{'kind':<17}{'wide':>5}{'found %':>8}{'wrong':>7}{'sharp':>8}{'blurred':>9}   {'within 1, 2, 3 σ %':<18}"
          f"{'subPix':>8}{'detector':>9}{'its %':>8}")  # fmt: skip
    with ProcessPoolExecutor(options.processes) as pool:
        n = options.count
        for shape in SHAPES:
            print(row(shape, list(pool.map(trial, [shape] * n, [options.seed] * n, range(n)))), flush=True)
        each = -(-options.bare // len(TEXTURES))
        print(f"\n{'ground':<17}{'patches':>8}{'snap':>6}{'propose':>9}")
        for kind in TEXTURES:
            counts = list(pool.map(false_centres, [kind] * each, [options.seed] * each, range(each)))
            print(f"{kind:<17}{each:>8}{sum(c[1] for c in counts):>6}{sum(c[2] for c in counts):>9}", flush=True)
        if options.data:
            patches = real_patches(options.data, options.bare, options.seed)
            snapped = list(pool.map(snap, patches, [np.array([36.0, 36.0])] * len(patches)))
            proposed = list(pool.map(propose, patches))
            print(f"{'photographs':<17}{len(patches):>8}{sum(s is not None for s in snapped):>6}"
                  f"{sum(len(p) for p in proposed):>9}")  # fmt: skip


if __name__ == "__main__":
    main()
