"""Fixtures that several files use."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from functools import cache
from pathlib import Path

import httpx
import pytest
from browsing import browser
from copied_sources import copy
from dask_cluster import dask_cluster
from editing import editor_tools
from openapi_scenes import node_tools
from postgres import database_url, postgres_server, postgres_url
from served import Served, served
from service_scenes import client_with, commands
from store_scenes import clock, command, migrated_database, migrated_file, store

from tailstack_service.console.progress import Progress
from tailstack_service.jobs.store import database
from turned_clock import TurnedClock
from waiting import LIMIT_SECONDS

__all__ = [
    "browser",
    "clock",
    "command",
    "copy",
    "dask_cluster",
    "database_url",
    "editor_tools",
    "migrated_database",
    "migrated_file",
    "node_tools",
    "postgres_server",
    "postgres_url",
    "store",
]


@pytest.fixture(scope="session", autouse=True)
def state_home(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """A service without TAILSTACK_DATABASE keeps what it is sent in a file of these tests, not of whoever runs them."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_STATE_HOME", str(tmp_path_factory.mktemp("state")))
        yield


@pytest.fixture(scope="session", autouse=True)
def no_progress_by_the_time() -> Iterator[None]:
    """The clock of progress stands still: a command says the same on stderr however long the machine takes."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Progress, "usual_clock", TurnedClock())
        yield


@pytest.fixture(scope="session", autouse=True)
def patience_with_the_disk() -> Iterator[None]:
    """A transaction of these processes does not give itself up because others keep the disk or the processors."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(database, "BUSY_SECONDS", LIMIT_SECONDS)
        yield


@pytest.fixture(scope="module")
def client(request: pytest.FixtureRequest) -> Iterator[httpx.Client]:
    """Of a service in this process, as it comes and without a worker; ``CLIENT`` of the file says otherwise."""
    with client_with(**getattr(request.module, "CLIENT", {})) as client:
        yield client


@pytest.fixture(scope="session")
def services(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[..., Served]]:
    """Services with a worker, by what their environment has more: each is started once for all files that ask it."""
    with ExitStack() as stack:
        yield cache(lambda **more: stack.enter_context(served(tmp_path_factory.mktemp("service"), **more)))


@pytest.fixture
def service(services: Callable[..., Served], request: pytest.FixtureRequest, browser: None) -> Served:
    """One whose page a browser opens; ``SERVED`` of the file adds to its environment."""
    return services(**getattr(request.module, "SERVED", {}))


@pytest.fixture
def call(capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[int, str, str]]:
    """Runs a command in this process: exit code, stdout, stderr."""
    return commands(capsys)


@pytest.fixture
def refused(call: Callable[..., tuple[int, str, str]]) -> Callable[..., str]:
    """What a command that leaves with 2 and prints nothing says of it, in one line."""

    def run(*arguments: str | Path) -> str:
        code, out, err = call(*arguments)
        assert (code, out) == (2, ""), err
        return " ".join(err.split())

    return run


@pytest.fixture
def loggers() -> Iterator[None]:
    """Handlers and levels that a command sets up for its own process are put back."""
    names = ("tailstack", "uvicorn", "sqlalchemy", "alembic", "distributed")
    kept = [(one, one.handlers, one.propagate, one.level) for one in map(logging.getLogger, names)]
    yield
    for logger, handlers, propagate, level in kept:
        logger.handlers, logger.propagate = handlers, propagate
        logger.setLevel(level)
