"""The line of progress: how long still; the bar, as wide as the terminal; lines for a log."""

from __future__ import annotations

import fcntl
import io
import os
import pty
import re
import struct
import termios

import pytest

from tailstack_service.console.progress import QUIET_SECONDS, Progress, say
from tailstack_service.operations.optimisation import STAGES, _share, reporter
from turned_clock import TurnedClock


def shown_left(progress: Progress) -> float | None:
    """As a person reads it."""
    found = re.search(r"about (\d+) s left", progress.line())
    return None if found is None else float(found[1])


# --- work whose steps are alike -------------------------------------------------------------------


def test_of_an_optimisation_the_time_left_is_that_of_its_stage_by_its_own_pace() -> None:
    """A minute of programmes at one pace, then starts at another: four of ten in eight seconds leave twelve."""
    clock = TurnedClock()
    progress = Progress("optimise", io.StringIO(), clock=clock)
    report = reporter(progress, "cost")
    for done in range(1, 11):
        clock.turn(6)
        report("programme", done, 10, None)
    assert progress.line() == "optimise: 60 s, programme 10 of 10"
    for done in range(1, 5):
        clock.turn(2)
        report("start", done, 10, 20.0 - done)
    assert progress.line() == "optimise: 68 s, 40 %, about 12 s left of this step, start 4 of 10, least cost so far 16"
    assert " about 12 s left of this step, start 4 of 10" in progress.bar(100)


def test_the_share_that_an_assistant_is_told_only_grows() -> None:
    told: list[float] = []
    report = _share(lambda done, total: told.append(done / total))
    for stage in STAGES:
        for done in (1, 2):
            report(stage, done, 2, None)
    assert told == sorted(set(told))
    assert told[-1] == 1


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
    clock.turn(155)
    assert shown_left(progress) == 30  # late by 100 s: three tenths of that are still to come


def test_what_begins_anew_is_another_step() -> None:
    """Trials of all in ten seconds, then shots of each unit at a tenth of the pace."""
    clock = TurnedClock()
    progress = Progress("verify", io.StringIO(), clock=clock)
    for done in range(1, 11):
        clock.turn_to(done)
        progress.report(done, 10)
    for done in range(1, 4):
        clock.turn(10)
        progress.report(done, 10)
    assert progress.line() == "verify: 40 s, 30 %, about 70 s left of this step"


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


def test_nothing_is_promised_that_is_not_known() -> None:
    clock = TurnedClock()
    progress = Progress("gate", io.StringIO(), clock=clock)
    progress.report(1, 2)
    clock.turn(100)
    assert (shown_left(progress) or 0) >= 10
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


def test_the_bar_is_as_wide_as_the_terminal_and_what_stands_beside_it_is_whole() -> None:
    for columns in (30, 50, 79, 119, 200):
        bar = at_work().bar(columns)
        assert len(bar) == columns
        assert bar.startswith("optimise  33 % █")
        drawn = bar.count("█") + bar.count("░")
        assert drawn >= 10
        assert bar.count("█") == pytest.approx(drawn / 3, abs=0.5)
    bar = at_work().bar(100)
    assert bar.endswith("░ about 60 s left, start 5 of 8, least cost so far 1746.2")
    # A cost of 17 is not one of 1746.2.
    for columns in range(30, 120):
        tail = at_work().bar(columns).rpartition("░")[2]
        parts = ["", " about 60 s left", ", start 5 of 8", ", least cost so far 1746.2"]
        assert tail in ["".join(parts[: count + 1]) for count in range(4)]
    assert "#" in at_work("ascii").bar(79)
    assert at_work("ascii").bar(79).isascii()
    assert at_work().bar(12) == "optimise: 30"
    progress = at_work()
    assert progress.line() == "optimise: 30 s, 33 %, about 60 s left, start 5 of 8, least cost so far 1746.2"


def test_the_width_is_that_of_the_terminal_just_now() -> None:
    master, slave = pty.openpty()
    with os.fdopen(master, "rb", buffering=0), os.fdopen(slave, "w") as stream:
        progress = Progress("verify", stream)
        for columns in (80, 133):
            fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", 24, columns, 0, 0))
            assert progress._columns() == columns - 1


def test_what_is_said_meanwhile_does_not_stand_on_the_bar(monkeypatch: pytest.MonkeyPatch) -> None:
    """A terminal of 80 columns: the line of progress is taken off it before another is written."""
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
