"""The answer of the optimiser."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import dist
from operator import attrgetter, itemgetter
from typing import Literal

from .digits import count_decimals, decimals_of, length
from .global_bound import GlobalBound, Relaxation
from .outline import Bar, Bars, Outline, checks_frame, frame, verdict_sentence
from .record import Result
from .tables import EVERYWHERE, PAPER, TERMINAL, Column, On, Table, fill, tabulate
from .verdicts import Check, Finding, Provenance, Vector3
from .verification import TargetEstimate, Verification


@dataclass(frozen=True, slots=True)
class MovedFiducial:
    """A fiducial that could move; ``before_mm`` is None for one that is new, ``after_mm`` for one left out."""

    label: str
    """Label of the fiducial."""
    before_mm: Vector3 | None
    """Position before, con, mm; null for one that is new."""
    after_mm: Vector3 | None
    """Position after, con, mm; null for one that was left out."""


@dataclass(frozen=True, slots=True)
class ChangedTolerance:
    """A half-width that was free.  ``at_target_*_mm``: what it moves the worst target by, half-width times lever."""

    contributor: str
    """structure_connector or connector_flange."""
    component: str
    """rx ... tz, the name of a locator, or what features state, with commas between what is made alike."""
    label: str
    """What the document calls the interface, and the component."""
    unit: str
    """Unit of the half-widths: deg or mm."""
    before_half_width: float
    """Half-width before, in `unit`."""
    after_half_width: float
    """Half-width after, in `unit`."""
    at_target_before_mm: float
    """What the half-width before moves the worst target by, half-width times lever, mm."""
    at_target_mm: float
    """What the half-width after moves the worst target by, mm."""
    cost_before: float | None
    """Cost of the half-width before, in the unit of the design's prices; null: it has no price (zero, or tighter than
    every grade)."""
    cost_after: float
    """Cost of the half-width after, in the unit of the design's prices."""
    grade: str | None
    """Process grade, or value of a drawing, that was chosen from a table; null without a table."""
    before_drawn: str | None = None
    """Of a value of a drawing what it was, `H7/g6` or `0.02`; half-widths are those of a uniform law of its spread
    then. null: of others."""


@dataclass(frozen=True, slots=True)
class MovedPivot:
    """A pivot that was free."""

    contributor: str
    """structure_connector or connector_flange."""
    label: str
    """What the document calls the interface."""
    before_mm: Vector3
    """Pivot before, con, mm."""
    after_mm: Vector3
    """Pivot after, con, mm."""


@dataclass(frozen=True, slots=True)
class AimedView:
    """A view that was free to be aimed otherwise, or that was added: what it was before is then that of its model."""

    view: str
    """Name of the view."""
    turn_deg: float
    """Angle between its beam before and after, deg."""
    beam_direction_before: Vector3
    """From the source to the detector, in con, as it was."""
    beam_direction: Vector3
    """The same in the new design."""
    source_isocentre_before_mm: float
    """From the source to the isocentre as it was, mm."""
    source_isocentre_mm: float
    """The same in the new design, mm."""


@dataclass(frozen=True, slots=True)
class ViewSearch:
    """Where views were free: what became of them, and what that rests on."""

    views: tuple[AimedView, ...]
    """The views that were free."""
    scored: int
    """Ways to aim them that were scored with everything else as it was."""
    solved: int
    """Ways to aim them at which everything else was optimised."""
    refused: int
    """How many of these gave no design: what they hide, or a limit out of reach."""
    objective_as_aimed: float | None
    """Objective by the closed form with the views as they were; null: no design there, they may not stay so, or one was
    added."""
    objective: float
    """Objective by the closed form with the views of the new design."""
    sentence: str
    """The same in words, and that it is the best of what was tried."""


@dataclass(frozen=True, slots=True)
class ViewOffer:
    """A view that could be added at a price: the cheapest designs with it and without it, both verified."""

    view: str
    """Name of the view."""
    like: str
    """The view that it is a copy of, but for its direction and distance."""
    price: float
    """What it costs."""
    added: bool
    """Whether the new design has it."""
    cost_without: float | None
    """Least cost found without it; null: no design keeps the limits, or none was found."""
    cost_with: float | None
    """Least cost found with it, its price not included; null as above."""
    worth: float | None
    """The price below which it pays: what it saves; null where one of the costs is."""
    beam_direction: Vector3 | None
    """From its source to its detector, in con, where it was aimed best; null without a design with it."""
    up_direction: Vector3 | None
    """The direction in con that is up in its image then."""
    source_isocentre_mm: float | None
    """From its source to its isocentre then, mm."""
    p95_without_mm: float | None
    """First-order P95 of the worst target of the design as it stood, mm; null: its layout does not determine it."""
    p95_with_mm: float | None
    """The same with this view so aimed and all else as it stood, mm; null without such a view."""
    sentence: str
    """What was decided, and why."""


@dataclass(frozen=True, slots=True)
class ShadowPrice:
    """What one unit of a limit or bound is worth, from the multipliers: a derivative, good for small steps."""

    name: str
    """The limit or bound."""
    unit: str
    """Unit of the limit or bound."""
    cost_per_unit: float
    """Change of the objective for one unit more: of cost, or of mm of the quantile where that is minimised."""
    sentence: str
    """The same as a sentence."""


@dataclass(frozen=True, slots=True)
class LocalOptimum:
    """A distinct optimum among the starts, by the closed form that ranks them."""

    objective: float
    """Its objective by the closed form: cost, or the largest quantile over its limit."""
    starts: int
    """How many starts ended there."""
    first_start: int
    """Number of the first of them."""
    rms_distance_mm: float
    """RMS distance of its fiducials from those of the best one, matched to the nearest, mm."""


@dataclass(frozen=True, slots=True)
class Certificate:
    """What the optimum rests on."""

    kkt_residual: float
    """Residual of the optimality conditions of the programme with the exact law, recomputed from the multipliers,
    relative."""
    starts: int
    """Starts of the search."""
    converged_starts: int
    """Those that came to an optimum."""
    best_costs: tuple[float, ...]
    """Distinct optima, ascending, by the closed form: costs, or objectives where no cost is minimised."""
    optima: tuple[LocalOptimum, ...]
    """The distinct optima among the starts."""
    relaxation: Relaxation
    """A lower bound of the cost, where there is one."""
    seed: int
    """Seed of the starts; the check draws with one that follows from it."""
    tightening_rounds: int
    """How often the limit was tightened until the check passed."""
    stopped: str
    """Why the search ended, in a sentence."""
    verification: Verification
    """Monte Carlo check of the new design, with a fresh seed."""
    global_bound: GlobalBound | None = None
    """How good any layout could be at these half-widths; null in an answer of an older version."""
    cheapest: Relaxation | None = None
    """How cheap any layout could be, with whatever half-widths: a lower bound of the cost over all that was asked for;
    null in an answer of an older version."""
    gap: float | None = None
    """How near to what no layout undercuts was to be near enough, relative; null: every start was to be solved."""


@dataclass(frozen=True, slots=True)
class SurvivedLoss:
    """What was asked for when fiducials are lost, and the worst loss of the new design."""

    limit_mm: float
    """Limit of P95 of the error at the tool after a loss, mm."""
    lost: tuple[str, ...]
    """Labels of the fiducials whose loss is worst."""
    target: str
    """Target at which it is."""
    estimate_mm: float
    """P95 there without them, by estimate, mm."""
    p95_mm: float
    """The same by Monte Carlo, with a fresh seed, mm."""
    interval_mm: tuple[float, float | None]
    """Where that lies, mm; the upper end null where it is not known."""
    trials: int
    """Trials of the check."""


@dataclass(frozen=True, slots=True)
class FrontPoint:
    """One limit of the front of cost and limit; with a design that was verified like the one returned, or without.

    Every requirement's limit is scaled by the same factor; limit, quantile and upper limit are those of the first that
    is in mm.
    """

    factor: float
    """Factor on the limit of every requirement."""
    limit_mm: float
    """The first requirement's limit so scaled, mm."""
    status: Literal["verified", "dominated", "out of reach", "not tried"]
    """verified: checked by Monte Carlo; dominated: another point costs no more at a tighter limit; out of reach: no
    design keeps it; not tried."""
    note: str
    """Why there is no design, or what costs less."""
    cost: float | None
    """Cost of the design; null without one."""
    quantile_mm: float | None
    """Largest first-order quantile over the first requirement's targets, mm; null without a design."""
    verified_upper_mm: float | None
    """Largest upper confidence limit of the check, mm; null without one."""
    half_widths: tuple[float, ...]
    """Half-widths, in the order and units of `tolerances`."""
    pivots_mm: tuple[Vector3, ...]
    """Pivots, con, mm, in the order of `pivots`."""
    fiducials_mm: tuple[Vector3, ...]
    """Fiducials, con, mm."""


@dataclass(frozen=True, slots=True)
class CountTried:
    """The best design with so many fiducials, by the closed form."""

    fiducials: int
    """How many fiducials."""
    cost: float | None
    """Cost, fiducials included; null: nothing feasible was found."""
    worst_ratio: float | None
    """Largest quantile over its limit; null: nothing feasible was found."""
    note: str
    """What happened, where there is no cost."""


@dataclass(frozen=True, slots=True)
class MoveValue:
    """What it buys to move one fiducial, or one group of a symmetry, and no other."""

    label: str
    """Label of the fiducial; of a group all of them."""
    objective: float | None
    """Objective with it alone moved and everything else optimised; null: what is asked for cannot be kept so."""


@dataclass(frozen=True, slots=True)
class MovesValue:
    """What moving fiducials buys beyond leaving them where they are, everything else optimised alike.

    Objectives are by the closed form: the cost, or the largest quantile over its limit; what moving costs is in them.
    """

    objective_left: float | None
    """Objective with all fiducials where they stand; null: what is asked for cannot be kept so."""
    objective_moved: float
    """Objective with all of them where the new design has them."""
    alone: tuple[MoveValue, ...]
    """Each moved alone; empty where that was not asked for, and where moving buys next to nothing, or everything."""
    needed: tuple[str, ...]
    """The fewest found whose moves keep nine tenths of what all buy; empty likewise."""
    kept_fraction: float | None
    """The part that they keep; null without them."""
    evaluations: int
    """Optima that were solved for to find that."""
    sentence: str
    """The same as a sentence."""


@dataclass(frozen=True, slots=True, repr=False)
class Optimisation(Result):
    """A design that keeps its limit at least cost (or what was asked for), verified by Monte Carlo.

    ``status``: what was asked for is verified.  The check in the certificate judges all of the design's requirements,
    those that ``optimise.requirement`` left out among them, and ``verdict_status`` is that of all.
    """

    schema: Literal["tailstack/optimisation/1"]
    status: Literal["verified"]
    """The new design keeps what was asked for by its Monte Carlo check; what does not is refused, not answered."""
    objective: str
    """What was minimised, in a sentence."""
    cost_before: float | None
    """Cost of the design as it stood, in the unit of its prices; null: some of it has no price."""
    cost_after: float
    """Cost of the new design, that of a view that was added included."""
    cost_closed_form: float | None
    """Cost of the half-widths, and of moving where that has a price, by the smooth closed form that drives the search;
    null where no cost is minimised."""
    cost_exact_law: float | None
    """Cost of the optimum by the exact law at the limit itself, before the check's margin, what fiducials and a view
    that was added cost included; null where no cost is minimised."""
    p95_before_mm: float | None
    """First-order P95 of the worst target before, mm; null: the layout as it stood does not determine it."""
    p95_after_mm: float
    """First-order P95 of the worst target after, mm; the check has the simulated one."""
    moved: tuple[MovedFiducial, ...]
    """Fiducials that could move."""
    tolerances: tuple[ChangedTolerance, ...]
    """Half-widths that were free."""
    pivots: tuple[MovedPivot, ...]
    """Pivots that were free."""
    scaling: float | None
    """Objective scaling: the common factor on all half-widths; otherwise null."""
    certificate: Certificate
    """What the optimum rests on."""
    shadow_prices: tuple[ShadowPrice, ...]
    """What one unit of each limit and bound is worth."""
    binding: tuple[str, ...]
    """Limits and bounds that hold the optimum where it is."""
    influence: tuple[Finding, ...]
    """What the free variables can and cannot do, known before solving."""
    counts: tuple[CountTried, ...]
    """The numbers of fiducials that were tried; empty where it was given."""
    front: tuple[FrontPoint, ...]
    """Points of the front of cost and limit; empty unless asked for."""
    design_before: dict[str, object]
    """The design document that it started from, complete."""
    design: dict[str, object]
    """The new design document, complete."""
    provenance: Provenance
    """Which design (the new one), by which version, under which model, and what is not included."""
    survived: SurvivedLoss | None = None
    """The worst loss of so many fiducials as `optimise.survive` says; null where that was not asked for."""
    not_asked: tuple[str, ...] = ()
    """Requirements that `optimise.requirement` left out; the check judges them all the same."""
    verdict_status: Literal["pass", "fail", "inconclusive", "no requirement"] = "pass"
    """Of all requirements of the new design, asked for or not: that of the check's verdict."""
    aimed: ViewSearch | None = None
    """How the views of `optimise.views` were aimed; null where none was free. All else holds for the views so aimed."""
    view_offer: ViewOffer | None = None
    """What became of a view that `optimise.views` may add at a price; null where it names none."""
    moves: MovesValue | None = None
    """What moving fiducials buys; null where none moved or their number changed, and with grades."""
    cost_of_moves: float = 0.0
    """The part of `cost_after` that moving fiducials costs by `optimise.stay`; 0 where that asks no price."""
    as_it_stood: str = ""
    """Where the design as it stood lies outside of what was asked for, by how much and what that changes; or why it is
    no answer although it has less of what was minimised; or that it is kept. Empty: a better one was found."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "verdict_status", self.certificate.verification.verdict.status)

    @property
    def worst_target(self) -> TargetEstimate:
        """Of the targets of what was asked for, the one with the largest P95 by the check."""
        check = self.certificate.verification
        named = {entry.target for entry in check.verdict.checks if entry.requirement not in self.not_asked}
        asked = [target for target in check.targets if target.name in named] or check.targets
        return max(asked, key=lambda target: target.p95_mm)

    @property
    def others(self) -> tuple[Check, ...]:
        """What was not asked for, as the check judged it."""
        checks = self.certificate.verification.verdict.checks
        return tuple(check for check in checks if check.requirement in self.not_asked)

    def outline(self) -> Outline:
        """What changed, what it costs, and what the check says of the new design."""
        verdict = self.certificate.verification.verdict
        bars = [Bar(entry.label, entry.at_target_mm, before=entry.at_target_before_mm) for entry in self.tolerances]
        chart = Bars("What each half-width moves the worst target by", "half-width times lever, mm", tuple(bars))
        if not bars:
            bar = Bar("worst target", self.p95_after_mm, before=self.p95_before_mm)
            chart = Bars("P95 of the worst target", "P95, mm", (bar,))
        return Outline(
            "Optimised design",
            self.provenance.design_name,
            self.verdict_status,
            f"{self._cost_sentence()} {verdict_sentence(verdict, self.provenance)}",
            (
                frame(ChangedTolerance, "tolerances", self.tolerances, changes_table(self.tolerances)),
                checks_frame(verdict),
                frame(MovedFiducial, "fiducials", self.moved, moved_table(self)),
                frame(ShadowPrice, "limits", self.shadow_prices, limits_table(self)),
                frame(FrontPoint, "front", self.front),
            ),
            chart,
            (*self.influence, *verdict.findings),
        )

    def _cost_sentence(self) -> str:
        """What it costs, against what the design as it stood did."""
        decimals = decimals_of(self.certificate.verification.verdict.checks)
        p95 = f"By estimate, P95 of the worst target is {length(self.p95_after_mm, decimals)} mm"
        p95 += "." if self.p95_before_mm is None else f", before {length(self.p95_before_mm, decimals)} mm."
        before = "" if self.cost_before is None else f", before {self.cost_before:.4g}"
        stood = f"{self.as_it_stood} " if self.as_it_stood else ""
        return f"{stood}Cost {self.cost_after:.4g}{before}. {p95}"


# --- tables ---------------------------------------------------------------------------------------------------


def changes_table(tolerances: Sequence[ChangedTolerance]) -> Table:
    """Half-widths that were free, what they move the target by, and what they cost."""
    graded = any(entry.grade is not None for entry in tolerances)
    drawn = any(entry.before_drawn is not None for entry in tolerances)
    columns = (
        Column("Tolerance", of=attrgetter("label")),
        *((Column("Drawn", of=attrgetter("before_drawn")),) if drawn else ()),
        *((Column("Becomes" if drawn else "Grade", of=attrgetter("grade")),) if graded else ()),
        Column("Unit", kind="unit", of=attrgetter("unit")),
        Column("Before", "unit", "significant", brief="±\nbefore", of=attrgetter("before_half_width")),
        Column("After", "unit", "significant", brief="±\nafter", of=attrgetter("after_half_width")),
        Column(
            "At target, before", "mm", "fixed", on=EVERYWHERE & ~On.PLAIN, brief="moves the tool\nbefore, mm",
            of=attrgetter("at_target_before_mm"),
        ),
        Column("At target, after", "mm", "fixed", brief="moves the tool\nafter, mm", of=attrgetter("at_target_mm")),
        Column("Cost before", "", "significant", 4, brief="cost\nbefore", of=attrgetter("cost_before")),
        Column("Cost after", "", "significant", 4, brief="cost\nafter", of=attrgetter("cost_after")),
    )  # fmt: skip
    return tabulate("Tolerances", "Tolerances that were free, as half-widths", columns, tolerances)


Move = MovedFiducial | MovedPivot  # a place before and after


def _position_columns(what: str, brief: str, gone: str = "") -> tuple[Column, ...]:
    """Label, place before, place after, and how far that is, of a :data:`Move`."""

    def coordinate(when: str, k: int) -> Column:
        def read(entry: Move) -> float | None:
            place: Vector3 | None = getattr(entry, f"{when}_mm")
            return None if place is None else place[k]

        head = f"{when}\nx, mm" if k == 0 else f"\n{'xyz'[k]}, mm"
        return Column(f"{when.capitalize()} {'xyz'[k]}", "mm", "fixed", 2, brief=head, of=read)

    return (
        Column(what, brief=brief, of=attrgetter("label")),
        *(coordinate(when, k) for when in ("before", "after") for k in range(3)),
        Column("Moved", "mm", "fixed", 2, TERMINAL, "moved\nmm", of=lambda entry: _way(entry, gone)),
    )


def _way(entry: Move, gone: str) -> float | str:
    if entry.before_mm is None:
        return "new"
    return gone if entry.after_mm is None else dist(entry.after_mm, entry.before_mm)


def _positions(name: str, caption: str, columns: tuple[Column, ...], entries: Sequence[Move], note: str = "") -> Table:
    """A terminal has those that moved."""
    rows = [fill(columns, each, on=EVERYWHERE if each.before_mm != each.after_mm else ~TERMINAL) for each in entries]
    return Table(name, caption, columns, tuple(rows), note)


def moved_table(optimisation: Optimisation) -> Table:
    """Fiducials that could move, are new or were left out."""
    columns = _position_columns("Fiducial", "fiducial,\nin con", "left out")
    note = "Before empty: new; after empty: left out."
    return _positions("Fiducials", "Fiducials that could move, frame con", columns, optimisation.moved, note)


def alone_table(moves: MovesValue) -> Table:
    """What each move buys alone."""
    left = moves.objective_left

    def share(entry: MoveValue) -> float | None:
        if left is None or entry.objective is None:
            return None
        return (left - entry.objective) / (left - moves.objective_moved)

    columns = (
        Column("Fiducial", of=attrgetter("label")),
        Column("Objective, moved alone", "", "significant", 4, of=attrgetter("objective")),
        Column("Of what all moves buy", "%", "percent", 0, of=share),
        Column("Among the fewest", of=lambda entry: "yes" if entry.label in moves.needed else ""),
    )
    return tabulate("Moves", "What each move buys alone", columns, moves.alone)


def pivots_table(optimisation: Optimisation) -> Table:
    """Pivots that could move."""
    columns = _position_columns("Interface", "pivot,\nin con")
    return _positions("Pivots", "Pivots that could move, frame con", columns, optimisation.pivots)


def offer_table(offer: ViewOffer) -> Table:
    """The design without and with the view that could be had for a price."""
    with_it = (f"with {offer.view}", offer.cost_with, offer.price, offer.p95_with_mm)
    columns = (
        Column("Design", of=itemgetter(0)),
        Column("Cost", "", "significant", 4, of=itemgetter(1)),
        Column("Price of the view", "", "significant", 4, of=itemgetter(2)),
        Column("In all", "", "significant", 4, of=lambda row: None if row[1] is None else row[1] + row[2]),
        Column("P95 as it stood", "mm", "fixed", of=itemgetter(3)),
    )
    rows = ((f"without {offer.view}", offer.cost_without, 0.0, offer.p95_without_mm), with_it)
    return tabulate("A view more", "The view that could be added", columns, rows, offer.sentence)


def aims_table(aimed: ViewSearch) -> Table:
    """Views that could be turned."""

    def beam(k: int) -> Callable[[AimedView], float]:
        return lambda entry: entry.beam_direction[k]

    columns = (
        Column("View", of=attrgetter("view")),
        Column("Turned by", "deg", "fixed", 1, of=attrgetter("turn_deg")),
        *(Column(f"Beam {axis}", "", "fixed", of=beam(k)) for k, axis in enumerate("xyz")),
        Column("Source to isocentre, before", "mm", "fixed", 1, of=attrgetter("source_isocentre_before_mm")),
        Column("After", "mm", "fixed", 1, of=attrgetter("source_isocentre_mm")),
    )
    return tabulate("Views", "Views that could be aimed", columns, aimed.views, aimed.sentence)


def limits_table(optimisation: Optimisation) -> Table:
    """What giving way at a limit or bound would save."""
    columns = (
        Column("Limit or bound", on=PAPER, of=attrgetter("name")),
        Column("Unit", kind="unit", on=PAPER, of=attrgetter("unit")),
        Column("Change", "per unit", "significant", 4, PAPER, of=attrgetter("cost_per_unit")),
        Column("In words", of=attrgetter("sentence")),
    )
    caption = "What one unit more of a limit or bound changes"
    return tabulate("Shadow prices", caption, columns, optimisation.shadow_prices)


def counts_table(optimisation: Optimisation) -> Table:
    """The best design with each number of fiducials that was tried."""
    cost = Column("Cost", "", "significant", 4, of=attrgetter("cost"))
    over = Column("Error over limit", "", "significant", 4, brief="error over\nlimit", of=attrgetter("worst_ratio"))
    columns = (
        Column("Fiducials", of=lambda entry: str(entry.fiducials)),
        Column("", of=attrgetter("note")),
        *((cost,) if any(entry.cost is not None for entry in optimisation.counts) else ()),
        *((over,) if any(entry.worst_ratio is not None for entry in optimisation.counts) else ()),
    )
    return tabulate("Counts", "The best design with each number of fiducials", columns, optimisation.counts)


def front_table(optimisation: Optimisation) -> Table:
    """Least cost at a row of limits."""
    decimals = max((count_decimals(point.limit_mm) for point in optimisation.front), default=3)
    columns = (
        Column("Limit", "mm", "stated", decimals, of=attrgetter("limit_mm")),
        Column("Cost", "", "significant", 4, of=attrgetter("cost")),
        Column("Estimate", "mm", "fixed", decimals, of=attrgetter("quantile_mm")),
        Column("Simulated, at most", "mm", "fixed", decimals, brief="simulated, at\nmost, mm", of=attrgetter(
            "verified_upper_mm"
        )),
        Column("Status", brief="\n", of=attrgetter("status")),
    )  # fmt: skip
    return tabulate("Front", "Least cost at a row of limits", columns, optimisation.front)


MOST_OPTIMA = 5


def optima_table(optimisation: Optimisation) -> Table:
    """The best of the optima that searches ended in."""
    columns = (
        Column("Objective", "", "significant", 5, of=attrgetter("objective")),
        Column("Starts", kind="whole", of=attrgetter("starts")),
        Column("First start", kind="whole", brief="first\nstart", of=attrgetter("first_start")),
        Column(
            "Fiducials from the best, rms", "mm", "fixed", 2, brief="fiducials from\nthe best, rms mm",
            of=attrgetter("rms_distance_mm"),
        ),
    )  # fmt: skip
    return tabulate("Optima", "Distinct optima", columns, optimisation.certificate.optima[:MOST_OPTIMA])
