"""Refusals on stderr: where, what, how to mend it, and the next command to type."""

from __future__ import annotations

import argparse
import os
import sys
import traceback
from collections.abc import Iterator, Sequence
from dataclasses import replace
from shlex import quote

from tailstack.errors import Problem, TailstackError

from ..environment import TRACEBACK, FolderError, misses_temporary_folder, no_temporary_folder
from ..rendering.text import group_alike, list_others, name_field, name_rule
from .command_line import BAD_INPUT, NOT_EVALUATED, program, spell_commands

# What to type next, by class of refusal; {file} is the design that was given.
NEXT = {
    "invalid-design": "tailstack validate {file}   (all rules: tailstack schema design)",
    "malformed-document": "tailstack validate {file}",
    "ill-posed-geometry": "tailstack validate {file}   (once it is mended)",
    "method-out-of-range": "tailstack verify {file}",
    "not-converged": "tailstack verify {file} --trials 100000",
    "infeasible": "tailstack score {file}   (its budget shows what to tighten)",
    "missing-extra": "install it, then repeat the command",
    "cannot-write": "make room or name another place, then repeat the command",
    "limit-exceeded": "tailstack {verb} --help",
    "invalid-request": "tailstack {verb} --help",
}

# By what a file is that was given as a design
NEXT_OF_FILE = {
    "step-file": "tailstack convert {file} -o design.yaml",
    "report-file": "tailstack report --verify {file}",
    "schema-file": "tailstack init   (makes a first design; tailstack example prints others)",
}

# validate does not look at what optimise and allocate are asked for, and has itself just been called
SAME_AGAIN = "mend it, then tailstack {verb} {file}   (all rules: tailstack schema design)"
NO_DESIGN = "tailstack init   (makes a first design; tailstack example prints others)"


def problem_text(problem: Problem) -> str:
    """``file:line:column: pointer: detail`` and, below it, the hint; what is in no document has no place."""
    place = problem.pointer or ("(document)" if problem.file is not None else "")
    if problem.file is not None and problem.line:
        place = f"{problem.file}:{problem.line}:{problem.column or 1}: {place}"
    elif problem.file is not None:
        place = f"{problem.file}: {place}"
    text = f"{place}: {problem.detail}" if place else problem.detail
    return text + (f"\n  hint: {spell_commands(problem.hint)}" if problem.hint else "")


def problems_text(problems: Sequence[Problem]) -> Iterator[str]:
    """Problems one after the other; three and more that say the same of several places are one, with their places."""
    for first, *others in group_alike(problems, lambda p: (p.file, p.code, name_rule(p.detail), name_field(p.pointer))):
        more = f"\n  {list_others([p.line for p in others], [p.pointer for p in others])}" if others else ""
        yield problem_text(first) + more


def name_stdin(problems: tuple[Problem, ...], file: str | None) -> tuple[Problem, ...]:
    """Problems with ``<stdin>`` for a file name where the design came from there."""
    return tuple(replace(p, file="<stdin>") if p.file is None and file == "-" else p for p in problems)


def next_command(error: TailstackError, arguments: argparse.Namespace) -> str:
    """What to type next."""
    file = getattr(arguments, "design", None) or "DESIGN"
    file = file[0] if isinstance(file, list) else file
    command = NEXT.get(error.slug, "tailstack {verb} --help")
    codes = {problem.code for problem in error.problems if not problem.pointer}
    if of_kind := [NEXT_OF_FILE[code] for code in codes if code in NEXT_OF_FILE]:
        command = of_kind[0]
    elif "file-not-found" in codes:  # of a design: what lies beside one is named on purpose
        given = getattr(arguments, "design", None) or []
        designs = [given] if isinstance(given, str) else given
        is_design = arguments.verb != "convert" and any(problem.file in designs for problem in error.problems)
        command = NO_DESIGN if is_design else "tailstack {verb} --help"
    elif error.slug == "invalid-design" and arguments.verb in ("optimise", "allocate", "validate"):
        command = SAME_AGAIN
    elif arguments.verb == "convert" and not file.endswith((".yaml", ".yml", ".json")):
        command = "tailstack {verb} --help"
    return spell_commands("next: " + command.format(file=quote(file), verb=arguments.verb))


def report_error(error: TailstackError | OSError, arguments: argparse.Namespace) -> int:
    """Write a refusal to stderr, as a problem document with --json.  Returns the exit code."""
    _show_traceback()
    if isinstance(error, OSError):
        if misses_temporary_folder(error):
            return _report(FolderError(no_temporary_folder()), arguments, NOT_EVALUATED)
        name = f"{error.filename}: " if error.filename else ""
        problem = Problem("", "os-error", f"{name}{error.strerror or error}")
        code = BAD_INPUT if error.filename else NOT_EVALUATED
        return _report(RequestOrSystemError(problem), arguments, code)
    return _report(error, arguments, error.exit_code)


class RequestOrSystemError(TailstackError, slug="invalid-request", title="The operating system refused"):
    """The operating system refused: a file, a port, a full disk."""


def _report(error: TailstackError, arguments: argparse.Namespace, code: int) -> int:
    problems = name_stdin(error.problems, getattr(arguments, "design", None))
    if getattr(arguments, "json", False):
        from ..documents import to_json
        from ..problems import problem_document

        error.problems = problems
        document = problem_document(error, instance=f"tailstack {arguments.verb}")
        sys.stderr.write(to_json(document).decode() + "\n")
        return code
    title = error.title if error.title[:2].isupper() else error.title[0].lower() + error.title[1:]  # PDF stays PDF
    lines = [f"tailstack {arguments.verb}: {title}"]
    lines += problems_text(problems)
    lines.append(next_command(error, arguments))
    print("\n".join(lines), file=sys.stderr)
    return code


def report_failure(error: BaseException, arguments: argparse.Namespace) -> int:
    """A defect of ours: one paragraph, no traceback unless asked for."""
    _show_traceback()
    if getattr(arguments, "json", False):
        from ..problems import TransportError

        defect = f"{type(error).__name__}: {error}"
        told = TransportError("internal-error", defect, "repeat with TAILSTACK_TRACEBACK=1")
        return _report(told, arguments, NOT_EVALUATED)
    print(
        f"tailstack {arguments.verb}: internal error, {type(error).__name__}: {error}\n"
        "This is a defect of tailstack, not of the design; nothing was evaluated. To see where it happened,\n"
        "repeat the command with TAILSTACK_TRACEBACK=1 in the environment; report it with the output of\n"
        f"{program()} doctor.",
        file=sys.stderr,
    )
    return NOT_EVALUATED


def _show_traceback() -> None:
    """Where it happened, for who asked; what the command leaves with does not depend on that."""
    if os.environ.get(TRACEBACK):
        traceback.print_exc()
