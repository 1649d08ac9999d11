"""The canonical text of a design, defaults filled in, and its hash; the texts of sections met before are remembered."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from typing import Any

import pydantic_core

from .document import DesignDocument, Fiducials
from .fiducial_files import FiducialList
from .fields import Record
from .remembering import FEW, kept


def sha256_of(document: DesignDocument, fiducials: FiducialList) -> str:
    """The hash of a design, 64 hexadecimal digits: of its canonical text and its fiducials, wherever they were read."""
    points = f"[{_PLAIN.encode(fiducials.labels)}, {_positions_json(fiducials.positions_mm)}]"
    return hashlib.sha256(f"{_written(document, _FIELDS)}\n{points}".encode()).hexdigest()


def _positions_json(positions_mm: Sequence[tuple[float, float, float]]) -> str:
    """The text of Python's json, by a faster writer where both write all digits alike."""
    text = pydantic_core.to_json(positions_mm).decode()
    if "e" in text or "0.0000" in text:  # Python has an exponent from 0.00001 on, the other writer later
        return _PLAIN.encode(positions_mm)
    return text.replace(",", ", ")


def _json(value: Any) -> str:
    return pydantic_core.to_json(value, by_alias=True, exclude_none=True).decode()


_kept_json = kept(_json)
_PLAIN = json.JSONEncoder(ensure_ascii=False, allow_nan=False)


def _entries(records: Sequence[Record]) -> str:
    return f"[{','.join([_kept_json(record) for record in records])}]" if len(records) <= FEW else _json(records)


def _written(record: Record, fields: list[tuple[str, str, Callable[[Any], str]]]) -> str:
    """The canonical text of a record: its fields in the order of the class, without spaces, as pydantic writes it."""
    values = [(key, write, getattr(record, name)) for name, key, write in fields]
    return f"{{{','.join([key + write(value) for key, write, value in values if value is not None])}}}"


def _fields(kind: type[Record], **writers: Callable[[Any], str]) -> list[tuple[str, str, Callable[[Any], str]]]:
    return [(name, f'"{info.alias or name}":', writers.get(name, _json)) for name, info in kind.model_fields.items()]


_HELD = [field for field in _fields(Fiducials) if field[0] not in ("points", "file")]  # those are written apart
_FIELDS = _fields(
    DesignDocument,
    fiducials=lambda section: _written(section, _HELD),
    **dict.fromkeys(("views", "targets", "requirements"), _entries),
    **dict.fromkeys(("interfaces", "transforms", "execution", "model"), _kept_json),
)
