"""Effects that a design can declare in the chain, each whole in a file of its own, listed here once.

To add one: a file with its section of the document, its ``Effect`` and its ``EffectKind``, and its line in ``EFFECTS``.
What scores, simulates, optimises, differentiates, reports and shows asks a system for its effects by place.
"""

from __future__ import annotations

from typing import Any

from ..fields import Record
from . import ball_images, detector_tilt, image_field, intrinsics, motion, temperature
from .kind import EffectKind, Host

# In the order in which seeds draw, budgets list, and records say what is not modelled: new ones come last
EFFECTS: tuple[EffectKind[Any], ...] = (
    intrinsics.KIND,
    motion.KIND,
    image_field.KIND,
    temperature.KIND,
    ball_images.KIND,
    detector_tilt.KIND,
)


def with_sections(host: Host, record: type[Record]) -> Any:
    """The record with the fields that the effects add to it, in their order."""
    bases = (*reversed(_sections(host)), record)
    return type(f"{record.__name__}WithEffects", bases, {"__module__": record.__module__})


def later_fields(host: Host) -> dict[str, None]:
    """The fields that effects add to a record, all of them None where they are not declared."""
    return {name: None for section in _sections(host) for name in section.model_fields}


def _sections(host: Host) -> list[type[Record]]:
    return [kind.section for kind in EFFECTS if kind.host == host]
