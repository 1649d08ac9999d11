"""Patterns of files, in policies and waivers, held against the names that a file has.

A file has a name from each folder at which patterns may begin (the root of its repository first).  Names and patterns
are compared in one Unicode form, NFC: the file systems of macOS hand out another one than editors write.  ``*`` and
``?`` also cross ``/``.  A part of a pattern that is itself the name of a file or folder is no pattern: who has a folder
``order [A7]`` means that one and not ``order A``.
"""

from __future__ import annotations

import glob
import unicodedata
from collections.abc import Collection, Iterable, Iterator
from fnmatch import fnmatchcase

SIGNS = "*?["


def normalise(text: str) -> str:
    """Text in the Unicode form in which names are compared."""
    return unicodedata.normalize("NFC", text)


def is_wild(part: str) -> bool:
    """Whether a pattern, or a part of it between slashes, may stand for more than one name."""
    return any(sign in part for sign in SIGNS)


def match_names(names: Iterable[str], pattern: str, literal: Collection[str] = ()) -> bool:
    """Whether a pattern matches one of the names of a file.

    literal: parts of patterns that exist as they are written, as :func:`find_literal` tells.
    """
    meant = normalise(pattern).removeprefix("./")
    if literal:
        known = {normalise(part) for part in literal}
        meant = "/".join(glob.escape(part) if part in known else part for part in meant.split("/"))
    return any(fnmatchcase(normalise(name), meant) for name in names)


def find_literal(patterns: Iterable[str], names: Iterable[str]) -> Iterator[str]:
    """Parts of patterns with wildcards in them that are, as they are written, parts of these names."""
    parts = {part for name in names for part in normalise(name).split("/")}
    for pattern in patterns:
        yield from (part for part in normalise(pattern).split("/") if is_wild(part) and part in parts)
