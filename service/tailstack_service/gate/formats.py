"""A gate's record in the formats that pipelines read, and the table of all formats.

sarif: SARIF 2.1.0 (OASIS), for code scanning and every viewer that reads it.
junit: JUnit XML (the form that Jenkins publishes as junit-10.xsd): a suite a design, a case a number or rule.  failure:
a finding counts.  error: nothing was judged.  skipped: a waiver accepts it, or nothing was held against it.  What was
said and does not count is in system-out of its case.  No times are given: they are not reproducible.  Ids of a
requirement are its case's property ``requirements``, with commas, as Xray and others read them; the schema of Jenkins
knows properties of suites alone.
github: workflow commands of GitHub Actions.  GitHub shows ten errors, ten warnings and ten notices of a step and says
nothing of the others, and it refuses a summary of more than 1 MiB altogether.
gitlab: the code quality report, a subset of the Code Climate format.  GitLab reads ``description``, ``check_name``,
``fingerprint``, ``severity``, ``location.path`` and ``location.lines.begin``, keeps one finding of a fingerprint, and
knows no accepted findings: those of waivers are left out.
needs: needs.json of sphinx-needs, for ``needimport``: a need of type test for the gate and for each requirement, with
links to its ids.  Only fields that every project has, for it warns of others.
reqif: ReqIF 1.2 (OMG; its schema is that of 1.0): an object for each id of a requirement, ``ReqIF.ForeignID``.
"""

from __future__ import annotations

import hashlib
import re
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import PurePath
from typing import Any, NamedTuple
from urllib.parse import quote
from xml.etree import ElementTree

from tailstack.results.json_text import write_json
from tailstack.results.verdicts import check_sentence, decided_by

from ..documents import plain, to_json
from ..rendering.text import Page, current, write_on
from .case import describe_requirement
from .records import (
    GatedDesign,
    GateFinding,
    GateNumber,
    GateRecord,
    GateRequirement,
    counts,
    name_place,
    split_findings,
)
from .rules import RULES, Rule
from .text import describe_outcome, render_markdown, render_text


def name_from_root(record: GateRecord, name_file: Callable[[str], str]) -> GateRecord:
    """The record with files named from the root of the repository, by what knows where that is."""
    return replace(
        record,
        findings=tuple(replace(finding, file=name_file(finding.file)) for finding in record.findings),
        designs=tuple(replace(design, file=name_file(design.file)) for design in record.designs),
    )


def fingerprint_findings(findings: Iterable[GateFinding]) -> list[str]:
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


def cut_text(text: str, most_bytes: int) -> str:
    """Text of at most so many bytes of UTF-8, cut at the end of a line, the rest told."""
    content = text.encode()
    if len(content) <= most_bytes:
        return text
    closing = "\n(cut here: the rest is in the record)\n"
    text = content[: max(most_bytes - len(closing), 0)].decode(errors="ignore")
    text = text[: text.rfind("\n") + 1] + closing
    return text if len(text.encode()) <= most_bytes else ""


# --- sarif --------------------------------------------------------------------------------------------

SCHEMA = "https://docs.oasis-open.org/sarif/sarif/v2.1.0/errata01/os/schemas/sarif-schema-2.1.0.json"


def render_sarif(record: GateRecord) -> str:
    """One run; what a waiver accepts stays in it, suppressed.  Columns count characters."""
    order = {name: index for index, name in enumerate(RULES)}
    run = {
        "tool": {
            "driver": {
                "name": "tailstack",
                "version": record.provenance.tailstack_version,
                "rules": [_write_sarif_rule(rule) for rule in RULES.values()],
            }
        },
        "columnKind": "unicodeCodePoints",
        # what could not be judged is not a run that found nothing
        "invocations": [{"executionSuccessful": record.verdict != "not evaluated", "exitCode": record.exit_code}],
        "results": [
            _write_sarif_result(finding, order[finding.rule], fingerprint)
            for finding, fingerprint in zip(record.findings, fingerprint_findings(record.findings), strict=True)
        ],
        "properties": {
            "verdict": record.verdict,
            "mode": record.mode,
            "seed": record.seed,
            "policySha256": record.provenance.policy_sha256,
            "notJudged": [
                {"file": design.file, "requirement": entry.requirement, "target": entry.target, "reason": entry.reason}
                for design in record.designs
                for entry in design.not_judged
            ],
            "notIncluded": list(record.provenance.not_included),
        },
    }
    return write_json({"$schema": SCHEMA, "version": "2.1.0", "runs": [run]}, indent=2) + "\n"


def _write_sarif_rule(rule: Rule) -> dict[str, Any]:
    return {
        "id": rule.id,
        "name": "".join(part.capitalize() for part in rule.id.split("-")),
        "shortDescription": {"text": rule.title},
        "fullDescription": {"text": rule.page.split("\n\n")[0].replace("\n", " ")},
        "help": {"text": rule.page, "markdown": rule.page},
        "defaultConfiguration": {"level": rule.severity},
        "properties": {"tags": ["tolerance"]},
    }


def _write_sarif_result(finding: GateFinding, index: int, fingerprint: str) -> dict[str, Any]:
    # A viewer of code needs a line: what is about a whole document stands at its first.
    region = {"startLine": finding.line or 1} | ({"startColumn": finding.column} if finding.column else {})
    place: dict[str, Any] = {"artifactLocation": {"uri": write_uri(finding.file)}, "region": region}
    location: dict[str, Any] = {"physicalLocation": place}
    if finding.pointer:
        location["logicalLocations"] = [{"fullyQualifiedName": finding.pointer, "kind": "member"}]
    result: dict[str, Any] = {
        "ruleId": finding.rule,
        "ruleIndex": index,
        "level": finding.severity,
        "message": {"text": finding.message},
        "locations": [location],
        # GitHub tells alerts of two runs apart by the second of these, and would compute it from the line if absent.
        "partialFingerprints": {"tailstackFinding/v1": fingerprint, "primaryLocationLineHash": f"{fingerprint[:16]}:1"},
        "properties": {"value": finding.value, "limit": finding.limit},
    }
    if finding.suppressed_by is not None:
        result["suppressions"] = [{"kind": "external", "status": "accepted", "justification": finding.suppressed_by}]
    return result


def write_uri(file: str) -> str:
    """A file's name as a URI reference: relative ones stay so, for a viewer knows the root of the repository."""
    path = PurePath(file)
    return path.as_uri() if path.is_absolute() else quote(path.as_posix(), safe="/")


# --- gitlab -------------------------------------------------------------------------------------------

UNJUDGED = ("invalid-design", "invalid-input", "not-evaluated")


def render_gitlab(record: GateRecord) -> str:
    """A list of findings, [] where there are none."""
    reported = [
        {
            "description": finding.message,
            "check_name": f"tailstack/{finding.rule}",
            "fingerprint": fingerprint,
            "severity": _weigh_gitlab(record, finding),
            "location": {"path": finding.file, "lines": {"begin": finding.line or 1}},
        }
        for finding, fingerprint in zip(record.findings, fingerprint_findings(record.findings), strict=True)
        if finding.suppressed_by is None
    ]
    return write_json(reported, indent=2) + "\n"


def _weigh_gitlab(record: GateRecord, finding: GateFinding) -> str:
    """blocker: nothing was judged.  critical, major: fails the gate, as error, as warning.  minor, info: does not."""
    if finding.rule in UNJUDGED:
        return "blocker"
    if counts(finding, record.fail_level):
        return "critical" if finding.severity == "error" else "major"
    return "info" if finding.severity == "note" else "minor"


# --- junit --------------------------------------------------------------------------------------------

NOT_EVALUATED, NOT_JUDGED = "not-evaluated", "not-judged"
_NOT_XML = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")  # what XML 1.0 cannot hold


def render_junit(record: GateRecord) -> str:
    """Suites in the order of the designs, then of other files that findings are about: policy, waivers, baseline."""
    about: dict[str, list[GateFinding]] = {design.file: [] for design in record.designs}
    for finding in record.findings:
        about.setdefault(finding.file, []).append(finding)
    suites = [(design.file, _list_cases(design, about.pop(design.file, []))) for design in record.designs]
    suites += [(file, _group_by_rule(findings)) for file, findings in about.items()]
    root = ElementTree.Element("testsuites", name="tailstack gate")
    for file, cases in suites:
        suite = ElementTree.SubElement(root, "testsuite", name=_as_xml(file))
        for name, findings, ids in cases:
            case = ElementTree.SubElement(suite, "testcase", classname=_as_xml(file), name=_as_xml(name))
            if ids:
                properties = ElementTree.SubElement(case, "properties")
                ElementTree.SubElement(properties, "property", name="requirements", value=",".join(ids))
            _tell_outcome(case, record, name, findings)
        _count_outcomes(suite, "tests", "failures", "errors", "skipped")
    _count_outcomes(root, "tests", "failures", "errors")
    return _write_xml(root)


def _write_xml(root: ElementTree.Element) -> str:
    ElementTree.indent(root)
    text = ElementTree.tostring(root, encoding="unicode")
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{text}\n'


def _count_outcomes(element: ElementTree.Element, *attributes: str) -> None:
    tags = {"tests": "testcase", "failures": "failure", "errors": "error", "skipped": "skipped"}
    element.attrib |= {name: str(sum(1 for _ in element.iter(tags[name]))) for name in attributes}


class _JunitCase(NamedTuple):
    """Its name, what is said of it, and the ids of its requirement."""

    name: str
    findings: list[GateFinding]
    ids: tuple[str, ...] = ()


def _list_cases(design: GatedDesign, findings: list[GateFinding]) -> list[_JunitCase]:
    cases: list[_JunitCase] = []
    for number in design.numbers:
        about = _find_about(number, findings)
        findings = [finding for finding in findings if finding not in about]
        cases.append(_JunitCase(f"{number.rule}: {number.requirement}, target {number.target}", about, number.ids))
    ids = {entry.name: entry.ids for entry in design.requirements if entry.origin == "design"}
    for requirement in dict.fromkeys(entry.requirement for entry in design.not_judged):
        about = [f for f in findings if f.rule == NOT_JUDGED and f.message.startswith(f"{requirement} (")]
        findings = [finding for finding in findings if finding not in about]
        cases += [_JunitCase(f"{NOT_JUDGED}: {requirement}", about, ids.get(requirement or "", ()))] if about else []
    cases += _group_by_rule(findings)
    # what is wrong may stand in another file, that of the fiducials: the design is no empty suite all the same
    return cases or [_JunitCase(NOT_EVALUATED if design.verdict == "not evaluated" else "gate", [])]


def _find_about(number: GateNumber, findings: Iterable[GateFinding]) -> list[GateFinding]:
    """The findings on a number; two limits may be called the same."""
    return [
        finding
        for finding in findings
        if finding.rule in (number.rule, "inconclusive")
        and finding.message.startswith(f"{number.requirement}, target {number.target}: ")
        and (finding.value, finding.limit) == (number.judged_value, number.judged_limit)
    ]


def _group_by_rule(findings: list[GateFinding]) -> list[_JunitCase]:
    groups: dict[str, list[GateFinding]] = {}
    for finding in findings:
        groups.setdefault(finding.rule, []).append(finding)
    return [_JunitCase(*group) for group in groups.items()]


def _decide_outcome(record: GateRecord, name: str, findings: list[GateFinding]) -> tuple[str, list[GateFinding]]:
    """What a case comes to, and the findings that say so."""
    if not findings and name == NOT_EVALUATED:
        return "error", []
    outcomes = (
        ("error", [finding for finding in findings if finding.rule in UNJUDGED]),
        ("failure", [finding for finding in findings if counts(finding, record.fail_level)]),
        ("skipped", [finding for finding in findings if finding.suppressed_by is not None]),
        ("skipped", [finding for finding in findings if finding.rule == NOT_JUDGED]),
    )
    return next(((kind, decisive) for kind, decisive in outcomes if decisive), ("passed", []))


def _tell_outcome(case: ElementTree.Element, record: GateRecord, name: str, findings: list[GateFinding]) -> None:
    """Elements below a case."""
    kind, decisive = _decide_outcome(record, name, findings)
    rest = [finding for finding in findings if finding not in decisive]
    if kind == "skipped":
        reasons = [f.message if f.suppressed_by is None else f"accepted by {f.suppressed_by}" for f in decisive]
        message = _as_xml("; ".join(dict.fromkeys(reasons)))
        ElementTree.SubElement(case, kind, type=findings[0].rule, message=message)
        rest = findings
    elif kind != "passed":
        rule, message = (decisive[0].rule, decisive[0].message) if decisive else (name, "see the other files")
        message += f" (and {len(decisive) - 1} more)" if len(decisive) > 1 else ""
        told = ElementTree.SubElement(case, kind, type=rule, message=_as_xml(message))
        told.text = _write_findings(decisive)
    if rest:
        ElementTree.SubElement(case, "system-out").text = _write_findings(rest)


def _write_findings(findings: list[GateFinding]) -> str:
    lines = [f"{name_place(finding)}: {finding.severity}: {finding.message}" for finding in findings]
    return _NOT_XML.sub("\ufffd", "\n".join(lines))


def _as_xml(text: str) -> str:
    """One line that XML can hold."""
    return _NOT_XML.sub("\ufffd", " ".join(text.split()))


# --- github -------------------------------------------------------------------------------------------

MOST_ANNOTATIONS = 10  # annotations of a kind in a step
SUMMARY_BYTES = 2**20


def render_github(record: GateRecord) -> str:
    """One command a finding that no waiver accepts, errors first; the last place of a full kind tells how many more."""
    lines = []
    counted, _ = split_findings(record)
    for severity, command in (("error", "error"), ("warning", "warning"), ("note", "notice")):
        own = [finding for finding in counted if finding.severity == severity]
        shown = own if len(own) <= MOST_ANNOTATIONS else own[: MOST_ANNOTATIONS - 1]
        lines += [_write_command(command, finding) for finding in shown]
        if more := len(own) - len(shown):
            rest = f"{more} more: GitHub shows {MOST_ANNOTATIONS} of a kind; all are in the summary and the record"
            lines.append(f"::{command} title={_escape_property('tailstack gate')}::{_escape_data(rest)}")
    return "\n".join([*lines, f"tailstack gate: {describe_outcome(record)}"]) + "\n"


def render_step_summary(record: GateRecord, taken_bytes: int = 0) -> str:
    """The gate as Markdown for ``$GITHUB_STEP_SUMMARY``, within what is left of its size."""
    return cut_text(render_markdown(record), SUMMARY_BYTES - taken_bytes)


def _write_command(command: str, finding: GateFinding) -> str:
    properties = [f"file={_escape_property(finding.file)}"]
    if finding.line is not None:
        properties.append(f"line={finding.line}")
        properties += [f"col={finding.column}"] if finding.column else []
    properties.append(f"title={_escape_property(f'tailstack {finding.rule}')}")
    where = f" ({finding.pointer})" if finding.pointer and finding.line is None else ""
    return f"::{command} {','.join(properties)}::{_escape_data(finding.message + where)}"


def _escape_data(text: str) -> str:
    return text.replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")


def _escape_property(text: str) -> str:
    return _escape_data(text).replace(":", "%3A").replace(",", "%2C")


# --- requirements: needs and reqif ----------------------------------------------------------------------


class _Verified(NamedTuple):
    """A requirement of a design, and what it came to."""

    file: str
    name: str
    ids: tuple[str, ...]
    status: str  # pass, fail, inconclusive, accepted (by a waiver), not judged, not evaluated
    asked: str  # what is asked for, in words
    sentence: str  # what was found
    origin: str = ""  # who asks for it: design or policy
    number: GateNumber | None = None  # what decides

    @property
    def identity(self) -> str:
        """The same for the same requirement of the same document, whatever its limit is and whatever it comes to."""
        return hashlib.sha256("\0".join((self.file, self.origin, self.name)).encode()).hexdigest()[:16].upper()


def _list_verified(record: GateRecord) -> list[_Verified]:
    """The gate itself, then the requirements of each design and limits of the policy, in the order of the record.

    A gate that was not evaluated verifies none of them, whatever its designs came to.
    """
    files = {design.file for design in record.designs}
    told = "; ".join([describe_outcome(record), *(f.message for f in record.findings if f.file not in files)])
    entries = [_Verified("", f"gate, policy {record.provenance.policy_name}", (), record.verdict, "", told)]
    for design in record.designs:
        findings = [finding for finding in record.findings if finding.file == design.file]
        entries += [_verify_requirement(design, requirement, findings) for requirement in design.requirements]
        if not design.requirements:
            told = "; ".join([f"The design: {design.verdict}", *(finding.message for finding in findings)])
            entries.append(_Verified(design.file, "", (), design.verdict, "", told))
    if record.verdict == "not evaluated":
        return [entry._replace(status=record.verdict) for entry in entries]
    return entries


def _verify_requirement(
    design: GatedDesign, requirement: GateRequirement, findings: Iterable[GateFinding]
) -> _Verified:
    """A waiver that accepts a number does not make it keep its limit; of several the worst decides."""
    stated = (requirement.name, requirement.rule, requirement.error, requirement.quantile, requirement.limit)
    found: dict[str, list[GateNumber]] = {}
    waivers: dict[str, None] = {}
    for number in design.numbers:
        limit = number.limit if number.beyond is None else number.beyond
        if (number.requirement, number.rule, number.error, number.quantile, limit) == stated:
            accepted = [finding.suppressed_by for finding in _find_about(number, findings)]
            waived = number.status != "pass" and accepted and None not in accepted
            found.setdefault("accepted" if waived else number.status, []).append(number)
            waivers |= {waiver: None for waiver in accepted if waiver is not None}
    status = next((each for each in ("fail", "inconclusive", "accepted", "pass") if each in found), "not judged")
    decides = decided_by(found[status])[0][0] if found else None
    reasons = [entry.reason for entry in design.not_judged if entry.requirement == requirement.name]
    told = f"Not judged: {', '.join(dict.fromkeys(reasons))}." if decides is None else check_sentence(decides)
    sentence = " ".join([told, *(f"Accepted by {waiver}." for waiver in waivers)])
    asked, ids = describe_requirement(requirement), requirement.ids
    return _Verified(design.file, requirement.name, ids, status, asked, sentence, requirement.origin, decides)


_MARKED = re.compile(r"([\\`*_|<>\[\]{}:])")  # what could begin markup in reStructuredText


def render_needs(record: GateRecord) -> str:
    """Ids are of the form that sphinx-needs asks for by default."""

    def write(text: str) -> str:
        return _MARKED.sub(r"\\\1", " ".join(text.split()))

    needs = {}
    for entry in _list_verified(record):
        title = " of ".join(filter(None, (entry.name, entry.file)))
        needs[f"TAILSTACK_{entry.identity}"] = {
            "id": f"TAILSTACK_{entry.identity}",
            "type": "test",
            "title": title.replace("[[", "[ ["),  # which would call a function
            "status": entry.status,
            "tags": ["tailstack"],
            "links": list(entry.ids),
            "content": "\n\n".join(write(text) for text in (entry.asked, entry.sentence) if text),
        }
    version = record.provenance.tailstack_version
    made = {"program": "tailstack", "version": version}
    versions = {version: {"creator": made, "needs": needs, "needs_amount": len(needs)}}
    data = {"project": record.provenance.policy_name, "current_version": version, "versions": versions}
    return write_json(data, indent=2) + "\n"


REQIF = "http://www.omg.org/spec/ReqIF/20110401/reqif.xsd"
_TEXTS = ("ReqIF.ForeignID", "ReqIF.Name", "Requirement", "Status", "Result", "Design", "Unit")
_ATTRIBUTES = dict.fromkeys(_TEXTS, "STRING") | dict.fromkeys(("Value", "Limit", "Margin"), "REAL")
MOST_LETTERS = 32_000


def render_reqif(record: GateRecord) -> str:
    """One specification, an object for each id of each requirement, and one for what has none."""
    root = ElementTree.Element("REQ-IF", xmlns=REQIF)
    changed = {"LAST-CHANGE": f"{record.provenance.today}T00:00:00Z"}

    def add(parent: ElementTree.Element, *path: str, text: str | None = None, **given: str) -> ElementTree.Element:
        """Elements below one another; text and attributes are of the last."""
        for tag in path:
            parent = ElementTree.SubElement(parent, tag)
        parent.text = None if text is None else _as_xml(text)
        parent.attrib |= {name.replace("_", "-"): _as_xml(value) for name, value in given.items()}
        return parent

    header = add(root, "THE-HEADER", "REQ-IF-HEADER", IDENTIFIER="header")
    for tag, text in (
        ("CREATION-TIME", changed["LAST-CHANGE"]),
        ("REQ-IF-TOOL-ID", f"tailstack {record.provenance.tailstack_version}"),
        ("REQ-IF-VERSION", "1.0"),  # of the schema, which 1.2 has not changed
        ("SOURCE-TOOL-ID", "tailstack"),
        ("TITLE", f"tailstack gate, policy {record.provenance.policy_name}"),
    ):
        add(header, tag, text=text)
    content = add(root, "CORE-CONTENT", "REQ-IF-CONTENT")
    kinds, types, objects = (add(content, tag) for tag in ("DATATYPES", "SPEC-TYPES", "SPEC-OBJECTS"))
    add(kinds, "DATATYPE-DEFINITION-STRING", IDENTIFIER="string", MAX_LENGTH=str(MOST_LETTERS), **changed)
    add(kinds, "DATATYPE-DEFINITION-REAL", IDENTIFIER="real", ACCURACY="15", MIN="-1e9", MAX="1e9", **changed)
    object_type = add(types, "SPEC-OBJECT-TYPE", IDENTIFIER="verified", LONG_NAME="Verified requirement", **changed)
    attributes = add(object_type, "SPEC-ATTRIBUTES")
    for name, kind in _ATTRIBUTES.items():
        defined = f"ATTRIBUTE-DEFINITION-{kind}"
        attribute = add(attributes, defined, IDENTIFIER=f"of-{name}", LONG_NAME=name, **changed)
        add(attribute, "TYPE", f"DATATYPE-DEFINITION-{kind}-REF", text=kind.lower())
    add(types, "SPECIFICATION-TYPE", IDENTIFIER="list", LONG_NAME="List of requirements", **changed)
    place = add(content, "SPECIFICATIONS", "SPECIFICATION", IDENTIFIER="gate", LONG_NAME="Gate", **changed)
    children = add(place, "CHILDREN")
    add(place, "TYPE", "SPECIFICATION-TYPE-REF", text="list")
    for entry in _list_verified(record):
        number = entry.number
        for foreign in entry.ids or ("",):
            name = f"_{entry.identity}" + (f"_{entry.ids.index(foreign)}" if foreign else "")
            made = add(objects, "SPEC-OBJECT", IDENTIFIER=name, LONG_NAME=entry.name or entry.file, **changed)
            values = add(made, "VALUES")
            texts = (foreign, entry.name, entry.asked, entry.status, entry.sentence, entry.file)
            measured = () if number is None else (number.unit, number.value, number.limit, number.margin)
            for (title, kind), cell in zip(_ATTRIBUTES.items(), (*texts, *measured), strict=False):
                if cell not in ("", None):
                    value = add(values, f"ATTRIBUTE-VALUE-{kind}", THE_VALUE=str(cell)[:MOST_LETTERS])
                    add(value, "DEFINITION", f"ATTRIBUTE-DEFINITION-{kind}-REF", text=f"of-{title}")
            add(made, "TYPE", "SPEC-OBJECT-TYPE-REF", text="verified")
            hierarchy = add(children, "SPEC-HIERARCHY", IDENTIFIER=f"at{name}", **changed)
            add(hierarchy, "OBJECT", "SPEC-OBJECT-REF", text=name)
    return _write_xml(root)


# --- all ----------------------------------------------------------------------------------------------


FORMATS: dict[str, Callable[[GateRecord], str]] = {
    "text": render_text,
    "json": lambda record: to_json(record).decode() + "\n",
    # a line for each field, so that a reviewer sees what changed in the one that is kept
    "baseline": lambda record: write_json(plain(record), indent=2) + "\n",
    "markdown": render_markdown,
    "sarif": render_sarif,
    "junit": render_junit,
    "github": render_github,
    "gitlab": render_gitlab,
    "needs": render_needs,
    "reqif": render_reqif,
}
NAMED_FROM_ROOT = ("sarif", "github", "gitlab", "needs", "reqif")  # files are named from the root of the repository


def render(record: GateRecord, name: str, name_file: Callable[[str], str] | None = None) -> bytes:
    """A record in a format, the same bytes whatever the terminal is like.

    name_file: how a file is called from the root of the repository, for what knows it from there only.
    """
    if name_file is not None and name in NAMED_FROM_ROOT:
        record = name_from_root(record, name_file)
    with write_on(Page(details=current().details)):
        return FORMATS[name](record).encode()
