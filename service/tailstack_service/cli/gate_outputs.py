"""Where a gate writes: formats to files and to stdout, and the summary of a step in GitHub Actions.

A file of the last run must never look like an answer to this one: each says *not evaluated* as soon as a gate has
begun, so one that is killed leaves nothing that looks current.  At the end all are written, or none says that the gate
passed.
"""

from __future__ import annotations

import os
import sys
from argparse import Namespace
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from datetime import date
from pathlib import Path

from tailstack.errors import Problem
from tailstack.version import __version__

from ..console.files import Staged, append, is_stream, stage
from ..gate.reading import make_finding
from ..gate.records import GateFinding, GateProvenance, GateRecord, record_unread
from .gate_files import Anchors

SUMMARY = "GITHUB_STEP_SUMMARY"
FOR_PEOPLE = ("text", "markdown", "github")  # on stdout they say why a gate failed
MEND = "make room for it or give another name, then run the gate again: no verdict is given without its files"


@dataclass(frozen=True, slots=True)
class Outputs:
    """Formats with their files, None for stdout; of the files, those that can be written."""

    formats: tuple[tuple[str, str | None], ...]
    usable: tuple[tuple[str, str], ...]
    anchors: Anchors = field(default_factory=Anchors)  # by which files are named from the root of the repository

    def begin(self, record: GateRecord) -> tuple[Outputs, list[Problem]]:
        """Let every file say that the gate has not ended.  Returns what can be written to, and what cannot.

        A file of an earlier gate that cannot be replaced, as the disk is full, is removed.
        """
        problems: list[Problem] = []
        usable: list[tuple[str, str]] = []
        for name, file in self.usable:
            with _note(problems, file, remove=True):
                if not is_stream(file):
                    stage(file, self.render(name, record)).put()
                usable.append((name, file))
        return replace(self, usable=tuple(usable)), problems

    def publish(self, record: GateRecord) -> list[Problem]:
        """Write the record everywhere but to stdout.  Returns what could not be written.

        Every file is written beside its place first: one that cannot be keeps all of them from being replaced.
        """
        beside: list[Staged] = []
        problems: list[Problem] = []
        for name, file in self.usable:
            with _note(problems, file):
                if not is_stream(file):
                    beside.append(stage(file, self.render(name, record)))
        for entry in beside:
            with _note(problems, entry.file):
                if problems:
                    entry.drop()
                else:
                    entry.put()
        for name, file in () if problems else self.usable:
            with _note(problems, file):
                if is_stream(file):
                    append(file, self.render(name, record))
        return problems or self.summary(record)

    def correct(self, record: GateRecord) -> None:
        """Write a record that says what could not be written wherever it can be; a file where it cannot is removed."""
        for name, file in self.usable:
            with _note([], file, remove=True):
                if is_stream(file):
                    append(file, self.render(name, record))
                else:
                    stage(file, self.render(name, record)).put()
        self.summary(record)

    def stdout(self, record: GateRecord) -> str | bytes:
        from ..gate.text import render_text

        name = self.on_stdout
        if name == "text":
            return render_text(record)
        return "" if name is None else self.render(name, record)

    def render(self, name: str, record: GateRecord) -> bytes:
        from ..gate.formats import render

        return render(record, name, self.anchors.name_from_root)

    @property
    def on_stdout(self) -> str | None:
        return next((name for name, file in self.formats if file is None), None)

    def summary(self, record: GateRecord) -> list[Problem]:
        """Append to the summary of a step of GitHub Actions, where format github was asked for."""
        file = os.environ.get(SUMMARY)
        if not file or not any(name == "github" for name, _ in self.formats):
            return []
        from ..gate.formats import name_from_root, render_step_summary

        problems: list[Problem] = []
        with _note(problems, f"{SUMMARY} {file}"), open(file, "ab") as stream:
            named = name_from_root(record, self.anchors.name_from_root)
            stream.write(render_step_summary(named, stream.tell()).encode())
        return problems


POINTS = (".csv", ".fcsv", ".mrk.json")  # endings of the files that designs take their fiducials from


def choose_outputs(
    formats: Iterable[tuple[str, str | None]], inputs: Iterable[str], anchors: Anchors
) -> tuple[Outputs, list[str]]:
    """The outputs, and what is wrong with them, in words.  inputs: files that are read and must not be written."""
    formats = tuple(formats)
    wrong: list[str] = []
    usable: list[tuple[str, str]] = []
    read = {os.path.realpath(name) for name in inputs}
    if sum(file is None for _, file in formats) > 1:
        wrong.append("two formats would be written to stdout; give all but one a file: --format json=gate.json")
    for name, file in formats:
        if file is None:
            continue
        if os.path.realpath(file) in read:
            wrong.append(f"--format {name}={file} would overwrite a file that is read; give it another name")
        elif file.lower().endswith(POINTS) and Path(file).exists():
            wrong.append(
                f"--format {name}={file} would overwrite what may be a file of fiducials; give it another name"
            )
        elif os.path.realpath(file) in {os.path.realpath(other) for _, other in usable}:
            wrong.append(f"two formats would be written to {file}; give each a file of its own")
        elif not Path(file).parent.is_dir() or Path(file).is_dir():
            wrong.append(f"cannot write {file}: no such directory, or a directory")
        else:
            usable.append((name, file))
    return Outputs(formats, tuple(usable), anchors), wrong


def say(lines: Iterable[str]) -> None:
    for line in lines:
        print(f"tailstack gate: {line}", file=sys.stderr)


@contextmanager
def _note(problems: list[Problem], file: str, *, remove: bool = False) -> Iterator[None]:
    """Note what keeps a file from being written, and remove what an earlier gate left there if it is to be."""
    try:
        yield
    except OSError as error:
        problems.append(Problem("", "not-written", f"cannot write {file}: {error.strerror or error}", MEND, file))
        if remove and Path(file).is_file():
            with suppress(OSError):
                Path(file).unlink()


NOT_FINISHED = Problem("", "not-finished", "the gate has not ended: it is running, or it was killed")
INTERRUPTED = Problem("", "interrupted", "the gate was interrupted before it came to a verdict")


def record_unfinished(
    arguments: Namespace, today: date, files: Sequence[str], problems: Iterable[Problem], exit_code: int
) -> GateRecord:
    """The record of a gate that ends with ``exit_code`` 2, 3 or 130 before it judged the designs of these files."""
    rule = "invalid-input" if exit_code == 2 else "not-evaluated"
    return GateRecord(
        schema="tailstack/gate/1",
        verdict="not evaluated",
        exit_code=exit_code,
        mode=arguments.mode,
        seed=0,
        fail_level=arguments.fail_level,
        on_inconclusive=arguments.on_inconclusive,
        max_regression_percent=arguments.max_regression_percent,
        findings=tuple(_make_finding(rule, problem, files) for problem in problems),
        designs=tuple(record_unread(file) for file in files),
        provenance=GateProvenance(
            tailstack_version=__version__,
            policy_name="(not read)",
            policy_sha256=None,
            waivers_sha256=None,
            baseline_sha256=None,
            today=today.isoformat(),
            not_included=(),  # there is no number
        ),
    )


def record_unwritten(record: GateRecord, problems: Iterable[Problem]) -> GateRecord:
    """The record of a gate that judged and could not leave its answer everywhere it was asked to: no verdict, whatever
    the designs came to, and the reasons before all findings."""
    reasons = tuple(_make_finding("not-evaluated", problem, ()) for problem in problems)
    code = record.exit_code if record.verdict == "not evaluated" else 3
    return replace(record, verdict="not evaluated", exit_code=code, findings=(*reasons, *record.findings))


def _make_finding(rule: str, problem: Problem, files: Sequence[str]) -> GateFinding:
    if problem.file is None:
        problem = replace(problem, pointer="", file=files[0] if files else "tailstack gate")
    return make_finding(rule, "error", problem.file or "", problem)
