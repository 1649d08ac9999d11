"""Patterns that can match nothing, or not what they were written for, by policy and waivers: refused with the cure.

A pattern that silently matches nothing leaves a class without designs, and its limits with nobody who is held to them.
What other tools read as an exception, a list or a variable has no meaning here.
"""

from __future__ import annotations

import posixpath
import re
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

from tailstack.design.refusals import place
from tailstack.errors import Problem

from .file_names import ABSOLUTE, find_literal, match_names, normalise, split_ascent
from .policy import GatePolicy, Rules
from .reading import GateError, add_prefix
from .waivers import GateWaivers

if TYPE_CHECKING:
    from .judge import GateDesign


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
_ESCAPED = re.compile(r"\[[^\]!]\]")  # a sign that is meant as it is


def find_slip(pattern: str, literal: Collection[str] = (), *, of_files: bool = True) -> Slip | None:
    """What keeps a pattern from matching what it was written for; None if nothing does.

    literal: parts of it that exist as they are written, in which nothing is a slip.
    """
    known = {normalise(part) for part in literal}
    meant = "/".join("x" if part in known else part for part in normalise(pattern).removeprefix("./").split("/"))
    meant = _ESCAPED.sub("x", meant)
    for expression, words, cure in (*_ANYWHERE, *(_FILES if of_files else ())):
        if found := re.search(expression, meant):
            return Slip(words, cure if isinstance(cure, str) else cure(meant, found))
    parts = split_ascent(meant)[1].split("/")
    if of_files and {"", ".", ".."} & {*parts}:
        return Slip("has parts that no name has", f"write {posixpath.normpath(meant)!r}")
    return next((slip for part in parts if (slip := _find_class_slip(part))), None)


_CLASS = re.compile(r"\[(!?\]?[^\]]*)\]")


def _find_class_slip(part: str) -> Slip | None:
    """In a part of a pattern, between slashes, what is no class of characters, or none that was meant."""
    if "[" in _CLASS.sub("", part):
        return Slip("has a bracket that is not closed before the next /", "close it; the sign itself is written [[]")
    for found in _CLASS.finditer(part):
        inside = found.group(1)
        signs = re.sub(r".-.", "", inside)
        if inside in ("", "!"):
            return Slip(f"has {found.group()}, which holds no character", "write those that are meant, as in [ab]")
        if inside.startswith("^"):
            return Slip(f"has {found.group()}, in which ^ is a sign like others", f"all but these is [!{inside[1:]}]")
        if re.match(r"\[[:.=]", inside):
            return Slip(f"has {found.group()}, and classes have no names here", "digits are [0-9], letters [A-Za-z]")
        if any(low > high for low, high in re.findall(r"(.)-(.)", inside)):
            return Slip(f"has {found.group()}, a range that runs backwards", "write the lower end first: [a-z]")
        if re.search(r"[,;|\s]", signs) or len({*signs}) < len(signs):
            return Slip(f"has {found.group()}, which is one character", f"for several names, {LIST}")
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
    stated = [*_list_patterns(policy), *(_list_waived(waivers) if waivers else ())]
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


def _list_waived(waivers: GateWaivers) -> Iterator[_Stated]:
    for index, waiver in enumerate(waivers.entries):
        for number, pattern in enumerate(waiver.designs or ()):
            yield _Stated(f"/waivers/{index}/designs/{number}", pattern)


def settle_patterns(
    policy: GatePolicy,
    waivers: GateWaivers | None,
    designs: Sequence[GateDesign],
    literal: Collection[str],
    *,
    folders: Collection[str] = (),
    ascents: Sequence[int | None] | None = None,
    prefixes: tuple[str, str] = ("", ""),
) -> tuple[GatePolicy, GateWaivers | None]:
    """Both, with what of their patterns is to be read as it is written.  Raises GateError for what can match nothing.

    literal: parts of patterns that exist as they are written, besides those of the designs' files.  folders: patterns
    that are folders.  ascents: of either document, how many folders lie between it and the root, None where there is
    none; None: names are from where they begin.  prefixes: of the pointers to either document, in the request that it
    came in.
    """
    files = [name for design in designs for name in design.known_as]  # not their own names, which their authors choose
    known = frozenset([*literal, *find_literal(list_file_patterns(policy, waivers), files)])
    names = [*files, *(design.design.name for design in designs if design.design is not None)]
    highest = max((split_ascent(name)[0] for name in files), default=0)
    limits = [highest if limit is None else limit for limit in ascents or (None, None)]
    above = {path for name in files for path in _list_folders(name)}
    for document, stated, limit, prefix in (
        (policy, _list_patterns(policy), limits[0], prefixes[0]),
        (waivers, _list_waived(waivers) if waivers else (), limits[1], prefixes[1]),
    ):
        problems = []
        for entry in stated:
            slip = find_slip(entry.pattern, known, of_files=entry.of_files)
            if slip is None and entry.of_files:
                slip = _find_place_slip(entry.pattern, known, names, above, folders, limit)
            if slip:
                detail = f"the pattern {entry.pattern!r} {slip.words}"
                problems.append(Problem(entry.pointer, "bad-pattern", detail, slip.cure))
        if problems and document is not None:
            source = document.source.placed()
            raise GateError(add_prefix(tuple(place(problem, source) for problem in problems), prefix))
    return replace(policy, literal=known), waivers and replace(waivers, literal=known)


def _find_place_slip(
    pattern: str,
    literal: Collection[str],
    names: Sequence[str],
    above: Collection[str],
    folders: Collection[str],
    limit: int,
) -> Slip | None:
    """Of a pattern without a slip in its text: that it leads out of the repository, or to folders and no file."""
    if split_ascent(pattern.removeprefix("./"))[0] > limit:
        return Slip("leads out of the repository", "names begin at its root: leave out ../")
    if match_names(names, pattern, literal):
        return None
    if pattern in folders or match_names(above, pattern, literal):
        return Slip("is a folder, and files are judged", f"write {pattern + '/*'!r}")
    return None


def _list_folders(name: str) -> Iterator[str]:
    while name := posixpath.dirname(name):
        if name == "/":
            return
        yield name
