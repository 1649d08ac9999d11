"""A whole job by the shortest engine there is: look, compute in any order, look again."""

from __future__ import annotations

from random import Random
from typing import Any

from tailstack_service.operations.content import canonical
from tailstack_service.operations.perform import perform
from tailstack_service.processes.task import ADVANCE, Outcome, Task, UnitResult

ROUNDS = 60


def run_job(
    kind: str, request: dict[str, Any], *, shuffle: int = 0, twice: bool = True
) -> tuple[Outcome, list[UnitResult]]:
    """The last outcome of a job (answer or problem) and everything that was recorded on the way.

    shuffle: seed of the order in which the units of a round are computed.  twice: every look is taken twice and has to
    come to the same.
    """
    order, sent = Random(shuffle), canonical(request)
    recorded: list[UnitResult] = []
    index = 1
    for _ in range(ROUNDS):
        look = Task(kind, sent, ADVANCE, tuple(sorted(recorded, key=lambda unit: unit.index)))
        seen = perform(look)
        again = perform(look) if twice else seen
        told = [(o.more, o.answer, o.problem, o.remaining, o.note) for o in (seen, again)]
        assert told[0] == told[1], "a look is a pure function of what is recorded"
        if not seen.more:
            return seen, recorded
        assert len(set(seen.more)) == len(seen.more)
        assert not set(seen.more) & {unit.spec for unit in recorded}
        wanted = list(enumerate(seen.more, index))
        index += len(wanted)
        order.shuffle(wanted)
        for place, spec in wanted:
            outcome = perform(Task(kind, sent, spec))
            if outcome.problem is not None:
                return outcome, recorded
            assert outcome.result is not None
            recorded.append(UnitResult(place, spec, outcome.result))
    raise AssertionError(f"a {kind} job did not end within {ROUNDS} rounds")
