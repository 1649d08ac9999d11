"""The installation errors that a study of coupling compares: as designed, and fixed levels."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from math import radians, sqrt

import numpy as np

from ..contributors import error_law
from ..errors import IllPosedError, OutOfRangeError, Problem
from ..estimation.checks import check_geometry
from ..montecarlo import ChainPlan, compile_plan
from ..propagation.linear import LinearModel, linearise_all
from ..scoring import P95
from ..system import Array, Mount, Reading, System
from .refusals import StudyError

Level = tuple[float, float]  # degrees about each axis, mm along (1, 1, 1)


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """One installation error in one reading."""

    reading: Reading
    level: Level | None  # None: as designed
    plans: tuple[ChainPlan, ...]  # one for each worst vertex of bounded components
    plan_of: tuple[int, ...]  # of each target
    models: dict[str, LinearModel]
    remark: str = ""  # what is not imaged there

    @property
    def name(self) -> str:
        return "as designed" if self.level is None else named(self.level)


def named(level: Level) -> str:
    return f"{level[0]:g} deg + {level[1]:g} mm"


def level_torsor(level: Level) -> Array:
    """(6,) rad, mm: one angle about each axis, a translation along (1, 1, 1)/sqrt(3).  Raises OutOfRangeError."""
    rotation_deg, translation_mm = level
    if not (abs(rotation_deg) <= 45 and abs(translation_mm) <= 1000):
        detail = (
            f"a level is at most 45 deg about each axis and 1000 mm; got {rotation_deg:g} deg and {translation_mm:g} mm"
        )
        raise OutOfRangeError(Problem("", "level", detail))
    return np.array([radians(rotation_deg)] * 3 + [translation_mm / sqrt(3)] * 3)


def in_place(system: System) -> System:
    """The system without any known error: mounts unbiased, no deflection."""

    def unbiased(mount: Mount) -> Mount:
        return replace(mount, bias=np.zeros(6))

    return replace(
        system,
        interface_1=unbiased(system.interface_1),
        interface_2=unbiased(system.interface_2),
        hand_eye=unbiased(system.hand_eye),
        execution_bias_mm=np.zeros(3),
    )


def cases_of(system: System, nominal: System, levels: Sequence[Level], error: str) -> Iterable[Case]:
    """As designed, with bounded components at their worst ends, and the levels, in the reading of ``system``."""
    models = linearise_all(system)
    ends = [tuple(sorted(error_law(m, error, P95).worst.vertex(m).items())) for m in models.values()]
    distinct = list(dict.fromkeys(ends))
    plans = tuple(compile_plan(system, vertex=dict(vertex)) for vertex in distinct)
    yield Case(system.reading, None, plans, tuple(distinct.index(vertex) for vertex in ends), models)
    for level in levels:
        mount = replace(nominal.interface_1, bias=level_torsor(level))
        moved = replace(nominal, reading=system.reading, interface_1=mount)
        remark, plan = _remark(moved, level), compile_plan(moved)
        yield Case(system.reading, level, (plan,), (0,) * len(ends), linearise_all(moved), remark)


def _remark(moved: System, level: Level) -> str:
    """What is not imaged at a level, or "".  Raises StudyError where the level leaves nothing to be estimated.

    Outside an image, the study goes on as if the detector were large enough: a paper's level may be larger than a
    field of view.
    """
    unbounded = replace(moved, views=tuple(replace(view, image_size_px=None) for view in moved.views))
    try:
        check_geometry(unbounded)
    except IllPosedError as error:
        detail = f"at {named(level)}, {moved.reading.value} reading: {error.problems[0].detail}"
        raise StudyError(Problem("", "level", detail, "name a smaller --level")) from None
    try:
        check_geometry(moved)
    except IllPosedError as error:
        return (
            f"At {named(level)}, {moved.reading.value} reading, {error.problems[0].detail}: there the study takes the "
            "detector as large enough."
        )
    return ""
