"""The chapters of a first-order score."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from math import hypot, inf, sqrt
from operator import attrgetter
from typing import NamedTuple

from tailstack.measures import MEASURE
from tailstack.results import (
    ERRORS,
    Check,
    FiducialWorth,
    Lever,
    Score,
    TargetCovariance,
    TargetEstimate,
    TargetScore,
    Verification,
)
from tailstack.results import headline_of as headline_words
from tailstack.results.digits import decimal, in_percent, length, percent, signed_decimal
from tailstack.results.quality import quality_table
from tailstack.results.score import SHOTS, BudgetLine, FiftyShots, budget_table, heading_of, targets_table, views_table
from tailstack.results.score import group as group_lines
from tailstack.results.tables import (
    EVERYWHERE,
    IN_DETAIL,
    PAPER,
    TERMINAL,
    Cell,
    Column,
    On,
    Row,
    Table,
    fill,
    tabulate,
)
from tailstack.results.verdicts import (
    P95,
    UNBOUNDED,
    breaches_table,
    decisive_check,
    is_of_all_shots,
    measures_table,
    name_basis,
    requirements_table,
    shares_table,
    what_is_limited,
)

from ...rendering.document import (
    Block,
    BlockGroup,
    Bullets,
    ChangeableNumber,
    Document,
    Facts,
    Figure,
    Formula,
    KeyNumber,
    Paragraph,
    Section,
    compose_document,
    group,
    say,
    tone_of,
    verdict_blocks,
)
from ...rendering.sentences import (
    LOCATED,
    bias_sentence,
    decision_sentence,
    ending_of,
    error_at,
    losses_sentence,
    margin_sentence,
    sources_of,
    trust_sentence,
    units_sentence,
    views_sentence,
)
from ..charts import PHONE, draw_dots, draw_levers, draw_scale, draw_shares
from ..records import Allowance, Headline, headline_of, tightest_check

MOST_LOSSES, MOST_SLIPS = 3, 8  # without details
DETAILED = 3  # targets whose budget has pictures and a table of its own, largest P95 first


def score_document(score: Score, sha256: str, target: str | None = None) -> Document:
    """A score by itself: no picture of the layout, which is not in its record.

    target: whose budget a terminal has; None: the one with the largest P95.
    """
    headline = headline_of(score, None)
    chosen = score.worst_target if target is None else next(each for each in score.targets if each.name == target)
    return compose_document(
        score,
        sha256,
        (
            Section("Error and requirements", error_blocks(score)),
            Section("Budget", (group(*budget_blocks(score), on=PAPER), _chosen_budget(score, chosen))),
            Section("What each lever can reach", levers_blocks(score)),
            Section("In words", _sentences(score, chosen), on=TERMINAL),
            Section("Slips of images", reliability_blocks(score)),
            Section("Fiducials", worth_blocks(score)),
            Section("Between targets", covariance_blocks(score)),
            Section("How good the estimate is", _trust(score, chosen), on=TERMINAL),
            Section("Method and assumptions", method_blocks(score), on=PAPER, reader="auditor"),
        ),
        "tailstack score design.yaml --json",
        "With the design of the hash named above.",
        kind="Estimated error",
        tone=tone_of(headline.status),
        status=headline.status,
        sentence=headline.sentence,
        numbers=(*key_numbers(headline, score.decimals), units_number(score, headline.target)),
        matters=headline.matters,
        figures=(headline_figure(headline, score.targets, score.decimals),),
        requirements=requirements_table(score.verdict),
        question="Estimate of the error; `tailstack verify` checks it by simulation.",
        method="first order",
        opening=(decision_sentence(score.verdict) or headline.sentence, *_margin(score)),
        findings=score.verdict.findings,
        ending=ending_of(score.verdict, score.provenance),
    )


def _margin(score: Score) -> tuple[str, ...]:
    """What is left to the limit of the requirement that decides, and what brings most."""
    decisive = decisive_check(score.verdict.checks)
    if decisive is None or decisive.open_because == UNBOUNDED:  # which is the opening's last sentence
        return ()
    target = next((entry for entry in score.targets if entry.name == decisive.target), None)
    if target is None:  # what decides joins several, and the budget is of one
        return (margin_sentence(decisive, (), score.decimals),)
    if biased := bias_sentence(target, decisive.error, score.decimals):
        return biased, margin_sentence(decisive, (), score.decimals)
    return (margin_sentence(decisive, sources_of(target, decisive.error), score.decimals),)


def _chosen_budget(score: Score, target: TargetScore) -> BlockGroup:
    count = len(score.targets)
    others = f" (of {count} targets; --target NAME shows another)" if count > 1 else ""
    missed = " where no fiducial is missed" if is_of_all_shots(score.verdict) else ""
    return group(
        Paragraph(
            f", P95 {length(target.budget_p95_mm, score.decimals)} mm{missed}{others}",
            f"Where the error at target {target.name} comes from",
        ),
        budget_table(target, score.decimals),
        say("without a law, at their worst ends", ", ".join(target.worst_vertex)),
        on=TERMINAL,
    )


def _sentences(score: Score, target: TargetScore) -> tuple[Block, ...]:
    """What a terminal says below the budget of a target."""
    decimals = score.decimals
    losses = [losses_sentence(line, score.verdict.checks) for line in score.losses]
    lost = "if fiducials are lost"
    return (
        group(Facts("Law", tuple(_law(target, decimals))), on=On.DETAIL),
        say("unit by unit", units_sentence(target, decimals)),
        say(lost, *losses[:MOST_LOSSES], on=On.PLAIN),
        say(lost, *losses, on=On.DETAIL),
    )


def _trust(score: Score, target: TargetScore) -> tuple[Block, ...]:
    """The second order, and how far first order can be trusted."""
    validity = score.validity
    return (
        say("second order", *second_order(target, score.decimals)),
        say("how good it is", f"{trust_sentence(validity)}.", on=On.PLAIN),
        say("linearisation", f"{validity.status}. {validity.statement}", on=On.DETAIL),
    )


def _law(target: TargetScore, decimals: int) -> Iterator[tuple[str, str]]:
    """The law that the quantile rests on, and what it would be under others."""
    bounds = target.bounds_mm
    yield (
        "law",
        f"{target.law}. The same mean and covariance allow a P95 of {length(bounds.gaussian, decimals)} mm if "
        f"Gaussian, at most {length(bounds.unimodal, decimals)} mm for any symmetric unimodal law, "
        f"{length(bounds.moments, decimals)} mm for any law.",
    )
    error = target.per_unit.yield_standard_error
    if error is not None:
        yield "per unit", f"standard error of the fraction of units {percent(error, 2)} %"
    whole = bounds.gaussian
    if whole and abs(target.block_diagonal_p95_mm / whole - 1) > 1e-4:
        yield (
            "for comparison",
            f"as a Gaussian law, P95 would be {target.block_diagonal_p95_mm:.4f} mm with the covariance between views "
            f"left out (Eq 16) and is {whole:.4f} mm with it.",
        )


def second_order(target: TargetScore, decimals: int) -> tuple[str, ...]:
    """What the second order adds, where it was asked for."""
    second = target.second_order
    if second.status == "not requested":
        return ()
    outcome = "refused" if second.status == "refused" else f"P95 {decimal(second.p95_mm, decimals)} mm"
    return (f"{outcome}. {second.reason}",)


def reliability_blocks(score: Score) -> tuple[Block, ...]:
    if not score.reliability:
        return ()
    columns = (
        Column("Fiducial that slips", brief="fiducial\nthat slips", of=attrgetter("fiducial")),
        Column("In view", brief="in view\n", of=attrgetter("view")),
        Column("Noticed from", "px", "fixed", 2, brief="noticed\nfrom, px", of=attrgetter("slip_px")),
        Column("Does up to", "mm", "fixed", score.decimals, brief="does up\nto, mm", of=attrgetter("effect_mm")),
        Column("At target", brief="at target\n", of=attrgetter("target")),
    )
    rows = tuple(
        fill(columns, item, on=EVERYWHERE if k < MOST_SLIPS else ~On.PLAIN) for k, item in enumerate(score.reliability)
    )
    note = (
        "Noticed by a test of the residuals at a level of 0.1 %, in 80 % of cases; a smaller slip does up to as much, "
        "unseen. - stands for a slip that never is noticed."
    )
    caption = "Slips of single images that do most before they are noticed"
    return (group(Table("Reliability", caption, columns, rows), Paragraph(note)),)


def covariance_blocks(score: Score) -> tuple[Block, ...]:
    """What the errors at every two targets have in common: correlations, and in full on sheets."""
    if not score.covariances:
        return ()
    std = {target.name: target.std_mm for target in score.targets}
    alike = not is_of_all_shots(score.verdict)  # deviations and covariances are of the same shots

    def correlation(k: int, of: TargetCovariance) -> float | None:
        both = std[of.first][k] * std[of.second][k]
        return of.tcp_mm2[k][k] / both if both and alike else None

    def entry(i: int, j: int, of: TargetCovariance) -> float:
        return of.tcp_mm2[i][j]

    columns = (
        Column("First", of=attrgetter("first")),
        Column("Second", of=attrgetter("second")),
        *(Column(f"Correlation of {axis}", "", "fixed", 3, brief=f"correlation\nof {axis}", of=partial(correlation, k))
          for k, axis in enumerate("xyz")),
        *(Column(f"Covariance {a} {b}", "mm^2", "significant", on=IN_DETAIL, brief=f"{a} {b}\nmm^2",
                 of=partial(entry, i, j)) for i, a in enumerate("xyz") for j, b in enumerate("xyz")),
    )  # fmt: skip
    note = (
        "Of the errors at the tool, in tcp, by estimate, a letter for the first target before that of the second. They "
        "have all in common but the noise of their own images. As located, in con, they stand in the record."
    )
    caption = "What the errors at every two targets have in common"
    table = tabulate("Between targets", caption, columns, score.covariances)
    return (group(table, Paragraph(note)),)


def worth_blocks(score: Score) -> tuple[Block, ...]:
    """Which way each fiducial makes what decides smaller, and what it comes to without it, the worst loss first."""
    if not score.fiducials:
        return ()
    headline, decimals = headline_of(score, None), score.decimals
    rows = sorted(score.fiducials, key=lambda each: -inf if each.value_without is None else -each.value_without)

    def way(k: int, of: FiducialWorth) -> float | None:
        return -of.slope[k] / hypot(*of.slope) if of.slope and any(of.slope) else None

    columns = (
        Column("Fiducial", of=attrgetter("fiducial")),
        *(Column(f"Better along {axis}", "", "fixed", 2, brief=f"better\nalong {axis}", of=partial(way, k))
          for k, axis in enumerate("xyz")),
        Column("Saves", f"{headline.unit}/mm", "significant", brief=f"saves\n{headline.unit}/mm",
               of=lambda each: each.slope and hypot(*each.slope)),
        Column("Without it", headline.unit, "fixed", decimals, brief=f"without\nit, {headline.unit}",
               of=attrgetter("value_without")),
    )  # fmt: skip
    why = "; ".join(dict.fromkeys(each.why for each in score.fiducials if each.why))
    note = (
        "Better: the direction, in con, in which the value falls most for each mm that the fiducial moves, and by how "
        f"much at first. {f'Not known (-): {why}.' if why else ''}"
    )
    value = f"{length(headline.value, decimals)} {headline.unit}"
    caption = f"What moving and losing each fiducial does to {headline.headline}, {value}"
    return (group(Table("Fiducials", caption, columns, tuple(fill(columns, row) for row in rows)), Paragraph(note)),)


def key_numbers(headline: Headline, decimals: int) -> tuple[KeyNumber, ...]:
    """What decides, its limit and the margin, in large type."""
    low, high = headline.interval
    end = "unknown" if high is None else length(high, decimals)
    unit = headline.unit
    ends = f"{length(low, decimals)} to {end} {unit}, {name_basis(headline.basis)}"
    error = "the error" if headline.error == "tcp" else ERRORS[headline.error]
    label = f"{headline.headline} of {error}" if headline.min_yield is None else headline.headline
    numbers = [KeyNumber(label, f"{length(headline.value, decimals)} {unit}", ends)]
    if headline.limit is None:
        return (*numbers, KeyNumber("Limit", "none", "no requirement is stated"))
    what = f"{headline.requirement}, target {headline.target}"
    numbers.append(KeyNumber("Limit", f"{headline.limit:g} {unit}", what))
    margin = headline.margin
    if margin is None:
        return (*numbers, KeyNumber("Margin", "not known", "the interval has no upper end"))
    share = in_percent(abs(margin) / headline.limit)
    detail = f"{share} of the limit is left above the interval" if margin >= 0 else f"the interval ends {share} beyond"
    return (*numbers, KeyNumber("Margin", f"{signed_decimal(margin, decimals)} {unit}".replace("-", "−"), detail))


def units_number(score: Score, name: str) -> KeyNumber:
    """How many installed units keep the limit in their own shots; without one, what most of them keep."""
    target = next((entry for entry in score.targets if entry.name == name), score.worst_target)
    unit, decimals = target.per_unit, score.decimals
    value = unit.p95_of_units_mm if unit.value_mm is None else unit.value_mm
    shots = f"{100 * unit.quantile:.6g} % of their own shots"
    how = "estimate, no fiducial missed" if is_of_all_shots(score.verdict) else "estimate"
    if unit.yield_fraction is None or unit.limit_mm is None:
        return KeyNumber(headline_words(unit.quantile, unit.units_fraction), f"{value:.{decimals}f} mm", how)
    kept = f"of units keep {shots} within {unit.limit_mm:g} mm, {how}"
    return KeyNumber("Yield", in_percent(unit.yield_fraction, 1), kept)


def headline_figure(headline: Headline, targets: Sequence[TargetScore | TargetEstimate], decimals: int) -> Figure:
    """What decides, its interval and the limit on one scale.

    targets: what the headline was found with, first order or Monte Carlo; mean and CVaR beside the value are those of
    its own distribution.  What units keep has another, of which these are not known.
    """
    of_error = headline.unit == MEASURE[headline.error].unit
    size = f"{f'Size of {ERRORS[headline.error]}' if of_error else headline.headline}, target {headline.target}"
    caption = f"{size}, by {name_basis(headline.basis)}: the bar is the interval."
    draw = partial(draw_scale, headline, _beside(headline, targets), decimals=decimals)
    return Figure("headline", partial(draw, "headline"), caption, partial(draw, "headline-narrow", PHONE))


def _beside(headline: Headline, targets: Sequence[TargetScore | TargetEstimate]) -> tuple[tuple[str, float], ...]:
    target = next((target for target in targets if target.name == headline.target), None)
    alike = headline.min_yield is None and headline.unit == MEASURE[headline.error].unit
    if target is None or not alike or (metric := error_at(target, headline.error)) is None:
        return ()
    mean = ("mean", metric.mean_norm_mm)
    return (mean, ("CVaR95", metric.cvar95_mm)) if headline.quantile == P95 else (mean,)


def measures_blocks(found: Score | Verification) -> tuple[Block, ...]:
    """Measures of other errors than those at the targets, if there are any, what leaves its corridor, and quality
    figures of what has a limit."""
    measures, quality = found.measures, quality_table(found.targets, found.measures)
    told = tuple(group(each, on=IN_DETAIL) for each in (shares_table(measures), quality) if each is not None)
    return (measures_table(measures), breaches_table(measures), *told)


def error_blocks(score: Score) -> tuple[Block, ...]:
    return (
        *dots_blocks(score),
        group(targets_table(score), group(Paragraph(LOCATED), on=On.PLAIN)),
        *measures_blocks(score),
        group(Paragraph(units_sentence(score.worst_target, score.decimals)), on=PAPER),
        group(*verdict_blocks(score.verdict), on=PAPER),
        group(views_table(score.views), on=IN_DETAIL),
        say("fiducials in the images", views_sentence(score.views), on=On.PLAIN),
        group(*((losses_listed(score),) if score.losses else ()), on=PAPER),
    )


def losses_listed(score: Score) -> Bullets:
    checks = score.verdict.checks
    return Bullets(tuple(f"If fiducials are lost: {losses_sentence(line, checks)}" for line in score.losses))


def count_misses(shots: FiftyShots) -> int:
    """How many of the fifty are beyond the limit: fifty times the probability of that, rounded."""
    return sum(value is None or value > shots.limit for value in shots.values)


def say_misses(shots: FiftyShots) -> str:
    """How many of the fifty miss the limit."""
    misses = count_misses(shots)
    verb = "misses" if misses == 1 else "miss"
    share = in_percent(shots.exceedance_probability, 1)
    return f"{misses} of {SHOTS} shots {verb} the limit of {shots.limit:g} {shots.unit} ({share} of all)"


def dots_blocks(score: Score) -> tuple[Block, ...]:
    """Picture and sheet, in a terminal a line; nothing where they were not asked for."""
    shots = score.fifty_shots
    if shots is None:
        return ()
    told, kept = say_misses(shots), SHOTS - count_misses(shots)
    columns = (
        Column("Shot", kind="whole", of=lambda row: row[0]),
        Column("Order", "%", "percent", 0, of=lambda row: (row[0] - 0.5) / SHOTS),
        Column("Value", shots.unit, "significant", 6, of=lambda row: row[1]),
        Column("Limit", of=lambda row: "misses" if row[0] > kept else "keeps"),
    )
    drawn = ((told, shots),)
    table = tabulate("Fifty shots", f"{shots.of}, by estimate: {told}", columns, list(enumerate(shots.values, 1)))
    picture = Figure(
        "fifty-shots", partial(draw_dots, drawn), f"Fifty shots that stand for all, by estimate: {shots.of}.",
        partial(draw_dots, drawn, "fifty-shots-narrow", PHONE),
    )  # fmt: skip
    line = f"{'o' * kept}{'X' * (SHOTS - kept)}: {told}"
    return (group(picture, on=PAPER), group(table, on=On.SHEET), say("fifty shots", line, on=TERMINAL))


# --- the budget ---------------------------------------------------------------------------------------

SLACK_NOTE = (
    " Half-width at limit: the one at which the requirement on a quantile that decides at the target, of all units "
    "together or of each unit, is just met, by estimate, if nothing else changes; slack is what is left to it, "
    "negative where it has to shrink, empty where not even zero is enough. Slack can be spent once: two tolerances "
    "cannot both use it up."
)
COST_NOTE = " Cost: by the prices of the design's optimise section; a half-width without a price has none."


def budget_with_slack(target: TargetScore, name: str, allowances: Sequence[Allowance] = (), decimals: int = 3) -> Table:
    """The budget of a target, and beside it how far each half-width is from the one at its limit, and what it costs."""
    known = {(entry.contributor, entry.component): entry for entry in allowances if entry.target == target.name}
    if not known:
        return budget_table(target, decimals, name)

    def of_own(field: str) -> Callable[[BudgetLine], Cell]:
        return lambda row: getattr(known.get((row.line.name, row.line.component)), field, None)

    def in_words(row: BudgetLine) -> str:
        own = known.get((row.line.name, row.line.component))
        below = any((part.name, part.component) in known for part in row.parts)
        return own.status if own is not None else "see its components" if below else ""

    columns = (
        Column("Half-width at limit", "unit", "significant", of=of_own("at_limit")),
        Column("Slack", "unit", "significant", of=of_own("slack")),
        Column("Slack in words", on=On.SHEET, of=in_words),
    )
    with_cost = any(entry.cost is not None for entry in known.values())
    cost = (Column("Cost", "", "significant", 4, of=of_own("cost")),) if with_cost else ()
    return budget_table(target, decimals, name, (*columns, *cost), SLACK_NOTE + (COST_NOTE if with_cost else ""))


def budget_blocks(score: Score, allowances: Sequence[Allowance] = ()) -> tuple[Block, ...]:
    """Pictures and table of the budget of the targets with the largest P95."""
    blocks: list[Block] = []
    if len(score.targets) > DETAILED:
        shown = f"Shown are the {DETAILED} targets with the largest P95 of {len(score.targets)}; the record has all."
        blocks.append(Paragraph(shown))
    what = "share of the variance of each contributor, each bar beginning where the one above ends"
    for k, target in enumerate(sorted(score.targets, key=lambda target: -target.p95_mm)[:DETAILED]):
        picture = "waterfall" if k == 0 else f"waterfall-{k + 1}"
        draw = partial(draw_shares, target.contributors, target.name, picture)
        blocks += [
            Figure(picture, draw, f"Target {target.name}: {what}."),
            budget_with_slack(target, "Budget" if k == 0 else f"Budget {k + 1}", allowances, score.decimals),
            group(live_budget(target, "What if", allowances, score.verdict.checks), on=On.SHEET),
        ]
        if target.worst_vertex:
            blocks.append(Paragraph(f"Bounded components stand at their worst ends: {', '.join(target.worst_vertex)}."))
    return tuple(blocks)


FIRST_ROW = 3  # row of a sheet in which the rows of its table begin
LIVE_COLUMNS = (
    Column("Contributor"), Column("Component"), Column("Unit", kind="unit"),
    Column("Half-width as it is", "unit", "given"), Column("Half-width", "unit", "given"),
    Column("Std of the error", "mm/unit", "significant"), Column("Slope t", "mm²/unit²", "significant"),
    Column("Curvature e", "mm²/unit⁴", "significant"), Column("Contribution", "mm", "significant"),
    Column("Share of variance", "%", "percent", 1), Column("Square of the value grown", "mm²", "significant"),
    Column("At limit as it is", "unit", "significant"), Column("At limit", "unit", "significant"),
    Column("Slack", "unit", "significant"), Column("Value", "mm", "fixed"), Column("Limit", "mm", "stated"),
    Column("Limit less value", "mm", "signed"),
)  # fmt: skip
LIVE_NOTE = (
    "The yellow numbers may be changed: contributions, shares, their root sum of squares (in the last row), value and "
    "slack follow. Contributions and shares are exact. The value is so as it is, and where one half-width by itself "
    "stands at its limit; elsewhere it is an estimate: score the design anew before it is drawn. Sources without a "
    "half-width of their own stay as they are, and those of 0 are left out."
)


class _LiveLine(NamedTuple):
    """A source or component that no other line holds too."""

    contributor: str
    component: str
    unit: str
    half_width: float | None  # None: none of its own
    contribution: float  # standard deviation of the error, mm
    slope: float = 0.0
    curvature: float = 0.0
    at_limit: float | None = None


def live_budget(target: TargetScore, name: str, allowances: Sequence[Allowance], checks: Sequence[Check]) -> Table:
    """The budget of a target as a sheet that moves: half-widths may be changed there, and what hangs on them follows.

    Shares and the root sum of squares are those of the covariance, exact for any half-widths.  The square of the value
    that is limited grows by a sum over the half-widths h, which the design has as h0: by t x, where x = h^2 - h0^2, and
    towards the limit by e x^2 more.  The slope t is that of the budget, and e is such that each half-width by itself
    meets the limit where it was computed to.  So at h0 all numbers are what is printed; elsewhere the value is an
    estimate.  checks: those to first order.
    """
    check = tightest_check(checks, target.name)
    if check is not None and check.beyond is not None:
        check = None  # its value is no quantile, as the half-widths at its limit are
    value, limit = (target.budget_p95_mm, None) if check is None else (check.value, check.limit)
    known = {(a.contributor, a.component): a for a in allowances if check and a.target == target.name}
    lines = list(_live_lines(target, value, limit, known))
    last, end = FIRST_ROW + len(lines) - 1, FIRST_ROW + len(lines)
    rss = sqrt(sum(line.contribution**2 for line in lines))
    as_it_is = f"{value!r}^2".upper()
    rows = [_live_row(line, rss, end, f"($P${end}^2-{as_it_is}-$K${end}+K{{row}})") for line in lines]
    together: tuple[Cell, ...] = (
        Formula(rss, f"SQRT(SUMSQ(I{FIRST_ROW}:I{last}))"),
        Formula(1.0 if rss else 0.0, f"SUM(J{FIRST_ROW}:J{last})"),
        Formula(0.0, f"SUM(K{FIRST_ROW}:K{last})"),
        None, None, None,
        Formula(value, f"SQRT(MAX(0,{as_it_is}+K{end}))"),
        None if limit is None else ChangeableNumber(limit),
        None if limit is None else Formula(limit - value, f"P{end}-O{end}"),
    )  # fmt: skip
    rows.append(Row(("Together", "", "", None, None, None, None, None, *together)))
    said = "P95 of the error at the tool" if check is None else f"{what_is_limited(check)} ({check.requirement})"
    return Table(name, f"What if, target {target.name}; value: {said}", LIVE_COLUMNS, tuple(rows), LIVE_NOTE)


def _live_lines(
    target: TargetScore, value: float, limit: float | None, known: Mapping[tuple[str, str], Allowance]
) -> Iterator[_LiveLine]:
    budget = [(total, part) for total, parts in group_lines(target.contributors) for part in parts or [total]]
    of_all = sum(std**2 for std in target.std_mm)
    for _, line in budget:
        if line.std and line.sensitivity_mm_per_unit and line.variance_share:  # of shots that miss no fiducial
            of_all = (line.std * line.sensitivity_mm_per_unit) ** 2 / line.variance_share
            break
    for total, line in budget:
        named = (heading_of(total), "" if line.component in ("all", "known") else line.component)
        contribution, width = sqrt(max(line.variance_share, 0.0) * of_all), line.half_width
        if not width:
            if contribution:
                yield _LiveLine(*named, "", None, contribution)
            continue
        slope, curvature = value**2 / target.budget_p95_mm * line.slope / width, 0.0
        own = known.get((line.name, line.component))
        at_limit = None if own is None else own.at_limit
        if limit is not None and at_limit is not None and at_limit != width:
            further = at_limit**2 - width**2
            straight = (limit**2 - value**2) / further
            if straight <= slope / 2:  # a parabola would come to the limit on its other side
                slope = straight
            curvature = (straight - slope) / further
        yield _LiveLine(*named, line.unit, width, contribution, slope, curvature, at_limit)


def _live_row(line: _LiveLine, rss: float, end: int, room: str) -> Row:
    """Cells of a line; end: row of what all come to together, room: how much of its own the square may grow by."""
    width, empty = line.half_width, (None, None, None)
    share = Formula((line.contribution / rss) ** 2 if rss else 0.0, f"IF($I${end}=0,0,(I{{row}}/$I${end})^2)")
    if width is None:
        return Row((*line[:3], *empty, None, None, line.contribution, share, None, *empty, *empty))
    stated = (width, ChangeableNumber(width), line.contribution / width, line.slope, line.curvature)
    squares = "(E{row}^2-D{row}^2)"
    side = "MAX" if line.at_limit is not None and line.at_limit > width else "MIN"  # where the limit lies
    grown = Formula(0.0, f"G{{row}}*{squares}+H{{row}}*{side}(0,{squares})^2")
    at_limit: tuple[Cell, ...] = empty
    if line.at_limit is not None and line.slope > 0:
        root = f"SQRT(MAX(0,G{{row}}^2+4*H{{row}}*{side}(0,{room})))"
        now = Formula(line.at_limit, f"SQRT(MAX(0,D{{row}}^2+2*{room}/(G{{row}}+{root})))")
        at_limit = (line.at_limit, now, Formula(line.at_limit - width, "M{row}-E{row}"))
    contribution = Formula(line.contribution, "F{row}*E{row}")
    return Row((*line[:3], *stated, contribution, share, grown, *at_limit, *empty))


# --- levers, and the method ----------------------------------------------------------------------------


def levers_blocks(score: Score) -> tuple[Block, ...]:
    """How far each lever leads every requirement by itself, that which decides first."""
    decisive = decisive_check(score.verdict.checks)
    names = list(dict.fromkeys(lever.requirement for lever in score.levers))
    if decisive is not None:
        names.sort(key=lambda name: name != decisive.requirement)
    blocks: list[Block] = []
    for k, name in enumerate(names):
        levers = [lever for lever in score.levers if lever.requirement == name]
        check = max((c for c in score.verdict.checks if c.requirement == name), key=lambda c: c.value, default=None)
        decimals, picture = score.decimals, "levers" if k == 0 else f"levers-{k + 1}"
        if check is not None:
            caption = f"{name}: what each lever comes to at its best, everything else as it is, and the limit."
            blocks.append(Figure(picture, partial(draw_levers, levers, check, picture, decimals), caption))
        on = EVERYWHERE if k == 0 else ~On.PLAIN
        reached = Paragraph(_say_reach(levers, check, score), "What each lever can reach")
        blocks += [group(reached, on=on & TERMINAL), group(_levers_table(levers, check, score), on=on)]
    return tuple(blocks)


HOW = {"perfect": "perfect", "least": "at its smallest allowed", "bound": "no better than", "found": "found by search"}


def _levers_table(levers: Sequence[Lever], check: Check | None, score: Score) -> Table:
    unit = "mm" if check is None else check.unit
    columns = (
        Column("Lever, by itself", brief="lever,\nby itself", of=attrgetter("label")),
        Column("At its best", brief="at its\nbest", of=lambda lever: HOW[lever.how]),
        Column("Comes to", unit, "fixed", score.decimals, brief=f"comes to\n{unit}", of=attrgetter("value")),
    )
    note = "No better than: no place of the fiducials, and nothing that optimise frees, leads below that."
    return tabulate("Levers", f"What each lever can reach{_say_reach(levers, check, score)}", columns, levers, note)


def _say_reach(levers: Sequence[Lever], check: Check | None, score: Score) -> str:
    """From where, and which of them keep the limit by themselves, or that not even all do."""
    if check is None:
        return f", P95 {length(score.worst_target.p95_mm, score.decimals)} mm"
    told = f", {check.requirement} {length(check.value, score.decimals)} {check.unit}, limit {check.limit:g}: "
    if wall := [lever for lever in levers if lever.name == "together" and lever.value > check.limit]:
        return f"{told}impossible below {wall[0].value:.4g} with {wall[0].label}"
    alone = [lever.label for lever in levers if lever.how != "bound" and lever.value <= check.limit]
    if check.value <= check.limit:
        return f"{told}{'kept as it is' if check.status == 'pass' else 'kept by an estimate that does not decide it'}"
    return f"{told}kept by {' or by '.join(alone)} alone" if alone else f"{told}no lever alone keeps it"


def method_blocks(score: Score) -> tuple[Block, ...]:
    """How first order was computed, how far it holds, and what was assumed."""
    worst, decimals, validity = score.worst_target, score.decimals, score.validity
    told = (
        *_law(worst, decimals),
        *(("second order", words) for words in second_order(worst, decimals)),
        ("linearisation", f"{validity.status}. {validity.statement}."),
    )
    sentences = (
        *(f"{word.capitalize()}: {sentence}" for word, sentence in told),
        "Sensitivities are evaluated at the biased geometry: known displacements are in the mean, tolerances and noise "
        "in the covariance. A tolerance is a half-width with the law named in the budget.",
        *score.provenance.notes,
    )
    pairs = (
        ("First order", "implicit differentiation of resection, triangulation and the chain to the tool"),
        ("Validity number", f"nu = {validity.nu:.3g}, {validity.status}"),
    )
    return Facts("Method", pairs), Bullets(sentences)
