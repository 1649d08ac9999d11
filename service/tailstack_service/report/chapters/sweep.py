"""The chapters of a sweep."""

from __future__ import annotations

from tailstack.results.sweep import Sweep, SweepAxis, points_table

from ...problems import RequestError
from ..blocks import Block, Bullets, Document, Figure, KeyNumber, Listing, Paragraph, Section
from ..charts import draw_sweep
from .tables import not_included, provenance_facts


def sweep_document(sweep: Sweep, sha256: str) -> Document:
    """Every point as a row; with one axis, P95 over it as a picture."""
    decimals = sweep.decimals
    found = [(target.p95_mm, point, target) for point in sweep.points for target in point.targets]
    refused = [point for point in sweep.points if point.status == "refused"]
    numbers = [KeyNumber("Points", f"{len(sweep.points):,}", f"{len(refused)} refused")]
    figures: tuple[Figure, ...] = ()
    sentence = "No point could be evaluated."
    if found:
        lowest, best, at = min(found, key=lambda entry: entry[0])
        highest, worst, there = max(found, key=lambda entry: entry[0])
        numbers.append(
            KeyNumber("Smallest P95", f"{lowest:.{decimals}f} mm", f"{at.name}, {_place(sweep, best.values)}")
        )
        numbers.append(
            KeyNumber("Largest P95", f"{highest:.{decimals}f} mm", f"{there.name}, {_place(sweep, worst.values)}")
        )
        evaluated = len(sweep.points) - len(refused)
        over = f"all {evaluated:,} points" if not refused else f"{evaluated:,} of {len(sweep.points):,} points"
        words = f"goes from {lowest:.{decimals}f} to {highest:.{decimals}f} mm over"
        if f"{lowest:.{decimals}f}" == f"{highest:.{decimals}f}":
            words = f"is {lowest:.{decimals}f} mm at"
        sentence = f"P95 of the TCP error {words} {over}"
        sentence += "." if not refused else f"; {len(refused):,} could not be evaluated and are not among them."
        figures = _figure(sweep)
    how = "by Monte Carlo" if sweep.check == "verification" else "by estimate"
    blocks: list[Block] = [points_table(sweep)]
    if refused:
        blocks.append(Bullets(tuple(f"{_place(sweep, p.values)}: {p.reason}" for p in refused[:20])))
    axes = ", ".join(f"{axis.called} ({len(axis.values)} values)" for axis in sweep.axes)
    return Document(
        kind="Sweep",
        title=sweep.provenance.design_name,
        tone="neutral",
        status="sweep",
        sentence=sentence,
        numbers=tuple(numbers),
        matters=_matters(sweep),
        figures=figures,
        sections=(
            Section("Points", (Paragraph(f"Varied: {axes}; each point {how}."), *blocks)),
            Section("Method and assumptions", _method(sweep), reader="auditor"),
            Section("What is not included", (not_included(sweep.provenance),), reader="auditor"),
            Section("Reproduction", (Listing(_command(sweep)), Paragraph(REPRODUCTION)), reader="auditor"),
        ),
        provenance=provenance_facts(sweep.provenance, sha256, sweep.schema),
    )


REPRODUCTION = (
    "design.yaml is the design of the hash named on the first page; the record of a sweep does not hold it. The same "
    "version of tailstack gives the same digits."
)


def _matters(sweep: Sweep) -> tuple[str, ...]:
    """How many designs pass, what the design as it stands has, what could not be evaluated."""
    said = []
    judged = [point for point in sweep.points if point.verdict not in (None, "no requirement")]
    if judged:
        passed = sum(point.verdict == "pass" for point in judged)
        said.append(f"{passed:,} of {len(judged):,} points keep their requirements.")
    as_it_is = [f"{_short(axis)} = {axis.base:g} {axis.unit}".strip() for axis in sweep.axes if axis.base is not None]
    if as_it_is:
        said.append(f"The design as it stands has {', '.join(as_it_is)}.")
    refused = [point for point in sweep.points if point.status == "refused"]
    if refused:
        first = f"{_place(sweep, refused[0].values)}: {refused[0].reason}"
        said.append(f"{len(refused):,} points were refused, the first at {first}.")
    return tuple(said)


def _method(sweep: Sweep) -> tuple[Block, ...]:
    if sweep.check == "score":
        how = "Each point is estimated, at the geometry that its own numbers give."
    elif sweep.trials is None:
        how = (
            f"Each point is checked by Monte Carlo on the full chain, to the solver's own precision, seed {sweep.seed}."
        )
    else:
        how = f"Each point is checked by {sweep.trials:,} Monte Carlo trials of the full chain, seed {sweep.seed}."
    same = "" if sweep.check == "score" else " One seed serves all points, so that they differ by their designs alone."
    return (Bullets((how + same, *sweep.provenance.notes)),)


def _command(sweep: Sweep) -> str:
    """The command that gives this sweep again."""
    axes = " ".join(f"--set {axis.pointer}={','.join(f'{value!r}' for value in axis.values)}" for axis in sweep.axes)
    drawn = "" if sweep.check == "score" else f" --check verification --seed {sweep.seed}"
    drawn += "" if sweep.trials is None else f" --trials {sweep.trials}"
    return f"tailstack sweep design.yaml {axes}{drawn} --json"


def _place(sweep: Sweep, values: tuple[float, ...]) -> str:
    return ", ".join(
        f"{_short(axis)} = {value:g} {axis.unit}".strip() for axis, value in zip(sweep.axes, values, strict=True)
    )


def _short(axis: SweepAxis) -> str:
    return axis.short


def _figure(sweep: Sweep) -> tuple[Figure, ...]:
    """P95 over one axis or two, where a picture can show it."""
    try:
        svg = draw_sweep(sweep, "curve")
    except RequestError:
        return ()
    pointers = " and ".join(axis.called for axis in sweep.axes)
    return (Figure("curve", svg, f"P95 of the TCP error over {pointers}."),)
