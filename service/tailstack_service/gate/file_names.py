"""Patterns of files, in policies and waivers, held against the names that a file has.

A file has a name from each folder at which patterns may begin (the root of its repository first), and none from above
the root.  Names and patterns are compared in one Unicode form, NFC: the file systems of macOS hand out another one than
editors write.  ``*`` and ``?`` also cross ``/``; ``**/`` is any number of folders, none included.  Brackets are no
classes of characters (``pattern_slips`` refuses them): who has a folder ``order [A7]`` never means ``order A``.
"""

from __future__ import annotations

import posixpath
import re
import unicodedata
from collections.abc import Iterable
from fnmatch import fnmatchcase
from functools import lru_cache
from itertools import product

ABSOLUTE = re.compile(r"[/\\]|[A-Za-z]:[/\\]")  # how such a path begins


def normalise(text: str) -> str:
    """Text in the Unicode form in which names are compared."""
    return unicodedata.normalize("NFC", text)


def is_wild(part: str) -> bool:
    """Whether a pattern, or a part of it between slashes, may stand for more than one name."""
    return "*" in part or "?" in part


def write_fnmatch(pattern: str) -> str:
    """The same pattern for fnmatch, which knows brackets as classes."""
    return normalise(pattern).replace("[", "[[]")


def match_names(names: Iterable[str], pattern: str) -> bool:
    """Whether a pattern matches one of the names of a file; an absolute one, which begins at no root, it never does."""
    ascent, forms = _spell_out(pattern)
    known = (split_ascent(posixpath.normpath(normalise(name))) for name in names if not ABSOLUTE.match(name))
    return any(above == ascent and fnmatchcase(rest, form) for above, rest in known for form in forms)


@lru_cache(maxsize=4096)
def _spell_out(pattern: str) -> tuple[int, tuple[str, ...]]:
    """How many folders up a pattern begins, and the rest as patterns of fnmatch: with and without ``**/``."""
    ascent, rest = split_ascent(write_fnmatch(pattern).removeprefix("./"))
    *folders, last = rest.split("/")
    ways = [
        ("", "*/") if part == "**" else (f"{part}/",)
        for before, part in zip(["", *folders], folders, strict=False)
        if (before, part) != ("**", "**")
    ]
    return ascent, tuple("".join(way) for way in product(*ways, (last,)))


def split_ascent(path: str) -> tuple[int, str]:
    """How many folders up a path begins, and what follows."""
    rest = path
    while rest.startswith("../"):
        rest = rest.removeprefix("../")
    return (len(path) - len(rest)) // 3, rest
