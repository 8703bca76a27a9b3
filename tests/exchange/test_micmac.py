"""MicMac: Fraser's and radial models by MicMac's formulas, other centres of distortion, hostile folders."""

from pathlib import Path

import numpy as np
import pytest
from foreign import assert_refused_or_read, small_solution

from photogram.camera import Pose, project_points
from photogram.errors import ExchangeError
from photogram.exchange.formats.micmac import read_micmac

PHGR = """<ModPhgrStd><RadialePart><CDist>{cdist}</CDist><CoeffDist>-2.5e-09</CoeffDist><CoeffDist>1.5e-16</CoeffDist>
<CoeffDist>-4e-24</CoeffDist></RadialePart><P1>3e-07</P1><P2>-2e-07</P2><b1>{b1}</b1><b2>{b2}</b2></ModPhgrStd>"""
RAD = "<ModRad><CDist>{cdist}</CDist><CoeffDist>-2.5e-09</CoeffDist><CoeffDist>1.5e-16</CoeffDist></ModRad>"
CALIBRATION = """<?xml version="1.0" ?>
<ExportAPERO><CalibrationInternConique><KnownConv>eConvApero_DistM2C</KnownConv><PP>2741.5 1837.25</PP><F>3670.5</F>
<SzIm>5472 3648</SzIm><CalibDistortion>{model}</CalibDistortion></CalibrationInternConique></ExportAPERO>
"""
ORIENTATION = """<?xml version="1.0" ?>
<ExportAPERO><OrientationConique><OrIntImaM2C><I00>0 0</I00><V10>1 0</V10><V01>0 1</V01></OrIntImaM2C>
<TypeProj>eProjStenope</TypeProj><FileInterne>Ori-A/AutoCal.xml</FileInterne><RelativeNameFI>true</RelativeNameFI>
<Externe><Centre>{centre}</Centre><ParamRotation><CodageMatr><L1>{l1}</L1><L2>{l2}</L2><L3>{l3}</L3></CodageMatr>
</ParamRotation></Externe><ConvOri><KnownConv>eConvApero_DistM2C</KnownConv></ConvOri></OrientationConique></ExportAPERO>
"""


def write(folder: Path, model: str) -> None:
    folder.mkdir(exist_ok=True)
    (folder / "AutoCal.xml").write_text(CALIBRATION.format(model=model), encoding="utf-8")
    for photograph in small_solution().photographs:
        if photograph.pose is None:
            continue
        R, centre = photograph.pose.rotation_world_from_camera, photograph.pose.position_world_m
        l1, l2, l3, c = (" ".join(repr(v) for v in row) for row in [*R.tolist(), centre.tolist()])
        text = ORIENTATION.format(centre=c, l1=l1, l2=l2, l3=l3)
        (folder / f"Orientation-{photograph.name}.xml").write_text(text, encoding="utf-8")


def as_micmac(x: float, y: float, centre: tuple[float, float], b1: float = 0.0, b2: float = 0.0, whole: bool = True
              ) -> tuple[float, float]:  # fmt: skip
    """Return the pixel by cDistModStdPhpgr::Direct, letter by letter."""
    u, v = 2741.5 + 3670.5 * x, 1837.25 + 3670.5 * y
    dx, dy = u - centre[0], v - centre[1]
    dr2 = dx * dx + dy * dy
    c = (-2.5e-09, 1.5e-16, -4e-24) if whole else (-2.5e-09, 1.5e-16, 0.0)
    p1, p2 = (3e-07, -2e-07) if whole else (0.0, 0.0)
    radial = c[0] * dr2 + c[1] * dr2**2 + c[2] * dr2**3
    ux = (2 * dx * dx + dr2) * p1 + 2 * dx * dy * p2 + b1 * dx + b2 * dy
    uy = (2 * dy * dy + dr2) * p2 + 2 * dx * dy * p1
    return u + radial * dx + ux, v + radial * dy + uy


GRID = np.array([[x, y] for x in np.linspace(-0.7, 0.7, 9) for y in np.linspace(-0.45, 0.45, 7)])


def largest_difference(folder: Path, **more: float | bool | tuple[float, float]) -> tuple[float, tuple[str, ...]]:
    solution = read_micmac(folder)
    at = project_points(solution.cameras[0], Pose(np.eye(3), np.zeros(3)), np.column_stack([GRID, np.ones(len(GRID))]))
    true = np.array([as_micmac(x, y, **more) for x, y in GRID])  # type: ignore[arg-type]
    return float(np.linalg.norm(at - true, axis=1).max()), solution.left_out


def test_frasers_model_about_the_principal_point_is_exact(tmp_path: Path) -> None:
    write(tmp_path / "Ori-A", PHGR.format(cdist="2741.5 1837.25", b1=0, b2=0))
    difference, left_out = largest_difference(tmp_path / "Ori-A", centre=(2741.5, 1837.25))
    assert difference < 1e-9
    assert left_out == ("Tie points: MicMac's homologous points have no positions.",)


@pytest.mark.parametrize(("centre", "whole"), [((2750.5, 1830.0), True), ((2760.0, 1845.0), False)])
def test_another_centre_is_fitted_and_said(tmp_path: Path, centre: tuple[float, float], whole: bool) -> None:
    model = (PHGR if whole else RAD).format(cdist=f"{centre[0]} {centre[1]}", b1=0, b2=0)
    write(tmp_path / "Ori-A", model)
    difference, left_out = largest_difference(tmp_path / "Ori-A", centre=centre, whole=whole)
    said = float(left_out[0].split("at most ")[1].split(" px")[0])
    assert 1e-6 < difference < 0.3
    assert difference <= said * 1.1


def test_affinity_with_distortion_is_fitted(tmp_path: Path) -> None:
    write(tmp_path / "Ori-A", PHGR.format(cdist="2741.5 1837.25", b1=2e-4, b2=-1e-4))
    difference, left_out = largest_difference(tmp_path / "Ori-A", centre=(2741.5, 1837.25), b1=2e-4, b2=-1e-4)
    assert difference < 0.1
    assert left_out[0].startswith("What a fit does not hold of the calibration AutoCal")


def test_poses_are_read_exactly(tmp_path: Path) -> None:
    write(tmp_path / "Ori-A", "<ModNoDist><Inutile>0</Inutile></ModNoDist>")
    found = read_micmac(tmp_path / "Ori-A")
    true = [p for p in small_solution().photographs if p.pose is not None]
    assert [p.name for p in found.photographs] == [p.name for p in true]
    for one, other in zip(found.photographs, true, strict=True):
        assert one.pose is not None
        assert other.pose is not None
        np.testing.assert_array_equal(one.pose.rotation_world_from_camera, other.pose.rotation_world_from_camera)
        np.testing.assert_array_equal(one.pose.position_world_m, other.pose.position_world_m)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("<KnownConv>eConvApero_DistM2C<", "<KnownConv>eConvApero_DistC2M<", "inverse"),
        ("<ModRad>", "<ModUnif><TypeModele>eModele_EquiSolid_FishEye</TypeModele></ModUnif><ModRad>", "in a row"),
        ("<F>3670.5<", "<F>-1<", "focal length"),
        ("<CoeffDist>-2.5e-09", "<CoeffDist>nan", "finite"),
        ("<CDist>2741.5 1837.25", "<CDist>9000 9000", "fits none"),
        ("<SzIm>5472", "<SzIm>9223372036854775808", "px"),
    ],
)
def test_what_cannot_be_read_is_refused(tmp_path: Path, old: str, new: str, message: str) -> None:
    write(tmp_path / "Ori-A", RAD.format(cdist="2741.5 1837.25"))
    file = tmp_path / "Ori-A" / "AutoCal.xml"
    text = file.read_text(encoding="utf-8")
    assert old in text
    file.write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(ExchangeError, match=message):
        read_micmac(tmp_path / "Ori-A")


def test_other_models_are_named(tmp_path: Path) -> None:
    write(tmp_path / "Ori-A", "<ModUnif><TypeModele>eModele_EquiSolid_FishEye</TypeModele></ModUnif>")
    with pytest.raises(ExchangeError, match="eModele_EquiSolid_FishEye"):
        read_micmac(tmp_path / "Ori-A")


def test_a_calibration_elsewhere_is_not_opened(tmp_path: Path) -> None:
    write(tmp_path / "Ori-A", RAD.format(cdist="2741.5 1837.25"))
    for file in (tmp_path / "Ori-A").glob("Orientation-*"):
        text = file.read_text(encoding="utf-8").replace("Ori-A/AutoCal.xml", "/etc/passwd")
        file.write_text(text, encoding="utf-8")
    with pytest.raises(ExchangeError, match=r"Ori-A/passwd: cannot be read"):
        read_micmac(tmp_path / "Ori-A")
    with pytest.raises(ExchangeError, match="has no file"):
        read_micmac(tmp_path)


@pytest.mark.parametrize("name", ["AutoCal.xml", "Orientation-IMG_001.JPG.xml"])
def test_damaged_files_are_refused_or_read(tmp_path: Path, name: str) -> None:
    write(tmp_path / "Ori-A", RAD.format(cdist="2741.5 1837.25"))
    file = tmp_path / "Ori-A" / name
    assert_refused_or_read(file, lambda: read_micmac(tmp_path / "Ori-A"), 2, least=60)
