"""What jobs of several kinds share when they are cut: spans of a list, and jobs of other kinds inside one job."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence

from ...processes.task import Outcome, UnitResult
from ..content import canonical


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
