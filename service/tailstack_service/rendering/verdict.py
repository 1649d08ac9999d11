"""The parts that every answer shares: what was judged, with which numbers, and what is not in them."""

from __future__ import annotations

from collections.abc import Sequence

from tailstack.results import Check, Finding, Provenance, Verdict

from .tables import WIDTH, columns, decimal, fold, number, paint, percent, signed_decimal, table, wrap


def heading(provenance: Provenance, basis: str) -> str:
    """Name of the design, then how it was computed."""
    how = (
        f"{basis} · {provenance.reading} reading · {provenance.rotation_form.replace('_', ' ')} rotation · "
        f"{provenance.triangulation} triangulation · tailstack {provenance.tailstack_version}"
    )
    return design_line(provenance) + "\n" + wrap(how)


def design_line(provenance: Provenance) -> str:
    """Name of the design and the beginning of its hash."""
    name = "\n".join(fold(provenance.design_name, WIDTH))
    if provenance.design_sha256 is None:
        return name
    digest = f"(sha256 {provenance.design_sha256[:12]})"
    return f"{name}  {digest}" if columns(name) + 2 + columns(digest) <= WIDTH else f"{name}\n{digest}"


_ORDER = {"fail": 0, "inconclusive": 1, "pass": 2}


def urgency(check: Check) -> tuple[int, float]:
    """Sorts checks: failures before open questions before the rest, then by value over limit, largest first."""
    return _ORDER[check.status], -check.value_mm / check.limit_mm


def decided_by(checks: Sequence[Check]) -> list[tuple[Check, int]]:
    """For each requirement the check that decides it, and at how many targets it is checked; failures first."""
    names = dict.fromkeys(check.requirement for check in checks)
    own = [[check for check in checks if check.requirement == name] for name in names]
    return sorted(((min(each, key=urgency), len(each)) for each in own), key=lambda entry: urgency(entry[0]))


def checks_table(checks: tuple[Check, ...]) -> str:
    """Each requirement at the target that decides it: what it limits, the value and its interval, what is left."""
    if not checks:
        return ""
    rows = []
    for check, count in decided_by(checks):
        low, high = check.interval_mm
        units = "pooled" if check.min_yield is None else f"{100 * check.min_yield:.6g} % of units"
        error = "" if check.error == "tcp" else f" {check.error}"
        rows.append(
            (
                check.requirement,
                check.target + (f" (worst of {count})" if count > 1 else ""),
                f"P{100 * check.quantile:.6g}{error}, {units}",
                number(check.value_mm),
                f"{decimal(low, 3)} .. {decimal(high, 3)}",
                number(check.limit_mm),
                signed_decimal(check.margin_mm),
                percent(check.yield_fraction),
                check.status,
            )
        )
    header = (
        "require-\nment", "target", "quantile of\nthe error", "value\nmm", "interval\nmm", "limit\nmm", "margin\nmm",
        "yield\n%", "status",
    )  # fmt: skip
    if all(row[7] == "-" for row in rows):
        rows, header = [(*row[:7], row[8]) for row in rows], (*header[:7], header[8])  # type: ignore[misc, assignment]
    return table(header, rows, left=3, whole=(2,))


def findings_text(findings: tuple[Finding, ...], colour: bool) -> str:
    lines = []
    for finding in findings:
        mark = paint(finding.severity, "fail" if finding.severity == "error" else "warning", colour)
        lines.append(wrap(f"[{finding.rule}] {finding.message}", first=f"{mark}: ", indent="  "))
    return "\n".join(lines)


def verdict_line(verdict: Verdict, colour: bool) -> str:
    """The last line of every answer."""
    return paint(f"verdict: {verdict.status}", verdict.status, colour) + f" ({verdict.basis})"


def verdict_text(verdict: Verdict, colour: bool) -> str:
    """Checks, findings and the verdict line."""
    parts = (checks_table(verdict.checks), findings_text(verdict.findings, colour), verdict_line(verdict, colour))
    return "\n\n".join(part for part in parts if part)


def provenance_text(provenance: Provenance) -> str:
    """Assumptions made on the way, and what no number here includes."""
    lines = [wrap(note, first="note: ", indent="  ") for note in provenance.notes]
    if provenance.not_included:
        lines.append(wrap("; ".join(provenance.not_included), first="not included: ", indent="  "))
    return "\n".join(lines)


def join_blocks(*parts: str) -> str:
    """Paragraphs, empty ones left out."""
    return "\n\n".join(part for part in parts if part) + "\n"
