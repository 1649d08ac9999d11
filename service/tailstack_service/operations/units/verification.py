"""A Monte Carlo check in units: shards of trials, installed units, quantiles by radial sampling.

``verify`` is replayed against what is recorded.  It looks at the same trials in the same order however they were cut
and wherever they were drawn, so the document is that of one undisturbed process, byte for byte.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from tailstack.geometry.arrays import Array
from tailstack.laws import Drawn
from tailstack.montecarlo import MAX_TRIALS
from tailstack.montecarlo.plan import ChainPlan, compile_plan
from tailstack.montecarlo.radial import RadialEstimate
from tailstack.montecarlo.shards import (
    Pending,
    Shard,
    TrialsTask,
    compute_shard,
    pack,
    shard_from_bytes,
    shard_to_bytes,
    shard_trials,
    spans,
    unpack,
)
from tailstack.verification import (
    UNITS,
    PreparedDesign,
    RadialTask,
    Sampling,
    UnitsTask,
    prepare,
    radial_estimate,
    unit_quantiles,
    verify_prepared,
)

from ...documents import to_json
from ...processes.task import Outcome, UnitResult
from ..content import canonical, loaded_design


def plan(request: dict[str, Any], results: Iterable[UnitResult]) -> Outcome:
    """The check as far as what is recorded carries it."""
    return plan_check(request["design"], sampling_of(request), results)


def plan_check(design: dict[str, Any], sampling: Sampling, results: Iterable[UnitResult]) -> Outcome:
    """:func:`plan` for a design document that is sampled in a way of its own."""
    held = {unit.spec: unit.result for unit in results}
    sampler = RecordedSampler(held)
    try:
        answer = verify_prepared(prepare_model(canonical(design)), sampling, threads=1, sampler=sampler)
    except Pending as pending:
        specs = tuple(dict.fromkeys(pending.wanted))
        note = f"Monte Carlo: {len(held)} parts sampled, {len(specs)} more to come"
        return Outcome(more=specs, remaining=pending.remaining, note=note)
    return Outcome(answer=to_json(answer))


def compute(request: dict[str, Any], spec: dict[str, Any]) -> bytes:
    """One part: what :class:`RecordedSampler` asked for."""
    ready, seed = prepare_model(canonical(request["design"])), sampling_of(request).seed
    if spec["what"] == "radial":
        vertex = tuple((name, end) for name, end in spec["vertex"])
        wanted = RadialTask(
            spec["target"], spec["error"], spec["quantile"], seed, vertex, sampling_of(request).precision
        )
        return canonical(radial_estimate(ready, wanted)._asdict())
    level = Drawn(spec["level"]) if spec["what"] == "units" else None
    plan = _plan(canonical(request["design"]), tuple(spec["vertex"]), spec.get("shots", 1), level)
    if level:
        units = UnitsTask(plan, seed, tuple(map(tuple, spec["wanted"])), level=level)
        return pack({}, [unit_quantiles(units, spec["first"], spec["count"])])
    return shard_to_bytes(
        compute_shard(TrialsTask(plan, seed, spec["first"], spec["stop"], spec["quantile"], True, ready.limits))
    )


def check_request(request: dict[str, Any], design: dict[str, Any]) -> dict[str, Any]:
    """The check of a design that is part of another kind of job, sampled as that one's request says."""
    own = {name: request[name] for name in ("trials", "precision", "max_trials") if request.get(name) is not None}
    return {"design": design, "seed": request.get("seed", 0), "method": "plain", **own}


def sampling_of(request: dict[str, Any]) -> Sampling:
    """What a request asks for.  Raises DesignError."""
    return Sampling(
        request.get("trials"),
        request.get("precision"),
        request.get("seed", 0),
        request.get("method", "plain"),
        request.get("max_trials") or MAX_TRIALS,
    )


@lru_cache(maxsize=4)
def prepare_model(design: bytes) -> PreparedDesign:
    """The linear model of a design in canonical JSON; the last few are kept.  Raises DesignError, IllPosedError."""
    return prepare(loaded_design(design))


@lru_cache(maxsize=8)
def _plan(design: bytes, vertex: tuple[float, ...], shots_per_unit: int, held: Drawn | None) -> ChainPlan:
    system = prepare_model(design).system
    return compile_plan(system, vertex=np.array(vertex), shots_per_unit=shots_per_unit, held=held)


@dataclass(frozen=True, slots=True)
class RecordedSampler:
    """A sampler of parts that are recorded by their specs; it raises Pending with the specs of those that are not."""

    held: Mapping[bytes, bytes]

    def shards(self, wanted: TrialsTask) -> Iterator[Shard]:
        size = shard_trials(wanted.plan, wanted.seed)
        specs = [_trials_spec(wanted, *span) for span in spans(wanted.first, wanted.stop, size)]
        if not all(spec in self.held for spec in specs):
            ahead = [_trials_spec(wanted, *span) for pair in wanted.then for span in spans(*pair, size)]
            end = max([wanted.stop, *(stop for _, stop in wanted.then)])
            self._require([*specs, *ahead], sum(1 for _ in spans(end, wanted.expected, size)))
        return (shard_from_bytes(self.held[spec]) for spec in specs)

    def unit_quantiles(self, wanted: UnitsTask) -> Array:
        shots = wanted.plan.shots_per_unit
        count = max(shard_trials(wanted.plan, wanted.seed) // shots, 1)
        asked = {"what": "units", "vertex": wanted.plan.vertex, "wanted": wanted.wanted, "shots": shots}
        asked["level"] = wanted.level
        specs = [canonical({**asked, "first": first, "count": stop - first}) for first, stop in spans(0, UNITS, count)]
        self._require(specs)
        return np.concatenate([unpack(self.held[spec])[1][0] for spec in specs])

    def radial(self, wanted: RadialTask) -> RadialEstimate:
        fields = {"target": wanted.target, "error": wanted.error, "quantile": wanted.quantile}
        spec = canonical({"what": "radial", "vertex": wanted.vertex, **fields})
        self._require([spec])
        estimate = json.loads(self.held[spec])
        return RadialEstimate(**{**estimate, "interval_mm": tuple(estimate["interval_mm"])})

    def _require(self, specs: list[bytes], remaining: int = 0) -> None:
        if missing := [spec for spec in specs if spec not in self.held]:
            raise Pending(missing, remaining)


def _trials_spec(wanted: TrialsTask, first: int, stop: int) -> bytes:
    span = {"first": first, "stop": stop, "quantile": wanted.quantile}
    return canonical({"what": "trials", "vertex": wanted.plan.vertex, **span})
