"""A few numbers with names and a few arrays, as bytes that any process and any machine reads back exactly.

Four bytes with the length of the head, the head as JSON (floats in their shortest form that reads back the same), then
the arrays as little-endian float64, one after another.  Not pickle: reading it runs nothing.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from math import prod
from typing import Any

import numpy as np

from .arrays import Array
from .json_text import write_json


def pack(head: dict[str, Any], arrays: Sequence[Array]) -> bytes:
    """``head`` (JSON's own types) and float64 arrays of any shape as bytes; the same input gives the same bytes."""
    shapes = [list(array.shape) for array in arrays]
    text = write_json({"head": head, "shapes": shapes}, sort_keys=True).encode()
    parts = [np.ascontiguousarray(array, dtype="<f8").tobytes() for array in arrays]
    return b"".join([len(text).to_bytes(4, "little"), text, *parts])


def unpack(content: bytes) -> tuple[dict[str, Any], list[Array]]:
    """What :func:`pack` was given; the arrays are read-only.  Raises ValueError for other bytes."""
    start = 4 + int.from_bytes(content[:4], "little")
    try:
        header = json.loads(content[4:start])
        shapes: list[list[int]] = header["shapes"]
        head: dict[str, Any] = header["head"]
    except (UnicodeDecodeError, json.JSONDecodeError, KeyError, TypeError) as error:
        raise ValueError(f"{len(content)} bytes are not a packed record: {error}") from None
    arrays = []
    for shape in shapes:
        size = prod(shape)
        if start + 8 * size > len(content):
            raise ValueError(f"a packed record breaks off after {len(content)} bytes")
        arrays.append(np.frombuffer(content, dtype="<f8", count=size, offset=start).reshape(shape))
        start += 8 * size
    if start != len(content):
        raise ValueError(f"{len(content) - start} bytes follow a packed record")
    return head, arrays
