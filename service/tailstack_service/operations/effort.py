"""How long a computation will take, from the size of what was sent: fiducials, views and targets.

The figures were measured on one core of a virtual machine (AMD EPYC, AVX-512).  They need not be right, only tell what
takes milliseconds from what takes seconds: what is expected to be quick and is not begins anew among the long ones.
"""

from __future__ import annotations

import json
import re
from typing import TYPE_CHECKING, Any

from .patches import merge

if TYPE_CHECKING:
    from .sent import Sent

LOOKED_AT = 100_000  # bytes of JSON that are looked into; a longer body takes long whatever is in it
REGION_TARGETS = 27  # as many as a box of three by three by three
LONG = 60.0  # seconds, of what is not looked into
BYTE_SECONDS = 0.3e-6  # for reading and checking a document
TARGETS_IN_YAML = re.compile(rb"^targets:(.*?)(?=^[^\s#-]|\Z)", re.MULTILINE | re.DOTALL)

Size = tuple[int, int, int]  # fiducials, views, targets


def score_seconds(sizes: list[Size], *, second_order: bool = False) -> float:
    """Of one core, for scores of designs of these sizes."""
    seconds = 0.0
    for fiducials, views, targets in sizes:
        seconds += 0.004 + 0.0005 * fiducials + 0.0035 * targets * (1 + fiducials * views / 200)
        if second_order:
            seconds += 2e-5 * (targets * fiducials * views) ** 2
    return seconds


def reading_seconds(sent: Sent) -> float:
    """For reading and checking what was sent, whatever it is."""
    return BYTE_SECONDS * len(sent.body)


def admission_seconds(sent: Sent) -> float:
    """For the check of what becomes a job, the optimiser's included: less than a score takes."""
    sizes = sizes_of(sent)
    return reading_seconds(sent) + (LONG if sizes is None else score_seconds(sizes))


def score_reception_seconds(sent: Sent) -> float:
    """For a score that is answered at once."""
    sizes = sizes_of(sent)
    scoring = LONG if sizes is None else score_seconds(sizes, second_order=asks_second_order(sent))
    return reading_seconds(sent) + scoring


def gate_seconds(sent: Sent) -> float:
    """For a gate to first order; for the admission of one that becomes a job."""
    at_once = b"analytic" in sent.body if sent.form == "json" else ("mode", "analytic") in sent.query
    if not at_once:
        return reading_seconds(sent)
    sizes = sizes_of(sent)
    return reading_seconds(sent) + (LONG if sizes is None else 1.5 * score_seconds(sizes))


def sizes_of(sent: Sent) -> list[Size] | None:
    """Sizes of the designs in a body, as far as it can be read; None if it is too long to be looked into."""
    if len(sent.body) > LOOKED_AT:
        return None
    if sent.form != "json":
        return [_size_of_text(sent.body)]
    try:
        data = json.loads(sent.body)
    except (ValueError, RecursionError):
        return []  # it will be refused
    if not isinstance(data, dict):
        return []
    found = [_apply_patch(data, sent.base), data.get("first"), data.get("second")]
    for entry in _list(data.get("designs")):
        if isinstance(entry, dict):
            found += [entry.get("design"), entry.get("text")]
    return [_size_of_text(one.encode(errors="replace")) if isinstance(one, str) else _size(one)
            for one in found if isinstance(one, dict | str)]  # fmt: skip


def _apply_patch(data: dict[str, Any], base: bytes | None) -> Any:
    """The design of a body, its patch applied; ``base`` is the one that it names by its hash."""
    design = data.get("design") if base is None else json.loads(base)
    patch = data.get("patch")
    return merge(design, patch) if isinstance(design, dict) and isinstance(patch, dict) else design


def asks_second_order(sent: Sent) -> bool:
    """Whether second order is asked for, in the body or the query."""
    if sent.form == "json":
        return b"second_order" in sent.body
    return any(name == "second_order" for name, _ in sent.query)


def _size(design: dict[str, Any]) -> Size:
    fiducials = design.get("fiducials")
    points = _list(fiducials.get("points")) if isinstance(fiducials, dict) else []
    targets = sum(REGION_TARGETS if isinstance(one, dict) and "region" in one else 1
                  for one in _list(design.get("targets")))  # fmt: skip
    return len(points), len(_list(design.get("views"))), targets


def _size_of_text(text: bytes) -> Size:
    """A design as YAML, by its words: reading it would take as long as computing it."""
    points, views = text.count(b"position_mm"), text.count(b"fiducial_noise_px")
    section = TARGETS_IN_YAML.search(text)
    if section is None:  # not in the usual form: each point may be a target
        return points, views, points
    targets = section[1].count(b"position_mm")
    return points - targets, views, targets + REGION_TARGETS * section[1].count(b"region")


def _list(value: Any) -> list[Any]:
    return value if isinstance(value, list) else []
