"""Small solutions of other programs, each as that program writes it, in a folder of its own."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from foreign import brown, made, small_solution
from PIL import Image
from test_blocks_exchange import block_of
from test_database import write_database
from test_dbat import solution_of as solution_of_dbat
from test_dbat import write_project as write_dbat
from test_meshroom import scene
from test_meshroom_baf import written as write_baf
from test_metashape_project import write_psx, write_psz
from test_micmac import PHGR
from test_micmac import write as write_micmac
from test_opf import perspective
from test_pix4d_params import text_of as text_of_pix4d
from test_reconstructions import placed
from test_visualsfm import written as write_nvm

from photogram.exchange.formats.table import WRITERS
from photogram.files.npz_json import write_json
from photogram.files.solutions.solution import ForeignSolution
from photogram.files.solutions.stored_solutions import write_stored

Write = Callable[[Path], object]
IN_DATABASE = ("flight/photo_00.jpg", "flight/photo_01.jpg")

RADIAL = replace(small_solution(k4=0.0, b=(0.0, 0.0)), ground_points=None)
ORIENTED = made([brown(radial=[-0.11, 0.03, -0.01, 0]), brown("2", size_px=(300, 420))])
CENTRED = made([brown(centred=True, radial=[-0.1, 0.02, 0, 0])])
DBAT = solution_of_dbat()
LARGE = replace(RADIAL, cameras=tuple(replace(camera, width_px=5472, height_px=3648) for camera in RADIAL.cameras))


def _write_baf(path: Path) -> None:
    write_baf(path, ORIENTED)
    names = path.with_name(f"{path.stem}_imgList.txt")
    names.write_text(names.read_text(encoding="utf-8").replace("/data/", ""), encoding="utf-8")


def _write_nvm(path: Path) -> None:
    write_nvm(path, ORIENTED, -0.1)
    path.write_text(path.read_text(encoding="utf-8").replace("images/", "flight/"), encoding="utf-8")


def _pictures(folder: Path, solution: ForeignSolution) -> None:
    for photograph in solution.photographs:
        camera = solution.cameras[photograph.camera]
        grey = np.full((camera.height_px, camera.width_px), 90, np.uint8)
        (folder / photograph.file).parent.mkdir(exist_ok=True)
        Image.fromarray(grey).save(folder / photograph.file, quality=1)


def make_solutions(folder: Path) -> None:
    """Write a folder for each form, with its photographs."""
    folder.mkdir()
    forms: dict[str, tuple[ForeignSolution, Write]] = {
        "colmap": (RADIAL, lambda at: WRITERS["colmap"].write(at, RADIAL)),
        "colmap-text": (ORIENTED, lambda at: WRITERS["colmap-text"].write(at, ORIENTED)),
        "opensfm": (RADIAL, lambda at: WRITERS["opensfm"].write(at, placed(RADIAL))),
        "bundler": (CENTRED, lambda at: WRITERS["bundler"].write(at / "bundle.out", CENTRED)),
        "metashape": (RADIAL, lambda at: WRITERS["metashape"].write(at / "cameras.xml", small_solution())),
        "opf": (RADIAL, lambda at: WRITERS["opf"].write(at, perspective())),
        "blocks": (RADIAL, lambda at: (at / "block.xml").write_text(block_of(small_solution(k4=0.0, b=(0.4, 0.0))))),
        "psz": (RADIAL, lambda at: write_psz(at / "project.psz", small_solution())),
        "psx": (RADIAL, lambda at: write_psx(at / "project.psx", small_solution())),
        "micmac": (LARGE, lambda at: write_micmac(at, PHGR.format(cdist="2741.5 1837.25", b1=0, b2=0))),
        "meshroom": (ORIENTED, lambda at: write_json(at / "sfm.json", scene(ORIENTED))),
        "baf": (ORIENTED, lambda at: _write_baf(at / "scene.baf")),
        "nvm": (ORIENTED, lambda at: _write_nvm(at / "model.nvm")),
        "dbat": (DBAT, lambda at: write_dbat(at, DBAT)),
        "pix4d": (RADIAL, lambda at: (at / "p_calibrated_camera_parameters.txt").write_text(text_of_pix4d(RADIAL))),
        "stored": (RADIAL, lambda at: write_stored(at / "solution.npz", small_solution())),
        "database": (ORIENTED, lambda at: write_database(at / "database.db", *IN_DATABASE)),
    }
    for name, (solution, write) in forms.items():
        at = folder / name
        at.mkdir()
        write(at)
        _pictures(at, solution)
