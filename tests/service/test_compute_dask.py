"""The Dask engine against a real scheduler and real workers over TLS: losses of every kind are given back."""

from __future__ import annotations

import logging
import os
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Any

import psutil
import pytest
import strange_units
from dask_cluster import Cluster
from strange_units import begun
from test_compute_pool import check_that_each_dies_alone, task

from family import forked_of
from plain_data import read_cases
from tailstack_service.jobs.engines.engine import start_engine
from tailstack_service.problems import RequestError
from tailstack_service.processes.task import Defect, GivenBack
from tailstack_service.settings import Settings
from waiting import LIMIT_SECONDS, until

if TYPE_CHECKING:
    from tailstack_service.jobs.engines.dask import DaskEngine


def children(cluster: Cluster) -> list[psutil.Process]:
    return [child for worker in cluster.workers if worker for child in forked_of(worker.pid)]


@pytest.fixture
def engine(dask_cluster: Cluster) -> Iterator[DaskEngine]:
    from tailstack_service.jobs.engines.dask import DaskEngine

    dask_cluster.revive()
    with closing(DaskEngine(Settings(**dask_cluster.settings), function=strange_units.FUNCTION)) as engine:
        until(lambda: engine.capacity == 2)
        yield engine


@pytest.mark.long
def test_tasks_are_computed_and_nothing_stays_in_the_cluster(dask_cluster: Cluster, engine: DaskEngine) -> None:
    from distributed import Client

    futures = [engine.submit(task(number=number), f"plain-{number}") for number in range(20)]
    results = {future.result(LIMIT_SECONDS).result for future in futures}
    assert len(results) == 20
    assert None not in results
    with Client(dask_cluster.address, security=engine._security, set_as_default=False) as watcher:
        until(lambda: watcher.run_on_scheduler(lambda dask_scheduler: len(dask_scheduler.tasks)) == 0)


def test_a_death_is_that_of_one_task_and_not_of_the_dask_worker(dask_cluster: Cluster, engine: DaskEngine) -> None:
    before = [worker.pid for worker in dask_cluster.workers if worker]
    check_that_each_dies_alone(engine, 12)
    with pytest.raises(Defect, match="ArithmeticError"):
        engine.submit(task("raise"), "raise").result(LIMIT_SECONDS)
    assert [worker.pid for worker in dask_cluster.workers if worker and worker.poll() is None] == before


@pytest.mark.long
def test_a_kill_stops_the_process_beside_the_dask_worker(engine: DaskEngine, tmp_path: Path) -> None:
    """It computes for ever otherwise."""
    note = tmp_path / "note"
    future = engine.submit(task("burn", note=str(note)), "burn")
    ((_, pid),) = until(lambda: begun(note))
    engine.kill(future)
    until(lambda: not psutil.pid_exists(pid))
    assert engine.submit(task(), "after").result(LIMIT_SECONDS).result


def test_processes_beside_dask_workers_compute_with_one_thread(dask_cluster: Cluster, engine: DaskEngine) -> None:
    for number in range(4):
        engine.submit(task(n=number), f"environment-{number}").result(LIMIT_SECONDS)
    beside = children(dask_cluster)
    assert beside
    assert all(child.environ()["OMP_NUM_THREADS"] == "1" for child in beside)


@pytest.mark.long
def test_a_lost_scheduler_gives_everything_back_and_is_found_again(
    dask_cluster: Cluster, engine: DaskEngine, tmp_path: Path
) -> None:
    note = tmp_path / "note"
    futures = [engine.submit(task("burn", note=str(note)), f"away-{number}") for number in range(4)]
    until(lambda: len(begun(note)) == 2, lambda: begun(note))
    beside = children(dask_cluster)
    dask_cluster.kill_scheduler()
    for future in futures:
        with pytest.raises(GivenBack):
            future.result(LIMIT_SECONDS)
    assert engine.capacity == 0
    psutil.wait_procs(beside, timeout=LIMIT_SECONDS)  # the Dask workers leave, and nobody computes for nobody
    assert not [process for process in beside if process.is_running()]
    until(lambda: all(worker and worker.poll() is not None for worker in dask_cluster.workers))
    dask_cluster.revive()
    until(lambda: engine.capacity == 2)
    assert engine.submit(task(), "found").result(LIMIT_SECONDS).result


@pytest.mark.long
def test_without_a_connection_tasks_are_given_back_at_once(dask_cluster: Cluster) -> None:
    nowhere = Settings(**dask_cluster.settings | {"TAILSTACK_DASK_SCHEDULER": "tls://127.0.0.1:1"})
    with closing(start_engine(nowhere)) as engine:
        assert engine.capacity == 0
        with pytest.raises(GivenBack):
            engine.submit(task(), "x").result(LIMIT_SECONDS)


def test_only_while_an_engine_is_there_the_client_keeps_its_tracebacks_to_itself(
    dask_cluster: Cluster, engine: DaskEngine
) -> None:
    client = logging.getLogger("distributed.client")
    record = client.makeRecord(client.name, logging.ERROR, __file__, 1, "Traceback", (), None)
    before, level = len(client.filters), client.level
    with closing(start_engine(Settings(**dask_cluster.settings))):
        until(lambda: len(client.filters) == before + 1)
        engine.close()
        until(lambda: len(client.filters) == before)
        assert not client.filter(record)
    until(lambda: client.filter(record))
    assert client.level == level


def test_another_version_on_the_dask_workers_computes_nothing(
    engine: DaskEngine, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tailstack_service.jobs.engines.dask.running_code", lambda: "0.0.0")
    with pytest.raises(GivenBack, match=r"the job was claimed by 0\.0\.0"):
        engine.submit(task(), f"version-{os.urandom(3).hex()}").result(LIMIT_SECONDS)


@pytest.mark.parametrize(("change", "said"), read_cases("settings", "dask"))
def test_settings_that_cannot_work_are_refused(change: dict[str, str], said: str, tmp_path: Path) -> None:
    pytest.importorskip("distributed")
    (tmp_path / "file.pem").touch()
    files: dict[str, Any] = dict.fromkeys(
        ("dask_ca_file", "dask_cert_file", "dask_key_file"), str(tmp_path / "file.pem")
    )
    settings = Settings(engine="dask", **({"dask_scheduler": "tls://127.0.0.1:8786"} | files | change))
    with pytest.raises(RequestError, match=said):
        start_engine(settings)
