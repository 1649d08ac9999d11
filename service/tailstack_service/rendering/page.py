"""The page that texts are laid out on: how wide it is, whether it has colours, and how much it says.

A command chooses its page once, before its verb runs; whatever writes for people asks ``current()``.  Without a choice
the page is ``Page()``, so that a text is the same bytes in a pipe, a file, a test and an answer over HTTP.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass

WIDTH = 80  # columns, where nobody says another number
NARROWEST = 40  # a page of fewer columns is written as one of so many
WIDEST_PROSE = 100  # columns of a paragraph: longer lines are hard to read


@dataclass(frozen=True, slots=True)
class Page:
    """What a text is written for."""

    width: int = WIDTH  # columns
    colour: bool = False
    details: bool = False  # with the method's own words and figures


_page: ContextVar[Page] = ContextVar("page", default=Page())  # noqa: B039 (a frozen record)


def current() -> Page:
    """The page that is being written on."""
    return _page.get()


@contextmanager
def write_on(page: Page) -> Iterator[None]:
    """Lay out every text of the block on a page."""
    token = _page.set(page)
    try:
        yield
    finally:
        _page.reset(token)
