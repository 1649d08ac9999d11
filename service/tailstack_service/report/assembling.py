"""A report from its parts: what was computed, what is drawn of it, and how to compute it again."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from itertools import pairwise
from math import degrees
from typing import Any, Literal

import numpy as np

from tailstack.budget import BudgetEntry, lines_of
from tailstack.contributors import error_law, risk_of_units, unit_for_people
from tailstack.design import Design, design_to_data
from tailstack.geometry.arrays import Array
from tailstack.laws import Drawn, level_of
from tailstack.montecarlo import MAX_TRIALS, PRECISION
from tailstack.montecarlo.chain import run_indices
from tailstack.montecarlo.plan import ChainPlan
from tailstack.montecarlo.simulate import Progress
from tailstack.optimisation.prices import cost_of
from tailstack.propagation.linear import LinearModel
from tailstack.results import Check, Optimisation, Score, TargetScore, Verification
from tailstack.results.radiostereometry import Profile
from tailstack.results.verdicts import decisive_check
from tailstack.scoring import score as score_design
from tailstack.studies.radiostereometry import PAIRS, radiostereometry, refuse_without_bodies
from tailstack.system import System
from tailstack.tail.declared import law_quantile
from tailstack.verification import PreparedDesign, prepare, verify

from .chapters.optimisation import optimise_command
from .records import Allowance, ErrorDistribution, Report, Reproduction, headline_of, tightest_check

DEFAULT_PARTS = ("score", "verification")
BINS = 36
DRAWN = 2**17  # trials that the pictures are drawn from: the first of the check's own
PER_CALL = 2**13
PICTURED = 3  # targets, largest P95 first: a region may have hundreds


@dataclass(frozen=True, slots=True)
class ReportContents:
    """What a report holds and how its numbers are drawn."""

    parts: tuple[str, ...] = DEFAULT_PARTS
    trials: int | None = None
    precision: float | None = None
    seed: int = 0
    max_trials: int = MAX_TRIALS
    starts: int | None = None  # of the optimiser; None: as many as the design says
    profile: Profile | None = None  # chapter for a field of work
    names: tuple[str, str] | None = None  # what two designs that are compared are called


def compute_report(design: Design, options: ReportContents, *, progress: Progress | None = None) -> Report:
    """The report of a design, computed here and now.  Raises TailstackError."""
    verification = optimisation = None
    if options.profile is not None:  # before the work, and not after it
        refuse_without_bodies(design)
    if "verification" in options.parts:
        verification = verify(
            design, trials=options.trials, precision=options.precision, seed=options.seed,
            max_trials=options.max_trials, progress=progress,
        )  # fmt: skip
    if "optimisation" in options.parts:
        from tailstack.optimisation import optimise

        optimisation = optimise(design, starts=options.starts)
    return assemble(design, options, verification, optimisation)


def assemble(
    design: Design, options: ReportContents, verification: Verification | None, optimisation: Optimisation | None
) -> Report:
    """The report of what was computed; a pure function.  Raises DesignError, IllPosedError."""
    scored = score_design(design, fifty_shots=True)
    ready = prepare(design, sampled=verification is not None)
    priced = _find_prices(design, ready.system)
    pictured = sorted(scored.targets, key=lambda target: target.p95_mm, reverse=True)[:PICTURED]
    return Report(
        schema="tailstack/report/1",
        title=design.name,
        headline=headline_of(scored, verification, optimisation),
        score=scored,
        verification=verification,
        optimisation=optimisation,
        distributions=tuple(_draw(ready, target, verification, options) for target in pictured),
        allowances=tuple(
            entry
            for name in _judged_targets(scored, pictured)
            for entry in list_allowances(ready.models[name], name, scored.verdict.checks, priced)
        ),
        design=design_to_data(design),
        reproduction=_reproduction(options, verification, optimisation),
        provenance=scored.provenance if verification is None else verification.provenance,
        radiostereometry=None
        if options.profile is None
        else radiostereometry(design, seed=options.seed, pairs=0 if verification is None else PAIRS),
    )


def _judged_targets(scored: Score, pictured: list[TargetScore]) -> list[str]:
    """Names of the targets whose slack is asked for: those that are pictured, and the one that decides."""
    decisive = decisive_check(scored.verdict.checks)
    decides = [target for target in scored.targets if decisive and target.name == decisive.target]
    return list(dict.fromkeys(target.name for target in (*pictured, *decides)))


def _draw(
    ready: PreparedDesign, target: TargetScore, verification: Verification | None, options: ReportContents
) -> ErrorDistribution:
    """Shares of shots by bins at a target, as the check drew them and by the first-order law."""
    count = 0 if verification is None else min(verification.trials, DRAWN)
    norms = draw_norms(ready, target.name, options.seed, count) if count else None
    p95 = target.p95_mm if norms is None else float(np.quantile(norms, 0.95))
    edges = np.linspace(0.0, 1.45 * max(p95, target.p95_mm, 1e-9), BINS + 1)
    law = ready.law(target.name, "tcp")
    beyond = [1.0, *(law.exceedance(float(edge)) for edge in edges[1:])]
    return ErrorDistribution(
        target.name,
        tuple(float(edge) for edge in edges),
        None if norms is None else tuple(float(n) for n in np.histogram(norms, edges)[0] / len(norms)),
        tuple(max(near - far, 0.0) for near, far in pairwise(beyond)),
        None if norms is None else len(norms),
    )


def draw_norms(ready: PreparedDesign, name: str, seed: int, count: int) -> Array:
    """(count,) mm: norms of the TCP error at a target in the first trials of the check itself, at its worst vertex."""
    place = [target.name for target in ready.system.targets].index(name)

    def norms(plan: ChainPlan) -> Array:
        parts = [
            run_indices(plan, seed, first, min(PER_CALL, count - first)).norms(place, 0)
            for first in range(0, count, PER_CALL)
        ]
        return np.concatenate(parts)

    at_each = [norms(ready.plans[vertex]) for vertex in ready.vertices[name, "tcp"]]
    return max(at_each, key=lambda drawn: float(np.quantile(drawn, 0.95)))


def _reproduction(
    options: ReportContents, verification: Verification | None, optimisation: Optimisation | None
) -> Reproduction:
    drawn = "" if verification is None else drawing_options(options)
    parts = "" if options.parts == DEFAULT_PARTS else f" --parts {','.join(options.parts)}"
    starts = "" if optimisation is None or options.starts is None else f" --starts {options.starts}"
    profile = "" if options.profile is None else f" --profile {options.profile}"
    commands = [
        "tailstack report --verify THIS_FILE",
        f"tailstack report design.yaml{parts}{profile}{drawn}{starts} --format json -o out",
        "tailstack score design.yaml --json",
    ]
    if verification is not None:
        commands.append(f"tailstack verify design.yaml{drawn} --json")
    if optimisation is not None:
        commands.append(optimise_command(optimisation))
    return Reproduction(
        commands=tuple(commands),
        parts=options.parts,
        seed=None if verification is None else options.seed,
        trials=options.trials,
        precision=options.precision,
        max_trials=None if verification is None or options.trials is not None else options.max_trials,
        starts=options.starts,
        statement="The first command finds in this file all it needs. design.yaml is the field design of this record: "
        "the last section of this report, the sheet Design of the spreadsheet. The same version of tailstack gives the "
        "same digits, whatever the number of threads, workers or machines.",
        profile=options.profile,
    )


def drawing_options(options: ReportContents) -> str:
    """The options of the command line that draw the same trials."""
    if options.trials is not None:
        return f" --seed {options.seed} --trials {options.trials}"
    drawn = f" --seed {options.seed} --precision {options.precision or PRECISION:g}"
    return drawn if options.max_trials == MAX_TRIALS else f"{drawn} --max-trials {options.max_trials}"


def options_of(request: dict[str, Any]) -> ReportContents:
    """The options of a job's request, or of the reproduction of a record."""
    names = [field.name for field in fields(ReportContents)]
    stated = {name: request[name] for name in names if request.get(name) is not None}
    lists = {name: tuple(value) for name, value in stated.items() if isinstance(value, list)}
    return ReportContents(**(stated | lists))


# --- how far half-widths may go ---------------------------------------------------------------------------

FURTHEST = 1024.0  # times the half-width as it is: beyond, it has no influence worth a number


def _quantile_mm(model: LinearModel, check: Check, line: BudgetEntry, factor: float) -> float:
    """What a check limits, with the half-widths of a line of the budget ``factor`` times what they are."""
    if factor != 1.0:
        scale = np.ones(len(line.block.half_width))
        scale[list(line.sources)] = factor
        block = line.block.with_half_widths(line.block.half_width * scale)
        blocks = tuple(block if number == line.number else other for number, other in enumerate(model.blocks))
        model = replace(model, blocks=blocks)
    law = error_law(model, check.error, check.quantile)
    if check.min_yield is None:
        return law_quantile(law.law, check.quantile).quantile_mm
    level = level_of(check.risk) or Drawn.UNIT
    return risk_of_units(model, law, check.quantile, None, check.min_yield, level).value_mm


Prices = dict[tuple[str, str], tuple[float | None, float, float]]  # cost, smallest, largest, by contributor, component


def list_allowances(
    model: LinearModel, target: str, checks: tuple[Check, ...], priced: Prices
) -> tuple[Allowance, ...]:
    """How far each line of the budget with one half-width may go by itself until a limit is met, and what it costs.

    In the order of the chain.  A half-width changes neither bias nor sensitivities, so one linear model serves all.
    checks: the first-order ones.  The slack is to the requirement that decides at the target, pooled or of each unit.
    """
    tightest = tightest_check(checks, target)
    entries = []
    for line in (line for line in lines_of(model) if line.alike):  # they do not overlap
        unit, people = unit_for_people(line.block.units[line.sources[0]])
        width = float(line.block.half_width[line.sources[0]]) * people  # in the unit that people use
        status, ratio = ("no requirement", None) if tightest is None else _ratio(model, line, tightest)
        cost, smallest, largest = priced.get((line.block.contributor, line.component), (None, None, None))
        entries.append(
            Allowance(
                target=target,
                contributor=line.block.contributor,
                component=line.component,
                unit=unit,
                half_width=width,
                requirement=None if tightest is None else tightest.requirement,
                status=status,
                at_limit=None if ratio is None else width * ratio,
                slack=None if ratio is None else width * (ratio - 1),
                cost=cost,
                smallest=smallest,
                largest=largest,
                label=line.block.label,
            )
        )
    return tuple(entries)


Status = Literal["spare", "too wide", "zero is not enough", "no influence", "no requirement"]


def _ratio(model: LinearModel, line: BudgetEntry, check: Check) -> tuple[Status, float | None]:
    """By which factor on the line's half-width what the check limits is at its limit.

    Where fiducials are missed, what they add is taken to stay in proportion to the quantile of shots that miss none.
    """
    if not line.block.half_width[line.sources[0]] > 0:
        return "no influence", None
    from scipy.optimize import brentq  # a tenth of a second, of which a report without limits has no use

    limit_mm = check.limit if check.beyond is None else check.beyond
    if check.missed and check.beyond is None:
        limit_mm *= _quantile_mm(model, check, line, 1.0) / check.value

    def excess(factor: float) -> float:
        return _quantile_mm(model, check, line, factor) - limit_mm

    if excess(1.0) > 0:
        if excess(0.0) > 0:
            return "zero is not enough", None
        return "too wide", float(brentq(excess, 0.0, 1.0, xtol=1e-12))
    high = 2.0
    while excess(high) < 0:
        high *= 4
        if high > FURTHEST:
            return "no influence", None
    return "spare", float(brentq(excess, 1.0, high, xtol=1e-12))


def _find_prices(design: Design, system: System) -> Prices:
    """Of the half-widths that the optimise section sets free, in the unit of the document; none without it."""
    if design.document.optimise is None:
        return {}
    from tailstack.optimisation.request import read_request

    mounts = {mount.name: mount for mount in system.interfaces}
    priced: Prices = {}
    for free in read_request(design).problem.half_widths:
        sources = mounts[free.contributor].sources
        place = sources.names.index(free.component)
        shown = degrees if sources.units[place] == "rad" else float
        cost = cost_of(free.price, float(sources.half_width[place]))
        known = cost if np.isfinite(cost) else None
        priced[free.contributor, free.component] = known, shown(free.minimum), shown(free.maximum)
    return priced
