"""The tolerance-budget report as a record, published as ``tailstack/report/1``; every rendering is made from it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from tailstack.results import Optimisation, Provenance, Score, Verification


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
class Reproduction:
    """How to get the same numbers again."""

    commands: tuple[str, ...]  # with the design of this record saved as design.json
    seed: int | None
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
    design: dict[str, object]  # the document, complete
    reproduction: Reproduction
    provenance: Provenance
