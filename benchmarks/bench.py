"""./run bench [NAMES...]: what tailstack costs against what was aimed at, each figure a ratio of interleaved runs.

Absolute times are printed for people and bind nobody.  The load of the machine by others is measured while a row is
measured; above 5 % the row is marked, and --strict does not hold it against us.  --save keeps the ratios as JSON: one
file for each release stands in benchmarks/history/, and docs/images/make_history.py draws them.
"""

from __future__ import annotations

import json
import os
import platform
import resource
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from statistics import median

import psutil

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "tests"), str(ROOT / "tests" / "service"), str(ROOT / "openapi")]

ROUNDS = 7
LOADED = 0.05  # of the machine's processors, above which a figure is marked


@dataclass(frozen=True, slots=True)
class Processors:
    """How much the machine and we have computed by a moment, in seconds of one processor."""

    elapsed: float
    machine: float  # by everybody, and what a hypervisor gave to its other guests
    ours: float  # by this process, those it started, and those that these started


def read_processors() -> Processors:
    """As the system counts now."""
    times = psutil.cpu_times()
    idle = times.idle + getattr(times, "iowait", 0.0)
    # user and nice hold what guests of this machine computed
    counted = sum(times) - idle - getattr(times, "guest", 0.0) - getattr(times, "guest_nice", 0.0)
    return Processors(time.monotonic(), counted, cpu_seconds() + _running_children_seconds())


def cpu_seconds() -> float:
    """Of this process and of those that it started and that have ended."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime


def _running_children_seconds() -> float:
    total = 0.0
    for child in psutil.Process().children(recursive=True):
        try:
            total += sum(child.cpu_times()[:4])  # user, system, and both of its own children that have ended
        except psutil.NoSuchProcess:
            continue
    return total


def foreign_share(before: Processors, after: Processors, count: int) -> float:
    """Share of ``count`` processors that computed for others between two moments."""
    others = (after.machine - before.machine) - (after.ours - before.ours)
    return max(0.0, others / ((after.elapsed - before.elapsed) * count))


@dataclass(slots=True)
class Load:
    """Share of the machine that others used; complete when the measurement has ended."""

    foreign: float = 0.0


@contextmanager
def watch_load() -> Iterator[Load]:
    """Measure the foreign load of what happens inside."""
    load, before = Load(), read_processors()
    yield load
    load.foreign = foreign_share(before, read_processors(), psutil.cpu_count() or 1)


@dataclass(frozen=True, slots=True)
class Rounds:
    """Seconds of each job an item, round by round, and the foreign load of all rounds."""

    cpu: dict[str, list[float]]
    wall: dict[str, list[float]]
    foreign: float

    def ratio(self, dividend: str, divisor: str, *, wall: bool = False) -> float:
        """Median over the rounds of one job's seconds divided by the other's in the same round."""
        spent = self.wall if wall else self.cpu
        return median(a / b for a, b in zip(spent[dividend], spent[divisor], strict=True))


def interleave(jobs: dict[str, Callable[[], int]], rounds: int = ROUNDS) -> Rounds:
    """Run all jobs in turn, round after round; a job returns how many items it did."""
    cpu: dict[str, list[float]] = {name: [] for name in jobs}
    wall: dict[str, list[float]] = {name: [] for name in jobs}
    with watch_load() as load:
        for _ in range(rounds):
            for name, job in jobs.items():
                began, cpu_began = time.perf_counter(), cpu_seconds()
                count = job()
                cpu[name].append((cpu_seconds() - cpu_began) / count)
                wall[name].append((time.perf_counter() - began) / count)
    return Rounds(cpu, wall, load.foreign)


@dataclass(frozen=True, slots=True)
class Target:
    """One line of the targets: what, in which unit, how far it must and should go, and which way is good."""

    what: str
    must: float | None = None
    aim: float | None = None
    unit: str = "×"
    better: str = ">"

    def meets(self, value: float, bar: float | None) -> bool:
        return bar is None or (value >= bar if self.better == ">" else value <= bar)


@dataclass(frozen=True, slots=True)
class Row:
    """A target as it was measured; ``value`` None: what would be measured is not built."""

    target: Target
    value: float | None
    foreign: float = 0.0
    timed: bool = True  # whether a load can have changed the value

    @property
    def loaded(self) -> bool:
        return self.timed and self.foreign > LOADED

    @property
    def missed(self) -> bool:
        return self.value is not None and not self.target.meets(self.value, self.target.must)

    @property
    def verdict(self) -> str:
        if self.value is None:
            return "not built"
        words = ["MISSED"] if self.missed else []
        if not words and (self.target.must, self.target.aim) != (None, None):
            words = [
                "aim" if self.target.aim is not None and self.target.meets(self.value, self.target.aim) else "must"
            ]
        return ", ".join([*words, *(["loaded"] if self.loaded else [])])


@dataclass(frozen=True, slots=True)
class Figure:
    """An absolute figure for people."""

    what: str
    value: float
    unit: str = ""


@dataclass(slots=True)
class Findings:
    """What a measurement gives: values in the order of its targets, and figures for people."""

    values: list[float | None]
    foreign: float = 0.0
    figures: list[Figure] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class Measurement:
    """Targets that are measured together; none: figures for people only."""

    measure: Callable[[], Findings]
    targets: tuple[Target, ...] = ()
    timed: bool = True

    def rows(self, findings: Findings) -> list[Row]:
        pairs = zip(self.targets, findings.values, strict=True)
        return [Row(target, value, findings.foreign, self.timed) for target, value in pairs]


def write_row(row: Row) -> str:
    """One line: what, measured, must, aim, foreign load, verdict."""
    sign = ">=" if row.target.better == ">" else "<="
    bars = ["" if bar is None else f"{sign} {bar:g}" for bar in (row.target.must, row.target.aim)]
    value = "" if row.value is None else f"{row.value:.4g} {row.target.unit}"
    foreign = "" if row.value is None else f"{100 * row.foreign:.0f} %"
    return f"{row.target.what:78} {value:>12} {bars[0]:>8} {bars[1]:>8} {foreign:>7}  {row.verdict}".rstrip()


def write_history(rows: list[tuple[str, Row]]) -> str:
    """What was measured of which version, as JSON; a row comes with the name of its measurement."""
    from tailstack import __version__

    measured = [
        {"name": name, **asdict(row.target), "value": row.value and float(f"{row.value:.4g}"), "loaded": row.loaded}
        for name, row in rows
    ]
    machine = {"python": platform.python_version(), "cores": os.cpu_count(), "machine": platform.machine()}
    return json.dumps({"version": __version__, **machine, "rows": measured}, indent=1, ensure_ascii=False) + "\n"


def must_fail(rows: list[Row]) -> bool:
    """Whether a must is missed where others did not load the machine."""
    return any(row.missed and not row.loaded for row in rows)
