"""Binary glTF 2.0 (GLB): meshes with normals, a picture on them, and what is said of them. JSON and one block of
bytes, so that no library is needed (Khronos Group 2021, sec. 4.4)."""

import json
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from photogram import __version__
from photogram.arrays import FloatArray, IntArray

_UNLIT = "KHR_materials_unlit"
_FLOAT, _UINT = 5126, 5125
_VERTICES, _INDICES = 34962, 34963
_HEADER, _CHUNK = struct.Struct("<4sII"), struct.Struct("<I4s")


@dataclass(frozen=True)
class Material:
    """How a part of a mesh looks: a dull surface, seen from both sides."""

    name: str
    grey: float = 1.0
    """What it reflects, linear, 0 to 1; 1 under a picture."""
    textured: bool = False
    """Whether it has the picture."""
    extras: Mapping[str, object] | None = None
    """What is said of it."""
    unlit: bool = False
    """Whether its colours are shown as they are, whatever the light (KHR_materials_unlit): those of a photograph have
    light and shadow in them."""


@dataclass(frozen=True, eq=False)
class Part:
    """Triangles (T) of one material between vertices (V); x to the right, y up, z towards the viewer, in m."""

    position_m: FloatArray
    """(V, 3); stored as float32."""
    normal: FloatArray
    """Unit vectors (V, 3)."""
    uv: FloatArray
    """Where in the picture (V, 2), 0 to 1, from its upper left corner."""
    triangle: IntArray
    """(T, 3), counter-clockwise as seen from outside."""
    material: Material


def glb(
    parts: Sequence[Part],
    jpeg: bytes | None,
    extras: Mapping[str, object],
    translation_m: tuple[float, float, float] | None = None,
) -> bytes:
    """Return parts as one GLB, with a picture (JPEG) for those that have it, and ``extras`` of the asset. All lies
    ``translation_m`` from the origin of the file. The same parts give the same bytes."""
    views, accessors, block = list[dict[str, int]](), list[dict[str, Any]](), bytearray()

    def viewed(content: bytes, **of: int) -> int:
        views.append({"buffer": 0, "byteOffset": len(block), "byteLength": len(content)} | of)
        block.extend(content + b"\0" * (-len(content) % 4))
        return len(views) - 1

    def accessor(values: FloatArray | IntArray, kind: str) -> int:
        is_index = kind == "SCALAR"
        stored = np.ascontiguousarray(values, dtype="<u4" if is_index else "<f4")
        described: dict[str, Any] = {
            "bufferView": viewed(stored.tobytes(), target=_INDICES if is_index else _VERTICES),
            "componentType": _UINT if is_index else _FLOAT,
            "count": len(stored),
            "type": kind,
        }
        if kind == "VEC3":
            described |= {"min": stored.min(axis=0).tolist(), "max": stored.max(axis=0).tolist()}
        accessors.append(described)
        return len(accessors) - 1

    primitives = [
        {
            "attributes": {
                "POSITION": accessor(part.position_m, "VEC3"),
                "NORMAL": accessor(part.normal, "VEC3"),
                "TEXCOORD_0": accessor(part.uv, "VEC2"),
            },
            "indices": accessor(part.triangle.reshape(-1), "SCALAR"),
            "material": number,
        }
        for number, part in enumerate(parts)
    ]
    whole: dict[str, Any] = {
        "asset": {"version": "2.0", "generator": f"photogram {__version__}", "extras": dict(extras)},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0} | ({} if translation_m is None else {"translation": list(translation_m)})],
        "meshes": [{"name": "surface", "primitives": primitives}],
        "materials": [_material(part.material) for part in parts],
    }
    if any(part.material.unlit for part in parts):
        whole["extensionsUsed"] = [_UNLIT]
    if jpeg is not None:
        whole |= {
            "images": [{"bufferView": viewed(jpeg), "mimeType": "image/jpeg"}],
            "samplers": [{"magFilter": 9729, "minFilter": 9987, "wrapS": 33071, "wrapT": 33071}],
            "textures": [{"source": 0, "sampler": 0}],
        }
    whole |= {"accessors": accessors, "bufferViews": views, "buffers": [{"byteLength": len(block)}]}
    text = json.dumps(whole, separators=(",", ":"), ensure_ascii=False).encode()
    text += b" " * (-len(text) % 4)
    size = _HEADER.size + 2 * _CHUNK.size + len(text) + len(block)
    return b"".join(
        [
            _HEADER.pack(b"glTF", 2, size),
            _CHUNK.pack(len(text), b"JSON"),
            text,
            _CHUNK.pack(len(block), b"BIN\0"),
            block,
        ]
    )


def _material(material: Material) -> dict[str, Any]:
    look: dict[str, Any] = {"metallicFactor": 0.0, "roughnessFactor": 1.0}
    look |= (
        {"baseColorTexture": {"index": 0}} if material.textured else {"baseColorFactor": [material.grey] * 3 + [1.0]}
    )
    said: dict[str, Any] = {} if material.extras is None else {"extras": dict(material.extras)}
    said |= {"extensions": {_UNLIT: {}}} if material.unlit else {}
    return {"name": material.name, "doubleSided": True, "pbrMetallicRoughness": look} | said
