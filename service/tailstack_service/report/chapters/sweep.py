"""The chapters of a sweep, and its rows as CSV for spreadsheets."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial

from tailstack.results.digits import length
from tailstack.results.sweep import Sweep, SweepPoint, SweepTarget, points_table
from tailstack.results.tables import PAPER, TERMINAL

from ...problems import RequestError
from ...rendering.document import (
    Bullets,
    Document,
    Facts,
    Figure,
    KeyNumber,
    Paragraph,
    Section,
    compose_document,
    group,
    say,
)
from ...rendering.text import csv_text, list_reasons, plain_text, spell_count
from ..charts import draw_sweep, find_worst, refuse_undrawable

EvaluatedPoint = tuple[SweepTarget, SweepPoint]  # a point, and its worst target


def sweep_document(sweep: Sweep, sha256: str) -> Document:
    """Every point as a row; with one axis, P95 over it as a picture."""
    evaluated = [(find_worst(point), point) for point in sweep.points if point.targets]
    refused = [point for point in sweep.points if point.status == "refused"]
    numbers = [KeyNumber("Points", f"{len(sweep.points):,}", f"{len(refused)} refused")]
    if evaluated:
        for label, (target, point) in zip(("Smallest P95", "Largest P95"), _find_ends(evaluated), strict=True):
            value = f"{length(target.p95_mm, sweep.decimals)} mm"
            numbers.append(KeyNumber(label, value, f"{target.name}, {_place(sweep, point.values)}"))
    sentence, verdict_sentences = _range_sentence(sweep, evaluated), _kept_sentence(sweep)
    scored = sweep.check == "score"
    reasons = list_reasons([point.reason for point in sweep.points], MOST_REASONS, numbered=True)
    each = "estimated" if scored else f"simulated with seed {sweep.seed}"
    how = "by estimate" if scored else "by Monte Carlo"
    listed = Bullets(tuple(f"{_place(sweep, point.values)}: {point.reason}" for point in refused[:20]))
    axes = ", ".join(f"{axis.label} ({len(axis.values)} values)" for axis in sweep.axes)
    points = (
        group(Paragraph(f"Varied: {axes}; each point {how}."), on=PAPER),
        group(_axes(sweep), on=TERMINAL),
        points_table(sweep),
        say("refused", *reasons),
        group(*((listed,) if refused else ()), on=PAPER),
    )
    return compose_document(
        sweep,
        sha256,
        (
            Section("Points", points),
            Section("Method and assumptions", (_method(sweep),), on=PAPER, reader="auditor"),
        ),
        _command(sweep),
        REPRODUCTION,
        kind="Sweep",
        status="sweep",
        sentence=sentence,
        numbers=tuple(numbers),
        matters=(*verdict_sentences, *_matters(sweep)),
        figures=_figure(sweep) if evaluated else (),
        question=f"Sweep of {spell_count(len(sweep.points), 'point')}, each {each}.",
        method="first order" if scored else "Monte Carlo",
        opening=(" ".join((sentence, *verdict_sentences)),),
    )


MOST_REASONS = 12
REPRODUCTION = (
    "design.yaml is the design of the hash named on the first page; the record of a sweep does not hold it. The same "
    "version of tailstack gives the same digits."
)


def _axes(sweep: Sweep) -> Facts:
    """What the letters of the table's columns stand for."""
    pairs = []
    for letter, axis in zip(sweep.letters, sweep.axes, strict=True):
        now = "varies" if axis.base is None else f"{axis.base:g} {axis.unit}".strip()
        pairs.append((letter, f"{axis.label}: {spell_count(len(axis.values), 'value')}; now {now}"))
    return Facts("Axes", tuple(pairs))


def _find_ends(evaluated: Sequence[EvaluatedPoint]) -> tuple[EvaluatedPoint, EvaluatedPoint]:
    """The points with the least and the largest P95 at their worst targets."""
    return min(evaluated, key=lambda entry: entry[0].p95_mm), max(evaluated, key=lambda entry: entry[0].p95_mm)


def _range_sentence(sweep: Sweep, evaluated: Sequence[EvaluatedPoint]) -> str:
    """Where the error is least and largest."""
    if not evaluated:
        return "No point could be evaluated."
    ends = _find_ends(evaluated)
    low, high = (f"{length(target.p95_mm, sweep.decimals)} mm" for target, _ in ends)
    at_low, at_high = (_place(sweep, point.values) for _, point in ends)
    refused = len(sweep.points) - len(evaluated)
    over = f"{len(evaluated):,} of {len(sweep.points):,} points" if refused else f"all {len(evaluated):,} points"
    several = any(len(point.targets) > 1 for _, point in evaluated)
    error = "the error at the tool at the worst target" if several else "the error at the tool"
    if len(sweep.points) == 1:
        return f"P95 of {error} is {low}."
    range_text = f"goes from {low} ({at_low}) to {high} ({at_high}) over {over}"
    if low == high:
        alike = len(evaluated) > 1 and f"{ends[0][0].p95_mm:.4f}" == f"{ends[1][0].p95_mm:.4f}"
        range_text = f"is {low} at {over}" + (": what is varied here does not matter" if alike else "")
    more = f"; {refused:,} could not be evaluated and are not among them" if refused else ""
    return f"P95 of {error} {range_text}{more}."


def _kept_sentence(sweep: Sweep) -> tuple[str, ...]:
    """How many designs pass, and how many are open; nothing where none is judged."""
    judged = [point for point in sweep.points if point.verdict not in (None, "no requirement")]
    passed = sum(point.verdict == "pass" for point in judged)
    left = sum(point.verdict == "inconclusive" for point in judged)
    more = f"; {left:,} {'is' if left == 1 else 'are'} open: neither kept nor missed for certain" if left else ""
    return (f"{passed:,} of {len(judged):,} points keep their requirements{more}.",) if judged else ()


def _matters(sweep: Sweep) -> Iterator[str]:
    """What the design as it stands has, what could not be evaluated."""
    as_it_is = [f"{axis.short} = {axis.base:g} {axis.unit}".strip() for axis in sweep.axes if axis.base is not None]
    if as_it_is:
        yield f"The design as it stands has {', '.join(as_it_is)}."
    refused = [point for point in sweep.points if point.status == "refused"]
    if refused:
        first = f"{_place(sweep, refused[0].values)}: {refused[0].reason}"
        yield f"{len(refused):,} points were refused, the first at {first}."


def _method(sweep: Sweep) -> Bullets:
    if sweep.check == "score":
        how = "Each point is estimated, at the geometry that its own numbers give."
    else:
        by = "Monte Carlo on the full chain, to the solver's own precision"
        by = by if sweep.trials is None else f"{sweep.trials:,} Monte Carlo trials of the full chain"
        how = f"Each point is checked by {by}, seed {sweep.seed}."
        how += " One seed serves all points, so that they differ by their designs alone."
    return Bullets((how, *sweep.provenance.notes))


def _command(sweep: Sweep) -> str:
    """The command that gives this sweep again."""
    axes = " ".join(f"--set {axis.pointer}={','.join(f'{value!r}' for value in axis.values)}" for axis in sweep.axes)
    drawn = "" if sweep.check == "score" else f" --check verification --seed {sweep.seed}"
    drawn += "" if sweep.trials is None else f" --trials {sweep.trials}"
    return f"tailstack sweep design.yaml {axes}{drawn} --json"


def _place(sweep: Sweep, values: tuple[float, ...]) -> str:
    pairs = zip(sweep.axes, values, strict=True)
    return ", ".join(f"{axis.short} = {value:g} {axis.unit}".strip() for axis, value in pairs)


def _figure(sweep: Sweep) -> tuple[Figure, ...]:
    """P95 over one axis or two, where a picture can show it."""
    try:
        refuse_undrawable([axis.values for axis in sweep.axes])
    except RequestError:
        return ()
    pointers = " and ".join(axis.label for axis in sweep.axes)
    return (Figure("curve", partial(draw_sweep, sweep, "curve"), f"P95 of the TCP error over {pointers}."),)


def sweep_csv(sweep: Sweep) -> str:
    """One line for each point and target; a refused point has one line without numbers."""
    rows: list[list[object]] = []
    for place, point in enumerate(sweep.points):
        head = [place + 1, *point.values, point.status, point.verdict]
        if not point.targets:
            rows.append([*head, *[None] * 7, point.reason])
        for target in point.targets:
            interval = target.p95_interval_mm or (None, None)
            rows.append([
                *head, plain_text(target.name), target.p95_mm, *interval, target.mean_norm_mm, target.bias_norm_mm,
                target.localisation_p95_mm, None,
            ])  # fmt: skip
    header = (
        "point", *(axis.pointer for axis in sweep.axes), "status", "verdict", "target", "p95_mm", "p95_low_mm",
        "p95_high_mm", "mean_norm_mm", "bias_norm_mm", "localisation_p95_mm", "reason",
    )  # fmt: skip
    return csv_text(header, rows)
