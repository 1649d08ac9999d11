"""The parts that every answer shares: what was judged, with which numbers, and what is not in them."""

from __future__ import annotations

from collections.abc import Sequence

from tailstack.results import Check, Finding, Provenance, Verdict
from tailstack.results.verdicts import STATED, checks_sentence, decisive_check, name_basis, requirements_table

from .alike import join_findings
from .page import current
from .tables import columns, fold, paint, prose_width, wrap, write_table

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
    """What a view is estimated as, before other words of the model; nothing of the one that nobody has to ask for."""
    from tailstack.system import DEFAULT_ESTIMATOR  # late: it brings numpy, which `--help` does without

    return "" if provenance.estimator == DEFAULT_ESTIMATOR else f"{provenance.estimator.replace('_', ' ')} estimator · "


def design_line(provenance: Provenance) -> str:
    """Name of the design and the beginning of its hash."""
    width = prose_width()
    name = "\n".join(fold(provenance.design_name, width))
    if provenance.design_sha256 is None:
        return name
    digest = f"(sha256 {provenance.design_sha256[:12]})"
    return f"{name}  {digest}" if columns(name) + 2 + columns(digest) <= width else f"{name}\n{digest}"


def decision_text(verdict: Verdict, optimised: Sequence[str] | None = None) -> str:
    """What is kept and the check that decides, as sentences; nothing where no requirement is stated.

    optimised: of a design that the optimiser made, the requirements that it was not asked to keep.
    """
    decisive = decisive_check(verdict.checks)
    if decisive is None:
        return ""
    following = _next_step(decisive, verdict.basis, optimised)
    return wrap(" ".join(part for part in (checks_sentence(verdict.checks), following) if part))


def _next_step(check: Check, basis: str, optimised: Sequence[str] | None) -> str:
    """What to do where a requirement is missed or open."""
    if check.status == "fail" and optimised is not None:
        if check.requirement in optimised:
            return f"It was not asked for: leave `optimise.requirement` out, or name {check.requirement} there."
        return "The simulation has the last word: give the optimiser more freedom, or change the limit."
    if check.status == "fail":
        return "`tailstack optimise` looks for the cheapest design that keeps it."
    if check.status == "pass":
        return ""
    if basis == "first order":
        return "Run `tailstack verify`, which simulates, to decide."
    if check.risk == "per_unit":
        return "The number of units drawn is fixed: change the limit or the design."
    return "Simulate more shots to decide: a tighter --precision or more --trials."


def requirements_text(verdict: Verdict) -> str:
    """Each requirement at the target that decides it: what it limits, the value and its interval, what is left."""
    table = requirements_table(verdict)
    return "" if table is None else write_table(table, above=True)


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
    """Findings and the verdict line; the table of requirements stands below the first sentence (``decision_text``)."""
    findings = [one for one in verdict.findings if current().details or one.rule not in STATED]  # the table has those
    parts = (findings_text(findings), more_text(), verdict_line(verdict))
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
