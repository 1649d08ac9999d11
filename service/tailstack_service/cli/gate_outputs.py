"""Where a gate writes: formats to files and to stdout, and the summary of a step in GitHub Actions.

Each file says *not evaluated* as soon as a gate has begun: one that is killed leaves nothing that looks current.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ..gate.records import GateRecord

SUMMARY = "GITHUB_STEP_SUMMARY"
ROOTS = ("GITHUB_WORKSPACE", "CI_PROJECT_DIR")  # where GitHub and GitLab check the repository out


@dataclass(frozen=True, slots=True)
class Outputs:
    """Formats with their files, None for stdout; of the files, those that can be written."""

    formats: tuple[tuple[str, str | None], ...]
    usable: tuple[tuple[str, str], ...]

    def files(self, record: GateRecord, *, or_none: bool = False) -> list[str]:
        """Write every file, each whole or not at all.  Returns what could not be written, in words.

        or_none: a file of an earlier gate that cannot be replaced, as the disk is full, is removed.
        """
        failed = []
        for name, file in self.usable:
            try:
                _write(Path(file), written(name, record))
            except OSError as error:
                failed.append(f"cannot write {file}: {error.strerror or error}")
                if or_none and Path(file).is_file():
                    with suppress(OSError):
                        Path(file).unlink()
        return failed

    def stdout(self, record: GateRecord) -> str | bytes:
        """What goes to stdout."""
        from ..gate.terminal import gate_text
        from .design_input import coloured_output

        name = next((name for name, file in self.formats if file is None), None)
        if name == "text":
            return gate_text(record, colour=coloured_output())
        return "" if name is None else written(name, record)

    def summary(self, record: GateRecord) -> list[str]:
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
            return [f"cannot write {SUMMARY} {file}: {error.strerror or error}"]
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


def _write(path: Path, content: bytes) -> None:
    beside = path.with_name(path.name + f".{os.getpid()}.part")
    try:
        if path.exists() and not path.is_file():  # /dev/stderr, a pipe: nothing to replace
            path.write_bytes(content)
            return
        beside.write_bytes(content)
        os.replace(beside, path)
    finally:
        beside.unlink(missing_ok=True)
