"""The tolerance-budget report as a record, published as ``tailstack/report/1``, and two of them side by side, published
as ``tailstack/comparison/1``; every rendering is made from them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from tailstack.results import Optimisation, Provenance, Score, Verification, headline_of


@dataclass(frozen=True, slots=True)
class Headline:
    """The first page: what a project lead needs to know."""

    status: Literal["pass", "fail", "inconclusive", "no requirement"]
    basis: str  # "first order" or "Monte Carlo"
    sentence: str  # the verdict with its numbers
    requirement: str | None  # of the check that decides; null without requirement
    target: str
    quantile: float
    value_mm: float
    interval_mm: tuple[float, float | None]
    limit_mm: float | None
    matters: tuple[str, ...]  # the things that matter most, at most three
    error: str = "tcp"  # or localisation
    min_yield: float | None = None  # null: pooled
    headline: str = ""  # what the value is, in words: "P95 that 90 % of units keep"
    margin_mm: float | None = None  # the limit less the upper end of the interval; null where one is not known

    def __post_init__(self) -> None:
        high = self.interval_mm[1]
        margin = None if high is None or self.limit_mm is None else self.limit_mm - high
        object.__setattr__(self, "headline", headline_of(self.quantile, self.min_yield))
        object.__setattr__(self, "margin_mm", margin)


@dataclass(frozen=True, slots=True)
class ErrorDistribution:
    """TCP error at one target: shares of shots by bins of the error's norm, sampled and by the first-order law."""

    target: str
    edges_mm: tuple[float, ...]  # of n bins: n + 1
    sampled: tuple[float, ...] | None  # n shares; what is beyond the last edge is not in them
    first_order: tuple[float, ...]  # n shares
    trials: int | None


@dataclass(frozen=True, slots=True)
class ConvergencePoint:
    """P95 of the first so many trials, with its order-statistic interval."""

    trials: int
    p95_mm: float
    interval_mm: tuple[float, float]


@dataclass(frozen=True, slots=True)
class Convergence:
    """How the sampled P95 at one target settled."""

    target: str
    confidence: float
    points: tuple[ConvergencePoint, ...]


@dataclass(frozen=True, slots=True)
class Allowance:
    """How far one half-width could go by itself, to first order, everything else as it is; and what it costs.

    Of the requirement on the error at this target that is nearest to its limit, or furthest beyond it.
    """

    target: str
    contributor: str
    component: str  # "all" for a line of sources that are alike
    unit: str  # deg, mm, px, N
    half_width: float
    requirement: str | None  # null: no pooled requirement names this target
    status: Literal["spare", "too wide", "zero is not enough", "no influence", "no requirement"]
    at_limit: float | None  # the half-width at which the requirement's quantile is at its limit
    slack: float | None  # at_limit - half_width: negative where it has to shrink
    cost: float | None  # by the price that the design's optimise section gives it; null: no price
    smallest: float | None  # bounds of the optimise section
    largest: float | None


@dataclass(frozen=True, slots=True)
class Reproduction:
    """How to get the same numbers again."""

    commands: tuple[str, ...]  # with the design of this record saved as design.yaml
    parts: tuple[str, ...]
    seed: int | None  # null: nothing was drawn
    trials: int | None  # asked for; null: as many as the precision takes
    precision: float | None  # asked for; null: the solver's own, or a number of trials
    max_trials: int | None  # drawn at most
    starts: int | None  # of the optimiser; null: as many as the design says
    statement: str


@dataclass(frozen=True, slots=True)
class Report:
    """A design, what was found about it, and how to find it again."""

    schema: Literal["tailstack/report/1"]
    title: str
    headline: Headline
    score: Score
    verification: Verification | None
    optimisation: Optimisation | None
    distributions: tuple[ErrorDistribution, ...]
    convergence: tuple[Convergence, ...]
    allowances: tuple[Allowance, ...]  # of the targets that distributions are of
    design: dict[str, object]  # the document, complete
    reproduction: Reproduction
    provenance: Provenance


@dataclass(frozen=True, slots=True)
class Difference:
    """P95 of the TCP error at one target that both designs have: second minus first.

    Both designs are drawn with the same random numbers, so that what they share cancels.
    """

    target: str
    basis: Literal["first order", "Monte Carlo"]
    first_p95_mm: float  # of the check, whose trials both designs share; first order where nothing was drawn
    second_p95_mm: float
    difference_mm: float
    interval_mm: tuple[float, float] | None  # null: first order
    confidence: float | None
    conclusion: Literal["smaller", "larger", "not decided", "computed"]  # of the second


@dataclass(frozen=True, slots=True)
class Change:
    """One field of the design document that differs."""

    pointer: str  # into the second design; into the first for what was removed
    name: str  # the same with names for numbers: views AP fiducial_noise_px
    unit: str
    kind: Literal["changed", "added", "removed"]
    first: str | None  # the value as JSON
    second: str | None


@dataclass(frozen=True, slots=True)
class ComparisonHeadline:
    """The first page of a comparison."""

    status: Literal["pass", "fail", "inconclusive", "no requirement"]  # the verdict on the second design
    sentence: str
    matters: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Comparison:
    """Two designs computed alike, with the same seed, and what sets them apart."""

    schema: Literal["tailstack/comparison/1"]
    title: str
    headline: ComparisonHeadline
    differences: tuple[Difference, ...]  # largest P95 of the second first
    compared_trials: int | None  # of each design, the same random numbers: what the interval comes from
    sections: int | None  # that they are cut into
    only_first: tuple[str, ...]  # targets that the other design does not have
    only_second: tuple[str, ...]
    changes: tuple[Change, ...]
    changes_left_out: int
    first: Report
    second: Report
