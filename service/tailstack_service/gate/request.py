"""A gate as a request: what arrives over HTTP and what a job keeps, and the way from there to a verdict."""

from __future__ import annotations

from dataclasses import replace
from datetime import date
from typing import Annotated, Any

from pydantic import Field, ValidationError, model_validator

from tailstack.design import load_design
from tailstack.design.fields import Name, Record, refusal
from tailstack.design.reading import DEFAULT_LIMITS, Limits, Source
from tailstack.design.refusals import refuse
from tailstack.errors import DesignError, LimitError, Problem

from ..problems import RequestError
from .baseline import read_baseline
from .judge import Gate, GateDesign, choose_seed, judge
from .policy import read_policy
from .records import Fold, GateRecord, Level, Mode
from .waivers import read_waivers

# What a service was set to admit was held to its limits at the door; here only what no setting can exceed is refused.
WIDEST_LIMITS = replace(DEFAULT_LIMITS, document_bytes=100_000_000)


FileName = Annotated[str, Field(min_length=1, max_length=400, pattern=r"^[^\x00-\x1f\x7f]*$")]


class GateRequestDesign(Record):
    """One design of a gate."""

    file: FileName = Field(
        description="What findings call it; the policy's patterns see this name.", examples=["designs/guide.yaml"]
    )
    design: dict[str, Any] | None = Field(default=None, description="The design document. Either this or text.")
    text: str | None = Field(
        default=None, description="The design document as YAML or JSON text: findings then have line and column."
    )
    class_: Name | None = Field(
        default=None, alias="class", description="Class of the policy. Absent: the policy's patterns decide."
    )

    @model_validator(mode="after")
    def _one(self) -> GateRequestDesign:
        if (self.design is None) == (self.text is None):
            raise refusal("one-of", "give exactly one of design and text")
        return self


class GateRequest(Record):
    """Body of ``POST /v1/gates``."""

    designs: Annotated[list[GateRequestDesign], Field(min_length=1)] = Field(description="The designs to judge.")
    policy: dict[str, Any] | None = Field(
        default=None, description="The policy (schema policy). Absent: the designs' own requirements, default rules."
    )
    waivers: dict[str, Any] | None = Field(default=None, description="Waivers (schema waivers).")
    baseline: dict[str, Any] | None = Field(default=None, description="The answer of an earlier gate (schema gate).")
    present: Annotated[list[FileName], Field(max_length=10_000)] | None = Field(
        default=None,
        description="Files of the baseline that are still there and not among these designs. A design of the baseline "
        "whose file is neither here nor judged may be one of these designs under another name.",
        examples=[["designs/other.yaml"]],
    )
    mode: Mode = Field(
        default="auto",
        description="analytic: first order, answered at once. verify: Monte Carlo for every design. auto: Monte Carlo "
        "where first order is near a limit.",
        examples=["analytic"],
    )
    seed: Annotated[int, Field(ge=0, lt=2**63)] | None = Field(
        default=None, description="Seed. Absent: the baseline's, else the policy's."
    )
    today: Annotated[str, Field(pattern=r"^\d{4}-\d{2}-\d{2}$")] | None = Field(
        default=None, description="Day by which waivers are judged, YYYY-MM-DD. Absent: the service's, UTC."
    )
    fail_level: Level = Field(default="error", description="Findings of this severity fail the gate.")
    on_inconclusive: Fold | None = Field(default=None, description="What an open question counts as. Absent: 4.")
    max_regression_percent: Annotated[float, Field(ge=0, le=1e6)] | None = Field(
        default=None, description="Allowed rise of P95 over the baseline. Absent: the policy's."
    )


def admit_gate(
    data: Any,
    *,
    today: date,
    limits: Limits = DEFAULT_LIMITS,
    max_designs: int = 1000,
    max_trials: int | None = None,
) -> dict[str, Any]:
    """A request, checked through and complete: what a job keeps and :func:`judge_designs` takes.

    data: the body as plain data.  today: used where the request names no day.  max_trials: the most that a policy may
    ask for.  Policy, waivers, baseline and every design are read strictly.  Raises RequestError, GateError,
    DesignError or LimitError, pointers into the body.
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
    complete = request.model_dump(by_alias=True)
    complete["designs"] = [{k: v for k, v in entry.items() if v is not None} for entry in complete["designs"]]
    complete["today"] = request.today or today.isoformat()
    gate = read_gate(complete, limits)
    trials = gate.policy.document.verification.max_trials
    if max_trials is not None and trials > max_trials:
        detail = f"at most {max_trials} trials are drawn for a design; {trials} were asked for"
        hint = "ask for less, or raise TAILSTACK_MAX_TRIALS"
        raise LimitError(Problem("/policy/verification/max_trials", "too-many", detail, hint))
    for index, entry in enumerate(gate.designs):
        if entry.refusal is not None:
            field = "text" if request.designs[index].design is None else "design"
            at = f"/designs/{index}/{field}"
            raise type(entry.refusal)([replace(p, pointer=at + p.pointer) for p in entry.refusal.problems])
    return {**complete, "seed": gate.seed}


def list_terms(data: dict[str, Any]) -> dict[str, Any]:
    """By what an admitted request is judged, as plain data: what an auditor has to know to have changed."""
    policy = read_policy(data["policy"], prefix="/policy")
    waivers = data["waivers"]
    day = _read_day(data["today"])
    return {
        "policy_sha256": policy.sha256,
        "policy_name": policy.document.name,
        "waivers_sha256": None if waivers is None else read_waivers(waivers, day, prefix="/waivers").sha256,
        **{name: data[name] for name in ("fail_level", "on_inconclusive", "max_regression_percent")},
    }


def read_gate(data: dict[str, Any], limits: Limits = WIDEST_LIMITS) -> Gate:
    """The gate that an admitted request describes; a design that cannot be read is kept as its refusal.

    Raises RequestError, GateError.
    """
    request = _read_request(data, limits)
    policy = read_policy(request.policy, prefix="/policy")
    today = _read_day(request.today)
    waivers = None if request.waivers is None else read_waivers(request.waivers, today, prefix="/waivers")
    baseline = None if request.baseline is None else read_baseline(request.baseline, prefix="/baseline")
    known = [entry.name for entry in policy.document.classes]
    for index, entry in enumerate(request.designs):
        if entry.class_ is not None and entry.class_ not in known:
            hint = f"classes: {', '.join(known)}" if known else "the policy has no classes"
            detail = f"the policy has no class {entry.class_!r}"
            raise RequestError(Problem(f"/designs/{index}/class", "unknown-value", detail, hint))
    return Gate(
        designs=tuple(_read_design(entry, limits) for entry in request.designs),
        policy=policy,
        waivers=waivers,
        baseline=baseline,
        mode=request.mode,
        seed=choose_seed(request.seed, policy, baseline),
        today=today,
        fail_level=request.fail_level,
        on_inconclusive=request.on_inconclusive,
        max_regression_percent=request.max_regression_percent,
        present=tuple(request.present or ()),
    )


def judge_designs(data: dict[str, Any]) -> GateRecord:
    """The record of an admitted request, Monte Carlo included, computed here and now.

    The same record as the job's; in mode analytic a matter of milliseconds.  Raises RequestError, GateError.
    """
    return judge(read_gate(data))


def _read_request(data: Any, limits: Limits) -> GateRequest:
    try:
        return GateRequest.model_validate(data)
    except ValidationError as error:
        raise RequestError(refuse(error, Source(data, None, None), limits, GateRequest).problems) from None


def _read_day(text: str | None) -> date:
    try:
        return date.fromisoformat(text or "")
    except ValueError:
        raise RequestError(Problem("/today", "bad-date", f"there is no such day: {text!r}", "YYYY-MM-DD")) from None


def _read_design(entry: GateRequestDesign, limits: Limits) -> GateDesign:
    # Text goes in as bytes: a text of one line would be taken for the path of a file.
    given = entry.design if entry.text is None else entry.text.encode(errors="surrogatepass")
    assert given is not None
    try:
        return GateDesign(entry.file, load_design(given, allow_files=False, limits=limits), None, entry.class_)
    except (DesignError, LimitError) as error:
        return GateDesign(entry.file, None, error, entry.class_)
