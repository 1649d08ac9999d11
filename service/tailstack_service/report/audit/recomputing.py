"""The numbers again: from the design in the record, or from one that is given beside it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from tailstack.design import Design, load_design
from tailstack.errors import Problem
from tailstack.montecarlo.simulate import Progress
from tailstack.results import Optimisation, Score, Verification
from tailstack.results.sweep import Sweep
from tailstack.scoring import score

from ...documents import plain
from ...problems import RequestError
from ..assembling import ReportOptions, assemble, compute_report, options_of
from ..comparing import compare, compute_comparison
from ..records import Comparison, Report


@dataclass(frozen=True, slots=True, eq=False)
class Again:
    """What was computed anew, as plain data, and what was taken as it is recorded."""

    record: Any
    trusted: str = ""  # in words; empty: nothing


NEEDS_DESIGN = ("score", "verification", "sweep")


def again(
    kind: str, record: Any, given: Design | None, *, fast: bool, progress: Progress | None = None
) -> Again | None:
    """The record computed anew, ``fast`` without Monte Carlo and optimiser; None where only its hash can be had.

    given: the design of a record that does not hold its own.  Raises RequestError where that is missing or another.
    """
    if kind in NEEDS_DESIGN:
        if given is None:
            if fast:
                return None
            detail = f"a {kind} does not hold its design, so its numbers cannot be computed again"
            hint = "tailstack report --verify FILE DESIGN, or --fast: hash and pages only"
            raise RequestError(Problem("", "missing-design", detail, hint))
        _same_design(record, given)
    elif kind == "gate":
        if fast:
            return None
        detail = "the numbers of a gate are computed again by tailstack gate, from its designs and its policy"
        raise RequestError(Problem("", "not-recomputed", detail, "add --fast: hash and pages only"))
    elif given is not None:
        detail = "the record holds its design: none is to be given"
        raise RequestError(Problem("", "unused-option", detail, "leave the second file out"))
    return _MAKERS[kind](record, given, fast, progress)


def _same_design(record: Any, given: Design) -> None:
    wanted = record.provenance.design_sha256
    if wanted != given.sha256:
        detail = f"this is another design: its SHA-256 is {given.sha256}, the record is of {wanted}"
        raise RequestError(Problem("", "another-design", detail, "give the design that the record was computed from"))


def _loaded(data: dict[str, object]) -> Design:
    return load_design(data, allow_files=False)


def _report(record: Report, given: None, fast: bool, progress: Progress | None) -> Again:
    design, options = _loaded(record.design), _options(record)
    if not fast:
        return Again(plain(compute_report(design, options, progress=progress)))
    made = assemble(design, options, record.verification, record.optimisation)
    return Again(plain(made), "the Monte Carlo check" if record.verification is not None else "")


def _options(record: Report) -> ReportOptions:
    made = record.reproduction
    asked = {name: getattr(made, name) for name in ("parts", "seed", "trials", "precision", "max_trials", "starts")}
    return options_of(asked)


def _comparison(record: Comparison, given: None, fast: bool, progress: Progress | None) -> Again:
    options = _options(record.first)
    pair = [_loaded(report.design) for report in (record.first, record.second)]
    if not fast:
        return Again(plain(compute_comparison(pair[0], pair[1], options, progress=progress)))
    made = [
        assemble(design, options, report.verification, None)
        for design, report in zip(pair, (record.first, record.second), strict=True)
    ]
    trusted = "the Monte Carlo checks of both" if record.first.verification is not None else ""
    return Again(plain(compare(made[0], made[1], options)), trusted)


def _score(record: Score, given: Design, fast: bool, progress: Progress | None) -> Again:
    asked = any(target.second_order.status != "not requested" for target in record.targets)
    return Again(plain(score(given, second_order=asked)))


def _verification(record: Verification, given: Design, fast: bool, progress: Progress | None) -> Again:
    from tailstack.verification import MAX_TRIALS, verify

    if fast:
        first = {target.name: target.p95_mm for target in score(given).targets}
        targets = tuple(replace(target, first_order_p95_mm=first[target.name]) for target in record.targets)
        return Again(plain(replace(record, targets=targets)), "the Monte Carlo check")
    fixed = record.precision_requested is None
    made = verify(
        given, trials=record.trials if fixed else None, precision=record.precision_requested, seed=record.seed,
        method=record.method, max_trials=record.max_trials or MAX_TRIALS, progress=progress,
    )  # fmt: skip
    return Again(plain(made))


def _sweep(record: Sweep, given: Design, fast: bool, progress: Progress | None) -> Again:
    from tailstack.sweeping import read_axes, sweep
    from tailstack.verification import MAX_TRIALS

    if fast and record.check == "verification":
        return Again(plain(record), "the Monte Carlo checks of all points")
    axes = read_axes(given, [{"pointer": axis.pointer, "values": list(axis.values)} for axis in record.axes])
    made = sweep(
        given, axes, check=record.check, trials=record.trials, seed=record.seed or 0,
        max_trials=record.max_trials or MAX_TRIALS, progress=progress,
    )  # fmt: skip
    return Again(plain(made))


def _optimisation(record: Optimisation, given: None, fast: bool, progress: Progress | None) -> Again:
    proof = record.certificate
    if not fast:
        from tailstack.optimisation import optimise

        return Again(plain(optimise(_loaded(record.design_before), seed=proof.seed, starts=proof.starts)))
    design = _loaded(record.design)
    first = {target.name: target.p95_mm for target in score(design).targets}
    check = proof.verification
    targets = tuple(replace(target, first_order_p95_mm=first[target.name]) for target in check.targets)
    same = replace(check.provenance, design_sha256=design.sha256)
    made = replace(record, provenance=replace(record.provenance, design_sha256=design.sha256))
    made = replace(made, certificate=replace(proof, verification=replace(check, targets=targets, provenance=same)))
    return Again(plain(made), "the optimiser and its check")


_MAKERS: dict[str, Callable[[Any, Any, bool, Progress | None], Again]] = {
    "report": _report,
    "comparison": _comparison,
    "score": _score,
    "verification": _verification,
    "sweep": _sweep,
    "optimisation": _optimisation,
}
