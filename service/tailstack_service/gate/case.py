"""One design before the gate: everything a rule may look at, and what a rule says."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from tailstack.design import Design
from tailstack.results import Score, Verification

from .policy_document import Rules
from .records import GatedDesign, GateNumber, GateRequirement, GateTarget, Unjudged


@dataclass(frozen=True, slots=True)
class ClassOfName:
    """A class of the policy that a design's name would choose, were it allowed to."""

    name: str
    pattern: str


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """A design that could be computed."""

    file: str
    design: Design
    rules: Rules
    score: Score
    verification: Verification | None
    numbers: tuple[GateNumber, ...]  # what was held against limits
    added: Mapping[str, str]  # requirements that the policy added: name -> rule
    targets: tuple[GateTarget, ...]
    requirements: tuple[GateRequirement, ...]  # of the design and of the policy, judged or not
    not_judged: tuple[Unjudged, ...]
    design_class: str | None
    class_of_name: ClassOfName | None
    compared: bool  # there is a baseline
    baseline: GatedDesign | None  # what it says of this design
    max_regression_percent: float


@dataclass(frozen=True, slots=True)
class Remark:
    """What a rule says about a design."""

    pointer: str  # into the design document
    message: str
    value: float | None = None
    limit: float | None = None
    target: str | None = None
    bound: float | None = None  # the end of the value's interval that a waiver must cover; None: the value itself
    about: str | None = None  # the rule whose waivers cover it, where that is another one
    unbounded: bool = False  # no end of the interval is known: no waiver covers it
    note: bool = False  # said for information, whatever the rule's severity
