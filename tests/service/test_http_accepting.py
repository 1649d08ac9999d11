"""Processes that listen on one socket share what connects, also when one of them is busy for a while."""

from __future__ import annotations

import asyncio
import errno
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, cast

import pytest

from tailstack_service.http import accepting
from tailstack_service.http.accepting import Taking


class Listener(threading.Thread):
    """An event loop of its own that takes connections and keeps them, as an API process does."""

    def __init__(self, bound: socket.socket) -> None:
        super().__init__(daemon=True)
        self.bound, self.open = bound, set[asyncio.BaseTransport]()
        self.loop = asyncio.new_event_loop()
        self.ready, self.end = threading.Event(), asyncio.Event()

    def protocol(self) -> asyncio.Protocol:
        listener = self

        class Kept(asyncio.Protocol):
            def connection_made(self, transport: asyncio.BaseTransport) -> None:
                listener.open.add(transport)

        return Kept()

    def run(self) -> None:
        asyncio.set_event_loop(self.loop)
        self.loop.run_until_complete(self._story())
        self.loop.close()

    async def _story(self) -> None:
        taking = Taking(self.bound, self.protocol, lambda: len(self.open))
        self.ready.set()
        await self.end.wait()
        taking.close()
        taking.close()
        await taking.wait_closed()
        for transport in self.open:
            cast(asyncio.Transport, transport).abort()
        await asyncio.sleep(0.01)

    def busy(self, seconds: float) -> None:
        self.loop.call_soon_threadsafe(time.sleep, seconds)
        time.sleep(0.002)

    def stop(self) -> None:
        self.loop.call_soon_threadsafe(self.end.set)
        self.join(10)


@contextmanager
def two_listeners() -> Iterator[tuple[tuple[str, int], Listener, Listener]]:
    with socket.create_server(("127.0.0.1", 0), backlog=100) as bound:
        listeners = [Listener(bound.dup()), Listener(bound.dup())]
        for listener in listeners:
            listener.start()
            assert listener.ready.wait(10)
        try:
            yield bound.getsockname(), *listeners
        finally:
            for listener in listeners:
                listener.stop()
                listener.bound.close()


def until(true: Any, seconds: float = 10.0) -> None:
    deadline = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < deadline
        time.sleep(0.001)


@pytest.mark.parametrize("busy_seconds", [0.0, 0.004])
def test_what_connects_at_once_is_shared(busy_seconds: float) -> None:
    """Sixteen connections within a millisecond or two; neither has fewer than three of them."""
    with two_listeners() as (address, first, second):
        if busy_seconds:
            first.busy(busy_seconds)
        clients = [socket.create_connection(address) for _ in range(16)]
        try:
            until(lambda: len(first.open) + len(second.open) == 16)
            assert min(len(first.open), len(second.open)) >= 3
        finally:
            for client in clients:
                client.close()


def test_one_that_is_busy_for_long_leaves_its_share_to_the_other() -> None:
    with two_listeners() as (address, first, second):
        first.busy(0.5)
        with socket.create_connection(address), socket.create_connection(address):
            until(lambda: len(second.open) == 2, 0.4)
            assert not first.open


def test_a_process_that_can_open_nothing_more_tries_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(accepting, "FULL_SECONDS", 0.05)

    class Full:
        """A socket whose first accept fails."""

        def __init__(self, bound: socket.socket) -> None:
            self.bound, self.asked = bound, 0

        def accept(self) -> Any:
            self.asked += 1
            if self.asked == 1:
                raise OSError(errno.EMFILE, "Too many open files")
            return self.bound.accept()

        def __getattr__(self, name: str) -> Any:
            return getattr(self.bound, name)

    with socket.create_server(("127.0.0.1", 0)) as bound:
        full = Full(bound)
        listener = Listener(cast(socket.socket, full))
        listener.start()
        assert listener.ready.wait(10)
        with socket.create_connection(bound.getsockname()):
            until(lambda: len(listener.open) == 1)
        listener.stop()
    assert full.asked >= 2
