"""Effects that a design can declare in the chain, each whole in a file of its own, listed here once.

To add one: a file with its section of the document, its ``Effect`` and its ``EffectKind``, and its line in ``EFFECTS``.
What scores, simulates, optimises, differentiates, reports and shows asks a system for its effects by place.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

from ..fields import Record, leave_out_later
from . import ball_images, clamping, detector_tilt, image_field, intrinsics, motion, robot, temperature
from .kind import EffectKind, Host

_Record = TypeVar("_Record", bound=Record)

# In the order in which seeds draw, budgets list, and records say what is not modelled: new ones come last
EFFECTS: tuple[EffectKind[Any], ...] = (
    intrinsics.KIND,
    motion.KIND,
    image_field.KIND,
    temperature.KIND,
    ball_images.KIND,
    detector_tilt.KIND,
    clamping.KIND,
    robot.KIND,
)


def with_sections(host: Host, *later: str) -> Callable[[type[_Record]], type[_Record]]:
    """Gives a record the fields that the effects add to it, in their order; no name of one is known to types.

    They, and what else came ``later`` than the first designs, are written only where they differ from their default."""
    sections = [kind.section for kind in EFFECTS if kind.host == host]
    later = (*later, *(name for section in sections for name in section.model_fields))

    def add(record: type[_Record]) -> type[_Record]:
        own = {"__module__": record.__module__, "__doc__": record.__doc__, "_as_before": leave_out_later(*later)}
        made: Any = type(record.__name__, (*reversed(sections), record), own)
        return cast(type[_Record], made)

    return add
