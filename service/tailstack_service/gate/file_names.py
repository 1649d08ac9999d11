"""Patterns of files, in policies and waivers, held against the names that a file has.

A file has a name from each folder at which patterns may begin (the root of its repository first), and none from above
the root.  Names and patterns are compared in one Unicode form, NFC: the file systems of macOS hand out another one than
editors write.  ``*`` and ``?`` also cross ``/``; ``**/`` is any number of folders, none included.  A part of a pattern
that is itself the name of a file or folder is no pattern, unless it has a ``*`` or ``?``: who has a folder
``order [A7]`` means that one and not ``order A``.
"""

from __future__ import annotations

import glob
import posixpath
import re
import unicodedata
from collections.abc import Collection, Iterable, Iterator
from fnmatch import fnmatchcase
from functools import lru_cache
from itertools import product

SIGNS = "*?["
ABSOLUTE = re.compile(r"[/\\]|[A-Za-z]:[/\\]")  # how such a path begins


def normalise(text: str) -> str:
    """Text in the Unicode form in which names are compared."""
    return unicodedata.normalize("NFC", text)


def is_wild(part: str) -> bool:
    """Whether a pattern, or a part of it between slashes, may stand for more than one name."""
    return any(sign in part for sign in SIGNS)


def is_open(part: str) -> bool:
    """Whether a pattern has a sign for any characters."""
    return "*" in part or "?" in part


def match_names(names: Iterable[str], pattern: str, literal: Collection[str] = ()) -> bool:
    """Whether a pattern matches one of the names of a file; an absolute one, which begins at no root, it never does.

    literal: parts of patterns that exist as they are written, as :func:`find_literal` tells.
    """
    ascent, forms = _spell_out(pattern, frozenset(literal))
    known = (split_ascent(posixpath.normpath(normalise(name))) for name in names if not ABSOLUTE.match(name))
    return any(above == ascent and fnmatchcase(rest, form) for above, rest in known for form in forms)


@lru_cache(maxsize=4096)
def _spell_out(pattern: str, literal: frozenset[str]) -> tuple[int, tuple[str, ...]]:
    """How many folders up a pattern begins, and the rest as patterns of fnmatch: with and without ``**/``."""
    ascent, rest = split_ascent(normalise(pattern).removeprefix("./"))
    known = {normalise(part) for part in literal}
    *folders, last = rest.split("/")
    ways: list[tuple[str, ...]] = []
    for before, part in zip(["", *folders], folders, strict=False):
        if part != "**":
            ways.append(tuple(f"{way}/" for way in _list_ways(part, known)))
        elif before != "**":
            ways.append(("", "*/"))
    return ascent, tuple("".join(way) for way in product(*ways, _list_ways(last, known)))


def _list_ways(part: str, literal: Collection[str]) -> tuple[str, ...]:
    """What a part may be.  A file called ``*.yaml`` takes nothing away from the pattern, whoever laid it there."""
    if part not in literal:
        return (part,)
    return (glob.escape(part), part) if is_open(part) else (glob.escape(part),)


def split_ascent(path: str) -> tuple[int, str]:
    """How many folders up a path begins, and what follows."""
    rest = path
    while rest.startswith("../"):
        rest = rest.removeprefix("../")
    return (len(path) - len(rest)) // 3, rest


def list_signed_parts(pattern: str) -> list[str]:
    """Parts of a pattern that hold more than letters, digits, blanks, dots and dashes."""
    return [part for part in normalise(pattern).split("/") if re.search(r"[^\w .-]", part)]


def find_literal(patterns: Iterable[str], names: Iterable[str]) -> Iterator[str]:
    """Parts of patterns with signs in them that are, as they are written, parts of these names."""
    parts = {part for name in names for part in normalise(name).split("/")}
    for pattern in patterns:
        yield from (part for part in list_signed_parts(pattern) if part in parts)
