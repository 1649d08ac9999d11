"""Designs on their way into the database: found at once where they came, soon elsewhere, and never waited for."""

from __future__ import annotations

import asyncio
from math import inf

import pytest

from tailstack.errors import Problem
from tailstack_service.http import kept_designs
from tailstack_service.http.kept_designs import KeptDesigns
from tailstack_service.jobs.store.errors import StoreUnavailable
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
        table = Table()
        here, there = KeptDesigns(table.read, table.write), KeptDesigns(table.read, table.write)
        here.keep("a", [("1", b"{}")])
        assert table.rows == {}
        assert await here.find("a", "1") == b"{}"
        assert await there.find("a", "1") == b"{}"
        assert await there.find("b", "1") is None

    asyncio.run(story())


def test_what_comes_together_is_written_together_and_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kept_designs, "FRESH_SECONDS", inf)

    async def story() -> None:
        table = Table()
        here = KeptDesigns(table.read, table.write)
        for name in "1231":
            here.keep("a", [(name, b"{}")])
        await until_async(lambda: table.writes)
        here.keep("a", [("1", b"{}")])
        await here.close()
        assert table.writes == [3]

    asyncio.run(story())


def test_a_design_that_is_gone_is_written_again_when_it_is_sent_again() -> None:
    async def story() -> None:
        table = Table()
        here = KeptDesigns(table.read, table.write)
        here.keep("a", [("1", b"{}")])
        await until_async(lambda: table.writes)
        table.rows.clear()
        assert await here.find("a", "1") is None
        here.keep("a", [("1", b"{}")])
        await here.close()
        assert table.rows == {("a", "1"): b"{}"}

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
