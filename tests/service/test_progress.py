"""The line of progress: how long still, on recorded courses; the bar, as wide as the terminal; lines for a log.

Recorded courses (tests/data/courses, by the script beside them): what ``optimise`` reported, in seconds of an otherwise
idle machine with two cores.  Nothing here waits for the time of the machine.
"""

from __future__ import annotations

import io
import json
import os
import pty
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from service_scenes import ROOT

from tailstack.design import load_design
from tailstack_service.console.progress import QUIET_SECONDS, Progress, say
from tailstack_service.operations.optimisation import expect, reporter
from tailstack_service.operations.remaining import RemainingTime
from turned_clock import TurnedClock

COURSES = sorted((ROOT / "tests" / "data" / "courses").glob("*.json"))
KINDS = ("per_unit", "settles", "compares", "targets", "fiducials")
RESOLUTION = 1.0  # seconds: what is shown has none


def watch(course: dict[str, Any], look: Callable[[float, Progress], None]) -> None:
    """Go through a course, and look 200 times at what is shown."""
    clock = TurnedClock()
    progress = Progress("optimise", io.StringIO(), clock=clock)
    points = 9 if course["goal"] == "pareto" else 0
    kind = {name: course[name] for name in KINDS}
    report = reporter(progress, course["goal"], RemainingTime(cores=2, front_points=points, **kind))
    events = list(course["events"])
    for step in range(200):
        seconds = course["end"] * step / 200
        while events and events[0][0] <= seconds:
            at, stage, done, total = events.pop(0)
            clock.turn_to(at)
            report(stage, done, total, None)
        clock.turn_to(seconds)
        look(seconds, progress)


def shown_left(progress: Progress) -> float | None:
    """As a person reads it."""
    found = re.search(r"about (\d+) s left", progress.line())
    return None if found is None else float(found[1])


def test_there_are_courses_of_every_kind() -> None:
    assert len(COURSES) >= 8
    goals = {json.loads(course.read_text())["goal"] for course in COURSES}
    assert {"cost", "pareto"} <= goals


def test_what_shapes_a_course_is_read_from_the_design() -> None:
    """The recorded courses of examples, and the examples."""
    for course, name in (
        ("demo8", "demo"),
        ("plate", "flat_plate"),
        ("locators", "locators_321"),
        ("tube", "tube_carrier"),
    ):
        content = json.loads((ROOT / "tests" / "data" / "courses" / f"{course}.json").read_text())
        expected = expect(load_design(ROOT / "examples" / f"{name}.yaml"))
        assert {kind: getattr(expected, kind) for kind in KINDS} == {kind: content[kind] for kind in KINDS}


@pytest.mark.parametrize("course", COURSES, ids=lambda course: course.stem)
def test_after_its_first_tenth_the_time_left_is_within_a_factor_of_two(
    course: Path,
) -> None:
    content = json.loads(course.read_text())
    wrong: list[tuple[float, float | None, float]] = []

    def look(seconds: float, progress: Progress) -> None:
        left, truth = progress.seconds_left(), content["end"] - seconds
        if seconds < max(0.1 * content["end"], RESOLUTION):  # nothing is shown before a second has passed
            return
        if left is None or not (truth / 2 <= left <= 2 * truth or abs(left - truth) <= RESOLUTION):
            wrong.append((round(seconds, 2), left, round(truth, 2)))

    watch(content, look)
    assert wrong == []


@pytest.mark.parametrize("course", COURSES, ids=lambda course: course.stem)
def test_the_bar_grows_to_its_end_and_never_shrinks(course: Path) -> None:
    fractions: list[float] = []
    watch(json.loads(course.read_text()), lambda _, progress: fractions.append(progress.fraction))
    assert fractions == sorted(fractions)
    assert fractions[-1] > 0.85


# --- work whose steps are alike -------------------------------------------------------------------


def test_the_time_that_views_were_aimed_before_is_not_taken_for_a_delay() -> None:
    """The same course, with and without a minute of that before it."""
    course = json.loads(COURSES[0].read_text(encoding="utf-8"))
    found = []
    for aimed in (0.0, 60.0):
        clock = TurnedClock()
        progress = Progress("optimise", io.StringIO(), clock=clock)
        kind = {name: course[name] for name in KINDS}
        report = reporter(progress, course["goal"], RemainingTime(cores=2, **kind))
        clock.turn(aimed)
        report("view", 25, 25, None)
        left = []
        for at, stage, done, total in course["events"]:
            clock.turn_to(aimed + at)
            report(stage, done, total, None)
            left.append(progress.seconds_left())
        found.append(left)
    assert found[1] == pytest.approx(found[0], abs=1e-6)


def test_what_came_before_the_first_step_is_not_taken_for_the_pace() -> None:
    """Ten seconds of loading, then a second for each of a hundred."""
    clock = TurnedClock()
    progress = Progress("sweep", io.StringIO(), clock=clock)
    for done in range(1, 41):
        clock.turn_to(10 + done)
        progress.report(done, 100)
    assert progress.line() == "sweep: 50 s, 40 %, about 60 s left"
    clock.turn(5)
    assert shown_left(progress) == 55  # it goes on between two reports


def test_a_first_step_of_many_promises_nothing() -> None:
    """Three seconds of loading and the first of 500 steps would be 25 minutes."""
    clock = TurnedClock()
    progress = Progress("gate", io.StringIO(), clock=clock)
    clock.turn(3)
    progress.report(1, 500)
    assert progress.line() == "gate: 3 s"
    clock.turn(0.1)
    progress.report(5, 500)
    assert progress.seconds_left() is None
    clock.turn(1.9)
    progress.report(101, 500)
    assert shown_left(progress) == 8


def test_a_step_that_takes_too_long_does_not_end_at_nothing() -> None:
    clock = TurnedClock()
    progress = Progress("gate", io.StringIO(), clock=clock)
    progress.report(1, 2)
    clock.turn(100)
    assert (shown_left(progress) or 0) >= 10


def test_nobody_knows_how_long() -> None:
    progress = Progress("report", io.StringIO(), clock=TurnedClock())
    progress.report(0, 0, "drawing")
    assert progress.line() == "report: 0 s, drawing"


# --- a terminal -----------------------------------------------------------------------------------


class Screen(io.StringIO):
    """A terminal that can show every letter, or none beyond ASCII."""

    def __init__(self, encoding: str) -> None:
        super().__init__()
        self._encoding = encoding

    @property
    def encoding(self) -> str:  # type: ignore[override]
        return self._encoding


def at_work(encoding: str = "utf-8") -> Progress:
    """A third of a work that takes 90 s."""
    clock = TurnedClock()
    progress = Progress("optimise", Screen(encoding), clock=clock)
    clock.turn(30)
    progress.report(1, 3, "start 5 of 8, least cost so far 1746.2")
    return progress


@pytest.mark.parametrize("columns", [30, 50, 79, 119, 200])
def test_the_bar_is_as_wide_as_the_terminal(columns: int) -> None:
    bar = at_work().bar(columns)
    assert len(bar) == columns
    assert bar.startswith("optimise  33 % █")
    drawn = bar.count("█") + bar.count("░")
    assert drawn >= 10
    assert bar.count("█") == pytest.approx(drawn / 3, abs=0.5)


def test_a_wide_terminal_shows_phase_per_cent_and_time_left() -> None:
    bar = at_work().bar(100)
    assert bar.endswith("░ about 60 s left, start 5 of 8, least cost so far 1746.2")


@pytest.mark.parametrize("columns", range(30, 120))
def test_what_stands_beside_the_bar_is_whole(columns: int) -> None:
    """A cost of 17 is not one of 1746.2."""
    tail = at_work().bar(columns).rpartition("░")[2]
    parts = ["", " about 60 s left", ", start 5 of 8", ", least cost so far 1746.2"]
    assert tail in ["".join(parts[: count + 1]) for count in range(4)]


def test_a_terminal_without_the_letters_gets_others() -> None:
    assert "#" in at_work("ascii").bar(79)
    assert at_work("ascii").bar(79).isascii()


def test_a_narrow_terminal_gets_what_fits() -> None:
    assert at_work().bar(12) == "optimise: 30"


def test_the_width_is_that_of_the_terminal_just_now() -> None:
    import fcntl
    import struct
    import termios

    master, slave = pty.openpty()
    with os.fdopen(master, "rb", buffering=0), os.fdopen(slave, "w") as stream:
        progress = Progress("verify", stream)
        for columns in (80, 133):
            fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", 24, columns, 0, 0))
            assert progress._columns() == columns - 1


def test_what_is_said_meanwhile_does_not_stand_on_the_bar(monkeypatch: pytest.MonkeyPatch) -> None:
    """A terminal of 80 columns: the line of progress is taken off it before another is written."""
    import fcntl
    import struct
    import termios

    master, slave = pty.openpty()
    fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 80, 0, 0))
    with os.fdopen(master, "rb", buffering=0) as screen, os.fdopen(slave, "w") as stream:
        monkeypatch.setattr("sys.stderr", stream)
        clock = TurnedClock()
        with Progress("demo", clock=clock) as progress:
            progress.report(0, 0, "job 01m82x00000000000000000000: 50 %, unit 2 of 4, about 10 s left, and more")
            clock.until_waits(QUIET_SECONDS)
            clock.turn(QUIET_SECONDS)
            shown = b""
            while b"left" not in shown:
                shown += screen.read(4096)
            say("wrote out/demo/tailstack-design.schema.json")
            while not re.search(rb"wrote [^\r\n]*\r?\n", shown):
                shown += screen.read(4096)
    assert re.search(rb"\r\x1b\[Kwrote out/demo/tailstack-design.schema.json\r?\n", shown), shown


def test_a_log_gets_lines_without_bars() -> None:
    progress = at_work()
    assert progress.line() == "optimise: 30 s, 33 %, about 60 s left, start 5 of 8, least cost so far 1746.2"


def test_a_log_gets_its_lines_at_growing_distances() -> None:
    """A log, unlike a terminal, keeps every line."""
    clock, log = TurnedClock(), io.StringIO()
    with Progress("optimise", log, clock=clock):
        for seconds in (1.0, 2.0, 4.0, 8.0, 10.0, 10.0):
            clock.until_waits(seconds)
            clock.turn(seconds)
        clock.until_waits(10.0)
    assert log.getvalue().splitlines() == [f"optimise: {seconds} s" for seconds in (1, 3, 7, 15, 25, 35)]


def test_by_a_clock_that_stands_still_nothing_is_said() -> None:
    """What the tests read of a command is the same on a slow machine."""
    clock, log = TurnedClock(), io.StringIO()
    with Progress("gate", log, clock=clock) as progress:
        clock.until_waits(QUIET_SECONDS)
        progress.report(1, 2)
    assert log.getvalue() == ""
