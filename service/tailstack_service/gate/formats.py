"""A gate's record in the formats that people and pipelines read; one table, one pure function each."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from ..documents import to_json
from .github import github_text
from .gitlab import gitlab_text
from .junit import junit_text
from .markdown import markdown_text
from .records import GateRecord
from .sarif import sarif_text
from .terminal import gate_text


@dataclass(frozen=True, slots=True)
class Format:
    """One format of ``--format``."""

    name: str
    write: Callable[[GateRecord], bytes]
    in_repository: bool = False  # files are named from the root of the repository, see ``places``


def _json(record: GateRecord) -> bytes:
    return to_json(record) + b"\n"


def _text(record: GateRecord) -> bytes:
    return gate_text(record).encode()


def _markdown(record: GateRecord) -> bytes:
    return markdown_text(record).encode()


def _sarif(record: GateRecord) -> bytes:
    return sarif_text(record).encode()


def _junit(record: GateRecord) -> bytes:
    return junit_text(record).encode()


def _github(record: GateRecord) -> bytes:
    return github_text(record).encode()


def _gitlab(record: GateRecord) -> bytes:
    return gitlab_text(record).encode()


FORMATS: dict[str, Format] = {
    entry.name: entry
    for entry in (
        Format("text", _text),
        Format("json", _json),
        Format("markdown", _markdown),
        Format("sarif", _sarif, in_repository=True),
        Format("junit", _junit),
        Format("github", _github, in_repository=True),
        Format("gitlab", _gitlab, in_repository=True),
    )
}
