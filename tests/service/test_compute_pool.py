"""Computing processes: one task each, their deaths attributed, none left behind.

What is expected of a result is computed here by hashing, not by the engine.
"""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import AbstractContextManager, closing, contextmanager
from pathlib import Path
from typing import Any

import psutil
import pytest
import strange_units
from strange_units import begun, expected_answer, request

from family import started
from tailstack_service.jobs.engines.engine import Engine, start_engine
from tailstack_service.jobs.engines.pool import PoolEngine
from tailstack_service.processes import birth, child
from tailstack_service.processes.birth import Nursery, make_environment, share_nursery
from tailstack_service.processes.task import ADVANCE, Defect, Died, GivenBack, Outcome, Task, UnitResult
from tailstack_service.settings import Settings
from waiting import LIMIT_SECONDS, until

UNIT = b'{"unit":0}'


def task(do: str = "answer", **options: object) -> Task:
    return Task("verification", request(do, **options), UNIT)


def gone(pid: int) -> bool:
    try:
        return psutil.Process(pid).status() == psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return True


@pytest.fixture(scope="module")
def pool() -> Iterator[PoolEngine]:
    with closing(PoolEngine(2, function=strange_units.FUNCTION)) as engine:
        yield engine


def test_a_task_and_its_outcome_whatever_is_printed_and_with_one_thread(pool: PoolEngine) -> None:
    asked = request(units=1)
    result = pool.submit(Task("verification", asked, UNIT), "one").result(LIMIT_SECONDS).result
    assert result is not None
    look = Task("verification", asked, ADVANCE, (UnitResult(1, UNIT, result),))
    assert pool.submit(look, "two").result(LIMIT_SECONDS).answer == expected_answer(asked)
    for number in range(4):
        assert pool.submit(task("print"), f"print-{number}").result(LIMIT_SECONDS).result
    pool.submit(task(), "environment").result(LIMIT_SECONDS)
    told = psutil.Process(pool.pids()[0]).environ()
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
        assert told[name] == "1"


def test_deaths_and_defects_are_told_with_their_cause(pool: PoolEngine) -> None:
    for number, words in (
        (signal.SIGILL, r"SIGILL \(illegal instruction: kernels built for another processor\)"),
        (signal.SIGKILL, r"SIGKILL \(killed from outside, as where memory runs out\)"),
        (signal.SIGSEGV, r"SIGSEGV \(segmentation fault\)"),
        (signal.SIGRTMIN + 1, rf"signal {signal.SIGRTMIN + 1}$"),
    ):
        with pytest.raises(Died, match=words):
            pool.submit(task("die", signal=int(number)), f"signal-{number}").result(LIMIT_SECONDS)
    with pytest.raises(Died, match="exit code 3"):
        pool.submit(task("leave"), "leave").result(LIMIT_SECONDS)
    with pytest.raises(Defect, match="ArithmeticError: a defect, for the test of it") as caught:
        pool.submit(task("raise"), "raise").result(LIMIT_SECONDS)
    assert "strange_units.py" in str(caught.value)
    with (
        closing(PoolEngine(1, function="no_such_module:perform")) as engine,
        pytest.raises(Defect, match="no_such_mod"),
    ):
        engine.submit(task(), "x").result(LIMIT_SECONDS)


def check_that_each_dies_alone(engine: Engine, count: int) -> None:
    """Two lanes, tasks of both in turn: only those that end their process fail, and the others all come back."""
    tasks = [task("die" if number % 4 == 0 else "answer", number=number) for number in range(count)]
    futures = [engine.submit(one, f"mixed-{number}") for number, one in enumerate(tasks)]
    for number, future in enumerate(futures):
        if number % 4 == 0:
            with pytest.raises(Died, match="SIGKILL"):
                future.result(LIMIT_SECONDS)
        else:
            assert future.result(LIMIT_SECONDS).result


def test_a_death_is_that_of_one_task(pool: PoolEngine) -> None:
    check_that_each_dies_alone(pool, 24)


def test_a_process_that_dies_idle_is_nobodys_fault(pool: PoolEngine, tmp_path: Path) -> None:
    note, go = tmp_path / "note", tmp_path / "go"
    for _ in range(2):
        for pid in pool.pids():
            os.kill(pid, signal.SIGKILL)
        asked = task("wait", note=str(note), until=str(go))
        futures = [pool.submit(asked, f"after-{os.urandom(4).hex()}") for _ in range(2)]
        until(lambda: len(begun(note)) == 2)  # each in a process of its own: neither of the dead is left
        go.touch()
        assert all(future.result(LIMIT_SECONDS).result for future in futures)
        go.unlink()
        note.unlink()


def test_a_kill_stops_the_process_at_once(pool: PoolEngine, tmp_path: Path) -> None:
    """It computes for ever otherwise."""
    note = tmp_path / "note"
    future = pool.submit(task("burn", note=str(note)), "burn")
    ((_, pid),) = until(lambda: begun(note))
    assert pool.seconds(future) > 0.0
    pool.kill(future)
    assert future.cancelled()
    until(lambda: gone(pid) and pool.seconds(future) == 0.0)
    assert pool.submit(task(), "after-burn").result(LIMIT_SECONDS).result


def test_what_waits_can_be_killed_and_harms_nobody(pool: PoolEngine, tmp_path: Path) -> None:
    go = tmp_path / "go"
    running = [pool.submit(task("wait", until=str(go)), f"wait-{k}") for k in range(2)]
    waiting = pool.submit(task(), "waiting")
    assert pool.seconds(waiting) == 0.0
    pool.kill(waiting)
    assert waiting.cancelled()
    go.touch()
    assert all(future.result(LIMIT_SECONDS).result for future in running)


def test_signals_to_the_group_are_left_to_the_worker(pool: PoolEngine, tmp_path: Path) -> None:
    note, go = tmp_path / "note", tmp_path / "go"
    future = pool.submit(task("wait", note=str(note), until=str(go)), "signals")
    until(lambda: begun(note))
    for pid in pool.pids():
        os.kill(pid, signal.SIGINT)
        os.kill(pid, signal.SIGTERM)
    go.touch()
    assert future.result(LIMIT_SECONDS).result


def test_processes_do_not_end_with_the_thread_that_asked(tmp_path: Path) -> None:
    """PR_SET_PDEATHSIG looks at the thread that started a process: a replacement is started under one that ends."""
    note, go = tmp_path / "note", tmp_path / "go"

    def short_life() -> tuple[PoolEngine, Future[Outcome], int]:
        engine = PoolEngine(1, function=strange_units.FUNCTION)
        future = engine.submit(task("wait", note=str(note), until=str(go)), "threads")
        until(lambda: begun(note))
        return engine, future, threading.get_native_id()

    with ThreadPoolExecutor(1) as thread:
        engine, future, number = thread.submit(short_life).result(LIMIT_SECONDS)
    with closing(engine):
        until(lambda: not Path(f"/proc/self/task/{number}").exists())  # the system has let it go
        go.touch()
        assert len(begun(note)) == 1
        assert future.result(LIMIT_SECONDS).result


@pytest.mark.long
def test_a_process_is_replaced_after_many_tasks() -> None:
    with closing(PoolEngine(1, function=strange_units.FUNCTION)) as engine:
        first = engine.pids()
        for number in range(0, child.TASKS, 100):
            for future in [engine.submit(task(), f"{number + k}") for k in range(100)]:
                future.result(LIMIT_SECONDS)
        until(lambda: engine.pids() != first)
        assert engine.submit(task(), "one more").result(LIMIT_SECONDS).result


def test_processes_that_never_begin_are_not_started_for_ever(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(birth, "make_command", lambda *_: [sys.executable, "-c", ""])
    monkeypatch.setattr(birth, "_nursery", None)
    monkeypatch.setattr(birth, "_started", [])
    with closing(PoolEngine(1, function=strange_units.FUNCTION)) as engine, pytest.raises(GivenBack, match="in a row"):
        engine.submit(task(), "x").result(LIMIT_SECONDS)
    for nursery, process in birth._started:
        nursery.wishes.close()
        process.wait(LIMIT_SECONDS)


def test_closing_leaves_no_process() -> None:
    engine = PoolEngine(2, function=strange_units.FUNCTION)
    futures = [engine.submit(task("burn"), f"{k}") for k in range(4)]
    until(lambda: all(engine.seconds(future) > 0.0 for future in futures[:2]))
    pids = engine.pids()
    engine.close()
    assert len(pids) == 2
    assert all(gone(pid) for pid in pids)
    assert all(future.done() for future in futures)


def running(program: str, *arguments: str, **options: Any) -> AbstractContextManager[subprocess.Popen[str]]:
    """A process of its own, with a nursery of its own; nothing of it outlives the block."""
    return started(sys.executable, "-c", program, *arguments, env=make_environment(), **options)


PREPARED = """
from strange_units import FUNCTION, request
from tailstack_service.jobs.engines.pool import PoolEngine
from tailstack_service.processes.birth import prepare_children
from tailstack_service.processes.task import Task
preparing = prepare_children("tailstack_service.operations.perform:warm_up", ("score", "batch", "optimise"))
try:
    preparing.send(None)
except RuntimeError:  # there is no event loop to wait in
    pass
engine = PoolEngine(1, function=FUNCTION)
asked = request("need", module="tailstack.verification")
assert engine.submit(Task("verification", asked, b'{"unit":0}'), "x").result().result
engine.close()
"""


@pytest.mark.long
def test_what_is_born_while_something_is_prepared_has_the_modules() -> None:
    """As the first process of a worker, whose service is about to load its kernels in the same nursery."""
    with running(PREPARED) as process:
        _, err = process.communicate(timeout=LIMIT_SECONDS)
        assert process.returncode == 0, err


JOINED = """
import json, sys, threading
from strange_units import FUNCTION
from tailstack_service.jobs.engines.pool import PoolEngine
from tailstack_service.processes.birth import Nursery, join_nursery
join_nursery(Nursery.read(sys.argv[1]))
engine = PoolEngine(1, function=FUNCTION)  # kept: its process ends with it
print(json.dumps(engine.pids()), flush=True)
threading.Event().wait()
"""


@contextmanager
def beside(nursery: Nursery | None) -> Iterator[tuple[subprocess.Popen[str], psutil.Process]]:
    """A process with which a nursery is shared, and a computing process of its."""
    with running(JOINED, str(nursery), pass_fds=(nursery.wishes.fileno(),)) as process:
        (pid,) = json.loads(process.stdout.readline())
        yield process, psutil.Process(pid)


def test_processes_of_one_service_fork_from_one_and_end_with_their_own() -> None:
    """kill -9 of the one beside: its computing process could not leave by itself, and the others go on."""
    with closing(PoolEngine(1, function=strange_units.FUNCTION)) as engine:
        mine = engine.pids()
        with beside(share_nursery()) as (process, computing):
            assert computing.ppid() == psutil.Process(mine[0]).ppid()
            computing.suspend()
            process.kill()
            until(lambda: gone(computing.pid))
        assert engine.submit(task(), "beside").result(LIMIT_SECONDS).result
        assert engine.pids() == mine


@pytest.mark.parametrize("lost", ["gone", "of other sources"])
def test_a_shared_nursery_that_cannot_be_had_is_replaced_by_an_own(lost: str) -> None:
    shared = share_nursery()
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with ours, theirs:
        if lost == "gone":
            theirs.close()
        told = shared._replace(wishes=ours) if lost == "gone" else shared._replace(code="other")
        with beside(told) as (process, computing):
            assert computing.parents()[1].pid == process.pid


def test_the_end_of_a_nursery_is_that_of_what_it_forked_and_another_follows(tmp_path: Path) -> None:
    note = tmp_path / "note"
    with closing(PoolEngine(2, function=strange_units.FUNCTION)) as engine:
        burning = engine.submit(task("burn", note=str(note)), "burning")
        first = engine.pids()
        until(lambda: begun(note))  # what a process has not begun is begun by the next
        nursery = psutil.Process(first[0]).parent()
        nursery.kill()
        with pytest.raises(Died, match="SIGKILL"):
            burning.result(LIMIT_SECONDS)
        until(lambda: all(gone(pid) for pid in first))
        assert engine.submit(task(), "next").result(LIMIT_SECONDS).result


ORPHAN = """
import socket
from tailstack_service.processes.nursery import Keeper
Keeper(socket.socketpair()[0])._be_born(lambda: print("computes"), 1, None)
"""


def test_a_process_whose_nursery_has_ended_leaves() -> None:
    """It can end between the fork and the wish of what was forked to end with it."""
    with running(ORPHAN) as process:
        assert process.communicate(timeout=LIMIT_SECONDS) == ("", "")
        assert process.returncode == 1


# --- signs of life --------------------------------------------------------------------------------


@pytest.mark.long
def test_a_process_that_stands_still_is_killed_and_one_that_computes_is_not(tmp_path: Path) -> None:
    note, go = tmp_path / "note", tmp_path / "go"
    settings = Settings(worker_processes=2, hang_seconds=2.0)
    with closing(start_engine(settings, function=strange_units.FUNCTION)) as engine:
        stopped = engine.submit(task("burn", note=str(note)), "stopped")
        ((_, victim),) = until(lambda: begun(note))
        computing = engine.submit(task("burn", until=str(go)), "computing")
        until(lambda: engine.seconds(computing))
        os.kill(victim, signal.SIGSTOP)
        with pytest.raises(Died, match="no sign of life: it used no processor time for 2 s"):
            stopped.result(LIMIT_SECONDS)
        assert not psutil.pid_exists(victim)
        assert not computing.done()  # it has computed for as long
        go.touch()
        assert computing.result(LIMIT_SECONDS).result is not None
        deadlocked = engine.submit(task("wait"), "deadlocked")  # it waits for what does not come
        with pytest.raises(Died, match="no sign of life"):
            deadlocked.result(LIMIT_SECONDS)
        assert engine.submit(task(), "next").result(LIMIT_SECONDS).result is not None


@pytest.mark.long
def test_a_task_that_is_too_large_for_the_pipe_of_a_process_that_stands_still() -> None:
    """The worker is still writing it when the process stops reading."""
    with closing(PoolEngine(1, function=strange_units.FUNCTION, hang_seconds=2.0)) as engine:
        (pid,) = engine.pids()
        os.kill(pid, signal.SIGSTOP)
        large = engine.submit(Task("verification", request(filler="x" * 5_000_000), UNIT), "large")
        assert large.result(LIMIT_SECONDS).result is not None  # by another process: this one had not begun
        assert not psutil.pid_exists(pid)


@pytest.mark.skipif(not birth.ON_LINUX, reason="reads what Linux says of a process")
def test_the_processor_time_of_a_process_is_that_of_its_threads_in_both_modes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """published: proc(5): after the name state, 10 fields, ticks in user and in kernel mode; those of its children."""
    monkeypatch.setattr(birth, "Path", lambda path: tmp_path / path.lstrip("/"))
    texts = {
        "": "7 (name) of) S 1 1 1 0 -1 4 900 901 902 903 32 6 6000 7000 20 0",
        "task/7": "7 (name) of) S" + " 0" * 10 + " 30 5",
        "task/8": "8 (b) S" + " 0" * 10 + " 2 1",
    }
    for folder, text in texts.items():
        (tmp_path / "proc/7" / folder).mkdir(parents=True, exist_ok=True)
        (tmp_path / "proc/7" / folder / "stat").write_text(text)
    assert birth.read_processor_time(7) == (32 + 6) / birth.TICKS_A_SECOND
    assert not birth.waits_for_system(7)
    (tmp_path / "proc/7/task/8/stat").write_text("8 (b) D" + " 0" * 10 + " 2 1")
    assert birth.waits_for_system(7)
    assert birth.read_processor_time(9) is None
    assert not birth.waits_for_system(9)
