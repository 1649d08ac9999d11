"""The tolerance-budget report as a record, published as ``tailstack/report/1``, and two of them side by side, published
as ``tailstack/comparison/1``; every rendering is made from them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from tailstack.measures import MEASURE, MeasureName
from tailstack.results import Optimisation, Provenance, Score, Verification
from tailstack.results.radiostereometry import Profile, Radiostereometry
from tailstack.results.record import Published
from tailstack.results.verdicts import headline_of as name_headline


@dataclass(frozen=True, slots=True)
class Headline:
    """The first page: what a project lead needs to know."""

    status: Literal["pass", "fail", "inconclusive", "no requirement"]
    """The verdict."""
    basis: str
    """What it rests on: first order or Monte Carlo."""
    sentence: str
    """The verdict with its numbers, in a sentence."""
    requirement: str | None
    """Requirement of the check that decides; null without requirement."""
    target: str
    """Target of the check that decides."""
    quantile: float
    """Quantile of the error's norm, 0.95 for P95."""
    value: float
    """The value that decides."""
    interval: tuple[float, float | None]
    """Its lower and upper end; a null upper end is not known."""
    limit: float | None
    """The limit; null without requirement."""
    matters: tuple[str, ...]
    """What matters most, at most three sentences."""
    error: MeasureName = "tcp"
    """Measure that decides, as a requirement names it: tcp (the error at the tool), ..."""
    min_yield: float | None = None
    """Fraction of units, or of mountings, that must keep the limit; null: the risk is pooled."""
    headline: str = ""
    """What the value is, in words: "P95 that 90 % of units keep"."""
    margin: float | None = None
    """Limit less the upper end of the interval; null where one of them is not known."""
    unit: str = ""
    """Unit of value, interval, limit and margin: mm, unless the measure has another."""
    risk: str = "per_unit"
    """Of what `min_yield` is a fraction: per_unit, per_mounting."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "unit", self.unit or MEASURE[self.error].unit)
        high = self.interval[1]
        margin = None if high is None or self.limit is None else self.limit - high
        headline = self.headline or name_headline(self.quantile, self.min_yield, risk=self.risk)
        object.__setattr__(self, "headline", headline)
        object.__setattr__(self, "margin", margin)


@dataclass(frozen=True, slots=True)
class ErrorDistribution:
    """TCP error at one target: shares of shots by bins of the error's norm, sampled and by the first-order law."""

    target: str
    """Name of the target."""
    edges_mm: tuple[float, ...]
    """Edges of n bins of the error's norm, n + 1 numbers, mm."""
    sampled: tuple[float, ...] | None
    """Share of sampled shots in each bin; what is beyond the last edge is in none. Null: nothing was drawn."""
    first_order: tuple[float, ...]
    """Share of shots in each bin by the first-order law."""
    trials: int | None
    """Sampled shots; null: nothing was drawn."""


@dataclass(frozen=True, slots=True)
class Allowance:
    """How far one half-width could go by itself, to first order, everything else as it is; and what it costs.

    Of the requirement on a quantile that decides at this target: one that is not kept before one that is, then the one
    that is nearest to its limit, or furthest beyond it; of all units together or of each unit by itself.
    """

    target: str
    """Name of the target."""
    contributor: str
    """Source of error: structure_connector, fiducial_manufacturing, ..."""
    component: str
    """Its component; all for a line of sources that are alike."""
    unit: str
    """Unit of the half-widths: deg, mm, px or N."""
    half_width: float
    """Half-width as it is, in `unit`."""
    requirement: str | None
    """Requirement that decides at this target; null: none on a quantile names this target."""
    status: Literal["spare", "too wide", "zero is not enough", "no influence", "no requirement"]
    """spare: the half-width may grow; too wide: it must shrink; zero is not enough: nor would a perfect part do; no
    influence; no requirement."""
    at_limit: float | None
    """Half-width at which the requirement's quantile is at its limit, in `unit`; null where there is none."""
    slack: float | None
    """`at_limit` less `half_width`, in `unit`: negative where it has to shrink; null where there is no such half-width.
    """
    cost: float | None
    """Cost by the price in the design's optimise section; null: no price."""
    smallest: float | None
    """Lower bound in the optimise section, in `unit`; null: none."""
    largest: float | None
    """Upper bound in the optimise section, in `unit`; null: none."""
    label: str = ""
    """What people call the source: the label that the design gives an interface, otherwise its name or words for it."""


@dataclass(frozen=True, slots=True)
class Reproduction:
    """How to get the same numbers again."""

    commands: tuple[str, ...]
    """Commands that give the same numbers, with the design of this record saved as design.yaml."""
    parts: tuple[str, ...]
    """What was computed: score, verification, optimisation."""
    seed: int | None
    """Seed of the check; null: nothing was drawn."""
    trials: int | None
    """Trials asked for; null: as many as the precision takes."""
    precision: float | None
    """Relative half-width asked for; null: the solver's own, or a number of trials."""
    max_trials: int | None
    """At most so many trials; null: their number was asked for, or nothing was drawn."""
    starts: int | None
    """Starts of the optimiser; null: as many as the design says."""
    statement: str
    """What the commands reproduce, and how exactly."""
    profile: Profile | None = None
    """Chapter for a field of work that was asked for; null: none."""


@dataclass(frozen=True, slots=True, repr=False)
class Report(Published):
    """A design, what was found about it, and how to find it again."""

    schema: Literal["tailstack/report/1"]
    title: str
    """Title of the report: the design's name."""
    headline: Headline
    """The first page: what a project lead needs to know."""
    score: Score
    """First order: bias, covariance, tail and budget."""
    verification: Verification | None
    """Monte Carlo check; null where it was not asked for."""
    optimisation: Optimisation | None
    """The optimised design; null where it was not asked for."""
    distributions: tuple[ErrorDistribution, ...]
    """TCP error at the targets with the largest P95, by bins."""
    allowances: tuple[Allowance, ...]
    """How far each half-width could go by itself, at the targets of `distributions` and at the one that decides."""
    design: dict[str, object]
    """The design document, complete."""
    reproduction: Reproduction
    """How to get the same numbers again."""
    provenance: Provenance
    radiostereometry: Radiostereometry | None = None
    """What ISO 16087 asks for, with the profile rsa; null: it was not asked for."""


@dataclass(frozen=True, slots=True)
class Difference:
    """P95 of the TCP error at one target that both designs have: second minus first.

    Both designs are drawn with the same random numbers, so that what they share cancels.
    """

    target: str
    """Name of the target that both designs have."""
    basis: Literal["first order", "Monte Carlo"]
    """What the P95 rest on."""
    first_p95_mm: float
    """P95 of the TCP error of the first design, mm: of the check, or first order where nothing was drawn."""
    second_p95_mm: float
    """P95 of the TCP error of the second design, mm."""
    difference_mm: float
    """Second minus first, mm."""
    interval_mm: tuple[float, float] | None
    """Confidence interval of the difference, from trials that both designs share, mm; null: first order."""
    confidence: float | None
    """Confidence of that interval, 0 to 1; null: first order."""
    conclusion: Literal["smaller", "larger", "not decided", "computed"]
    """Of the second: smaller or larger where the interval says so, otherwise not decided; computed: first order."""


@dataclass(frozen=True, slots=True)
class Change:
    """One field of the design document that differs."""

    pointer: str
    """JSON pointer into the second design; into the first for what was removed."""
    name: str
    """The same with names for numbers: views AP fiducial_noise_px."""
    unit: str
    """Unit of the field; empty where it has none."""
    kind: Literal["changed", "added", "removed"]
    """changed, added or removed."""
    first: str | None
    """Value in the first design as JSON; null where it was added."""
    second: str | None
    """Value in the second design as JSON; null where it was removed."""


@dataclass(frozen=True, slots=True)
class ComparisonHeadline:
    """The first page of a comparison."""

    status: Literal["pass", "fail", "inconclusive", "no requirement"]
    """The verdict on the second design."""
    sentence: str
    """The comparison in a sentence."""
    matters: tuple[str, ...]
    """What matters most, at most three sentences."""


@dataclass(frozen=True, slots=True, repr=False)
class Comparison(Published):
    """Two designs computed alike, with the same seed, and what sets them apart."""

    schema: Literal["tailstack/comparison/1"]
    title: str
    """Title of the comparison: the names of both designs."""
    headline: ComparisonHeadline
    """The first page of the comparison."""
    differences: tuple[Difference, ...]
    """P95 at every target that both designs have, largest of the second first."""
    compared_trials: int | None
    """Trials of each design, with the same random numbers, that the intervals come from; null: first order."""
    sections: int | None
    """Sections that those trials are cut into; null: first order."""
    only_first: tuple[str, ...]
    """Targets that only the first design has."""
    only_second: tuple[str, ...]
    """Targets that only the second design has."""
    changes: tuple[Change, ...]
    """Fields of the design document that differ."""
    changes_left_out: int
    """Further differing fields that are not listed."""
    first: Report
    """Report of the first design."""
    second: Report
    """Report of the second design."""
    names: tuple[str, str] | None = None
    """What both are called, such as versions of one design; null: the first and the second."""
