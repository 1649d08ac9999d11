"""Which tests run, and what every test is held to: it leaves the process as it found it."""

from __future__ import annotations

import asyncio
import gc
import inspect
import logging
import os
import random
import re
import sys
from collections.abc import Generator, Iterator
from functools import cache
from typing import Any

import pytest
from hypothesis import settings

# A busy machine is no failure, and a run without a seed draws what the run before drew
settings.register_profile("fixed", deadline=None, derandomize=True)
settings.register_profile("free", deadline=None, derandomize=False)  # with CI in the environment the default is not

# What a caller may have said to pytest, pipelines, Git, terminals and tailstack is not for what tests start.  As xdist
# tells its workers who they are by the environment, those keep that.
CALLERS = (
    "PYTEST_", "TAILSTACK_", "GITHUB_", "GITLAB_", "RUNNER_", "CI_", "GATE_", "GIT_", "PYTHONPATH", "PYTHONSTARTUP",
    "PYTHONWARNINGS", "PY_COLORS", "NO_COLOR", "FORCE_COLOR", "COLUMNS", "LINES", "SOURCE_DATE_EPOCH",
)  # fmt: skip
OF_TESTS = (
    "TAILSTACK_TESTS_LIMIT_SECONDS", "TAILSTACK_TESTS_REQUIRE", "TAILSTACK_SCREENSHOTS", "PYTEST_XDIST_WORKER",
    "PYTEST_XDIST_WORKER_COUNT", "PYTEST_XDIST_TESTRUNUID", "PYTEST_DISABLE_PLUGIN_AUTOLOAD",
)  # fmt: skip
PYTEST_OWN = "PYTEST_CURRENT_TEST"  # pytest writes it before each phase of a test
OUR_LOGGERS = ("tailstack", "tailstack_service")
LEFT_OUT = pytest.StashKey[int]()
UNKNOWN = pytest.StashKey[list[str]]()  # cases that a mark names


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--short", action="store_true", help="leave out what is marked as long")
    parser.addoption("--seed", type=int, default=0, help="of what is drawn at random; 0: as it is written")
    parser.addoption("--shuffle", type=int, default=None, help="a seed: files, and the tests of each, in random order")
    parser.addoption("--costs", default=None, help="a file to which each test writes the CPU seconds that it took")


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line(
        "markers",
        "long(*cases, but=()): left out of the short tier: the whole test, the cases named, or all but those in `but`",
    )
    config.addinivalue_line("markers", "hostile: random; with another --seed it tries what it has not tried before")
    for name in [name for name in os.environ if name.startswith(CALLERS) and name not in (PYTEST_OWN, *OF_TESTS)]:
        del os.environ[name]
    settings.load_profile("free" if config.getoption("--seed") else "fixed")
    gc.disable()  # what is imported and collected stays: looking through it took a fifth of the time of collecting it


@pytest.hookimpl(trylast=True)
def pytest_collection_finish() -> None:
    gc.freeze()
    gc.enable()


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if config.getoption("--short"):
        long = [item for item in items if is_long(item)]
        config.stash[LEFT_OUT] = len(long)
        config.hook.pytest_deselected(items=long)
        items[:] = [item for item in items if not is_long(item)]
    if config.getoption("--shuffle") is not None:
        chance = random.Random(config.getoption("--shuffle"))
        chance.shuffle(items)
        files = sorted({item.path for item in items})
        chance.shuffle(files)
        place = {file: k for k, file in enumerate(files)}
        items.sort(key=lambda item: place[item.path])


@pytest.hookimpl(wrapper=True)
def pytest_pycollect_makeitem() -> Generator[None, Any, Any]:
    """A mark that names a case that there is not leaves out nothing: the test will fail."""
    made = yield
    items = [each for each in made if isinstance(each, pytest.Function)] if isinstance(made, list) else []
    there = {case_of(item) for item in items}
    for item in items:
        named = {case for mark in item.iter_markers("long") for case in (*mark.args, *mark.kwargs.get("but", ()))}
        item.stash[UNKNOWN] = sorted(named - there)
    return made


def pytest_runtest_setup(item: pytest.Item) -> None:
    if unknown := item.stash.get(UNKNOWN, []):
        pytest.fail(f"its mark `long` names cases that there are not: {', '.join(unknown)}", pytrace=False)


def case_of(item: pytest.Item) -> str:
    return item.name.partition("[")[2][:-1]


def is_long(item: pytest.Item) -> bool:
    """Whether a mark of the test names this case of it."""
    case = case_of(item)
    marks = list(item.iter_markers("long"))
    return any(case in mark.args if mark.args else case not in mark.kwargs.get("but", ()) for mark in marks)


@pytest.fixture(scope="session")
def run_seed(request: pytest.FixtureRequest) -> int:
    """What a random test adds to the seed that it names: 0 unless --seed says otherwise."""
    return int(request.config.getoption("--seed"))


@pytest.hookimpl(tryfirst=True)
def pytest_pyfunc_call(pyfuncitem: pytest.Function) -> bool | None:
    """A test that is a coroutine runs in an event loop of its own; what waits in it has its own limit."""
    if not inspect.iscoroutinefunction(pyfuncitem.obj):
        return None
    given = {name: pyfuncitem.funcargs[name] for name in inspect.signature(pyfuncitem.obj).parameters}
    asyncio.run(pyfuncitem.obj(**given))
    return True


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """Notes what a test costs, with what it starts: CPU of this process and of the children that ended."""
    before = sum(os.times()[:4])
    try:
        return (yield)
    finally:
        if file := item.config.getoption("--costs"):
            with open(file, "a", encoding="utf-8") as record:
                record.write(f"{sum(os.times()[:4]) - before:.2f} {item.nodeid}\n")


# What a process of xdist starts once for all its tests, by what files say that ask for it: one process has all of them
STARTED_ONCE = {
    "browser": re.compile(r"^from browsing import", re.MULTILINE),
    "PostgreSQL": re.compile(r"\b(?:postgres_\w+|database_url|migrated_database|store): "),
}


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Files go to processes whole, and those that ask the same browser or server to one, which starts it once."""
    from xdist.scheduler import LoadFileScheduling

    @cache
    def scope_of(file: str) -> str:
        text = (config.rootpath / file).read_text(encoding="utf-8")
        return next((name for name, says in STARTED_ONCE.items() if says.search(text)), file)

    class Scheduling(LoadFileScheduling):
        def _split_scope(self, nodeid: str) -> str:
            return scope_of(super()._split_scope(nodeid))

    return Scheduling(config, log) if config.getoption("dist") == "loadfile" else None


def pytest_sessionfinish(session: pytest.Session) -> None:
    if hasattr(session.config, "workeroutput"):  # a process of xdist tells the one that started it
        session.config.workeroutput["left_out"] = session.config.stash.get(LEFT_OUT, 0)


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node: Any) -> None:
    node.config.stash[LEFT_OUT] = getattr(node, "workeroutput", {}).get("left_out", 0)


@pytest.hookimpl(trylast=True)
def pytest_unconfigure(config: pytest.Config) -> None:
    """The last line of a run says what it did not run."""
    if not hasattr(config, "workerinput") and (left_out := config.stash.get(LEFT_OUT, 0)):
        print(f"{left_out} tests were left out, which are long; all of them: ./run test --all")


@pytest.fixture(autouse=True)
def leaves_the_process_as_it_was() -> Iterator[None]:
    """Fail a test after which the process differs, and mend the process for the next test.

    What leaks here reaches every process that a later test starts: a processor's name in the environment once made
    a hundred tests die of an illegal instruction.
    """
    environment, directory, path = _environment(), os.getcwd(), list(sys.path)
    levels, disabled, modules = _log_levels(), logging.root.manager.disable, set(sys.modules)
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
    if _log_levels() != levels:
        changes += _restore_log_levels(levels, first=sys.modules.keys() - modules)
    if logging.root.manager.disable != disabled:
        changes.append(f"logging.disable was {disabled}, is {logging.root.manager.disable}")
        logging.disable(disabled)
    if changes:
        pytest.fail("the test left the process changed:\n  " + "\n  ".join(changes), pytrace=False)


def _restore_log_levels(levels: dict[str, int], first: set[str]) -> list[str]:
    """What had changed of them; first: the modules that the test is the first to import."""
    known = {name: logging.NOTSET for name in _log_levels() if name.split(".")[0] in OUR_LOGGERS} | levels
    # A package that this test is the first to import may set its own levels: distributed does
    own = {name for name in first if "." not in name} - {*OUR_LOGGERS}
    known = {name: level for name, level in known.items() if name.split(".")[0] not in own}
    now = {name: logging.getLogger(name).level for name in known}
    if now != known:
        for name, level in known.items():
            logging.getLogger(name).setLevel(level)
    return _differences("log level of", known, now)


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
