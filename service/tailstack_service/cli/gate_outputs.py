"""Where a gate writes: formats to files and to stdout, and the summary of a step in GitHub Actions.

Each file says *not evaluated* as soon as a gate has begun: one that is killed leaves nothing that looks current.  At
the end all are written, or none says that the gate passed.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from tailstack.errors import Problem, TailstackError

from ..console.files import Staged, append, is_stream, staged

if TYPE_CHECKING:
    from ..gate.records import GateRecord

SUMMARY = "GITHUB_STEP_SUMMARY"
ROOTS = ("GITHUB_WORKSPACE", "CI_PROJECT_DIR")  # where GitHub and GitLab check the repository out
FOR_PEOPLE = ("text", "markdown", "github")  # on stdout they say why a gate failed
MEND = "make room for it or give another name, then run the gate again: no verdict is given without its files"


class OutputError(TailstackError):
    """Somewhere an output was asked for cannot be written to."""

    slug = "invalid-request"
    title = "An output cannot be written"
    exit_code = 3


@dataclass(frozen=True, slots=True)
class Outputs:
    """Formats with their files, None for stdout; of the files, those that can be written."""

    formats: tuple[tuple[str, str | None], ...]
    usable: tuple[tuple[str, str], ...]

    def begin(self, record: GateRecord) -> tuple[Outputs, list[Problem]]:
        """Let every file say that the gate has not ended.  Returns what can be written to, and what cannot.

        A file of an earlier gate that cannot be replaced, as the disk is full, is removed.
        """
        problems: list[Problem] = []
        usable: list[tuple[str, str]] = []
        for name, file in self.usable:
            try:
                if not is_stream(file):
                    staged(file, written(name, record)).put()
                usable.append((name, file))
            except OSError as error:
                problems.append(_refused(file, error))
                _remove(file)
        return replace(self, usable=tuple(usable)), problems

    def publish(self, record: GateRecord) -> list[Problem]:
        """Write the record everywhere but to stdout.  Returns what could not be written.

        Every file is written beside its place first: one that cannot be keeps all of them from being replaced.
        """
        beside: list[Staged] = []
        problems: list[Problem] = []
        for name, file in self.usable:
            if is_stream(file):
                continue
            try:
                beside.append(staged(file, written(name, record)))
            except OSError as error:
                problems.append(_refused(file, error))
        for entry in beside:
            try:
                if problems:
                    entry.drop()
                else:
                    entry.put()
            except OSError as error:
                problems.append(_refused(entry.file, error))
        for name, file in () if problems else self.usable:
            try:
                if is_stream(file):
                    append(file, written(name, record))
            except OSError as error:
                problems.append(_refused(file, error))
        return problems or self.summary(record)

    def correct(self, record: GateRecord) -> None:
        """Write a record that says what could not be written wherever it can be; a file where it cannot is removed."""
        for name, file in self.usable:
            try:
                if is_stream(file):
                    append(file, written(name, record))
                else:
                    staged(file, written(name, record)).put()
            except OSError:
                _remove(file)
        self.summary(record)

    def stdout(self, record: GateRecord) -> str | bytes:
        """What goes to stdout."""
        from ..console.arguments import coloured_output
        from ..gate.terminal import gate_text

        name = self.on_stdout
        if name == "text":
            return gate_text(record, colour=coloured_output())
        return "" if name is None else written(name, record)

    @property
    def on_stdout(self) -> str | None:
        """The format on stdout."""
        return next((name for name, file in self.formats if file is None), None)

    def summary(self, record: GateRecord) -> list[Problem]:
        """Append to the summary of a step of GitHub Actions, where format github was asked for."""
        file = os.environ.get(SUMMARY)
        if not file or not any(name == "github" for name, _ in self.formats):
            return []
        from ..gate.github import step_summary
        from ..gate.places import in_repository

        try:
            with open(file, "ab") as stream:
                stream.write(step_summary(in_repository(record, prefix()), stream.tell()).encode())
        except OSError as error:
            return [_refused(f"{SUMMARY} {file}", error)]
        return []


POINTS = (".csv", ".fcsv", ".mrk.json")  # endings of the files that designs take their fiducials from


def outputs_of(formats: Iterable[tuple[str, str | None]], inputs: Iterable[str]) -> tuple[Outputs, list[str]]:
    """The outputs, and what is wrong with them, in words.  inputs: files that are read and must not be written."""
    formats = tuple(formats)
    wrong: list[str] = []
    usable: list[tuple[str, str]] = []
    read = {_real(name) for name in inputs}
    if sum(file is None for _, file in formats) > 1:
        wrong.append("two formats would be written to stdout; give all but one a file: --format json=gate.json")
    for name, file in formats:
        if file is None:
            continue
        if _real(file) in read:
            wrong.append(f"--format {name}={file} would overwrite a file that is read; give it another name")
        elif file.lower().endswith(POINTS) and Path(file).exists():
            wrong.append(
                f"--format {name}={file} would overwrite what may be a file of fiducials; give it another name"
            )
        elif _real(file) in {_real(other) for _, other in usable}:
            wrong.append(f"two formats would be written to {file}; give each a file of its own")
        elif not Path(file).parent.is_dir() or Path(file).is_dir():
            wrong.append(f"cannot write {file}: no such directory, or a directory")
        else:
            usable.append((name, file))
    return Outputs(formats, tuple(usable)), wrong


def written(name: str, record: GateRecord) -> bytes:
    """A record in a format."""
    from ..gate.formats import FORMATS
    from ..gate.places import in_repository

    chosen = FORMATS[name]
    return chosen.write(in_repository(record, prefix()) if chosen.in_repository else record)


def prefix() -> str:
    """The way from the root of the repository to the working directory, where a pipeline says the first."""
    here = Path.cwd().resolve()
    for variable in ROOTS:
        root = os.environ.get(variable)
        if root and here.is_relative_to(Path(root).resolve()):
            way = here.relative_to(Path(root).resolve()).as_posix()
            return "" if way == "." else way
    return ""


def say(lines: Iterable[str]) -> None:
    for line in lines:
        print(f"tailstack gate: {line}", file=sys.stderr)


def _real(name: str) -> str:
    return os.path.realpath(name)


def _refused(file: str, error: OSError) -> Problem:
    return Problem("", "not-written", f"cannot write {file}: {error.strerror or error}", MEND, file)


def _remove(file: str) -> None:
    if Path(file).is_file():
        with suppress(OSError):
            Path(file).unlink()
