"""What a file of this folder says of its effect, and what the rules that doubt values are made of.

An effect is one file: the section of the document that declares it, what it compiles to, what a record says where it is
not declared, which of its values are doubted, and up to what size first order was calibrated for it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Generic, Literal, NamedTuple, TypeVar

from ..errors import Problem
from ..fields import Record
from ..results import Vector3
from ..system import Effect, System, View

Section = TypeVar("Section", bound=Record)
Subject = TypeVar("Subject")
Pivots = Mapping[str, Vector3]  # con, mm, of the interfaces that a design declares
Host = Literal["view", "fiducials", "execution", "design"]  # the records of the document that sections can be added to


class Doubt(NamedTuple):
    """A value that a rule doubts."""

    pointer: str
    message: str
    value: float
    limit: float


@dataclass(frozen=True, slots=True, eq=False)
class Setting:
    """Where a section stands, and what effects read of the rest of a design."""

    pointer: str  # to the record that holds the section
    views: tuple[View, ...]  # the one that holds it; all of them, where none does
    pivots_mm: Pivots


@dataclass(frozen=True, slots=True)
class PlausibilityTest(Generic[Subject]):
    """One rule: what it doubts, and where its numbers come from."""

    id: str  # stable, the rule of its findings
    title: str
    numbers: str  # the bounds and their source
    find: Callable[[Subject], Iterator[Doubt]] | None = None  # None: the ranges of fields name it
    slip: bool = False  # a slip of unit, which may be why a geometry is refused


class Excess(NamedTuple):
    """An effect that is larger than first order was calibrated for."""

    words: str


class Proportional(NamedTuple):
    """The size of an effect by which first order errs in proportion."""

    words: str  # with one place for the size, in per cent
    size: float  # relative


Limit = Excess | Proportional


@dataclass(frozen=True, slots=True)
class EffectKind(Generic[Section]):
    """One effect of the table ``effects.EFFECTS``."""

    host: Host
    """The record of the document that its section is added to."""
    section: type[Section]
    """What declares it: fields with a default of None, which that record takes over."""
    compile: Callable[[Section, Setting], Iterator[Effect]]
    """What a section declares.  Order counts: seeds draw in it."""
    not_modelled: Callable[[System], str] = lambda system: ""
    """What a record says where it is not declared, or not in every view; empty: nothing."""
    check: Callable[[Section, Pivots], Iterator[Problem]] | None = None
    """What is refused beyond one record."""
    list_fiducials: Callable[[Section], Iterable[tuple[str, Sequence[str]]]] | None = None
    """Labels of fiducials that a section lists, each list with its pointer: they are held against those that exist."""
    doubts: tuple[PlausibilityTest[System], ...] = ()
    """Rules on values that are allowed and hardly ever meant."""
    limits: Callable[[System], Iterator[Limit]] | None = None
    """Up to what size first order holds for it."""


def name_views(what: str, kind: type[Effect], system: System) -> str:
    """What is not modelled in the views without an effect of this kind, which are named unless it is all of them."""
    declared = {view for effect in system.effects if isinstance(effect, kind) for _, view in effect.places}
    without = [view.name for view in system.views if view.name not in declared]
    if not without:
        return ""
    return what if len(without) == len(system.views) else f"{what} ({', '.join(without)})"
