"""A gate as a request: what a command sends, what arrives over HTTP and what a job keeps, and the way to a verdict."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from datetime import date
from typing import Any

from pydantic import ValidationError

from tailstack.design import design_to_data, load_design
from tailstack.design.reading import DEFAULT_LIMITS, DocumentSource, Limits
from tailstack.design.refusals import place, refuse
from tailstack.errors import DesignError, LimitError, Problem

from ..problems import RefusedAt, RequestError
from .asked import GateRequest, GateRequestDesign
from .baseline import GateBaseline, read_baseline
from .judge import Gate, choose_seed, report_refusal
from .pattern_slips import check_patterns
from .policy import GatePolicy, read_policy
from .reading import GateDesign
from .records import WORST_FIRST, GateFinding, GateRecord, record_unread
from .waivers import GateWaivers, describe_waiver, read_waivers

# What a service was set to admit was held to its limits at the door; here only what no setting can exceed is refused.
WIDEST_LIMITS = replace(DEFAULT_LIMITS, document_bytes=100_000_000)


@dataclass(frozen=True, slots=True)
class AdmittedGate:
    """A request that was read and checked through."""

    content: dict[str, Any]  # complete: what a job keeps and :func:`read_gate` takes
    gate: Gate

    @property
    def terms(self) -> dict[str, Any]:
        """By what it is judged, as plain data: what an auditor has to know to have changed."""
        policy, waivers = self.gate.policy, self.gate.waivers
        return {
            "policy_sha256": policy.sha256,
            "policy_name": policy.document.name,
            "waivers_sha256": None if waivers is None else waivers.sha256,
            **{name: self.content[name] for name in ("fail_level", "on_inconclusive", "max_regression_percent")},
        }


def admit_gate(
    data: Any, *, today: date, limits: Limits = DEFAULT_LIMITS, max_designs: int = 1000, max_trials: int | None = None
) -> AdmittedGate:
    """A request, read once.

    data: the body as plain data.  today: used where the request names no day.  max_trials: the most that a policy may
    ask for.  Policy, waivers, baseline and every design are read strictly.  Raises RequestError, GateError,
    or RefusedAt for a design, pointers into the body.
    """
    request = _read_request(data, limits)
    if len(request.designs) > max_designs:
        detail = f"a gate takes {max_designs} designs at most; {len(request.designs)} arrived"
        raise LimitError(Problem("/designs", "too-many", detail, "split it, or raise TAILSTACK_MAX_GATE_DESIGNS"))
    names = [entry.file for entry in request.designs]
    for index, name in enumerate(names):
        if name in names[:index]:
            detail = f"{name!r} is also the name of design {names.index(name)}: findings could not be told apart"
            raise RequestError(Problem(f"/designs/{index}/file", "given-twice", detail, "name every design once"))
    request = request.model_copy(update={"today": request.today or today.isoformat()})
    gate = _make_gate(request, limits)
    trials = gate.policy.document.verification.max_trials
    if max_trials is not None and trials > max_trials:
        detail = f"at most {max_trials} trials are drawn for a design; {trials} were asked for"
        hint = "ask for less, or raise TAILSTACK_MAX_TRIALS"
        raise LimitError(Problem("/policy/verification/max_trials", "too-many", detail, hint))
    for index, entry in enumerate(gate.designs):
        if entry.refusal is not None:
            field = "text" if request.designs[index].design is None else "design"
            raise RefusedAt.place(entry.refusal, f"/designs/{index}/{field}")
    complete = request.model_dump(by_alias=True)
    complete["designs"] = [{k: v for k, v in entry.items() if v is not None} for entry in complete["designs"]]
    return AdmittedGate({**complete, "seed": gate.seed}, gate)


def read_gate(data: dict[str, Any]) -> Gate:
    """The gate that an admitted request describes; a design that cannot be read is kept as its refusal.

    Raises RequestError, GateError.
    """
    return _make_gate(_read_request(data, WIDEST_LIMITS), WIDEST_LIMITS)


def _make_gate(request: GateRequest, limits: Limits) -> Gate:
    policy = read_policy(request.policy, prefix="/policy")
    try:
        today = date.fromisoformat(request.today or "")
    except ValueError:
        detail = f"there is no such day: {request.today!r}"
        raise RequestError(Problem("/today", "bad-date", detail, "YYYY-MM-DD")) from None
    waivers = None if request.waivers is None else read_waivers(request.waivers, today, prefix="/waivers")
    baseline = None if request.baseline is None else read_baseline(request.baseline, prefix="/baseline")
    known = [entry.name for entry in policy.document.classes]
    for index, entry in enumerate(request.designs):
        if entry.class_ is not None and entry.class_ not in known:
            hint = f"classes: {', '.join(known)}" if known else "the policy has no classes"
            detail = f"the policy has no class {entry.class_!r}"
            raise RequestError(Problem(f"/designs/{index}/class", "unknown-value", detail, hint))
    designs = tuple(_read_design(entry, limits) for entry in request.designs)
    # who sends names knows the folders from which they are; a file alone is from the root
    ascents = (99, 99) if any(entry.names for entry in request.designs) else None
    check_patterns(policy, waivers, designs, ascents=ascents, prefixes=("/policy", "/waivers"))
    return gate_of(request, designs, policy, waivers, baseline, today, tuple(request.present or ()))


def gate_of(
    asked: Any, designs: tuple[GateDesign, ...], policy: GatePolicy, waivers: GateWaivers | None,
    baseline: GateBaseline | None, today: date, present: tuple[str, ...],
) -> Gate:  # fmt: skip
    """The gate of what was read; ``asked``: a :class:`GateRequest`, or arguments of the same names."""
    return Gate(
        designs, policy, waivers, baseline, asked.mode, choose_seed(getattr(asked, "seed", None), policy, baseline),
        today, asked.fail_level, asked.on_inconclusive, asked.max_regression_percent, present,
    )  # fmt: skip


def _read_request(data: Any, limits: Limits) -> GateRequest:
    try:
        return GateRequest.model_validate(data)
    except ValidationError as error:
        raise RequestError(refuse(error, DocumentSource(data, None, None), limits, GateRequest).problems) from None


def _read_design(entry: GateRequestDesign, limits: Limits) -> GateDesign:
    # Text goes in as bytes: a text of one line would be taken for the path of a file.
    given = entry.design if entry.text is None else entry.text.encode(errors="surrogatepass")
    assert given is not None
    own = GateDesign(entry.file, None, design_class=entry.class_, names=tuple(entry.names or ()))
    try:
        return replace(own, design=load_design(given, allow_files=False, limits=limits))
    except (DesignError, LimitError) as error:
        return replace(own, refusal=error)


# --- judged by a running service: what is sent, and the record that comes back, at lines of the files here ------

# What a service calls documents that came without a file of their own.
POLICY, WAIVERS, BASELINE = "policy", "waivers", "baseline"
_WAIVER = re.compile(rf"{WAIVERS}#/waivers/(\d+), ")
_POINT = re.compile(r"/fiducials/points(/\d+.*)?")


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
