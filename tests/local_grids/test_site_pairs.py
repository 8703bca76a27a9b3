"""Tables of pairs: what is read, and every fault with its line."""

from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from photogram.errors import ControlPointError
from photogram.local_grids.site_pairs import read_pairs

HEAD = "name,longitude,latitude,height,local_easting,local_northing,local_height"


def table(folder: Path, *rows: str, head: str = HEAD) -> Path:
    path = folder / "pairs.csv"
    path.write_text("\n".join([head, *rows]) + "\n", encoding="utf-8")
    return path


def test_a_table_with_all_it_may_have(tmp_path: Path) -> None:
    head = "Point;Easting [m];Northing [m];h;local_e;local_n;local_h;sigma_plan;sigma_height;use"
    path = table(tmp_path, "A;500000.1;6170000.2;40.5;1000;2000;3.5;0.01;0.02;plan", "B;1;2;;3;4;;;;", head=head)
    found = read_pairs(path)
    assert found.name == ("A", "B")
    assert not found.geographic
    np.testing.assert_array_equal(found.position, [[500000.1, 6170000.2, 40.5], [1.0, 2.0, np.nan]])
    np.testing.assert_array_equal(found.local, [[1000.0, 2000.0, 3.5], [3.0, 4.0, np.nan]])
    np.testing.assert_array_equal(found.sigma_m, [[0.01, 0.02], [np.nan, np.nan]])
    assert found.use == ("plan", "both")


@pytest.mark.parametrize(
    ("row", "says"),
    [
        ("A,12,55,40,x,2,3", "local_easting must be a number, found 'x'"),
        ("A,12,,40,1,2,3", "latitude is empty"),
        ("A,12,95,40,1,2,3", "no place on the globe"),
        ("A,1e300,55,40,1,2,3", "longitude must be within"),
        (",12,55,40,1,2,3", "the pair has no name"),
        ("A,12,55,40,1,2,3,9", "8 fields"),
        ('"A,12,55,40,1,2,3', "line"),
    ],
)
def test_a_fault_is_named_with_its_line(tmp_path: Path, row: str, says: str) -> None:
    path = table(tmp_path, "Z,12,55,40,1,2,3", row)
    with pytest.raises(ControlPointError) as fault:
        read_pairs(path)
    assert f"{path}:" in str(fault.value)
    assert says in str(fault.value) or ":3:" in str(fault.value)


@pytest.mark.parametrize(
    ("head", "says"),
    [
        ("name,longitude,latitude,height,local_easting", "no column for local_northing"),
        ("name,height,local_easting,local_northing", "no longitude and latitude"),
        ("name,longitude,latitude,easting,northing,local_easting,local_northing", "both longitude, latitude"),
        ("name,longitude,latitude,local_easting,local_northing,colour", "unknown column 'colour'"),
    ],
)
def test_columns_that_do_not_serve(tmp_path: Path, head: str, says: str) -> None:
    with pytest.raises(ControlPointError, match=says):
        read_pairs(table(tmp_path, ",".join("1" for _ in head.split(",")), head=head))


def test_twice_the_same_name_and_a_use_that_is_none(tmp_path: Path) -> None:
    path = table(tmp_path, "A,12,55,4,1,2,3,both", "A,12,55,4,1,2,3,all", head=HEAD + ",use")
    with pytest.raises(ControlPointError) as fault:
        read_pairs(path)
    assert "'A' is there twice, first in line 2" in str(fault.value)
    assert "use must be one of both, plan, height, check, found 'all'" in str(fault.value)


@given(st.binary(max_size=400))
def test_whatever_a_file_holds_it_is_read_or_refused(tmp_path_factory: pytest.TempPathFactory, content: bytes) -> None:
    path = tmp_path_factory.mktemp("pairs") / "pairs.csv"
    for text in (content, (HEAD + "\n").encode() + content):
        path.write_bytes(text)
        with suppress(ControlPointError):
            assert len(read_pairs(path)) > 0
