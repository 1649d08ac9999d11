"""How jobs of several kinds are cut: into spans of a list, into jobs of other kinds, or not at all."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from typing import Any

from ...documents import to_json
from ...processes.task import Outcome, UnitResult
from ..content import canonical, design_of
from ..operation import Call, Operation


def plan_spans(what: str, total: int, count: int, results: Iterable[UnitResult]) -> Outcome | list[bytes]:
    """The results of spans of ``count`` of ``total`` things, in their order; an outcome: some are not recorded yet."""
    recorded = {unit.spec: unit.result for unit in results}
    specs = [canonical({"what": what, "first": first, "count": count}) for first in range(0, total, count)]
    missing = tuple(spec for spec in specs if spec not in recorded)
    return Outcome(more=missing, note=f"{total} {what}") if missing else [recorded[spec] for spec in specs]


class Parts:
    """The parts of a job, each planned as a job of its own; a unit says of which part it is."""

    def __init__(self, results: Sequence[UnitResult]) -> None:
        self._results = [(json.loads(unit.spec), unit) for unit in results]
        self._specs: list[bytes] = []
        self._remaining, self._notes = 0, list[str]()

    def results_of(self, part: str | int) -> tuple[UnitResult, ...]:
        """What is recorded of a part, as its own plan knows it."""
        return tuple(
            UnitResult(unit.index, canonical(spec["spec"]), unit.result)
            for spec, unit in self._results
            if spec["of"] == part
        )

    def answer_of(self, part: str | int, step: Outcome) -> bytes | None:
        """The answer of a part, by the step that its plan came to; None: its units are needed first."""
        if step.answer is not None:
            return step.answer
        self._specs += [canonical({"of": part, "spec": json.loads(spec)}) for spec in step.more]
        self._remaining += step.remaining
        self._notes.append(f"{part}: {step.note}")
        return None

    def more(self, note: str = "") -> Outcome | None:
        """The units that all parts need; None: every part has its answer."""
        if not self._specs:
            return None
        return Outcome(more=tuple(self._specs), remaining=self._remaining, note=note or "; ".join(self._notes))


# --- an operation that is not cut ------------------------------------------------------------------------

WHOLE = canonical({"what": "whole"})


def plan_whole(results: Sequence[UnitResult]) -> Outcome:
    """One unit, then the whole record, which it gave."""
    return Outcome(answer=results[0].result) if results else Outcome(more=(WHOLE,))


def compute_whole(operation: Operation, request: dict[str, Any]) -> bytes:
    """The record of an operation, computed by its ``run``."""
    designs = tuple(design_of({"design": request[field]}) for field in operation.designs if field in request)
    options = {name: request[name] for name in operation.options.model_fields if name in request}
    return to_json(operation.run(Call(designs, operation.options.model_validate(options), threads=1)))
