"""Patterns that can match nothing, or not what they were written for, by policy and waivers: refused with the cure.

A pattern that silently matches nothing leaves a class without designs, and its limits with nobody who is held to them.
What other tools read as an exception, a list or a variable has no meaning here.
"""

from __future__ import annotations

import posixpath
import re
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
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


def _write_one_each(pattern: str, found: re.Match[str]) -> str:
    inside = found.group()[1:-1]
    each = [pattern[: found.start()] + part.strip() + pattern[found.end() :] for part in inside.split(",")]
    return f"write one pattern for each: {', '.join(map(repr, each))}" if "," in inside else LIST


_Cure = str | Callable[[str, re.Match[str]], str]
LIST = "write one pattern for each"
SIGN = "a sign that stands in a name is written ?"
NAMED = "name what is meant; designs that are excepted get a class before this one"
# What holds of any pattern, of files and of tolerances.  The first that is found is said.
_ANYWHERE: tuple[tuple[str, str, _Cure], ...] = (
    (r"^\s|\s$", "begins or ends with a blank", lambda pattern, _: f"write {pattern.strip()!r}"),
    (r"^(['\"]).*\1$", "stands in quotes twice", lambda pattern, _: f"write {pattern[1:-1]!r}"),
    (r"\$[{(\w]|\$\[\[|\{\{|%[A-Za-z_]\w*%", "has a variable, and none is filled in",
     f"write what it stands for; {SIGN}"),
    (r"^!", "begins with !, and there are no exceptions here", f"{NAMED}; {SIGN}"),
    (r"[@+!]\(.*\)|[?*]\([^()]*\|.*\)|\|", "has alternatives, which are none here", f"{LIST}; {SIGN}"),
    (r"\{[^{}]*(,|\.\.)[^{}]*\}", "has braces, which are no list here", _write_one_each),
    (r"[\[\]]", "has a bracket, and there are no classes of characters here", f"{LIST}; {SIGN}"),
    (r"^\^|\$$", "looks like a regular expression", "a pattern is always of the whole name: leave out ^ and $"),
    (r"\\", "has a backslash, which is in no name",
     lambda pattern, _: f"write {pattern.replace(chr(92), '/')!r}; {SIGN}"),
)  # fmt: skip
_FILES: tuple[tuple[str, str, _Cure], ...] = (
    (r"^~[\w-]*(/|$)", "begins at somebody's home", "names begin at the root of the repository"),
    (rf"^(?:{ABSOLUTE.pattern}|[A-Za-z][A-Za-z0-9+.-]+:/)", "is an absolute path",
     lambda pattern, _: "names begin at the root of the repository, as in "
     f"{'/'.join(pattern.split('/')[-2:]).strip('/')!r}"),
    (r"\.(?:ya?ml|json)['\"]?[\s,;:]+\S*\.(?:ya?ml|json)$", "is several patterns in one", LIST),
    (r"/$|^\.{1,2}$", "is a folder, and files are judged", lambda pattern, _: f"write {pattern.rstrip('/') + '/*'!r}"),
)  # fmt: skip


def find_slip(pattern: str, *, of_files: bool = True) -> Slip | None:
    """What keeps a pattern from matching what it was written for; None if nothing does."""
    meant = normalise(pattern).removeprefix("./")
    for expression, words, cure in (*_ANYWHERE, *(_FILES if of_files else ())):
        if found := re.search(expression, meant):
            return Slip(words, cure if isinstance(cure, str) else cure(meant, found))
    parts = split_ascent(meant)[1].split("/")
    if of_files and {"", ".", ".."} & {*parts}:
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
    above = {path for name in files for path in _list_folders(name)}
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


def _list_folders(name: str) -> Iterator[str]:
    while name := posixpath.dirname(name):
        if name == "/":
            return
        yield name
