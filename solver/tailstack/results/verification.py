"""The answer of a Monte Carlo check."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from .digits import decimals_of
from .outline import Bar, Bars, Outline, checks_frame, frame, measures_frames, verdict_sentence
from .record import Result
from .score import TARGET, AtTarget, bias_columns, norm_columns, pair_rows
from .tables import IN_DETAIL, PAPER, Column, Table
from .verdicts import Interval, MeasureResult, Provenance, Vector3, Verdict


@dataclass(frozen=True, slots=True)
class Exceedance:
    """How often the error is beyond a limit."""

    limit_mm: float
    """The limit, mm."""
    probability: float
    """Share of trials whose error is beyond it."""
    interval: Interval
    """Confidence interval of that probability."""


@dataclass(frozen=True, slots=True)
class MetricEstimate:
    """Sampled result for one error metric at one target."""

    bias_mm: Vector3
    """Mean error vector x, y, z in the error's frame, mm."""
    std_mm: Vector3
    """Standard deviations of the error along x, y, z in the error's frame, mm."""
    mean_norm_mm: float
    """Mean of the error's norm, mm."""
    p95_mm: float
    """Sampled 95 % quantile of the error's norm, mm."""
    p95_interval_mm: Interval
    """Confidence interval of `p95_mm`, by order statistics, mm."""
    cvar95_mm: float
    """Mean of the worst 5 % of the error's norm, mm."""
    worst_mm: float
    """Largest error's norm among the trials, mm: it grows with their number."""
    exceedance: Exceedance | None
    """How often the error is beyond the tightest limit here; null without a limit."""
    first_order_ratio: float
    """First-order P95 over the sampled one: below 1, first order is optimistic."""


@dataclass(frozen=True, slots=True)
class TargetEstimate(MetricEstimate, AtTarget):
    """``bias_mm`` ... ``exceedance`` are the TCP error; ``localisation`` is the same before connector_flange."""

    confidence: float
    """Confidence of each interval by itself, 0 to 1."""
    flagged_trials: int
    """Trials that the fast chain could not prove solved and that were computed again by singular value decomposition.
    """
    first_order_p95_mm: float
    """P95 to first order, mm: that of the score; where the design says how often fiducials are missed, over shots with
    up to two of them missed."""
    localisation: MetricEstimate
    """The same of the localisation error: of the triangulated target in con, before connector_flange."""


@dataclass(frozen=True, slots=True)
class Reprojection:
    """RMS over fiducials and views of the distance between measured and reprojected images."""

    trials: int
    """Trials that it was sampled with."""
    mean_px: float
    """Mean, px."""
    p95_px: float
    """95 % quantile, px."""


@dataclass(frozen=True, slots=True)
class DrawnLosses:
    """Shots with fiducials missed, as often as the design says."""

    trials: int
    """Shots that were drawn."""
    trials_with_losses: int
    """Of these, shots in which at least one fiducial is missed."""
    trials_without_answer: int
    """Shots left with too few fiducials for an answer. In quantiles and exceedance their error counts as infinite;
    bias, spread, means, largest error and reprojection error are of the other shots."""
    probability_without_answer: float = 0.0
    """Of such a shot, known from the design: at least that."""
    has_open_means: bool = False
    """Whether such shots are so probable, a billionth or more, or were drawn, that a limit of a mean or of the mean of
    the worst 5 % cannot be shown to be kept, however many shots are drawn."""


@dataclass(frozen=True, slots=True, repr=False)
class Verification(Result):
    """Monte Carlo on the full nonlinear chain."""

    schema: Literal["tailstack/verification/1"]
    seed: int
    """Seed of the trials: the same seed gives the same digits."""
    trials: int
    """Trials that were drawn."""
    method: Literal["plain", "radial"]
    """plain: every trial by itself; radial: directions, with the quantile found along each."""
    engine: str
    """The chain that computed the trials, in words."""
    precision_requested: float | None
    """Relative half-width of P95's interval that was asked for; null where a number of trials was."""
    max_trials: int | None
    """At most so many; null where their number was asked for. It sets when the precision is looked at, so the
    intervals."""
    precision_reached: float
    """Largest relative half-width of the interval of a P95, or of a quantile that is required of all shots."""
    stopping: str
    """Why it stopped, in a sentence."""
    targets: tuple[TargetEstimate, ...]
    """One entry for each target and each sample of a region."""
    reprojection: Reprojection
    """Error between measured and reprojected images."""
    first_order_ratio: float
    """First-order P95 over the sampled one at the worst target."""
    verdict: Verdict
    """Requirements held against the sampled errors."""
    provenance: Provenance
    losses: DrawnLosses | None = None
    """Shots with fiducials missed; null where the design does not say how often they are."""
    measures: tuple[MeasureResult, ...] = ()
    """Measures made of the errors at targets, each wherever it is read; empty where there are none."""

    @property
    def precision_of_p95(self) -> float:
        """Largest relative half-width of P95's interval over the targets."""
        ends = ((target.p95_mm, *target.p95_interval_mm) for target in self.targets)
        return max(((high - low) / 2 / p95 if p95 else 0.0 for p95, low, high in ends), default=0.0)

    @property
    def decimals(self) -> int:
        """Decimals of its lengths."""
        largest = max((target.p95_mm for target in self.targets), default=1.0)
        return decimals_of(self.verdict.checks, largest, self.precision_reached)

    def outline(self) -> Outline:
        """Sampled errors at the targets, with their intervals."""
        bars = tuple(
            Bar(target.name, target.p95_mm, target.p95_interval_mm, None if beyond is None else beyond.limit_mm)
            for target in self.targets
            for beyond in (target.exceedance,)
        )
        return Outline(
            "Monte Carlo check",
            self.provenance.design_name,
            self.verdict.status,
            verdict_sentence(self.verdict, self.provenance),
            (
                frame(TargetEstimate, "targets", self.targets, estimates_table(self)),
                *measures_frames(self.measures),
                checks_frame(self.verdict),
            ),
            Bars(f"P95 of the error at the tool, {self.trials:,} trials", "P95 with its interval, mm", bars),
            self.verdict.findings,
        )


def estimates_table(check: Verification, of: str = "") -> Table:
    """Monte Carlo: the error at the tool and as located, with intervals, and first order over it."""
    decimals = check.decimals
    confidence = f"{100 * check.targets[0].confidence:g} %" if check.targets else ""
    columns = (
        TARGET,
        *bias_columns(decimals),
        *norm_columns(
            decimals,
            Column("P95 from", "mm", "fixed", decimals, brief="from\nmm", of=lambda row: row[1].p95_interval_mm[0]),
            Column("P95 to", "mm", "fixed", decimals, brief="to\nmm", of=lambda row: row[1].p95_interval_mm[1]),
        ),
        Column("Worst met", "mm", "fixed", decimals, PAPER, of=lambda row: row[1].worst_mm),
        Column(
            "Beyond limit", "%", "percent", 2, brief="over the\nlimit, %",
            of=lambda row: row[1].exceedance.probability if row[1].exceedance else None,
        ),
        Column(
            "Estimate / simulated", "", "fixed", 4, IN_DETAIL, "estimate /\nsimulated",
            of=lambda row: row[1].first_order_ratio,
        ),
    )  # fmt: skip
    caption = f"Simulation (Monte Carlo){of}: the error at each target; intervals of {confidence} confidence"
    return Table("Monte Carlo", caption, columns, pair_rows(check.targets, columns))
