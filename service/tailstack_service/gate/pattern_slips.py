"""Patterns that can match nothing, or not what they were written for, by policy and waivers: refused with the cure.

A pattern that silently matches nothing leaves a class without designs, and its limits with nobody who is held to them.
Of signs a pattern has ``*`` and ``?``.  What others read as an exception, a list, a class of characters, a variable or
a regular expression is refused wherever it stands, for nobody knows whether it is meant so.
"""

from __future__ import annotations

import posixpath
import re
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import NamedTuple

from tailstack.design.refusals import place
from tailstack.errors import Problem

from .file_names import ABSOLUTE, match_names, normalise, split_ascent
from .policy import GatePolicy, Rules
from .reading import GateDesign, GateError, add_prefix
from .waivers import GateWaivers


class Slip(NamedTuple):
    """What is wrong with a pattern, and what to do."""

    words: str
    cure: str


_SIGN = re.compile(r"""[\\'"$|{}\[\]^]|[@+!]\(|^!|%[A-Za-z_]\w*%|^\s|\s$""")
_ELSEWHERE = re.compile(rf"~[\w-]*(/|$)|{ABSOLUTE.pattern}|[A-Za-z][A-Za-z0-9+.-]+:/")
CURE = (
    "write one pattern for each name that is meant, and ? for a sign that stands in a name; what is excepted gets a "
    "class before this one"
)


def find_slip(pattern: str, *, of_files: bool = True) -> Slip | None:
    """What keeps a pattern from matching what it was written for; None if nothing does."""
    meant = normalise(pattern).removeprefix("./")
    if sign := _SIGN.search(meant):
        return Slip(f"has {sign.group()!r}, and of signs a pattern has * and ? alone", CURE)
    if not of_files:
        return None
    if _ELSEWHERE.match(meant):
        below = "/".join(meant.split("/")[-2:]).strip("/")
        return Slip("is no path from the root of the repository", f"names begin there, as in {below!r}")
    if meant.endswith("/") or meant in (".", ".."):
        return Slip("is a folder, and files are judged", f"write {meant.rstrip('/') + '/*'!r}")
    if {"", ".", ".."} & {*split_ascent(meant)[1].split("/")}:
        return Slip("has parts that no name has", f"write {posixpath.normpath(meant)!r}")
    return None


# --- the patterns of a gate -------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class _Stated:
    """A pattern where it stands."""

    pointer: str
    pattern: str
    of_files: bool = True


def list_file_patterns(policy: GatePolicy, waivers: GateWaivers | None) -> list[str]:
    """Patterns of files, of both documents."""
    stated = [*_list_patterns(policy), *_list_waived(waivers)]
    return [entry.pattern for entry in stated if entry.of_files]


def _list_patterns(policy: GatePolicy) -> Iterator[_Stated]:
    document = policy.document
    sections: list[tuple[str, Rules]] = [("", document.rules)]
    for index, entry in enumerate(document.classes):
        sections.append((f"/classes/{index}", entry.rules))
        for number, pattern in enumerate(entry.files or ()):
            yield _Stated(f"/classes/{index}/files/{number}", pattern)
    for at, rules in sections:
        for index, process in enumerate(rules.process_capability.processes):
            for number, pattern in enumerate(process.tolerances):
                where = f"{at}/rules/process-capability/processes/{index}/tolerances/{number}"
                yield _Stated(where, pattern, of_files=False)


def _list_waived(waivers: GateWaivers | None) -> Iterator[_Stated]:
    for index, waiver in enumerate(() if waivers is None else waivers.entries):
        for number, pattern in enumerate(waiver.designs or ()):
            yield _Stated(f"/waivers/{index}/designs/{number}", pattern)


def check_patterns(
    policy: GatePolicy,
    waivers: GateWaivers | None,
    designs: Sequence[GateDesign],
    *,
    ascents: Sequence[int | None] | None = None,
    prefixes: tuple[str, str] = ("", ""),
) -> None:
    """Raises GateError for patterns that can match nothing.

    ascents: of either document, how many folders lie between it and the root, None where there is none; None: names
    are from where they begin.  prefixes: of the pointers to either document, in the request that it came in.
    """
    files = [name for design in designs for name in design.known_as]
    highest = max((split_ascent(name)[0] for name in files), default=0)
    limits = [highest if limit is None else limit for limit in ascents or (None, None)]
    above = {str(folder) for name in files for folder in PurePosixPath(name).parents} - {"/", "."}
    for document, stated, limit, prefix in (
        (policy, _list_patterns(policy), limits[0], prefixes[0]),
        (waivers, _list_waived(waivers), limits[1], prefixes[1]),
    ):
        problems = []
        for entry in stated:
            slip = find_slip(entry.pattern, of_files=entry.of_files)
            if slip is None and entry.of_files:
                slip = _find_place_slip(entry.pattern, files, above, limit)
            if slip:
                detail = f"the pattern {entry.pattern!r} {slip.words}"
                problems.append(Problem(entry.pointer, "bad-pattern", detail, slip.cure))
        if problems and document is not None:
            source = document.source.with_places()
            raise GateError(add_prefix(tuple(place(problem, source) for problem in problems), prefix))


def _find_place_slip(pattern: str, names: Sequence[str], above: Collection[str], limit: int) -> Slip | None:
    """Of a pattern without a slip in its text: that it leads out of the repository, or to folders and no file."""
    if split_ascent(pattern.removeprefix("./"))[0] > limit:
        return Slip("leads out of the repository", "names begin at its root: leave out ../")
    if match_names(above, pattern) and not match_names(names, pattern):
        return Slip("is a folder, and files are judged", f"write {pattern + '/*'!r}")
    return None
