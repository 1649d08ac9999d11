"""Records of gates that came to no verdict: refused, broken off, interrupted, or not finished yet.

A file of the last run must never look like an answer to this one: it says *not evaluated* from the moment at which the
gate begins to the moment at which it has ended.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from datetime import date

from tailstack.errors import Problem
from tailstack.scoring import NOT_INCLUDED
from tailstack.version import __version__

from .records import Fold, GatedDesign, GateFinding, GateProvenance, GateRecord, Level, Mode

NOT_FINISHED = Problem("", "not-finished", "the gate has not ended: it is running, or it was killed")
INTERRUPTED = Problem("", "interrupted", "the gate was interrupted before it came to a verdict")


def unfinished(
    files: Sequence[str],
    problems: Iterable[Problem],
    exit_code: int,
    *,
    today: date,
    mode: Mode = "auto",
    fail_level: Level = "error",
    on_inconclusive: Fold | None = None,
    max_regression_percent: float | None = None,
) -> GateRecord:
    """The record of a gate that ends with ``exit_code`` 2, 3 or 130 before it judged the designs of these files."""
    rule = "invalid-input" if exit_code == 2 else "not-evaluated"
    return GateRecord(
        schema="tailstack/gate/1",
        verdict="not evaluated",
        exit_code=exit_code,
        mode=mode,
        seed=0,
        fail_level=fail_level,
        on_inconclusive=on_inconclusive,
        max_regression_percent=max_regression_percent,
        findings=tuple(_finding(rule, problem, files) for problem in problems),
        designs=tuple(GatedDesign(file, None, None, None, "not evaluated", "none", None, (), ()) for file in files),
        provenance=GateProvenance(
            tailstack_version=__version__,
            policy_name="(not read)",
            policy_sha256=None,
            waivers_sha256=None,
            baseline_sha256=None,
            today=today.isoformat(),
            not_included=NOT_INCLUDED,
        ),
    )


def unwritten(record: GateRecord, problems: Iterable[Problem]) -> GateRecord:
    """The record of a gate that judged and could not leave its answer everywhere it was asked to: no verdict, whatever
    the designs came to, and the reasons before all findings."""
    reasons = tuple(_finding("not-evaluated", problem, ()) for problem in problems)
    code = record.exit_code if record.verdict == "not evaluated" else 3
    return replace(record, verdict="not evaluated", exit_code=code, findings=(*reasons, *record.findings))


def _finding(rule: str, problem: Problem, files: Sequence[str]) -> GateFinding:
    return GateFinding(
        rule=rule,
        severity="error",
        file=problem.file or (files[0] if files else "tailstack gate"),
        line=problem.line,
        column=problem.column,
        pointer=problem.pointer if problem.file else "",
        message=problem.detail + (f" — {problem.hint}" if problem.hint else ""),
        value=None,
        limit=None,
        suppressed_by=None,
    )
