"""STL files, binary and as text -> surfaces of triangles in mm, and their bytes as a text that stands in a document.

STL has no unit, and says of no surface that it is closed: the unit is the caller's, and what a side needs is checked.
"""

from __future__ import annotations

import base64
import gzip
import hashlib
import re
import zlib
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ..errors import DesignError, LimitError, Problem
from ..geometry.arrays import Array, frozen
from ..geometry.mesh import Mesh
from .reading import decode, show

ENDING = ".stl"
MOST_TRIANGLES = 20_000  # a surface that beads keep near has no need of more
MOST_BYTES = 8_000_000  # of a file, written as text
MOST_TEXT = 600_000  # characters of one in a document, which has at most a million
HEADER, RECORD = 84, 50  # bytes of a binary file, and of each triangle
WELDED = 1e-6  # of the size: corners that near are one
FLAT = 1e-12  # of the size, squared: a triangle with less area has none
FURTHEST_MM = 1e5
CURE = "save it again as STL"
DECIMATE = "simplify it (MeshLab: quadric edge collapse; FreeCAD: decimate): a tenth of a millimetre does not matter"
REPAIR = "repair it (FreeCAD: Analyze, Evaluate and repair mesh), or leave side out"


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """A surface as it stands in a file, and what is to be known of it."""

    mesh: Mesh  # in the unit of the file, counterclockwise from outside where it is closed
    remarks: tuple[str, ...]
    not_closed: str  # why it has no inside, in words; empty where it has one


def pack(content: bytes, name: str) -> str:
    """The bytes of a file as text of a document.  Raises LimitError."""
    text = base64.b64encode(gzip.compress(content, 9, mtime=0)).decode()
    if len(text) > MOST_TEXT:
        detail = f"{name} takes {len(text)} characters in a document; at most {MOST_TEXT}"
        raise LimitError(Problem("", "too-large", detail, DECIMATE, name))
    return text


def unpack(text: str) -> bytes:
    """The bytes that a text stands for: base64, of the file or of what gzip makes of it.  Raises DesignError."""
    try:
        content = base64.b64decode("".join(text.split()), validate=True)
    except ValueError:
        detail, cure = f"this is not base64: {show(text[:40])}", "base64 FILE.stl, or name the file"
        raise DesignError(Problem("", "not-base64", detail, cure)) from None
    if content[:2] != b"\x1f\x8b":
        return content
    try:
        stream = zlib.decompressobj(31)
        plain = stream.decompress(content, MOST_BYTES + 1)
    except zlib.error as error:
        raise DesignError(Problem("", "not-gzip", f"gzip cannot read it: {error}", CURE)) from None
    if len(plain) > MOST_BYTES:
        raise LimitError(Problem("", "too-large", f"it holds more than {MOST_BYTES} bytes", DECIMATE))
    if not stream.eof:
        raise DesignError(Problem("", "not-gzip", "it ends before gzip's end", "copy all of it"))
    return plain


@lru_cache(maxsize=8)
def read_packed(text: str, name: str) -> Surface:
    """The surface of a file that stands in a document.  Raises as ``read_surface`` does."""
    return read_surface(unpack(text), name)


def digest(text: str) -> str:
    """Of the file that a text of a document stands for, however that was packed: 64 hexadecimal digits."""
    return hashlib.sha256(unpack(text)).hexdigest()


def read_surface(content: bytes, name: str) -> Surface:
    """Read an STL file.  Raises DesignError with file and line or triangle, LimitError."""
    if not content.strip():
        raise DesignError(Problem("", "empty-document", f"{name} is empty", CURE, name))
    triangles = _read_binary(content, name) if _is_binary(content) else _read_text(content, name)
    if len(triangles) > MOST_TRIANGLES:
        raise _refuse_many(name, str(len(triangles)))
    bad = np.flatnonzero(~(np.abs(triangles) <= FURTHEST_MM).all(axis=(1, 2)))
    if len(bad):
        detail = f"{name}: triangle {bad[0] + 1} has no usable corner: {show(triangles[bad[0]].tolist())}"
        more = f", and {len(bad) - 1} more" if len(bad) > 1 else ""
        raise DesignError(Problem("", "out-of-range", detail + more, "repair it, and save it in mm", name))
    return _weld(triangles, name)


def _refuse_many(name: str, count: str) -> LimitError:
    detail = f"{name} holds {count} triangles; at most {MOST_TRIANGLES}"
    return LimitError(Problem("", "too-many", detail, DECIMATE, name))


def _is_binary(content: bytes) -> bool:
    """By the zeros in it, as headers of binary files begin with solid too; what has none by its first word."""
    return b"\0" in content[: HEADER + RECORD] or content.lstrip()[:5].lower() != b"solid"


def _read_binary(content: bytes, name: str) -> Array:
    """(T, 3, 3)."""
    count = int.from_bytes(content[80:84], "little") if len(content) >= HEADER else 0
    if count > MOST_TRIANGLES:
        raise _refuse_many(name, str(count))
    if len(content) != HEADER + RECORD * count:
        is_stl = len(content) > HEADER and count > 0
        detail = f"{name} says {count} triangles, {HEADER + RECORD * count} bytes, and has {len(content)}"
        detail = detail if is_stl else f"{name} is no STL file: neither text that begins with solid, nor a binary one"
        raise DesignError(Problem("", "stl-length", detail, CURE, name))
    records = np.frombuffer(content, np.uint8, RECORD * count, HEADER).reshape(count, RECORD)
    corners = np.ascontiguousarray(records[:, 12:48]).view("<f4")
    return corners.astype(float).reshape(count, 3, 3)


_ORDER = ("facet normal", "outer loop", "vertex", "vertex", "vertex", "endloop", "endfacet")


def _read_text(content: bytes, name: str) -> Array:
    """(T, 3, 3)."""
    corners: list[list[float]] = []
    at, line, inside = 0, 0, False
    lines = enumerate(decode(content, name).splitlines(), 1)
    for line, words in ((number, text.lower().split()) for number, text in lines if text.strip()):
        word = words[0]
        if at == 0 and word in ("solid", "endsolid"):
            inside = word == "solid"
            continue
        wanted = _ORDER[at].split()
        if not inside or words[: len(wanted)] != wanted:
            expected = f"{_ORDER[at]!r}" if inside else "'solid'"
            detail = f"{expected} is expected here; got {show(' '.join(words)[:60])}"
            raise DesignError(Problem("", "stl-syntax", detail, CURE, name, line))
        if word == "vertex":
            corners.append(_read_corner(words[1:], name, line))
        at = (at + 1) % len(_ORDER)
        if len(corners) > 3 * MOST_TRIANGLES:
            raise _refuse_many(name, f"more than {MOST_TRIANGLES}")
    if inside:
        raise DesignError(Problem("", "stl-syntax", "the file ends before 'endsolid'", "copy all of it", name, line))
    return np.array(corners).reshape(-1, 3, 3)


def _read_corner(words: list[str], name: str, line: int) -> list[float]:
    numbers = [float(word) for word in words if re.fullmatch(r"[-+]?(\d+\.?\d*|\.\d+)(e[-+]?\d+)?", word)]
    if len(words) != 3 or len(numbers) != 3:
        detail = f"a vertex has three numbers with points for decimals; got {show(' '.join(words)[:60])}"
        raise DesignError(Problem("", "wrong-type", detail, CURE, name, line))
    return numbers


def _weld(triangles: Array, name: str) -> Surface:
    """Triangles (T, 3, 3) with an area, with common corners, and outwards where they enclose a volume."""
    if not len(triangles):
        raise DesignError(Problem("", "empty-document", f"{name} holds no triangle", CURE, name))
    low = triangles.min(axis=(0, 1))
    size = float((triangles.max(axis=(0, 1)) - low).max()) or 1.0
    every = triangles.reshape(-1, 3)
    cells = np.round((every - low) / (WELDED * size))
    _, first, which = np.unique(cells, axis=0, return_index=True, return_inverse=True)
    corners, each = frozen(every[first]), which.reshape(-1, 3)
    a, b, c = np.moveaxis(corners[each], 1, 0)
    solid = np.linalg.norm(np.cross(b - a, c - a), axis=1) > FLAT * size**2
    if not solid.any():
        raise DesignError(Problem("", "empty-surface", f"{name}: no triangle has an area", CURE, name))
    flat = int((~solid).sum())
    remarks = [f"{name}: {flat} triangles without area were left out"] if flat else []
    mesh = Mesh(corners, each[solid])
    not_closed = _say_open(mesh)
    if not not_closed and mesh.volume_mm3 < 0:
        mesh = Mesh(corners, mesh.triangles[:, ::-1])
        remarks.append(f"{name}: its triangles faced inwards; they were turned round")
    return Surface(mesh, tuple(remarks), not_closed)


def _say_open(mesh: Mesh) -> str:
    """Why a surface has no inside, in words."""
    edges = mesh.find_edges()
    for found, what in (
        (edges.open, "edges have a triangle on one side only"),
        (edges.crossed, "edges have triangles that do not agree on the outside"),
    ):
        if len(found):
            place = mesh.corners_mm[found[0]].mean(axis=0)
            return f"{len(found)} {what}, one at {[round(float(value), 3) for value in place]}"
    size = float(np.ptp(mesh.corners_mm, axis=0).max())
    return "it encloses no volume" if abs(mesh.volume_mm3) < FLAT**0.5 * size**3 else ""
