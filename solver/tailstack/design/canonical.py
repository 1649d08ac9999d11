"""The canonical text of a design, defaults filled in, and its hash."""

from __future__ import annotations

import hashlib
import json

from ..json_text import write_json
from .document import DesignDocument
from .fiducial_files import FiducialList

_ELSEWHERE = {"fiducials": {"points", "file", "origin"}}  # the points are hashed apart, wherever they were read


def sha256_of(document: DesignDocument, fiducials: FiducialList) -> str:
    """The hash of a design, 64 hexadecimal digits: of its canonical text and its fiducials, wherever they were read."""
    content = document.model_dump(mode="json", by_alias=True, exclude_none=True, exclude=_ELSEWHERE)
    points = [fiducials.labels, fiducials.positions_mm]
    # with spaces, unlike everything else: the hashes of designs that are in the field were made so
    spaced = json.dumps(points, ensure_ascii=False, allow_nan=False)  # noqa: TID251
    return hashlib.sha256(f"{write_json(content)}\n{spaced}".encode()).hexdigest()
