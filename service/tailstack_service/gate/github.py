"""A gate as workflow commands of GitHub Actions: annotations at the lines of a pull request.

GitHub shows ten errors, ten warnings and ten notices of a step and says nothing of the others, and it refuses a summary
of more than 1 MiB altogether.
"""

from __future__ import annotations

from .markdown import markdown_text
from .places import cut, not_judged
from .records import GateFinding, GateRecord

MOST = 10  # annotations of a kind in a step
SUMMARY_BYTES = 2**20
COMMANDS = {"error": "error", "warning": "warning", "note": "notice"}


def github_text(record: GateRecord) -> str:
    """One command a finding that no waiver accepts, errors first; the last place of a full kind tells how many more."""
    lines = []
    for severity, command in COMMANDS.items():
        found = [f for f in record.findings if f.severity == severity and f.suppressed_by is None]
        shown = found if len(found) <= MOST else found[: MOST - 1]
        lines += [_command(command, finding) for finding in shown]
        if len(found) > len(shown):
            rest = (
                f"{len(found) - len(shown)} more: GitHub shows {MOST} of a kind; all are in the summary and the record"
            )
            lines.append(f"::{command} title={_property('tailstack gate')}::{_data(rest)}")
    accepted = sum(finding.suppressed_by is not None for finding in record.findings)
    waived = f", {accepted} accepted by waivers" if accepted else ""
    lines.append(f"tailstack gate: {record.verdict} (exit code {record.exit_code}{waived}{not_judged(record)})")
    return "\n".join(lines) + "\n"


def step_summary(record: GateRecord, taken_bytes: int = 0) -> str:
    """The gate as Markdown for ``$GITHUB_STEP_SUMMARY``, within what is left of its size."""
    return cut(markdown_text(record), SUMMARY_BYTES - taken_bytes)


def _command(command: str, finding: GateFinding) -> str:
    properties = [f"file={_property(finding.file)}"]
    if finding.line is not None:
        properties.append(f"line={finding.line}")
        properties += [f"col={finding.column}"] if finding.column else []
    properties.append(f"title={_property(f'tailstack {finding.rule}')}")
    where = f" ({finding.pointer})" if finding.pointer and finding.line is None else ""
    return f"::{command} {','.join(properties)}::{_data(finding.message + where)}"


def _data(text: str) -> str:
    return text.replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")


def _property(text: str) -> str:
    return _data(text).replace(":", "%3A").replace(",", "%2C")
