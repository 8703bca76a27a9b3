"""Binary PLY: both byte orders, what follows the vertices, headers that are none."""

import numpy as np
import pytest

from photogram.files.clouds.binary_ply import vertices_of

HEAD = b"ply\nformat binary_big_endian 1.0\ncomment made\nelement vertex 2\nproperty float x\nproperty uchar red\n"


def test_big_endian_and_what_follows() -> None:
    kind = np.dtype([("x", ">f4"), ("red", "u1")])
    vertices = np.array([(1.5, 7), (-2.25, 255)], kind)
    data = HEAD + b"element face 1\nproperty list uchar int v\nend_header\n" + vertices.tobytes() + b"more"
    found = vertices_of(data)
    assert found["x"].tolist() == [1.5, -2.25]
    assert found["red"].tolist() == [7, 255]


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "no PLY file"),
        (b"ply\nformat ascii 1.0\nend_header\n", "not read"),
        (HEAD + b"end_header\n123456789", "ends after 1 of 2"),
        (HEAD + b"property float x\nend_header\n", "of their own"),
        (HEAD + b"property list uchar int v\nend_header\n", "not read"),
        (HEAD.replace(b"2\n", b"-2\n") + b"end_header\n", "not read"),
        (HEAD.replace(b"vertex 2", b"vertex 9223372036854775808") + b"end_header\n", "ends after 0"),
    ],
)
def test_what_is_no_ply_file_is_refused(data: bytes, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        vertices_of(data)
