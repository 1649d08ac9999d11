"""What Monte Carlo has to decide about a design: the same for a gate here and for one that is cut into units."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .designs import Computed, Gate
from .waiving import accepted_values

if TYPE_CHECKING:
    from tailstack.results import Verification
    from tailstack.runs import Progress, Sampling


def sampling_of(gate: Gate, computed: Computed) -> Sampling:
    """How a design that was scored is checked: in mode auto until every limit is decided and no longer, in mode verify
    to the policy's precision as well.  Values up to which waivers accept are limits like others.
    """
    from tailstack.montecarlo.sequential import CvarQuestion, Question
    from tailstack.runs import Sampling

    assert computed.score is not None
    assert computed.held is not None
    names = (computed.entry.file, computed.held.name)
    wanted = gate.policy.document.verification
    questions = [
        Question(check.target, check.error, check.quantile, value)
        for check in computed.score.verdict.checks
        if check.risk == "pooled"
        for value in accepted_values(
            gate.waivers, gate.today, computed.added.get(check.requirement, "p95"), check.target, names
        )
    ]
    cvar, means = computed.rules.cvar, []
    if cvar.limit_mm is not None and cvar.severity != "off":
        for target in computed.score.targets:
            values = accepted_values(gate.waivers, gate.today, "cvar", target.name, names)
            means += [CvarQuestion(target.name, limit, cvar.confidence) for limit in (cvar.limit_mm, *values)]
    auto = gate.mode == "auto"
    return Sampling(
        precision=None if auto else wanted.precision,
        seed=gate.seed,
        max_trials=wanted.max_trials,
        sequential=auto,
        questions=tuple(questions),
        cvar=tuple(means),
    )


def verified(gate: Gate, computed: Computed, progress: Progress | None = None) -> Verification:
    """Monte Carlo as the policy says, here and now.  Raises TailstackError."""
    from tailstack.runs import prepare
    from tailstack.verifying import verify_prepared

    assert computed.held is not None
    return verify_prepared(prepare(computed.held), sampling_of(gate, computed), progress=progress)


def looks_of(gate: Gate) -> int:
    """Looks that the checks of a gate are planned with."""
    from tailstack.montecarlo import estimators, sequential

    planned = sequential.planned_looks if gate.mode == "auto" else estimators.planned_looks
    return len(planned(gate.policy.document.verification.max_trials))
