"""Tables of ground points as twelve programs write them, permuted: read right, or refused with the right cause?

    python benchmarks/tables.py [TABLES]                 default: 200

One survey's nine points are written again and again, each time by another program's habit and with another choice of
what that program leaves to its user or his country: the order of columns, their names and language, separator, decimal
mark, groups of thousands, encoding, ends of lines, unit, remarks above, columns that say nothing here, the CRS, names
with blanks or zeros in front. Each is read as a project's file, and its positions in the map are compared with what was
meant, to 2 mm in plan and height (figures are written with three decimals, degrees with nine).

Right: every point. Refused: an error that says the cause which the table has on purpose (an order that nothing tells,
figures with one comma and three digits, an unknown unit). Wrong: anything else, silently another position above all.
"""

import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from photogram.arrays import FloatArray
from photogram.errors import ProjectError
from photogram.geodesy.frames import geodetic_from_map
from photogram.pipeline.pipeline import load_project

CRS = "EPSG:25832"
FOOT_M, SURVEY_FOOT_M = 0.3048, 1200.0 / 3937.0
UNITS_M = (
    ("", 1.0), ("", 1.0), (" (m)", 1.0), (" [m]", 1.0), (" (ft)", FOOT_M), (" (US survey feet)", SURVEY_FOOT_M),
)  # fmt: skip
NAMES = ("GCP1", "GCP2", "P 3", "004", "Ü5", "6", "T-7", "8a", "Mühle 9")

PROJECT = """\
photogram: 1
crs: EPSG:25832
cameras:
  c: {{width_px: 4000, height_px: 3000, focal_px: 3000, principal_point_px: [1999.5, 1499.5], source: EXIF}}
photographs: {{folder: images, height_above_ground_m: 80}}
control_points:
  sigma_m: [0.02, 0.02, 0.03]
  mark_sigma_px: 1
  files:
    - {{path: {name}{more}}}
"""


@dataclass
class Table:
    """A table as it is written: rows of cells below ``head``, and what a surveyor adds to the project file."""

    program: str
    head: list[str]
    rows: list[list[str]]
    above: list[str] = field(default_factory=list)
    separator: str = ","
    suffix: str = ".csv"
    encoding: str = "utf-8"
    end: str = "\n"
    comma: bool = False
    crs: str = ""
    cause: str = ""


def points(rng: np.random.Generator) -> FloatArray:
    """Return easting, northing and height of nine points (9, 3)."""
    grid = np.stack(np.meshgrid([0.0, 60.0, 120.0], [0.0, 50.0, 100.0]), axis=-1).reshape(-1, 2)
    plan = grid + rng.uniform(-5.0, 5.0, (9, 2)) + [720_012.0, 6_192_034.0]
    return np.asarray(np.round(np.column_stack([plan, rng.uniform(31.0, 39.0, 9)]), 3), dtype=np.float64)


def metres(values: FloatArray, unit_m: float = 1.0) -> list[str]:
    """Return lengths with three decimals of metres, five of other units."""
    return [f"{value / unit_m:.3f}" if unit_m == 1.0 else f"{value / unit_m:.5f}" for value in values]


def degrees(values: FloatArray) -> list[str]:
    """Return angles in decimal degrees."""
    return [f"{value:.9f}" for value in values]


def one_of(rng: np.random.Generator, choices: Sequence[str]) -> str:
    """Return one of several texts by chance."""
    return choices[int(rng.integers(len(choices)))]


def emlid(rng: np.random.Generator, p: FloatArray) -> Table:
    """Emlid Flow: grid and geodetic coordinates, solution, base and the name of the system in one table."""
    head = [
        "Name", "Code", "Code description", "Easting", "Northing", "Elevation", "Description", "Longitude", "Latitude",
        "Ellipsoidal height", "Origin", "Tilt angle", "Easting RMS", "Northing RMS", "Elevation RMS", "Lateral RMS",
        "Antenna height", "Antenna height units", "Solution status", "Correction type", "Averaging start",
        "Averaging end", "Samples", "PDOP", "GDOP", "Base easting", "Base northing", "Base elevation", "CS name",
    ]  # fmt: skip
    longitude, latitude, _ = geodetic_from_map(CRS, p).T
    e, n, h = (metres(c) for c in p.T)
    ellipsoidal = metres(p[:, 2] + 40.5)
    lon, lat = degrees(longitude), degrees(latitude)
    rows = [
        [
            NAMES[i], "gcp", "", e[i], n[i], h[i], "", lon[i], lat[i], ellipsoidal[i], "Global", "", "0.010", "0.010",
            "0.014", "0.014", "1.800", "m", one_of(rng, ["FIX", "FIX", "FLOAT"]), "RTK", "2026-05-01 10:00:00.0 UTC",
            "2026-05-01 10:00:10.0 UTC", "50", "1.2", "1.5", "719000.000", "6191000.000", "30.000",
            "ETRS89 / UTM zone 32N",
        ]
        for i in range(9)
    ]  # fmt: skip
    return Table("Emlid Flow", head, rows, crs=one_of(rng, ["", CRS, "EPSG:4326"]))


def without_header(program: str) -> Callable[[np.random.Generator, FloatArray], Table]:
    """Name, northing, easting (or the reverse), elevation, description: no line says which."""

    def made(rng: np.random.Generator, p: FloatArray) -> Table:
        order = [1, 0, 2] if rng.random() < 0.6 else [0, 1, 2]
        first, second, h = (metres(p[:, k]) for k in order)
        more = [["GCP"], []][int(rng.integers(2))]
        rows = [[NAMES[i], first[i], second[i], h[i], *more] for i in range(9)]
        return Table(program, [], rows, suffix=one_of(rng, [".csv", ".txt"]), separator=one_of(rng, [",", "\t", ";"]))

    return made


def named(program: str, *heads: Sequence[str]) -> Callable[[np.random.Generator, FloatArray], Table]:
    """Columns by the names that a program or a language has for them; N and E before a name say what it is."""

    def made(rng: np.random.Generator, p: FloatArray) -> Table:
        head = list(heads[int(rng.integers(len(heads)))])
        unit, unit_m = UNITS_M[int(rng.integers(len(UNITS_M)))]
        columns = {"N": metres(p[:, 1], unit_m), "E": metres(p[:, 0], unit_m), "H": metres(p[:, 2], unit_m)}
        fixed = {"P": list(NAMES), "C": ["nail"] * 9, "S": ["0.012"] * 9}
        cells = [columns.get(name[0]) or fixed[name[0]] for name in head]
        called = [name[2:] + (unit if name[0] in columns else "") for name in head]
        return Table(program, called, [list(row) for row in zip(*cells, strict=True)])

    return made


def geodetic(program: str, *heads: Sequence[str]) -> Callable[[np.random.Generator, FloatArray], Table]:
    """Longitude and latitude: in degrees, or in degrees, minutes and seconds."""

    def made(rng: np.random.Generator, p: FloatArray) -> Table:
        head = list(heads[int(rng.integers(len(heads)))])
        longitude, latitude, _ = geodetic_from_map(CRS, p).T
        form = one_of(rng, ["degrees", "degrees", "sexagesimal", "letters"])
        texts = {"X": sexagesimal(longitude, "E", form), "Y": sexagesimal(latitude, "N", form), "H": metres(p[:, 2])}
        cells = [texts.get(name[0]) or list(NAMES) for name in head]
        rows = [list(row) for row in zip(*cells, strict=True)]
        return Table(program, [name[2:] for name in head], rows, crs="EPSG:4258")

    return made


def sexagesimal(values: FloatArray, letter: str, form: str) -> list[str]:
    """Return angles in a form: decimal degrees, degrees with minutes and seconds, or these with a ``letter``."""
    if form == "degrees":
        return degrees(values)
    whole = np.floor(values)
    minutes = np.floor((values - whole) * 60.0)
    seconds = ((values - whole) * 60.0 - minutes) * 60.0
    after = letter if form == "letters" else ""
    return [f"{d:.0f}°{m:.0f}'{s:.6f}\"{after}" for d, m, s in zip(whole, minutes, seconds, strict=True)]


def metashape(rng: np.random.Generator, p: FloatArray) -> Table:
    """Metashape's reference: remarks, names behind #, estimates beside measurements."""
    e, n, h = (metres(c) for c in p.T)
    head = [
        "#Label", "X/Easting", "Y/Northing", "Z/Altitude", "Accuracy_X/Y/Z_(m)", "Error_(m)", "X_error", "Y_error",
        "Z_error", "X_est", "Y_est", "Z_est",
    ]  # fmt: skip
    rows = [
        [NAMES[i], e[i], n[i], h[i], "0.010000", "0.013", "0.004", "0.003", "0.012", e[8 - i], n[8 - i], h[8 - i]]
        for i in range(9)
    ]
    above = ["# Cameras (0)"] if rng.random() < 0.3 else []
    if rng.random() < 0.5:
        above.append(
            '# CoordinateSystem: PROJCS["ETRS89 / UTM zone 32N",GEOGCS["ETRS89",DATUM["European Terrestrial Reference '
            'System 1989",SPHEROID["GRS 1980",6378137,298.257222101,AUTHORITY["EPSG","7019"]],AUTHORITY["EPSG","6258"]]'
            ',PRIMEM["Greenwich",0,AUTHORITY["EPSG","8901"]],UNIT["degree",0.01745329251994328,AUTHORITY["EPSG","9102"]'
            '],AUTHORITY["EPSG","4258"]],PROJECTION["Transverse_Mercator",AUTHORITY["EPSG","9807"]],PARAMETER['
            '"latitude_of_origin",0],PARAMETER["central_meridian",9],PARAMETER["scale_factor",0.9996],PARAMETER['
            '"false_easting",500000],PARAMETER["false_northing",0],UNIT["metre",1,AUTHORITY["EPSG","9001"]],AUTHORITY['
            '"EPSG","25832"]]'
        )
    return Table("Metashape", head, rows, above, suffix=one_of(rng, [".csv", ".txt"]))


def opendronemap(program: str, *crs: str) -> Callable[[np.random.Generator, FloatArray], Table]:
    """A gcp_list.txt: a CRS, then a row for each mark."""

    def made(rng: np.random.Generator, p: FloatArray) -> Table:
        e, n, h = (metres(c) for c in p.T)
        rows = [
            [e[i], n[i], h[i], f"{rng.uniform(10, 3990):.2f}", f"{rng.uniform(10, 2990):.2f}", photograph, NAMES[i]]
            for i in range(9)
            for photograph in ("IMG_0001.JPG", "IMG_0002.JPG")
        ]  # fmt: skip
        separator = one_of(rng, ["\t", "\t", ","])
        return Table(program, [], rows, [one_of(rng, crs)], suffix=".txt", separator=separator)

    return made


PROGRAMS: tuple[Callable[[np.random.Generator, FloatArray], Table], ...] = (
    emlid,
    without_header("Trimble Access"),
    without_header("Carlson SurvCE"),
    without_header("PIX4Dmapper"),
    named(
        "Leica Captivate",
        ("P:Point ID", "E:Easting", "N:Northing", "H:Ortho Height", "C:Code"),
        ("P:Punkt-ID", "E:Ost", "N:Nord", "H:Höhe", "C:Code"),
        ("P:Punktnummer", "E:Rechtswert", "N:Hochwert", "H:Höhe", "C:Bemerkung"),
    ),
    named(
        "FieldGenius",
        ("P:Point", "N:Northing", "E:Easting", "H:Elevation", "C:Description"),
        ("P:Punto", "N:Norte", "E:Este", "H:Cota", "C:Descripcion"),
    ),
    metashape,
    named(
        "RealityScan",
        ("P:#name", "E:x", "N:y", "H:alt"),
        ("P:Name", "E:X (East)", "N:Y (North)", "H:Alt"),
    ),
    named(
        "DroneDeploy",
        ("P:GCP Label", "N:Northing", "E:Easting", "H:Elevation"),
        ("P:GCP Label", "E:Easting", "N:Northing", "H:Elevation"),
    ),
    geodetic(
        "DroneDeploy",
        ("P:GCP Label", "Y:Latitude", "X:Longitude", "H:Elevation"),
        ("P:GCP Label", "X:Longitude", "Y:Latitude", "H:Elevation"),
    ),
    named(
        "Propeller",
        ("P:Point Number", "N:Northing", "E:Easting", "H:Elevation", "S:Horizontal accuracy (m)", "C:Code"),
        ("P:point_id", "E:east", "N:north", "H:height"),
        ("P:Nome", "E:Leste", "N:Norte", "H:Altitude"),
        ("P:Nom", "E:Est", "N:Nord", "H:Altitude"),
        ("P:Punto", "E:Est", "N:Nord", "H:Quota"),
    ),
    opendronemap("OpenDroneMap", "EPSG:25832", "epsg:25832", "+proj=utm +zone=32 +ellps=GRS80 +units=m +no_defs"),
    opendronemap("GCP Editor Pro", "EPSG:25832", "WGS84 UTM 32N", "WGS84 UTM 32U"),
)


def habits(rng: np.random.Generator, table: Table) -> Table:
    """Change what a program leaves to its user and his country."""
    is_list = table.suffix == ".txt" and bool(table.above) and not table.head
    if not is_list and table.separator == ",":
        table.separator = one_of(rng, [",", ",", ";", "\t", "|"])
    if table.separator in (";", "\t") and not is_list and rng.random() < 0.4:
        table.comma = True
        table.rows = [
            [cell.replace(".", ",") if is_number(cell) or "°" in cell else cell for cell in row] for row in table.rows
        ]
    elif table.separator != "," and not is_list and rng.random() < 0.15:
        table.rows = [[f"{float(cell):,.3f}" if is_long(cell) else cell for cell in row] for row in table.rows]
    if rng.random() < 0.1 and not is_list and table.head and table.head[0][0] != "#":
        table.head[0] = "#" + table.head[0]
    if rng.random() < 0.15 and not is_list:
        table.above = [*table.above, "# exported 2026-05-01"]
    table.encoding = one_of(rng, ["utf-8", "utf-8", "utf-8-sig", "cp1252", "utf-16"])
    table.end = one_of(rng, ["\n", "\r\n"])
    return table


def is_number(cell: str) -> bool:
    """Return whether a cell is a figure with decimals."""
    return "." in cell and cell.replace(".", "", 1).lstrip("-").isdecimal()


def is_long(cell: str) -> bool:
    """Return whether a cell is a figure of a thousand or more."""
    return is_number(cell) and float(cell) >= 1000.0


def spoiled(rng: np.random.Generator, table: Table) -> Table:
    """Give one table in ten a fault that no reader can mend, and the words by which it has to be named."""
    fault = one_of(rng, ["unit", "column", "number", "twice"])
    if fault == "unit" and table.head and any("asting" in name for name in table.head):
        k = next(k for k, name in enumerate(table.head) if "asting" in name)
        table.head[k] = table.head[k].split(" (")[0].split(" [")[0] + " (cubits)"
        table.cause = "cubits"
    elif fault == "column" and table.head and "llipsoidal" not in "".join(table.head):
        keep = [k for k, name in enumerate(table.head) if name.split(" (")[0].split(" [")[0] not in HEIGHTS]
        if len(keep) < len(table.head):
            table.head = [table.head[k] for k in keep]
            table.rows = [[row[k] for k in keep] for row in table.rows]
            table.cause = "no column for height"
    elif fault == "number":
        k = 3 if table.program == "Emlid Flow" else 2
        table.rows[4][k] = "n/a"
        table.cause = "must be a number, found 'n/a'"
    elif fault == "twice" and table.head:
        table.rows[5] = [*table.rows[4]]
        table.cause = "is used twice"
    return table


HEIGHTS = ("Elevation", "Alt", "alt", "Altitude", "height", "Cota", "Quota", "Höhe", "Ortho Height", "Z/Altitude")


def text_of(table: Table) -> str:
    """Return a table as it stands in its file."""

    def line(cells: Sequence[str]) -> str:
        return table.separator.join(f'"{c}"' if table.separator in c else c for c in cells)

    return table.end.join([*table.above, *([line(table.head)] if table.head else []), *map(line, table.rows), ""])


@dataclass(frozen=True)
class Outcome:
    """What became of a table: ``kind`` is right, refused or wrong."""

    table: Table
    kind: str
    says: str
    text: str


def outcome(seed: int, folder: Path) -> Outcome:
    """Write the table of a seed with its project, and read it."""
    rng = np.random.default_rng([seed, 49])
    truth = points(rng)
    table = PROGRAMS[seed % len(PROGRAMS)](rng, truth)
    table = habits(rng, table)
    if seed % 10 == 7:
        table = spoiled(rng, table)
    text = text_of(table)
    here = folder / f"{seed}"
    (here / "images").mkdir(parents=True)
    for k in (1, 2):
        (here / "images" / f"IMG_{k:04d}.JPG").touch()
    name = f"points{table.suffix}"
    (here / name).write_bytes(text.encode(table.encoding))
    more = f", crs: {table.crs}" if table.crs else ""
    (here / "project.yaml").write_text(PROJECT.format(name=name, more=more), encoding="utf-8")
    try:
        project = load_project(here / "project.yaml")
    except ProjectError as error:
        named = bool(table.cause) and table.cause in str(error)
        return Outcome(table, "refused" if named else "wrong", str(error), text)
    found = {p.name: p.position_map_m for p in project.control_points}
    expected = dict(zip(NAMES, truth, strict=True))
    if table.cause or set(found) != set(expected):
        return Outcome(table, "wrong", f"read {len(found)} points{', fault unseen' if table.cause else ''}", text)
    away = max(float(np.abs(found[k] - expected[k]).max()) for k in expected)
    return Outcome(table, "right" if away < 0.002 else "wrong", f"off by {away:.4f} m", text)


def main() -> None:
    """Read every table, and print what became of those of each program."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    with tempfile.TemporaryDirectory() as folder:
        outcomes = [outcome(seed, Path(folder)) for seed in range(count)]
    programs = dict.fromkeys(o.table.program for o in outcomes)
    print(f"{'program':18s} {'tables':>6s} {'right':>6s} {'refused, with the cause':>24s} {'wrong':>6s}")
    for program in programs:
        own = Counter(o.kind for o in outcomes if o.table.program == program)
        print(f"{program:18s} {own.total():6d} {own['right']:6d} {own['refused']:24d} {own['wrong']:6d}")
    total = Counter(o.kind for o in outcomes)
    print(f"{'all':18s} {total.total():6d} {total['right']:6d} {total['refused']:24d} {total['wrong']:6d}")
    for seed, o in enumerate(outcomes):
        if o.kind == "wrong":
            print(f"\n{seed}: {o.table.program}, {o.table.encoding}: {o.says}\n" + "\n".join(o.text.splitlines()[:4]))


if __name__ == "__main__":
    main()
