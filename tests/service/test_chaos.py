"""A few random kills on each of SQLite, PostgreSQL and Dask (``./run chaos`` does many): nothing lost, nothing doubled,
every answer that of an undisturbed run.

``chaos.py`` says what is killed.  The order of the kills follows the seed; when they hit depends on the machine.
"""

from __future__ import annotations

from pathlib import Path

import pytest
from chaos import Report, requests, run_chaos
from dask_cluster import Cluster
from postgres import Server

SEED = 20

pytestmark = pytest.mark.hostile


def check(report: Report, kinds: set[str]) -> None:
    assert report.sound, report.text()
    assert sorted(kill.kind for kill in report.kills) == sorted(kinds)
    assert report.units_begun >= report.units_needed


@pytest.mark.long
def test_a_service_and_a_worker_on_sqlite(tmp_path: Path, run_seed: int) -> None:
    """A check, a sweep, a search from several starts."""
    kinds = {"worker", "frozen worker", "server", "computing process", "deleted file"}
    url = f"sqlite:///{tmp_path / 'chaos.sqlite3'}"
    report = run_chaos("sqlite", url, tmp_path, kills=5, seed=SEED + run_seed, asked=requests(3))
    check(report, kinds)
    assert len(report.looks) == 2


@pytest.mark.long
def test_two_workers_on_postgresql(postgres_server: Server, postgres_url: str, tmp_path: Path, run_seed: int) -> None:
    kinds = ("database", "frozen database", "worker", "computing process")
    report = run_chaos(
        "postgresql", postgres_url, tmp_path, kills=4, seed=SEED + run_seed, asked=requests(2), serving=False,
        kinds=kinds, server=postgres_server,
    )  # fmt: skip
    check(report, set(kinds))


@pytest.mark.long
def test_two_workers_with_dask(dask_cluster: Cluster, tmp_path: Path, run_seed: int) -> None:
    kinds = ("Dask worker", "Dask scheduler", "worker")
    dask_cluster.revive()
    url = f"sqlite:///{tmp_path / 'chaos.sqlite3'}"
    report = run_chaos(
        "dask", url, tmp_path, kills=3, seed=SEED + run_seed, asked=requests(2), serving=False, kinds=kinds,
        cluster=dask_cluster,
    )  # fmt: skip
    check(report, set(kinds))
