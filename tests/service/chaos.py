"""Random kills while jobs are computed; every answer must be that of an undisturbed run, byte for byte.

    python tests/service/chaos.py [--kills N] [--database sqlite|postgresql|both] [--engine pool|dask|both] [--seed N]

A service (``tailstack serve``) and a worker beside it share one database.  What ends is started again, as a service
manager would.  Jobs come in until all kills are done, then everything is waited for.  Not all is killed: workers and
the database are frozen, the file of SQLite is deleted (and put back).  Where the state of the service changes with it,
readiness has to say so within three seconds.
``test_chaos.py`` does the same with few kills.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, closing, suppress
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import httpx
import psutil
import sqlalchemy as sa
from dask_cluster import Cluster
from dask_cluster import installed as dask_installed
from postgres import Server, find_binaries, free_ports
from service_scenes import EXAMPLES, ask

from family import die_with_parent, ended
from optimise_documents import BOX, document
from tailstack_service.jobs.store import jobs, results, tables, workers
from tailstack_service.jobs.store.database import Database, reading
from tailstack_service.jobs.store.schema import migrate_database, open_database
from tailstack_service.operations.content import canonical
from tailstack_service.operations.perform import perform
from tailstack_service.problems import StoreError, StoreUnavailable
from tailstack_service.processes.birth import make_command, make_environment, running_code
from tailstack_service.processes.task import ADVANCE, Task, UnitResult

T = TypeVar("T")

TENANT = "chaos"
LEASE_SECONDS = 1.0
AT_ONCE = 4  # unfinished jobs, so that every process has something to lose
HASTE = 0.25  # of the kills come before the last one has been recovered from
LOOK_SECONDS = 0.02
PATIENCE_SECONDS = 300.0  # without a record, or since a kill that is not recovered from: something is stuck
TRUE_WITHIN_SECONDS = 3.0  # readiness, after the state has changed

SETTINGS = {
    "TAILSTACK_LEASE_SECONDS": str(LEASE_SECONDS),
    "TAILSTACK_POLL_SECONDS": "0.02",
    "TAILSTACK_SHORT_WORKERS": "1",  # nobody asks for anything short
    # Kills at random are no poison: the same unit may well be hit more often than five times
    "TAILSTACK_MAX_UNIT_DEATHS": "100",
    "TAILSTACK_MAX_UNIT_ATTEMPTS": "1000",
}


# --- what is computed -----------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Request:
    """A job to submit."""

    kind: str
    body: bytes


@dataclass(frozen=True, slots=True)
class Expected:
    """What an undisturbed run in this process came to."""

    sha256: str
    units: int  # looks included


@cache
def requests(count: int) -> tuple[Request, ...]:
    """The first ``count`` of: adaptive and fixed checks, sweeps, searches from several starts; the lightest first."""
    from tailstack import load_design
    from tailstack.design import design_to_data

    demo = design_to_data(load_design(EXAMPLES / "demo.yaml"))
    axes = [{"pointer": "/views/*/fiducial_noise_px", "start": 0.1, "stop": 0.5, "count": 9}]
    further = [{"pointer": "/interfaces/structure_connector/tolerances/rz/half_width_deg", "values": [0.1, 0.2, -1.0]}]
    free: dict[str, Any] = {"box": BOX, "rotation_bounds": {"min_deg": 0.01, "max_deg": 0.5}}
    asked: list[tuple[str, dict[str, Any]]] = [
        ("verification", {"design": demo, "precision": 0.003, "seed": 1, "max_trials": 2**19}),
        ("sweep", {"design": demo, "axes": axes, "check": "verification", "trials": 60_000, "seed": 1}),
        ("optimisation", {"design": document(6, **free), "starts": 6, "seed": 3}),
        ("verification", {"design": demo, "trials": 2_000_000, "seed": 1}),
        ("verification", {"design": demo, "precision": 0.002, "seed": 2, "max_trials": 2**20}),
        ("sweep", {"design": demo, "axes": axes + further, "check": "verification", "trials": 100_000, "seed": 2}),
        ("optimisation", {"design": document(8, **free), "starts": 10, "seed": 2}),
    ]
    return tuple(Request(kind, canonical(data)) for kind, data in asked[:count])


@cache
def undisturbed(request: Request) -> Expected:
    """The job by nothing but ``perform``, in one process, in order."""
    recorded: list[UnitResult] = []
    index = looks = 0
    while True:
        seen = perform(Task(request.kind, request.body, ADVANCE, tuple(recorded)))
        looks += 1
        if seen.answer is not None:
            return Expected(hashlib.sha256(seen.answer).hexdigest(), looks + len(recorded))
        assert seen.more, seen.problem
        for number, spec in enumerate(seen.more, index + 1):
            found = perform(Task(request.kind, request.body, spec)).result
            assert found is not None
            recorded.append(UnitResult(number, spec, found))
        index += len(seen.more) + 1


# --- who computes it ------------------------------------------------------------------------------


class Fleet:
    """Two workers, one of them a service's unless ``serving`` is False; ``revive`` starts what has ended."""

    def __init__(self, url: str, log: Path, told: dict[str, str], *, serving: bool) -> None:
        kept = {name: value for name, value in make_environment().items() if not name.startswith("TAILSTACK_")}
        self._environment = {**kept, **SETTINGS, **told, "TAILSTACK_DATABASE": url}
        self._log = log
        worker = make_command("tailstack_service.cli.main", "worker")
        port = next(free_ports())
        self.url = f"http://127.0.0.1:{port}" if serving else None
        serve = make_command("tailstack_service.cli.main", "serve", "--port", str(port))
        self._commands = {"serve": serve, "worker": worker} if serving else {"another": worker, "worker": worker}
        self.processes: dict[str, subprocess.Popen[bytes]] = {}
        self.revive()

    def revive(self) -> None:
        for name, words in self._commands.items():
            if name not in self.processes or self.processes[name].poll() is not None:
                with self._log.open("ab") as log:
                    self.processes[name] = subprocess.Popen(
                        words, stdin=subprocess.DEVNULL, stdout=log, stderr=log, env=self._environment,
                        preexec_fn=die_with_parent,
                    )  # fmt: skip

    def pids(self) -> set[int]:
        """Of everything that may be a worker: what was started here, and children of the service."""
        found = {process.pid for process in self.processes.values()}
        if "serve" in self.processes:
            with suppress(psutil.NoSuchProcess):
                found |= {child.pid for child in psutil.Process(self.processes["serve"].pid).children()}
        return found

    def close(self) -> None:
        for process in self.processes.values():
            with ended(process):
                pass


# --- what is done to them -------------------------------------------------------------------------

Units = set[tuple[str, int]]  # job, number


@dataclass(slots=True)
class Kill:
    """One kill, and the units that were under way in what was killed."""

    kind: str
    at: float
    under_way: Units
    recovered: float | None = None  # s, until the last of them was recorded


@dataclass(slots=True)
class Report:
    """What a run came to."""

    name: str
    seed: int
    seconds: float = 0.0
    kills: list[Kill] = field(default_factory=list)
    jobs: int = 0
    units_needed: int = 0
    units_recorded: int = 0
    units_counted: int = 0  # by the usage of the tenant: once per record
    units_begun: int = 0
    lost: list[str] = field(default_factory=list)  # jobs without an answer, and why
    different: list[str] = field(default_factory=list)  # jobs whose answer is not that of the undisturbed run
    looks: list[float] = field(default_factory=list)  # s, until readiness was true to a state that had changed
    untrue: list[str] = field(default_factory=list)  # states that readiness did not tell of in time

    @property
    def unrecovered(self) -> list[Kill]:
        return [kill for kill in self.kills if kill.recovered is None]

    @property
    def sound(self) -> bool:
        counts = {self.units_needed, self.units_recorded, self.units_counted}
        return not (self.lost or self.different or self.untrue or self.unrecovered) and len(counts) == 1

    def text(self) -> str:
        by_kind = Counter(kill.kind for kill in self.kills)
        told = "  ".join(f"{kind} {count}" for kind, count in sorted(by_kind.items()))
        doubled = max(self.units_recorded, self.units_counted) - self.units_needed
        lines = [
            f"{self.name}, seed {self.seed}: {'sound' if self.sound else 'NOT SOUND'}, {self.seconds:.0f} s",
            f"  kills            {len(self.kills)}   {told}",
            f"  jobs             {self.jobs}, lost {len(self.lost)}, other than undisturbed {len(self.different)}",
            f"  units            {self.units_needed} needed, {self.units_recorded} recorded, {doubled} doubled",
            f"  redone work      {self.units_begun / max(self.units_needed, 1) - 1:.1%}"
            "   (units begun over units needed, less one)",
        ]
        if self.looks or self.untrue:
            worst = f"after {max(self.looks):.2f} s at most" if self.looks else "never"
            lines.append(f"  readiness        true {worst}   ({len(self.looks)} changes, {len(self.untrue)} untold)")
        if known := sorted(kill.recovered for kill in self.kills if kill.recovered is not None):
            told = f"p50 {_quantile(known, 0.5):.2f} s, p95 {_quantile(known, 0.95):.2f} s"
            what = "from the kill until the last unit that was under way there is recorded"
            lines.append(f"  recovered        {told}   ({what}; {len(known)} kills)")
        open_kills = [f"not recovered from: {kill.kind}" for kill in self.unrecovered]
        return "\n".join(lines + [f"  {line}" for line in self.lost + self.different + self.untrue + open_kills])


def _quantile(ordered: Sequence[float], share: float) -> float:
    return ordered[min(len(ordered) - 1, int(share * len(ordered)))]


class Chaos:
    """One run: submits, kills, watches, compares."""

    def __init__(
        self, db: Database, fleet: Fleet, report: Report, asked: Sequence[Request], *,
        kinds: Sequence[str] | None, server: Server | None, cluster: Cluster | None,
    ) -> None:  # fmt: skip
        self.db, self.fleet, self.report, self.asked = db, fleet, report, asked
        self.server, self.cluster = server, cluster
        self.random = random.Random(report.seed)
        self.submitted: dict[str, Request] = {}
        self.frozen: list[tuple[float, int]] = []  # when it thaws, pid
        every: dict[str, Callable[[], tuple[Units, Callable[[], None]] | None]] = {
            "worker": self._kill_worker,
            "frozen worker": self._freeze_worker,
        }
        if "serve" in fleet.processes:
            every["server"] = self._kill_server
        if cluster is None:
            every["computing process"] = self._kill_child
        else:
            every |= {"Dask worker": self._kill_dask_worker, "Dask scheduler": self._kill_dask_scheduler}
        if server is not None:
            every |= {"database": self._restart_database, "frozen database": self._freeze_database}
        else:
            every["deleted file"] = self._delete_file
        self.kinds = {kind: every[kind] for kind in kinds or every}

    def run(self, kills: int, pause: tuple[float, float]) -> None:
        begun = time.monotonic()
        kinds = self._in_turn()
        due: float | None = None
        hasty, kind = False, next(kinds)
        last, counted = time.monotonic(), -1
        while len(self.report.kills) < kills or self._unfinished():
            if len(self.report.kills) < kills:
                self._submit()
                if due is None and (hasty or not self.report.unrecovered):
                    due = time.monotonic() + self.random.uniform(*pause)
                if due is not None and time.monotonic() > due and self._strike(kind):
                    due, hasty, kind = None, self.random.random() < HASTE, next(kinds)
            self._look_after()
            done = self._insist(self._recorded)
            if done != counted:
                last, counted = time.monotonic(), done
            stuck = any(time.time() - kill.at > PATIENCE_SECONDS for kill in self.report.unrecovered)
            if stuck or time.monotonic() - last > PATIENCE_SECONDS:
                break
            time.sleep(LOOK_SECONDS)
        self._insist(self._watch)
        self.report.seconds = time.monotonic() - begun
        self._compare()

    # --- jobs ---------------------------------------------------------------------------------------

    def _insist(self, call: Callable[[], T]) -> T:
        while True:
            try:
                return call()
            except (StoreUnavailable, StoreError):
                time.sleep(LOOK_SECONDS)

    def _submit(self) -> None:
        while self._insist(self._unfinished) < AT_ONCE:
            number = len(self.submitted)
            request = self.asked[number % len(self.asked)]
            made, _ = self._insist(
                lambda request=request, number=number: jobs.submit_job(  # type: ignore[misc]
                    self.db, tenant=TENANT, kind=request.kind, request=request.body, design_name="chaos",
                    solver_version=running_code(), request_id=f"chaos-{number}", idempotency_key=str(number),
                    max_queued=10_000,
                )
            )  # fmt: skip
            self.submitted[made.id] = request

    def _unfinished(self) -> int:
        c = tables.jobs.c
        query = sa.select(sa.func.count()).where(c.state.in_(tables.UNFINISHED))
        return int(self._insist(lambda: self._scalar(query)))

    def _recorded(self) -> int:
        return int(self._scalar(sa.select(sa.func.coalesce(sa.func.sum(tables.jobs.c.units_done), 0))))

    def _scalar(self, query: Any) -> Any:
        with reading(self.db) as connection:
            return connection.execute(query).scalar_one()

    def _leased(self, worker_id: str | None = None) -> Units:
        u = tables.units.c
        query = sa.select(u.job_id, u.number).where(u.state == tables.LEASED)
        if worker_id is not None:
            query = query.where(u.worker_id == worker_id)

        def ask() -> Units:
            with reading(self.db) as connection:
                return {(row.job_id, row.number) for row in connection.execute(query)}

        return self._insist(ask)

    def _watch(self) -> None:
        """Note which kills have been recovered from by now."""
        u = tables.units.c
        for kill in self.report.unrecovered:
            under_way = sa.tuple_(u.job_id, u.number).in_(sorted(kill.under_way))
            if self._scalar(sa.select(sa.func.count()).where(under_way, u.state != tables.RECORDED)) == 0:
                kill.recovered = time.time() - kill.at

    # --- kills --------------------------------------------------------------------------------------

    def _in_turn(self) -> Iterator[str]:
        """Every kind as often as every other, in an order that the seed decides."""
        while True:
            order = list(self.kinds)
            self.random.shuffle(order)
            yield from order

    def _strike(self, kind: str) -> bool:
        found = self.kinds[kind]()
        if found is None:
            return False
        under_way, act = found
        at = time.time()
        act()
        self.report.kills.append(Kill(kind, at, under_way))
        return True

    def _victim(self) -> workers.WorkerEntry | None:
        """A worker that has something to lose and is not frozen."""
        pids = self.fleet.pids() - {pid for _, pid in self.frozen}
        there = [worker for worker in self._insist(lambda: workers.list_workers(self.db)) if worker.pid in pids]
        busy = [worker for worker in there if self._leased(worker.id)]
        return self.random.choice(busy) if busy else None

    def _kill_worker(self) -> tuple[Units, Callable[[], None]] | None:
        victim = self._victim()
        return None if victim is None else (self._leased(victim.id), lambda: _kill(victim.pid))

    def _freeze_worker(self) -> tuple[Units, Callable[[], None]] | None:
        victim = self._victim()
        if victim is None:
            return None

        def freeze() -> None:
            _kill(victim.pid, signal.SIGSTOP)
            self.frozen.append((time.monotonic() + LEASE_SECONDS * self.random.uniform(1.5, 3.0), victim.pid))

        return self._leased(victim.id), freeze

    def _kill_server(self) -> tuple[Units, Callable[[], None]] | None:
        serve = self.fleet.processes["serve"]
        family = {child.pid for child in psutil.Process(serve.pid).children()} if serve.poll() is None else set()
        its = [worker.id for worker in self._insist(lambda: workers.list_workers(self.db)) if worker.pid in family]
        under_way = set().union(*map(self._leased, its))
        return (under_way, serve.kill) if under_way else None

    def _kill_child(self) -> tuple[Units, Callable[[], None]] | None:
        victim = self._victim()
        if victim is None:
            return None
        children = []
        with suppress(psutil.NoSuchProcess):
            children = psutil.Process(victim.pid).children(recursive=True)  # and what they are forked from
        return (self._leased(victim.id), lambda: _kill(self.random.choice(children).pid)) if children else None

    def _restart_database(self) -> tuple[Units, Callable[[], None]] | None:
        assert self.server is not None
        under_way, server = self._leased(), self.server

        def restart() -> None:
            server.stop()
            time.sleep(self.random.uniform(0.0, 2.0 * LEASE_SECONDS))
            server.start()

        return (under_way, restart) if under_way else None

    def _freeze_database(self) -> tuple[Units, Callable[[], None]] | None:
        assert self.server is not None
        under_way, server = self._leased(), self.server

        def freeze() -> None:
            with server.frozen():
                begun = time.monotonic()
                self._expect(503, "the database stands still")
                time.sleep(max(0.0, begun + LEASE_SECONDS * self.random.uniform(1.5, 3.0) - time.monotonic()))
            self._expect(200, "the database has woken")

        return (under_way, freeze) if under_way and self._ready() in (200, None) else None

    def _delete_file(self) -> tuple[Units, Callable[[], None]] | None:
        under_way, path = self._leased(), Path(str(self.db.engine.url.database))

        def delete() -> None:
            kept = path.with_name(path.name + ".kept")
            os.link(path, kept)  # the very file, so that nothing that was accepted is lost with it
            path.unlink()
            try:
                self._expect(503, "the file of the database is deleted")
                time.sleep(self.random.uniform(0.0, 2.0 * LEASE_SECONDS))
                if path.exists():
                    self.report.untrue.append("another file was made in the place of the one that was deleted")
            finally:
                os.replace(kept, path)
            self._expect(200, "the file of the database is back")

        # none is starting: a process that begins where no file is makes one, as at the first start
        workers_there = {each.pid for each in self._insist(lambda: workers.list_workers(self.db))} & self.fleet.pids()
        settled = len(workers_there) == len(self.fleet.processes)
        return (under_way, delete) if under_way and settled and self._ready() in (200, None) else None

    # --- readiness ----------------------------------------------------------------------------------

    def _ready(self) -> int | None:
        """The status of readiness, 0 for none; None without a service."""
        if self.fleet.url is None:
            return None
        with suppress(httpx.HTTPError):
            return ask("GET", f"{self.fleet.url}/health/ready", timeout=300).status_code
        return 0

    def _expect(self, status: int, state: str) -> None:
        """Note how long it takes until readiness has this status."""
        if self.fleet.url is None:
            return
        begun = time.monotonic()
        while time.monotonic() < begun + TRUE_WITHIN_SECONDS:
            if self._ready() == status and time.monotonic() < begun + TRUE_WITHIN_SECONDS:
                self.report.looks.append(time.monotonic() - begun)
                return
            time.sleep(LOOK_SECONDS)
        self.report.untrue.append(f"readiness was not {status} within {TRUE_WITHIN_SECONDS:g} s: {state}")

    def _kill_dask_worker(self) -> tuple[Units, Callable[[], None]] | None:
        assert self.cluster is not None
        cluster, under_way = self.cluster, self._leased()
        alive = [place for place, worker in enumerate(cluster.workers) if worker and worker.poll() is None]
        if not under_way or len(alive) < len(cluster.workers):
            return None
        return under_way, lambda: cluster.kill_worker(self.random.choice(alive))

    def _kill_dask_scheduler(self) -> tuple[Units, Callable[[], None]] | None:
        assert self.cluster is not None
        scheduler, under_way = self.cluster.scheduler, self._leased()
        if not under_way or scheduler is None or scheduler.poll() is not None:
            return None
        return under_way, self.cluster.kill_scheduler

    def _look_after(self) -> None:
        """Thaw what was frozen long enough, start what has ended, note what was recovered."""
        for thaw, pid in list(self.frozen):
            if time.monotonic() > thaw:
                _kill(pid, signal.SIGCONT)
                self.frozen.remove((thaw, pid))
        self.fleet.revive()
        if self.cluster is not None:
            self.cluster.revive()
        self._insist(self._watch)

    # --- the end ------------------------------------------------------------------------------------

    def _compare(self) -> None:
        report = self.report
        report.jobs = len(self.submitted)
        for job_id, request in self.submitted.items():
            job, expected = jobs.find_job(self.db, TENANT, job_id), undisturbed(request)
            report.units_needed += expected.units
            if job is None or job.state != "succeeded" or job.result_sha256 is None:
                report.lost.append(f"{job_id} {request.kind}: {job.state if job else 'gone'} {job and job.problem}")
                continue
            kept = results.read_result(self.db, TENANT, job.result_sha256)
            digest = hashlib.sha256(kept.body).hexdigest() if kept else None
            if not digest == job.result_sha256 == expected.sha256:
                report.different.append(f"{job_id} {request.kind}: {digest}, undisturbed {expected.sha256}")
        u = tables.units.c
        report.units_recorded = self._scalar(sa.select(sa.func.count()).where(u.state == tables.RECORDED))
        report.units_begun = self._scalar(sa.select(sa.func.sum(u.attempts)))
        report.units_counted = self._scalar(sa.select(sa.func.sum(tables.usage.c.units)))


def _kill(pid: int, sign: signal.Signals = signal.SIGKILL) -> None:
    with suppress(ProcessLookupError):  # it ended by itself, or with another
        os.kill(pid, sign)


def run_chaos(
    name: str, url: str, folder: Path, *, kills: int, seed: int, asked: Sequence[Request], processes: int = 1,
    pause: tuple[float, float] = (0.5, 1.0), serving: bool = True, kinds: Sequence[str] | None = None,
    server: Server | None = None, cluster: Cluster | None = None,
) -> Report:  # fmt: skip
    """Kill ``kills`` times on the database at ``url``, which has no tables yet; logs go into ``folder``."""
    for request in asked:
        undisturbed(request)
    migrate_database(url)
    report = Report(name, seed)
    told = {"TAILSTACK_WORKER_PROCESSES": str(processes)} | (cluster.settings if cluster else {})
    with ExitStack() as stack:
        db = open_database(url)
        stack.callback(db.close)
        fleet = Fleet(url, folder / "fleet.log", told, serving=serving)
        stack.callback(fleet.close)
        Chaos(db, fleet, report, asked, kinds=kinds, server=server, cluster=cluster).run(kills, pause)
    return report


# --- ./run chaos ----------------------------------------------------------------------------------


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="./run chaos", description=__doc__.partition("\n")[0] if __doc__ else "")
    parser.add_argument("--kills", type=int, default=20, metavar="N", help="of each run (default %(default)s)")
    parser.add_argument("--database", choices=("sqlite", "postgresql", "both"), default="both")
    parser.add_argument("--engine", choices=("pool", "dask", "both"), default="both")
    parser.add_argument("--seed", type=int, default=1, metavar="N", help="of the kills (default %(default)s)")
    parser.add_argument("--processes", type=int, default=2, metavar="N", help="of each worker (default %(default)s)")
    parser.add_argument("--logs", type=Path, metavar="DIR", help="keep what the processes say")
    arguments = parser.parse_args(argv)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit("chaos: told to stop"))  # by way of every finally
    databases = ["sqlite", "postgresql"] if arguments.database == "both" else [arguments.database]
    runs = [(database, "pool") for database in databases if arguments.engine in ("pool", "both")]
    if arguments.engine in ("dask", "both"):
        runs.append((databases[-1], "dask"))  # a cluster belongs to a server's database, unless there is only a file
    sound = True
    for database, engine in runs:
        if engine == "dask" and not dask_installed():
            sys.exit("chaos: Dask is not installed (pip install 'tailstack[dask]'); or --engine pool")
        with ExitStack() as stack:
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="tailstack-chaos-")))
            log = arguments.logs / f"{database}-{engine}" if arguments.logs else folder
            log.mkdir(parents=True, exist_ok=True)
            server = cluster = None
            if database == "postgresql":
                if (binaries := find_binaries()) is None:
                    sys.exit("chaos: PostgreSQL is not installed (Debian: apt-get install postgresql)")
                server = stack.enter_context(closing(Server(binaries)))
            if engine == "dask":
                cluster = stack.enter_context(closing(Cluster()))
            url = server.url(server.create_database()) if server else f"sqlite:///{folder / 'chaos.sqlite3'}"
            report = run_chaos(
                f"{database}, {engine}", url, log, kills=arguments.kills, seed=arguments.seed, asked=requests(99),
                processes=arguments.processes, pause=(1.0, 3.0), server=server, cluster=cluster,
            )  # fmt: skip
        print(report.text(), flush=True)
        sound = sound and report.sound
    return 0 if sound else 1


if __name__ == "__main__":
    sys.exit(main())
