"""Where findings stand, for programs that compare runs: paths in the repository, fingerprints, what counts."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Iterable
from dataclasses import replace
from pathlib import PurePosixPath
from posixpath import normpath

from .records import GateFinding, GateRecord


def in_repository(record: GateRecord, prefix: str) -> GateRecord:
    """The record with files named from the root of the repository.

    prefix: the way from that root to the directory that the names are relative to, with slashes; "" is the root.
    """
    if not prefix:
        return record
    return replace(
        record,
        findings=tuple(replace(finding, file=_below(prefix, finding.file)) for finding in record.findings),
        designs=tuple(replace(design, file=_below(prefix, design.file)) for design in record.designs),
    )


def _below(prefix: str, file: str) -> str:
    if PurePosixPath(file).is_absolute() or file.startswith("<"):
        return file
    return normpath(f"{prefix}/{file}")


def fingerprints(findings: Iterable[GateFinding]) -> list[str]:
    """One for each finding: the same for the same rule at the same place of the same document, whatever line or value
    it has today.  Several findings of a rule at one place are told apart by their order."""
    seen: Counter[tuple[str, ...]] = Counter()
    prints = []
    for finding in findings:
        named = finding.message.split(": ", 1)[0]  # requirement and target, where the rule has them
        parts = (finding.rule, finding.file, finding.pointer, named if ", target " in named else "")
        again = (str(seen[parts]),) if seen[parts] else ()
        seen[parts] += 1
        prints.append(hashlib.sha256("\0".join((*parts, *again)).encode()).hexdigest())
    return prints


def counts(record: GateRecord, finding: GateFinding) -> bool:
    """Whether a finding fails the gate by its weight."""
    heavy = ("error",) if record.fail_level == "error" else ("error", "warning")
    return finding.suppressed_by is None and finding.severity in heavy


def not_judged(record: GateRecord) -> str:
    """How many requirements and limits nothing was held against, in words for a closing line; "" if there are none."""
    count = sum(
        len({(entry.rule, entry.requirement) for entry in design.not_judged if entry.requirement is not None})
        for design in record.designs
    )
    return f", {count} requirement{'s' if count > 1 else ''} not judged" if count else ""


def cut(text: str, most_bytes: int) -> str:
    """Text of at most so many bytes of UTF-8, cut at the end of a line, the rest told."""
    content = text.encode()
    if len(content) <= most_bytes:
        return text
    closing = "\n(cut here: the rest is in the record)\n"
    kept = content[: max(most_bytes - len(closing), 0)].decode(errors="ignore")
    whole = kept[: kept.rfind("\n") + 1] + closing
    return whole if len(whole.encode()) <= most_bytes else ""
