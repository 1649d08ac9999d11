"""What every test is held to: it leaves the process as it found it."""

from __future__ import annotations

import logging
import os
import sys
from collections.abc import Iterator
from typing import Any

import pytest
from hypothesis import settings

settings.register_profile("tailstack", deadline=None)  # a busy machine is no failure
settings.load_profile("tailstack")

PYTEST_OWN = "PYTEST_CURRENT_TEST"  # pytest writes it before each phase of a test
OUR_LOGGERS = ("tailstack", "tailstack_service")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--first-case", action="store_true", help="of each test the first of its cases alone")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if config.getoption("--first-case"):
        first = {item.nodeid.partition("[")[0]: item for item in reversed(items)}
        kept = [item for item in items if first[item.nodeid.partition("[")[0]] is item]
        config.hook.pytest_deselected(items=[item for item in items if item not in set(kept)])
        items[:] = kept


@pytest.fixture(autouse=True)
def leaves_the_process_as_it_was() -> Iterator[None]:
    """Fail a test after which the process differs, and mend the process for the next test.

    What leaks here reaches every process that a later test starts: a processor's name in the environment once made
    a hundred tests die of an illegal instruction.
    """
    environment, directory, path = _environment(), os.getcwd(), list(sys.path)
    levels, disabled = _log_levels(), logging.root.manager.disable
    yield
    changes = []
    if (now := _environment()) != environment:
        changes += _differences("os.environ", environment, now)
        for name in now.keys() - environment.keys():
            del os.environ[name]
        os.environ.update(environment)
    if _directory() != directory:
        changes.append(f"the working directory was {directory}, is {_directory()}")
        os.chdir(directory)
    if sys.path != path:
        changes += [f"sys.path was {path}, is {sys.path}"]
        sys.path[:] = path
    known = {name: logging.NOTSET for name in _log_levels() if name.split(".")[0] in OUR_LOGGERS} | levels
    now_levels = {name: logging.getLogger(name).level for name in known}
    if now_levels != known:
        changes += _differences("log level of", known, now_levels)
        for name, level in known.items():
            logging.getLogger(name).setLevel(level)
    if logging.root.manager.disable != disabled:
        changes.append(f"logging.disable was {disabled}, is {logging.root.manager.disable}")
        logging.disable(disabled)
    if changes:
        pytest.fail("the test left the process changed:\n  " + "\n  ".join(changes), pytrace=False)


def _environment() -> dict[str, str]:
    return {name: value for name, value in os.environ.items() if name != PYTEST_OWN}


def _directory() -> str:
    try:
        return os.getcwd()
    except FileNotFoundError:  # the test deleted it and stayed in it
        return "one that was deleted"


def _log_levels() -> dict[str, int]:
    """Of the root (by the name "root") and of every logger that there is."""
    loggers = logging.root.manager.loggerDict.items()
    return {"root": logging.root.level} | {n: one.level for n, one in loggers if isinstance(one, logging.Logger)}


def _differences(what: str, before: dict[str, Any], after: dict[str, Any]) -> list[str]:
    names = sorted(name for name in before.keys() | after.keys() if before.get(name) != after.get(name))
    return [f"{what} {name!r} was {before.get(name)!r}, is {after.get(name)!r}" for name in names]
