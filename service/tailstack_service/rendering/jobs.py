"""Jobs as text: a table of many, one in full, and the line that follows its progress."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from tailstack.results.digits import percent

from .tables import draw_table


def jobs_text(records: Sequence[Mapping[str, Any]]) -> str:
    """One line a job."""
    rows = [
        (
            record["id"], record["kind"], record["state"], record["design_name"],
            _second(record["created_at"]), f"{percent(record['progress']['fraction'], 0)} %",
        )
        for record in records
    ]  # fmt: skip
    header = ("id", "kind", "state", "design", "created (UTC)", "done")
    return draw_table(header, rows, left=5, whole=(0, 1, 2, 4)) + "\n"


def job_text(record: Mapping[str, Any]) -> str:
    """Everything about one job."""
    progress = record["progress"]
    lines = [
        ("id", record["id"]),
        ("kind", record["kind"]),
        ("design", record["design_name"]),
        ("state", record["state"]),
        ("progress", progress_text(record)),
        ("created", _second(record["created_at"])),
        ("started", _second(record["started_at"])),
        ("finished", _second(record["finished_at"])),
        ("solver", record["solver_version"]),
        ("note", record["recomputed"] or progress["note"]),
        ("result", record["links"]["result"]),
    ]
    text = "".join(f"{name:<10}{value}\n" for name, value in lines if value)
    if record["problem"] is not None:
        text += "".join(
            f"{'problem':<10}{error['pointer']}{': ' if error['pointer'] else ''}{error['detail']}\n"
            + (f"{'':<10}hint: {error['hint']}\n" if error["hint"] else "")
            for error in record["problem"]["errors"]
        )
    return text


def progress_text(record: Mapping[str, Any]) -> str:
    """``40 %, unit 4 of 10, about 2 s left``."""
    progress = record["progress"]
    parts = [f"{percent(progress['fraction'], 0)} %", f"unit {progress['units_done']} of {progress['units_expected']}"]
    if progress["eta_seconds"]:
        parts.append(f"about {max(progress['eta_seconds'], 1):.0f} s left")
    return ", ".join(parts)


def _second(moment: str | None) -> str:
    return "" if moment is None else moment[:19].replace("T", " ")
