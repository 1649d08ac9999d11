"""Designs on their way into the database: found at once where they came, soon elsewhere, and never waited for."""

from __future__ import annotations

import asyncio

import pytest

from tailstack.errors import Problem
from tailstack_service.http import kept_designs
from tailstack_service.http.kept_designs import CLOSING_SECONDS, FRESH_SECONDS, PAUSE_SECONDS, KeptDesigns
from tailstack_service.problems import StoreUnavailable
from turned_clock import TurnedClock
from waiting import until_async


class Table:
    """Stands for the database of several API processes."""

    def __init__(self) -> None:
        self.rows: dict[tuple[str, str], bytes] = {}
        self.writes: list[int] = []
        self.broken = False

    async def read(self, tenant: str, sha256: str) -> bytes | None:
        return self.rows.get((tenant, sha256))

    async def write(self, entries: list[tuple[str, str, bytes]]) -> None:
        self.writes.append(len(entries))
        if self.broken:
            raise StoreUnavailable(Problem("", "store-unavailable", "gone"))
        self.rows |= {(tenant, sha256): body for tenant, sha256, body in entries}


def test_a_design_is_found_at_once_where_it_came_and_soon_elsewhere() -> None:
    async def story() -> None:
        table, clock = Table(), TurnedClock()
        here, there = (KeptDesigns(table.read, table.write, clock=clock) for _ in range(2))
        here.keep("a", [("1", b"{}")])
        assert table.rows == {}
        assert await here.find("a", "1") == b"{}"
        assert await found_later(there, "a", "1", clock) == b"{}"
        assert await found_later(there, "b", "1", clock) is None

    asyncio.run(story())


async def found_later(designs: KeptDesigns, tenant: str, sha256: str, clock: TurnedClock) -> bytes | None:
    """A design that is not there yet: whoever asks for it looks a second time, after several writes."""
    asking = asyncio.ensure_future(designs.find(tenant, sha256))
    await clock.until_waits_async(4 * PAUSE_SECONDS)
    clock.turn(PAUSE_SECONDS)
    await until_async(lambda: not designs._waiting)
    clock.turn(3 * PAUSE_SECONDS)
    return await asking


async def written(table: Table, count: int, clock: TurnedClock) -> None:
    """Let the pause pass until there were so many writes."""
    await clock.until_waits_async(PAUSE_SECONDS)
    clock.turn(PAUSE_SECONDS)
    await until_async(lambda: len(table.writes) == count)


def test_what_comes_together_is_written_together_and_once() -> None:
    async def story() -> None:
        table, clock = Table(), TurnedClock()
        here = KeptDesigns(table.read, table.write, clock=clock)
        for name in "1231":
            here.keep("a", [(name, b"{}")])
        await written(table, 1, clock)
        here.keep("a", [("1", b"{}")])
        await here.close()
        assert table.writes == [3]

    asyncio.run(story())


def test_a_design_that_was_written_long_ago_is_written_again() -> None:
    """By then the database may have forgotten it."""

    async def story() -> None:
        table, clock = Table(), TurnedClock()
        here = KeptDesigns(table.read, table.write, clock=clock)
        here.keep("a", [("1", b"{}")])
        await written(table, 1, clock)
        clock.turn(FRESH_SECONDS - 0.001)
        here.keep("a", [("1", b"{}")])
        assert not here._waiting
        clock.turn(0.002)
        here.keep("a", [("1", b"{}")])
        await written(table, 2, clock)

    asyncio.run(story())


def test_a_design_that_is_gone_is_written_again_when_it_is_sent_again() -> None:
    async def story() -> None:
        table, clock = Table(), TurnedClock()
        here = KeptDesigns(table.read, table.write, clock=clock)
        here.keep("a", [("1", b"{}")])
        await written(table, 1, clock)
        table.rows.clear()
        assert await found_later(here, "a", "1", clock) is None
        here.keep("a", [("1", b"{}")])
        await here.close()
        assert table.rows == {("a", "1"): b"{}"}

    asyncio.run(story())


def test_a_database_that_does_not_answer_holds_no_stop_up() -> None:
    async def story() -> None:
        table, clock = Table(), TurnedClock()

        async def never(entries: list[tuple[str, str, bytes]]) -> None:
            await asyncio.get_running_loop().create_future()

        here = KeptDesigns(table.read, never, clock=clock)
        here.keep("a", [("1", b"{}")])
        closing = asyncio.create_task(here.close())
        await clock.until_waits_async(CLOSING_SECONDS)
        assert not closing.done()
        clock.turn(CLOSING_SECONDS)
        await closing

    asyncio.run(story())


def test_without_a_database_little_is_remembered_and_nobody_waits(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kept_designs, "MOST_WAITING", 3)

    async def story() -> None:
        table = Table()
        table.broken = True
        here = KeptDesigns(table.read, table.write)
        here.keep("a", [(name, b"{}") for name in "12345"])
        await here.close()
        assert table.writes == [3]
        assert await here.find("a", "5") is None

    asyncio.run(story())


def test_what_has_not_been_written_is_written_when_the_service_stops() -> None:
    async def story() -> None:
        table = Table()
        here = KeptDesigns(table.read, table.write)
        here.keep("a", [("1", b"{}")])
        await here.close()
        assert table.rows == {("a", "1"): b"{}"}

    asyncio.run(story())
