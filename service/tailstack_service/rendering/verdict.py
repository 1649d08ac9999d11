"""The parts that every answer shares: what was judged, with which numbers, and what is not in them."""

from __future__ import annotations

from collections.abc import Sequence

from tailstack.results import Check, Finding, Provenance, Verdict
from tailstack.results.verdicts import STATED, check_sentence, decisive_check, urgency

from .alike import join_findings
from .page import current
from .sentences import name_basis
from .tables import columns, decimal, fold, number, paint, percent, prose_width, signed_decimal, table, wrap

MORE = "--details adds the method and every figure; `tailstack words` explains P95, TCP, connector and the like."


def heading(provenance: Provenance, what: str, method: str) -> str:
    """Name of the design and what was done; with details its hash, by which ``method`` and under which model."""
    if not current().details:
        return "\n".join(fold(provenance.design_name, prose_width())) + "\n" + wrap(what)
    how = (
        f"{what} · {method} · {provenance.reading} reading · {provenance.rotation_form.replace('_', ' ')} rotation · "
        f"{name_estimator(provenance)}{provenance.triangulation} triangulation · "
        f"tailstack {provenance.tailstack_version}"
    )
    return design_line(provenance) + "\n" + wrap(how)


def name_estimator(provenance: Provenance) -> str:
    """What a view is estimated as, before other words of the model; nothing of DLT, which nobody has to ask for."""
    return "" if provenance.estimator == "dlt" else f"{provenance.estimator.replace('_', ' ')} estimator · "


def design_line(provenance: Provenance) -> str:
    """Name of the design and the beginning of its hash."""
    width = prose_width()
    name = "\n".join(fold(provenance.design_name, width))
    if provenance.design_sha256 is None:
        return name
    digest = f"(sha256 {provenance.design_sha256[:12]})"
    return f"{name}  {digest}" if columns(name) + 2 + columns(digest) <= width else f"{name}\n{digest}"


def decided_by(checks: Sequence[Check]) -> list[tuple[Check, int]]:
    """For each requirement the check that decides it, and at how many targets it is checked; failures first."""
    names = dict.fromkeys(check.requirement for check in checks)
    own = [[check for check in checks if check.requirement == name] for name in names]
    return sorted(((min(each, key=urgency), len(each)) for each in own), key=lambda entry: urgency(entry[0]))


def decision_text(verdict: Verdict) -> str:
    """The check that decides, as a sentence; nothing where no requirement is stated."""
    decisive = decisive_check(verdict.checks)
    if decisive is None:
        return ""
    return wrap(" ".join(part for part in (check_sentence(decisive), _next_step(decisive, verdict.basis)) if part))


def _next_step(check: Check, basis: str) -> str:
    """What to do where a requirement is missed or open."""
    if check.status == "fail":
        return "`tailstack optimise` looks for the cheapest design that keeps it."
    if check.status == "pass":
        return ""
    if basis == "first order":
        return "Run `tailstack verify`, which simulates, to decide."
    if check.risk == "per_unit":
        return "The number of units drawn is fixed: change the limit or the design."
    return "Simulate more shots to decide: a tighter --precision or more --trials."


def checks_table(checks: tuple[Check, ...]) -> str:
    """Each requirement at the target that decides it: what it limits, the value and its interval, what is left."""
    if not checks:
        return ""
    rows = []
    for check, count in decided_by(checks):
        low, high = check.interval_mm
        limited = f"P{100 * check.quantile:.6g}" + ("" if check.error == "tcp" else ", located")
        limited += "" if check.min_yield is None else f", {100 * check.min_yield:.6g} % of units"
        rows.append(
            (
                check.requirement,
                check.target + (f" (worst of {count})" if count > 1 else ""),
                limited,
                number(check.value_mm),
                f"{decimal(low, 3)} .. {decimal(high, 3)}",
                number(check.limit_mm),
                signed_decimal(check.margin_mm),
                percent(check.yield_fraction),
                check.status,
            )
        )
    header = (
        "require-\nment", "target", "what is\nlimited", "value\nmm", "between\nmm", "limit\nmm", "to spare\nmm",
        "units\nwithin, %", "status",
    )  # fmt: skip
    if not current().details or all(row[7] == "-" for row in rows):
        rows, header = [(*row[:7], row[8]) for row in rows], (*header[:7], header[8])  # type: ignore[misc, assignment]
    return table(header, rows, left=3)


def findings_text(findings: Sequence[Finding]) -> str:
    lines = []
    for finding, sentence in join_findings(findings):
        mark = paint(finding.severity, "fail" if finding.severity == "error" else "warning")
        lines.append(wrap(f"[{finding.rule}] {sentence}", first=f"{mark}: ", indent="  "))
    return "\n".join(lines)


def verdict_line(verdict: Verdict) -> str:
    """The last line of every answer."""
    return paint(f"verdict: {verdict.status}", verdict.status) + f" ({name_basis(verdict.basis)})"


def verdict_text(verdict: Verdict) -> str:
    """Checks, findings and the verdict line."""
    findings = [one for one in verdict.findings if current().details or one.rule not in STATED]  # the table has those
    parts = (checks_table(verdict.checks), findings_text(findings), more_text(), verdict_line(verdict))
    return "\n\n".join(part for part in parts if part)


def more_text() -> str:
    """Where more is to be had; nothing where it is on the page already."""
    return "" if current().details else wrap(MORE, first="more: ", indent="  ")


def provenance_text(provenance: Provenance) -> str:
    """Assumptions made on the way, and what no number here includes."""
    lines = [wrap(note, first="note: ", indent="  ") for note in provenance.notes]
    if provenance.not_included:
        lines.append(wrap("; ".join(provenance.not_included), first="not included: ", indent="  "))
    return "\n".join(lines)


def join_blocks(*parts: str) -> str:
    """Paragraphs, empty ones left out."""
    return "\n\n".join(part for part in parts if part) + "\n"
