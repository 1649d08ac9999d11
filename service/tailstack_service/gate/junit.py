"""A gate as JUnit XML (the form that Jenkins publishes as junit-10.xsd): a suite a design, a case a number or rule.

failure: a finding counts.  error: nothing was judged.  skipped: a waiver accepts it, or nothing was held against it.
What was said and does not count is in system-out of its case.  No times are given: they are not reproducible, and the
gate has no clock.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from xml.sax.saxutils import escape, quoteattr

from .gitlab import UNJUDGED
from .places import counts
from .records import GatedDesign, GateFinding, GateRecord
from .terminal import place_of

NOT_EVALUATED, NOT_JUDGED = "not-evaluated", "not-judged"
_REFUSED = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")  # what XML 1.0 cannot hold


@dataclass(frozen=True, slots=True)
class _Case:
    name: str
    findings: tuple[GateFinding, ...]


def junit_text(record: GateRecord) -> str:
    """Suites in the order of the designs, then of other files that findings are about: policy, waivers, baseline."""
    suites = []
    files = [design.file for design in record.designs]
    for design in record.designs:
        suites.append((design.file, _cases(design, [f for f in record.findings if f.file == design.file])))
    for other in dict.fromkeys(finding.file for finding in record.findings if finding.file not in files):
        suites.append((other, _by_rule([finding for finding in record.findings if finding.file == other])))
    written = [_suite(record, name, cases) for name, cases in suites]
    total = [sum(numbers[k] for numbers, _ in written) for k in range(4)]
    head = f'<testsuites name="tailstack gate" tests="{total[0]}" failures="{total[1]}" errors="{total[2]}">'
    body = [line for _, lines in written for line in lines]
    return "\n".join(['<?xml version="1.0" encoding="UTF-8"?>', head, *body, "</testsuites>"]) + "\n"


def _cases(design: GatedDesign, findings: list[GateFinding]) -> list[_Case]:
    cases = []
    left = list(findings)
    for number in design.numbers:
        opening = f"{number.requirement}, target {number.target}: "
        about = [f for f in left if f.rule in (number.rule, "inconclusive") and f.message.startswith(opening)]
        left = [finding for finding in left if finding not in about]
        cases.append(_Case(f"{number.rule}: {number.requirement}, target {number.target}", tuple(about)))
    for requirement in dict.fromkeys(entry.requirement for entry in design.not_judged):
        about = [f for f in left if f.rule == NOT_JUDGED and f.message.startswith(f"{requirement} (")]
        left = [finding for finding in left if finding not in about]
        cases += [_Case(f"{NOT_JUDGED}: {requirement}", tuple(about))] if about else []
    cases += _by_rule(left)
    # what is wrong may stand in another file, that of the fiducials: the design is no empty suite all the same
    return cases or [_Case(NOT_EVALUATED if design.verdict == "not evaluated" else "gate", ())]


def _by_rule(findings: list[GateFinding]) -> list[_Case]:
    rules = dict.fromkeys(finding.rule for finding in findings)
    return [_Case(rule, tuple(finding for finding in findings if finding.rule == rule)) for rule in rules]


def _suite(record: GateRecord, name: str, cases: list[_Case]) -> tuple[tuple[int, int, int, int], list[str]]:
    lines: list[str] = []
    failures = errors = skipped = 0
    for case in cases:
        kind, findings = _outcome(record, case)
        failures += kind == "failure"
        errors += kind == "error"
        skipped += kind == "skipped"
        lines += _written(name, case, kind, findings)
    counted = (len(cases), failures, errors, skipped)
    head = f'  <testsuite name={_attribute(name)} tests="{len(cases)}" failures="{failures}" '
    return counted, [f'{head}errors="{errors}" skipped="{skipped}">', *lines, "  </testsuite>"]


def _outcome(record: GateRecord, case: _Case) -> tuple[str, list[GateFinding]]:
    """What a case comes to, and the findings that say so."""
    unjudged = [finding for finding in case.findings if finding.rule in UNJUDGED]
    counted = [finding for finding in case.findings if counts(record, finding)]
    accepted = [finding for finding in case.findings if finding.suppressed_by is not None]
    if not case.findings and case.name == NOT_EVALUATED:
        return "error", []
    open_ones = [finding for finding in case.findings if finding.rule == NOT_JUDGED]
    kinds = (("error", unjudged), ("failure", counted), ("skipped", accepted), ("skipped", open_ones))
    for kind, found in kinds:
        if found:
            return kind, found
    return "passed", []


def _written(suite: str, case: _Case, kind: str, findings: list[GateFinding]) -> list[str]:
    lines = [f"    <testcase classname={_attribute(suite)} name={_attribute(case.name)}>"]
    if kind == "skipped":
        reasons = "; ".join(
            dict.fromkeys(
                finding.message if finding.suppressed_by is None else f"accepted by {finding.suppressed_by}"
                for finding in findings
            )
        )
        lines.append(f"      <skipped type={_attribute(case.findings[0].rule)} message={_attribute(reasons)}/>")
    elif kind != "passed":
        more = f" (and {len(findings) - 1} more)" if len(findings) > 1 else ""
        rule, message = (
            (findings[0].rule, findings[0].message + more) if findings else (case.name, "see the other files")
        )
        opening = f"      <{kind} type={_attribute(rule)} message={_attribute(message)}>"
        text = "\n".join(_line(finding) for finding in findings)
        lines.append(f"{opening}{_text(text)}</{kind}>")
    rest = [finding for finding in case.findings if finding not in findings or kind == "skipped"]
    if rest:
        text = "\n".join(_line(finding) for finding in rest)
        lines.append(f"      <system-out>{_text(text)}</system-out>")
    return [*lines, "    </testcase>"] if len(lines) > 1 else [lines[0].removesuffix(">") + "/>"]


def _line(finding: GateFinding) -> str:
    return f"{place_of(finding)}: {finding.severity}: {finding.message}"


def _text(text: str) -> str:
    return escape(_REFUSED.sub("\ufffd", text))


def _attribute(text: str) -> str:
    return quoteattr(_REFUSED.sub("\ufffd", " ".join(text.split())))
