"""A gate that a running service judges: what is sent, and the record that comes back, at lines of the files here."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

from tailstack.design import design_to_data
from tailstack.design.reading import DocumentSource
from tailstack.design.refusals import place
from tailstack.errors import Problem

from ..console.progress import Progress
from ..gate.judge import Gate, conclude, report_refusal, score_designs
from ..gate.records import WORST_FIRST, GateFinding, GateRecord, record_unread
from ..gate.waivers import describe_waiver

# What a service calls documents that came without a file of their own.
POLICY, WAIVERS, BASELINE = "policy", "waivers", "baseline"
_WAIVER = re.compile(rf"{WAIVERS}#/waivers/(\d+), ")
_POINT = re.compile(r"/fiducials/points(/\d+.*)?")


def judge_remotely(gate: Gate, url: str, progress: Progress) -> GateRecord:
    """The record as it would have been computed here.  Raises RemoteError, also for an answer that is no record."""

    from ..console.remote import RemoteService, compute_remotely, unexpected_error
    from ..schemas import read_record

    request = write_request(gate)
    service = RemoteService(url)
    if not request["designs"]:  # there is nothing to ask
        return conclude(gate, score_designs(gate), [None] * len(gate.designs))
    try:
        record: GateRecord = read_record("gate", compute_remotely(service, "/v1/gates", request, progress.report))
        names = [entry["file"] for entry in request["designs"]]
        if [design.file for design in record.designs] != names or record.exit_code not in range(5):
            raise ValueError("it is about other designs")
    except ValueError as error:
        raise unexpected_error(service.url, "the record of this gate", error) from None
    return complete_record(record, gate)


def write_request(gate: Gate) -> dict[str, Any]:
    """Body of ``POST /v1/gates``: every design that could be read, with the points of its fiducial file in it."""
    designs = [
        {"file": e.file, "names": list(e.known_as), "design": design_to_data(e.design)}
        for e in gate.designs
        if e.design is not None
    ]
    unread = [entry.file for entry in gate.designs if entry.design is None]  # they are there, if not sent
    request = {
        "designs": designs,
        "mode": gate.mode,
        "seed": gate.seed,
        "today": gate.today.isoformat(),
        "fail_level": gate.fail_level,
        "policy": gate.policy.source.data,
        "waivers": None if gate.waivers is None else gate.waivers.source.data,
        "baseline": None if gate.baseline is None else gate.baseline.source.data,
        "on_inconclusive": gate.on_inconclusive,
        "max_regression_percent": gate.max_regression_percent,
        "present": None if gate.baseline is None else [*gate.present, *unread] or None,
    }
    return {name: value for name, value in request.items() if value is not None}


def complete_record(record: GateRecord, gate: Gate) -> GateRecord:
    """The record of a service with findings at their lines here, and with the designs that could not be read, which
    were not sent."""
    sent = iter(record.designs)
    designs = tuple(record_unread(entry.file) if entry.design is None else next(sent) for entry in gate.designs)
    findings = [_place_here(finding, gate) for finding in record.findings]
    unread = [f for entry in gate.designs if entry.refusal is not None for f in report_refusal(entry, entry.refusal)]
    if unread:  # the service did not know of designs that may have what a pattern is for
        findings = [*(finding for finding in findings if not _is_of_pattern(finding)), *unread]
        record = replace(record, verdict=WORST_FIRST[0], exit_code=2)
    order = {entry.file: index for index, entry in enumerate(gate.designs)}
    findings.sort(key=lambda finding: order.get(finding.file, len(order)))
    return replace(record, findings=tuple(findings), designs=designs)


def _is_of_pattern(finding: GateFinding) -> bool:
    """Whether a finding says that a pattern is for nothing: that hangs on all designs."""
    idle = finding.rule == "waiver-unused" and "/designs/" in finding.pointer
    return idle or finding.rule in ("process-unused", "class-unused")


def _place_here(finding: GateFinding, gate: Gate) -> GateFinding:
    """A finding of the service with the name of the file here, the line in it, and the waiver by its place here."""
    design = next((entry.design for entry in gate.designs if entry.file == finding.file), None)
    document = {POLICY: gate.policy, WAIVERS: gate.waivers, BASELINE: gate.baseline}.get(finding.file)
    if design is not None:
        if design.document.fiducials.file is not None and _POINT.fullmatch(finding.pointer):
            finding = replace(finding, pointer="/fiducials/file")  # the points were sent inside the design
        finding = _find_line(finding, finding.file, design.source)
    elif document is not None:
        finding = _find_line(finding, document.file, document.source)
    waiver = _WAIVER.match(finding.suppressed_by or "")
    if waiver is not None and gate.waivers is not None:
        finding = replace(finding, suppressed_by=describe_waiver(gate.waivers, int(waiver.group(1))))
    return finding


def _find_line(finding: GateFinding, file: str, source: DocumentSource) -> GateFinding:
    here = place(Problem(finding.pointer, finding.rule, ""), source)
    return replace(finding, file=file, line=here.line, column=here.column)
