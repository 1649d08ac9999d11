"""Trials until every limit is decided: the run of a check whose verdict is all that is wanted."""

from __future__ import annotations

from functools import partial

from .montecarlo.sequential import repeated_interval, repeated_ranks, simulate_to_decision
from .sampling import (
    Prepared,
    Progress,
    Quantile,
    Run,
    Sampling,
    Source,
    confidence_at_each,
    confidence_of,
    cvar_decided,
    largest,
    limits_of,
    lowest_quantile,
    questions_of,
    together,
)
from .scoring import P95


def run_sequential(
    ready: Prepared, sampling: Sampling, threads: int | None, progress: Progress | None, source: Source | None
) -> Run:
    confidence = confidence_at_each(ready)
    runs = [
        partial(
            simulate_to_decision, plan, seed=sampling.seed, questions=questions_of(ready, vertex, sampling),
            confidence=confidence, max_trials=sampling.max_trials, quantile=lowest_quantile(ready.system),
            settled=partial(cvar_decided, ready, vertex, sampling), threads=threads, progress=progress,
            limits=limits_of(ready.system), source=None if source is None else source.shards,
        )
        for vertex, plan in ready.plans.items()
    ]  # fmt: skip
    found = dict(zip(ready.plans, together(runs), strict=True))
    wanted = {(name, error, P95) for name, error in ready.vertices}
    wanted |= {(n, r.error, r.quantile) for r in ready.system.requirements for n in r.targets}
    quantiles: dict[tuple[str, str, float], Quantile] = {}
    for name, error, quantile in sorted(wanted):
        at_each = []
        for vertex in ready.vertices[name, error]:
            run = found[vertex]
            ranks = repeated_ranks(run.looks, quantile, confidence)[run.looks.index(run.samples.trials)]
            one = repeated_interval(run.samples, name, error, quantile, ranks)
            at_each.append(Quantile(one.value_mm, one.interval_mm))
        quantiles[name, error, quantile] = largest(at_each)
    reached = max(
        (one.interval_mm[1] - one.interval_mm[0]) / (2 * one.value_mm) if one.value_mm > 0 else 0.0
        for key, one in quantiles.items()
        if key[1:] == ("tcp", P95)
    )
    longest = max((run for run in found.values()), key=lambda run: run.samples.trials)
    reason = "every limit is decided" if all(run.decided for run in found.values()) else "the cap was reached"
    stopping = (
        f"Stopped after {longest.samples.trials} trials because {reason}: a sequential test with up to "
        f"{len(longest.looks)} looks, each limit of a quantile decided wrongly with a probability of at most "
        f"{(1 - confidence_of(ready.system)) / 2:.3g} on either side, over all looks."
    )
    samples = {vertex: run.samples for vertex, run in found.items()}
    return Run(samples, confidence, stopping, reached, quantiles)
