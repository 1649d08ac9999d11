"""Everything that can happen, in random order, against a model of sixty lines that knows nothing of databases.

The seed is part of a test's name.  A step that the model does not foresee fails at once; in the end every job that was
not cancelled has the very answer of an undisturbed run.
"""

from __future__ import annotations

import hashlib
import random
from dataclasses import dataclass, field
from typing import Any

import pytest
from store_scenes import LEASE, Clock, claim, find, record, submit

from tailstack_service.jobs.store import jobs, queue, results, upkeep, workers
from tailstack_service.jobs.store.database import Database
from tailstack_service.jobs.store.jobs import Job
from tailstack_service.jobs.store.queue import Claim
from tailstack_service.processes.task import ADVANCE, UnitResult

STEPS = 260


def computed(request: bytes, spec: bytes) -> bytes:
    return hashlib.sha256(request + spec).digest()


def advanced(request: bytes, recorded: tuple[UnitResult, ...]) -> dict[str, object]:
    """Two rounds of units, their number drawn from the request; then the answer."""
    rounds = [1 + request[-1] % 4, 1 + request[-2] % 3]
    if len(recorded) < sum(rounds):
        number = 0 if not recorded else 1
        assert len(recorded) == sum(rounds[:number])
        return {"more": tuple(b'{"round":%d,"unit":%d}' % (number, k) for k in range(rounds[number]))}
    parts = [one.spec.hex() + "=" + one.result.hex() for one in recorded]
    assert [one.result for one in recorded] == [computed(request, one.spec) for one in recorded]
    return {"answer": ("{" + f'"parts":"{";".join(parts)}"' + "}").encode()}


def undisturbed(request: bytes) -> bytes:
    recorded: tuple[UnitResult, ...] = ()
    while "answer" not in (step := advanced(request, recorded)):
        specs = step["more"]
        assert isinstance(specs, tuple)
        recorded += tuple(UnitResult(0, spec, computed(request, spec)) for spec in specs)
    assert isinstance(step["answer"], bytes)
    return step["answer"]


@dataclass
class UnitModel:
    token: int = 0
    state: str = "ready"
    until: float = 0.0


@dataclass
class JobModel:
    version: str
    state: str = "unfinished"
    generation: int = 1
    done: int = 0
    units: dict[int, UnitModel] = field(default_factory=lambda: {0: UnitModel()})

    def held(self, claimed: Claim) -> UnitModel | None:
        """The unit, if this claim still has it."""
        unit = self.units.get(claimed.index)
        current = self.state == "unfinished" and self.generation == claimed.generation and unit is not None
        return unit if current and unit and unit.token == claimed.token and unit.state == "leased" else None

    def recorded(self, claimed: Claim) -> bool:
        unit = self.units.get(claimed.index)
        same = self.generation == claimed.generation and unit is not None and unit.token == claimed.token
        return same and unit is not None and unit.state == "recorded"

    def end(self, state: str) -> None:
        self.state = state
        self.units = {number: unit for number, unit in self.units.items() if unit.state == "recorded"}

    def add(self, count: int) -> None:
        first = max(self.units) + 1
        self.units |= {first + k: UnitModel() for k in range(count)}

    def can_be_claimed(self, now: float) -> set[int]:
        if self.state != "unfinished":
            return set()
        return {n for n, u in self.units.items() if u.state == "ready" or (u.state == "leased" and u.until < now)}


class Play:
    """The store and its model, moved by the same steps."""

    def __init__(self, store: Database, clock: Clock, seed: int) -> None:
        self.store, self.clock, self.random = store, clock, random.Random(seed)
        self.jobs: dict[str, tuple[Job, bytes]] = {}
        self.model: dict[str, JobModel] = {}
        self.claims: list[tuple[str, Claim]] = []  # also those that are lost
        self.seen: dict[str, float] = {}
        self.counted = {"records": 0, "refused": 0, "again": 0, "lost": 0, "resets": 0, "expired": 0}

    def submit(self) -> None:
        request = b'{"n":%d}' % len(self.jobs) + self.random.randbytes(2)
        version = self.random.choice("12")
        job = submit(self.store, request, solver_version=version)
        self.jobs[job.id], self.model[job.id] = (job, request), JobModel(version)

    def live(self) -> set[str]:
        return {version for version, at in self.seen.items() if at > self.clock.now - LEASE}

    def claim(self) -> None:
        version = self.random.choice("12")
        if self.random.random() < 0.8:
            workers.report_alive(self.store, f"w{version}", "host", 1, version, "pool", 1)
            self.seen[version] = self.clock.now
        limit = self.random.randint(1, 5)
        others = self.live() - {version}
        possible = {
            (job_id, number)
            for job_id, job in self.model.items()
            if job.version not in others
            for number in job.can_be_claimed(self.clock.now)
        }
        found = claim(self.store, f"w{version}", limit, solver_version=version, max_attempts=10_000)
        assert bool(found) == bool(possible)
        assert len({(one.job_id, one.index) for one in found}) == len(found) <= limit
        kept = sum(self.model[job_id].version == version for job_id, _ in possible)
        assert len(found) >= min(limit, kept and 1)
        for one in found:
            job = self.model[one.job_id]
            if job.version != version:
                job.version, job.generation, job.done, job.units = version, job.generation + 1, 0, {0: UnitModel()}
                self.counted["resets"] += 1
            else:
                assert (one.job_id, one.index) in possible
            unit = job.units[one.index]
            self.counted["expired"] += unit.state == "leased"
            assert (one.generation, one.token) == (job.generation, unit.token + 1)  # tokens only grow
            assert one.request == self.jobs[one.job_id][1]
            unit.token, unit.state, unit.until = one.token, "leased", self.clock.now + LEASE
            self.claims.append((f"w{version}", one))

    def record(self) -> None:
        _, one = self.random.choice(self.claims)
        job, request = self.model[one.job_id], self.jobs[one.job_id][1]
        unit, again = job.held(one), job.recorded(one)
        outcome = advanced(request, one.results) if one.spec == ADVANCE else {"result": computed(request, one.spec)}
        assert record(self.store, one, **outcome) == (unit is not None or again)
        self.counted["records" if unit else "again" if again else "refused"] += 1
        if unit is None:
            return
        unit.state, job.done = "recorded", job.done + 1
        if "answer" in outcome:
            job.end("succeeded")
        elif "more" in outcome:
            assert isinstance(outcome["more"], tuple)
            job.add(len(outcome["more"]))
        elif all(other.state == "recorded" for other in job.units.values()):
            job.add(1)

    def release(self) -> None:
        _, one = self.random.choice(self.claims)
        unit = self.model[one.job_id].held(one)
        queue.release(self.store, one, died=False)
        if unit is not None:
            unit.state = "ready"

    def renew(self) -> None:
        worker_id = self.random.choice(["w1", "w2"])
        mine = [one for owner, one in self.claims if owner == worker_id]
        mine = self.random.sample(mine, min(len(mine), 8))
        expected = [one for one in mine if not (self.holds(one) or self.model[one.job_id].recorded(one))]
        assert queue.renew(self.store, worker_id, mine, LEASE) == expected
        self.counted["lost"] += len(expected)
        for one in mine:
            unit = self.holds(one)
            if unit is not None:
                unit.until = self.clock.now + LEASE

    def holds(self, one: Claim) -> UnitModel | None:
        return self.model[one.job_id].held(one)

    def cancel(self) -> None:
        job_id = self.random.choice(list(self.jobs))
        jobs.cancel_job(self.store, "acme", job_id)
        if self.model[job_id].state == "unfinished":
            self.model[job_id].end("cancelled")

    def step(self) -> None:
        moves: dict[Any, float] = {self.submit: 2, self.claim: 6, self.record: 9, self.release: 1, self.renew: 1}
        if len(self.jobs) > 4:
            moves[self.cancel] = 0.25
        if not self.claims:
            moves = {self.submit: 1, self.claim: 2}
        self.random.choices(list(moves), list(moves.values()))[0]()
        self.clock.advance(self.random.choice([0, 0, 0, 0.1, 1, LEASE / 2, LEASE + 1]))

    def compare(self) -> None:
        for job_id, model in self.model.items():
            job = find(self.store, self.jobs[job_id][0])
            assert job.generation == model.generation
            assert job.units_done == model.done
            assert job.is_over == (model.state != "unfinished")


@pytest.mark.long
@pytest.mark.hostile
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_random_interleavings_agree_with_the_model(store: Database, clock: Clock, seed: int, run_seed: int) -> None:
    play = Play(store, clock, seed + 10 * run_seed)
    for number in range(20 * STEPS):  # until each thing that can happen did: STEPS steps may leave out the rarest
        play.step()
        if number % 20 == 0:
            play.compare()
        if number >= STEPS and all(play.counted.values()):
            break
    assert all(play.counted.values()), play.counted  # each thing that can happen did
    assert all(check.ok for check in upkeep.check_database(store)), upkeep.check_database(store)
    clock.advance(10 * LEASE)
    while held := claim(store, "last", 3, solver_version="3"):
        for one in held:
            request = play.jobs[one.job_id][1]
            done = advanced(request, one.results) if one.spec == ADVANCE else {"result": computed(request, one.spec)}
            assert record(store, one, **done)
    for job_id, (job, request) in play.jobs.items():
        ended = find(store, job)
        if play.model[job_id].state == "cancelled":
            assert ended.state == "cancelled"
            continue
        assert ended.result_sha256 is not None
        kept = results.read_result(store, "acme", ended.result_sha256)
        assert kept is not None
        assert kept.body == undisturbed(request)
    assert all(check.ok for check in upkeep.check_database(store)), upkeep.check_database(store)
