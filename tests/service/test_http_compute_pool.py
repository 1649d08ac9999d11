"""Places to compute: processes that are killed when they have to be, and shared, so that nobody waits for the large
request of somebody else."""

from __future__ import annotations

import asyncio
import json
import operator
import os
import random
import re
import signal
import sqlite3
import threading
from collections.abc import AsyncIterator, Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager, closing
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import httpx
import psutil
import pytest
from service_scenes import Caller, client_with, large_design, small_design
from starlette.requests import Request
from strange_units import stand_still, wait_for

from tailstack import load_design, losses, score
from tailstack.design.write import data_to_yaml
from tailstack.errors import LimitError
from tailstack_service.http import compute_pool
from tailstack_service.http.compute_pool import CallerLeft, ComputePool, FairQueue
from tailstack_service.jobs.store import jobs
from tailstack_service.operations import operation, perform
from tailstack_service.problems import RefusedAt, TransportError
from tailstack_service.processes import birth, pool
from tailstack_service.processes.pool import ComputingProcess
from tailstack_service.processes.task import Defect, Died, Estimated, RawRequest
from tailstack_service.settings import Settings
from waiting import LIMIT_SECONDS, until, until_async

QUICK, LONG = 0.0, 60.0  # seconds expected
BUSY = partial(sum, range(10**12))  # hours of CPU


def read_then(seconds: float, rest: Callable[[], Any]) -> Any:
    """A request that is read in no time, and whose rest is expected to take so many seconds."""
    return Estimated(seconds, rest)


def read_and_break() -> Any:
    """A request that is read, and whose rest breaks; it holds what cannot be sent, as that of an operation does."""
    return Estimated(QUICK, lambda: 1 / 0)


def request(tenant: str = "a") -> Request:
    return Caller(tenant).request()


@asynccontextmanager
async def some(count: int = 2, waiting: int = 8, seconds: float = 60.0) -> AsyncIterator[ComputePool]:
    made = ComputePool(count, waiting, seconds, threading.Event())
    try:
        yield made
    finally:
        pids = made.pids()
        await made.close()
        assert not any(psutil.pid_exists(pid) for pid in pids)


def looks(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Lets the pool look often at what is computed; gives what it had taken at each look, s of the processor.

    Between two of them at least ``LOOK_SECONDS`` pass.
    """
    seen: list[float] = []
    watch = ComputePool._watch

    def watching(computing: ComputePool, computation: Any, taken: float) -> None:
        seen.append(taken)
        watch(computing, computation, taken)

    monkeypatch.setattr(pool, "LOOK_SECONDS", 0.02)
    monkeypatch.setattr(ComputePool, "_watch", watching)
    return seen


@pytest.fixture
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pool, "LOOK_SECONDS", 0.02)
    monkeypatch.setattr(compute_pool, "WORTH_SECONDS", 0.0)


async def test_what_a_call_returns_refuses_or_breaks_arrives() -> None:
    async with some() as computing:
        assert await computing.run(request(), partial(operator.add, 40, 2), QUICK) == 42
        sent = RawRequest("json", b'{"design": {"schema": "tailstack/design/1"}}')
        with pytest.raises(RefusedAt) as refused:
            await computing.run(request(), partial(perform.receive, "score", sent, Settings()), QUICK)
        assert refused.value.slug == "invalid-design"
        assert all(problem.pointer.startswith("/design") for problem in refused.value.problems)
        with pytest.raises(Defect, match="ZeroDivisionError"):
            await computing.run(request(), partial(operator.truediv, 1, 0), QUICK)
        # Nor is what broke lost where what was to be computed holds what cannot be sent
        with pytest.raises(Defect, match="ZeroDivisionError"):
            await computing.run(request(), read_and_break, QUICK)
        assert await computing.run(request(), partial(operator.add, 1, 1), LONG) == 2


async def test_a_process_that_dies_is_replaced_and_while_it_waited_nobodys_loss() -> None:
    async with some(1) as computing:
        with pytest.raises(Died, match="7"):
            await computing.run(request(), partial(os._exit, 7), QUICK)
        assert await computing.run(request(), partial(operator.add, 1, 1), QUICK) == 2
    async with some(1) as computing:
        pid = await computing.run(request(), os.getpid, QUICK)
        os.kill(pid, signal.SIGKILL)
        await until_async(lambda: computing._processes.idle[0].has_ended)
        assert await computing.run(request(), partial(operator.add, 1, 1), QUICK) == 2
        assert computing.kills == 0


async def test_files_that_were_replaced_under_the_service_are_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is computed with some of the old sources and some of the new."""
    monkeypatch.setattr(birth, "digest_code", lambda: "of other sources")
    async with some(1) as computing:
        with pytest.raises(TransportError, match="were replaced") as refused:
            await computing.run(request(), os.getpid, QUICK)
        assert (refused.value.slug, computing.warmth) == ("stopping", "failed")


async def test_what_takes_longer_than_the_limit_is_killed(impatient: None) -> None:
    async with some(1, seconds=0.5) as computing:
        with pytest.raises(LimitError, match="TAILSTACK_MAX_SECONDS"):
            await computing.run(request(), BUSY, LONG)
        assert computing.kills == 1
        assert await computing.run(request(), os.getpid, QUICK) in computing.pids()


async def test_what_nobody_waits_for_any_more_is_killed(impatient: None) -> None:
    async with some(1) as computing:
        pid = await computing.run(request(), os.getpid, QUICK)
        leaving = Caller()
        running = asyncio.create_task(computing.run(leaving.request(), stand_still, LONG))
        waiting = asyncio.create_task(computing.run(leaving.request(), stand_still, LONG))
        await until_async(lambda: computing._under_way == len(computing._long_turns) == 1)
        leaving.gone = True
        for task in (running, waiting):
            with pytest.raises(CallerLeft):
                await task
        await until_async(lambda: not psutil.pid_exists(pid))
        assert await computing.run(request(), partial(operator.add, 1, 1), LONG) == 2


async def test_what_has_just_begun_is_finished_for_who_left(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A new process costs more than what is left of it."""
    seen = looks(monkeypatch)
    async with some(1) as computing:
        pid = await computing.run(request(), os.getpid, QUICK)
        left = asyncio.create_task(
            computing.run(Caller(gone=True).request(), partial(wait_for, tmp_path / "go"), QUICK)
        )
        before = len(seen)
        await until_async(lambda: len(seen) > before + 5)
        (tmp_path / "go").touch()
        await left
        assert computing.pids() == [pid]


async def test_a_stop_ends_what_runs_and_what_waits() -> None:
    async with some(1) as computing:
        tasks = [asyncio.create_task(computing.run(request(), stand_still, LONG)) for _ in range(3)]
        await until_async(lambda: (computing._under_way, len(computing._long_turns)) == (1, 2))
        computing._stopping.set()
        for task in (*tasks, computing.run(request(), os.getpid, QUICK)):
            with pytest.raises(TransportError) as refused:
                await task
            assert refused.value.slug == "stopping"


async def test_something_quick_never_waits_for_something_long(tmp_path: Path) -> None:
    """Of two processes long computations have one, however many wait, and quick ones have both."""
    async with some(2) as computing:
        long = [asyncio.create_task(computing.run(request(), stand_still, LONG)) for _ in range(4)]
        await until_async(lambda: (computing._long, len(computing._long_turns)) == (1, 3))
        for _ in range(3):
            assert await computing.run(request(), partial(operator.add, 1, 1), QUICK) == 2
        assert not any(task.done() for task in long)
        for task in long:
            task.cancel()
        await asyncio.gather(*long, return_exceptions=True)
        call = partial(wait_for, tmp_path / "go")
        at_once = [asyncio.create_task(computing.run(request(), call, QUICK)) for _ in range(2)]
        await until_async(lambda: computing._under_way == 2)
        (tmp_path / "go").touch()
        await asyncio.gather(*at_once)
        assert len(computing.pids()) == 2


async def test_seconds_are_those_of_the_processor(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """What waits for the processor on a busy machine, or sleeps, uses none of its time."""
    seen = looks(monkeypatch)
    async with some(1, seconds=0.5) as computing:
        waits = asyncio.create_task(computing.run(request(), partial(wait_for, tmp_path / "go"), LONG))
        await until_async(lambda: len(seen) * pool.LOOK_SECONDS > 3 * computing.seconds)
        (tmp_path / "go").touch()
        await waits
        assert computing.kills == 0


async def test_what_uses_no_processor_at_all_is_given_up(impatient: None) -> None:
    async with some(1) as computing:
        computing._hang_seconds = 1.0
        with pytest.raises(Died, match="no processor time"):
            await computing.run(request(), stand_still, LONG)
        assert computing.kills == 1


async def test_what_was_read_and_takes_long_waits_for_its_turn_where_the_long_ones_are_many(tmp_path: Path) -> None:
    """Its process is given back: a flood of what looks short until it is read keeps nobody waiting."""
    async with some(2, waiting=20) as computing:
        call = partial(read_then, LONG, partial(wait_for, tmp_path / "go"))
        flood = [asyncio.create_task(computing.run(request("greedy"), call, QUICK)) for _ in range(6)]
        await until_async(lambda: computing._long == 1 and len(computing._long_turns) == 5)
        assert await computing.run(request("modest"), partial(operator.add, 1, 1), QUICK) == 2
        assert not any(task.done() for task in flood)
        (tmp_path / "go").touch()
        await asyncio.gather(*flood)
        assert (computing._long, computing._under_way, computing.kills) == (0, 0, 0)


async def test_processor_time_is_paid_for_and_not_waiting(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A small score that waits for a busy machine, or a disk, costs its tenant no turn."""
    seen = looks(monkeypatch)
    async with some(1) as computing:
        await computing.run(request(), partial(operator.add, 1, 1), QUICK)
        before = computing._quick_turns._used["a"]
        waits = asyncio.create_task(computing.run(request(), partial(wait_for, tmp_path / "go"), QUICK))
        seen.clear()
        await until_async(lambda: len(seen) > 40)
        (tmp_path / "go").touch()
        await waits
        waited = len(seen) * pool.LOOK_SECONDS  # at least
        assert computing._quick_turns._used["a"] - before < waited / 2


async def test_what_nobody_waits_for_any_more_is_never_begun(monkeypatch: pytest.MonkeyPatch) -> None:
    """... when its turn comes before anybody has looked whether its caller is there: it would have to be killed."""
    monkeypatch.setattr(pool, "LOOK_SECONDS", 30.0)
    async with some(1) as computing:
        leaving = Caller()
        tasks = [asyncio.create_task(computing.run(leaving.request(), BUSY, LONG)) for _ in range(3)]
        await until_async(lambda: len(computing._long_turns) == 2)
        leaving.gone = True
        tasks[0].cancel()
        for left in tasks[1:]:
            with pytest.raises(CallerLeft):
                await left
        assert (computing.kills, computing._under_way) == (1, 0)
        assert await computing.run(request(), partial(operator.add, 1, 1), QUICK) == 2


async def test_a_process_that_is_not_there_yet_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its computation was cancelled while it was being forked: it counts as killed, and its place is free."""
    there = asyncio.Event()

    async def wait(process: ComputingProcess) -> Any:
        await there.wait()
        return await opened(process)

    opened = ComputingProcess._open
    monkeypatch.setattr(ComputingProcess, "_open", wait)
    async with some(1) as computing:
        early = asyncio.create_task(computing.run(request(), BUSY, LONG))
        await until_async(lambda: computing._under_way == 1)
        early.cancel()
        await until_async(lambda: computing._under_way == 0)
        assert computing.kills == 1
        there.set()
        assert await computing.run(request(), partial(operator.add, 1, 1), QUICK) == 2


async def test_what_is_soon_done_is_finished_for_a_caller_who_left(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """By its processor time: on a busy machine it is no nearer to its end, and every process killed makes it busier."""
    seen = looks(monkeypatch)
    monkeypatch.setattr(compute_pool, "WORTH_SECONDS", 0.2)
    async with some(1) as computing:
        leaving = Caller()
        call = partial(read_then, 0.4, partial(wait_for, tmp_path / "go"))
        running = asyncio.create_task(computing.run(leaving.request(), call, QUICK))
        await until_async(lambda: computing._under_way == 1)
        leaving.gone = True
        await until_async(lambda: len(seen) * pool.LOOK_SECONDS > 0.8)  # longer than expected, unused
        (tmp_path / "go").touch()
        assert await running is None
        assert computing.kills == 0


async def test_what_goes_on_after_the_reading_ends_as_it_should() -> None:
    """Also from a process that goes on with what it has read."""
    async with some() as computing:
        with pytest.raises(Defect, match="ZeroDivisionError"):
            await computing.run(request(), partial(read_then, LONG, partial(operator.truediv, 1, 0)), QUICK)
        assert await computing.run(request(), partial(operator.add, 1, 1), QUICK) == 2
        assert computing.kills == 0
    async with some(1) as computing:
        call = partial(read_then, LONG, partial(operator.add, 1, 1))
        assert await computing.run(request(), call, QUICK) == 2


def taken(turns: FairQueue, *names: str, expected: float = 0.0) -> list[str]:
    """The order in which computations are taken, each named by its tenant and a number."""
    for name in names:
        turns.put(cast(Any, SimpleNamespace(tenant=name[0], name=name, expected=expected)))
    return [cast(Any, turns.take()).name for _ in range(len(turns))]


def test_the_order_of_turns() -> None:
    turns = FairQueue()
    assert taken(turns, "a1", "a2", "a3", "b1", "c1", "b2") == ["a1", "b1", "c1", "a2", "b2", "a3"]
    assert not turns
    # a overran by ten seconds: the next five of b, two seconds each, come before it.
    turns = FairQueue()
    assert taken(turns, "a1", "b1", expected=2.0) == ["a1", "b1"]
    turns.charge("a", 9.0)
    names = [f"b{k}" for k in range(6)]
    assert taken(turns, "a2", *names, expected=2.0) == [*names[:5], "a2", names[5]]
    # Who comes after a while is served in its turn, and not until it has used as much as the others.
    turns = FairQueue()
    taken(turns, *(f"a{k}" for k in range(9)), expected=1.0)
    assert taken(turns, "a1", "b1", "a2", "b2", "b3", expected=1.0)[-1] != "a2"


async def test_who_fills_the_room_is_the_one_who_is_refused(tmp_path: Path) -> None:
    async with some(1, waiting=3) as computing:
        call = partial(wait_for, tmp_path / "go")
        asked = [asyncio.create_task(computing.run(request("a"), call, LONG)) for _ in range(4)]
        await until_async(lambda: len(computing._long_turns) == 3)
        with pytest.raises(TransportError) as refused:
            await computing.run(request("a"), os.getpid, LONG)
        assert (refused.value.slug, refused.value.headers) == ("busy", {"Retry-After": "2"})
        assert "3 wait, the limit" in str(refused.value)
        modest = asyncio.create_task(computing.run(request("b"), os.getpid, LONG))
        await until_async(asked[3].done)
        (tmp_path / "go").touch()
        assert await modest in computing.pids()
        ends = await asyncio.gather(*asked, return_exceptions=True)
        assert [isinstance(end, TransportError) for end in ends] == [False, False, False, True]


async def test_what_was_taken_for_quick_and_is_not_is_one_of_the_long_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    """... where it is; of two, one begins anew when the other is done, and pays for the process that it took."""
    monkeypatch.setattr(compute_pool, "OVERRUN_SECONDS", 0.3)
    monkeypatch.setattr(pool, "LOOK_SECONDS", 0.02)
    async with some(2) as computing:
        slow = [asyncio.create_task(computing.run(request(), BUSY, QUICK)) for _ in range(2)]
        await until_async(lambda: computing._long == 1 and computing.kills == 1)
        assert await computing.run(request("b"), partial(operator.add, 1, 1), QUICK) == 2
        assert not any(task.done() for task in slow)
        assert computing._quick_turns._used["a"] > compute_pool.BIRTH_SECONDS
        for task in slow:
            task.cancel()
        await asyncio.gather(*slow, return_exceptions=True)


# --- how long something takes ---------------------------------------------------------------------


def test_size_and_form_say_what_is_quick() -> None:
    for size, quick in (
        ((8, 2, 1), True),
        ((24, 2, 2), True),
        ((12, 2, 5), True),
        ((200, 8, 1), False),
        ((8, 2, 50), False),
        ((200, 8, 200), False),
    ):
        assert (operation.score_seconds([operation.Size(*size)]) <= compute_pool.QUICK_SECONDS) == quick
    for form in ("application/vnd.apache.parquet", "model/step"):
        assert operation.reading_seconds(RawRequest(form, b"x")) > compute_pool.QUICK_SECONDS


@pytest.mark.parametrize(
    ("fiducials", "targets", "limits", "missed"),
    [(8, 1, 1, ""), (8, 6, 1, ""), (8, 3, 2, "all"), (12, 6, 4, ""), (30, 4, 1, ""), (33, 4, 1, "one")],
)
def test_the_losses_of_a_score_are_expected_at_what_they_take(
    fiducials: int, targets: int, limits: int, missed: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """independent: what the search is seen to do, gains of images and exact laws, counted while a score is computed."""
    draw = random.Random(4)
    design = small_design(optimise=None, requirements=[{"name": f"r{k}", "limit_mm": 1 + k} for k in range(limits)])
    design["fiducials"]["points"] = [
        {"position_mm": [draw.uniform(-40, 40), draw.uniform(-40, 40), draw.uniform(-80, 5)]} for _ in range(fiducials)
    ]
    design["targets"] = [{"name": f"t{k}", "position_mm": [k, 0, 70]} for k in range(targets)]
    if missed:
        holder = design["fiducials"] if missed == "all" else design["fiducials"]["points"][-1]
        holder["loss_probability"] = 0.01
    gains, laws = [0], [0]
    lose, law_without = losses.lose, losses.LossSearch._law_without

    def count_gains(*asked: Any) -> None:
        aims, weights = asked[1], asked[6]
        gains[0] += len(aims) * weights.size
        lose(*asked)

    def count_laws(search: Any, *asked: Any) -> Any:
        laws[0] += 1
        return law_without(search, *asked)

    monkeypatch.setattr(losses, "lose", count_gains)
    monkeypatch.setattr(losses.LossSearch, "_law_without", count_laws)
    loaded = load_design(design)
    score(loaded)
    size = operation.size_of(loaded)
    assert size.missed == {"": 0, "one": 1, "all": fiducials}[missed]

    def expected(**per: float) -> float:
        """With so many seconds for each of these, and none for the others."""
        for name in ("GAIN_SECONDS", "LAW_SECONDS", "MISSED_SECONDS"):
            monkeypatch.setattr(operation, name, per.get(name, 0.0))
        return operation.score_seconds([size])

    plain = expected()
    assert expected(GAIN_SECONDS=1.0) - plain == pytest.approx(gains[0], rel=1e-9)
    # one to ten of a requirement at a target are asked before the worst is known; a mixture is made of both errors
    asked_for = expected(LAW_SECONDS=1.0, MISSED_SECONDS=2.0) - plain
    assert abs(asked_for - laws[0]) <= 10 * targets * limits


def expected_seconds(name: str, sent: RawRequest) -> float:
    """How long the rest of a request is expected to take, once it is read."""
    found = perform.receive(name, sent, Settings())
    assert isinstance(found, Estimated), found
    return found.seconds


def as_json(body: dict[str, Any]) -> RawRequest:
    return RawRequest("json", json.dumps(body).encode())


def test_what_is_asked_without_losses_is_expected_without_them() -> None:
    design = many_targets()
    design["fiducials"]["loss_probability"] = 0.01
    asked, spared = (expected_seconds("score", as_json({"design": design, "losses": each})) for each in (True, False))
    size = operation.size_of(load_design(design))
    assert size == (200, 2, 35, 35, 200)
    assert (asked, spared) == (operation.score_seconds([size]), operation.score_seconds([size], losses=False))
    assert asked > spared
    every = operation.score_seconds([size._replace(missed=0)], losses=False)
    assert spared > 5 * every, "what is missed is in every score"


def many_targets() -> dict[str, Any]:
    """A large design with 35 targets: 15 of them the samples of a region."""
    region = {"sphere": {"centre_mm": [0, 0, 60], "radius_mm": 5}}
    return large_design(
        [{"name": f"t{k}", "position_mm": [k, 0, 70]} for k in range(20)] + [{"name": "ball", "region": region}]
    )


def escaped(text: str) -> str:
    """The same keys, each first letter written as an escape."""
    return re.sub(r"^( *(?:- )?)([a-z])([a-z_]*):", lambda m: f'{m[1]}"\\x{ord(m[2]):02x}{m[3]}":', text, flags=re.M)


def disguises() -> dict[str, tuple[str, RawRequest]]:
    """One large design as many requests, none of which says by its words how long it takes."""
    design = many_targets()
    yaml, one = data_to_yaml(design), json.dumps({"design": design})
    gate = json.dumps({"designs": [{"file": "a.yaml", "design": design}], "mode": "analytic"})
    texts = json.dumps({"designs": [{"file": "a.yaml", "text": escaped(yaml)}], "mode": "analytic"})
    return {
        "YAML": ("score", RawRequest("yaml", yaml.encode())),
        "YAML with escaped keys": ("score", RawRequest("yaml", escaped(yaml).encode())),
        "JSON": ("score", RawRequest("json", one.encode())),
        "gate": ("gate", RawRequest("json", gate.encode())),
        "gate, escaped mode": ("gate", RawRequest("json", gate.replace('"analytic"', '"\\u0061nalytic"').encode())),
        "gate of escaped text": ("gate", RawRequest("json", texts.encode())),
        "layout": ("layout", RawRequest("json", one.encode())),
        "check of a job": ("verification", RawRequest("json", one.encode())),
        "table": ("batch", as_json({"design": design, "table": {"/views/0/fiducial_noise_px": [0.3]}})),
    }  # fmt: skip


@pytest.mark.parametrize("disguise", disguises())
def test_a_large_design_is_long_whatever_it_looks_like(disguise: str) -> None:
    """The estimate is that of the design as it was read: the same for every way to write it."""
    assert expected_seconds(*disguises()[disguise]) >= operation.score_seconds([operation.Size(200, 2, 20)])


def test_second_order_is_long_however_it_is_written() -> None:
    plain = as_json({"design": small_design(targets=many_targets()["targets"]), "second_order": True})
    written = RawRequest("json", plain.body.replace(b"second_", b"second\\u005f"))
    assert expected_seconds("score", written) == expected_seconds("score", plain) > 1.0


def test_losses_count_in_a_gate_that_judges_them() -> None:
    """A policy decides whether the worst loss is looked for, and with it how long a gate takes."""

    def seconds(rules: dict[str, Any]) -> float:
        body = {
            "designs": [{"file": "a.yaml", "design": small_design()}],
            "policy": {"schema": "tailstack/policy/1", "name": "p", "rules": rules},
            "mode": "analytic",
        }
        return expected_seconds("gate", as_json(body))

    judged = seconds({"survives-loss": {"lost": 1}})
    assert judged > seconds({"p95": {"limit_mm": 0.6}}) > 0.0


# --- over HTTP ------------------------------------------------------------------------------------


def test_many_scores_at_once_are_all_answered_alike() -> None:
    body = {"design": small_design()}

    def post(client: httpx.Client) -> Any:
        response = client.post("/v1/scores", json=body)
        assert response.status_code == 200, response.text
        return response.json()

    with client_with(Settings(max_waiting=100)) as client, ThreadPoolExecutor(8) as pool:
        answers = list(pool.map(post, [client] * 40))
    assert all(answer == answers[0] for answer in answers)


@pytest.mark.long
def test_a_writer_that_is_stopped_keeps_nobody_from_reading(tmp_path: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Who writes waits for it."""
    submitting: list[bool] = []
    submit_job = jobs.submit_job

    def submit(*arguments: Any, **named: Any) -> Any:
        submitting.append(True)
        return submit_job(*arguments, **named)

    monkeypatch.setattr(jobs, "submit_job", submit)
    path, body = tmp_path / "jobs.sqlite3", {"design": small_design(), "trials": 1000}
    with client_with(Settings(database=f"sqlite:///{path}")) as client, ThreadPoolExecutor(20) as pool:
        assert client.post("/v1/verifications", json=body).status_code == 202
        with closing(sqlite3.connect(path, isolation_level=None)) as other:
            other.execute("BEGIN IMMEDIATE")
            waiting = [pool.submit(client.post, "/v1/verifications", json=body) for _ in range(12)]
            until(lambda: len(submitting) > 1)  # somebody writes, as far as that goes
            assert len(client.get("/v1/jobs").json()["jobs"]) == 1
            assert client.get("/health/ready").status_code == 200
            assert not any(each.done() for each in waiting)
            other.execute("ROLLBACK")
            assert [each.result(LIMIT_SECONDS).status_code for each in waiting] == [202] * 12


def test_scores_need_no_database(tmp_path: Any) -> None:
    """The directory of the database is gone: scores are answered, jobs are refused for a while."""
    settings = Settings(database=f"sqlite:///{tmp_path / 'jobs.sqlite3'}")
    with client_with(settings) as client:
        for path in tmp_path.iterdir():
            path.unlink()
        body = {"design": small_design()}
        assert client.post("/v1/scores", json=body).status_code == 200
        assert client.post("/v1/validations", json=body).status_code == 200
        assert client.post("/v1/scores", json={**body, "patch": {"name": "x"}}).status_code == 200
        assert client.post("/v1/scores", json={"design_sha256": "0" * 64}).status_code == 503
        refused = client.post("/v1/verifications", json=body)
        assert refused.status_code == 503, refused.text
        assert int(refused.headers["retry-after"]) > 0
        assert str(tmp_path) not in refused.text
        ready = client.get("/health/ready")
        assert (ready.status_code, ready.json()["status"]) == (503, "no database")
