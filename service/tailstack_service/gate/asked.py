"""What a gate is asked with, over HTTP and on the command line, whose --help knows it without the solver."""

from __future__ import annotations

import argparse
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from tailstack.fields import Name, Record, refusal

from ..console.command_line import read_number
from ..console.flags import NO_FLAG, Flag

Mode = Literal["analytic", "verify", "auto"]
Level = Literal["error", "warning"]
Fold = Literal["fail", "warn"]
FileName = Annotated[str, Field(min_length=1, max_length=400, pattern=r"^[^\x00-\x1f\x7f]*$")]


class GateRequestDesign(Record):
    """One design of a gate."""

    file: FileName = Field(examples=["designs/guide.yaml"])
    """What findings call it; the policy's patterns see this name where names has none."""
    design: dict[str, Any] | None = None
    """The design document. Either this or text."""
    text: str | None = None
    """The design document as YAML or JSON text: findings then have line and column."""
    names: Annotated[list[FileName], Field(max_length=200)] | None = Field(
        default=None, examples=[["designs/guide.yaml"]]
    )
    """The names of the file that the policy's and the waivers' patterns see, links resolved: from the root of its
    repository, from the folder of the policy. Absent: file is the only one."""
    class_: Name | None = Field(default=None, alias="class")
    """Class of the policy. Absent: the policy's patterns decide."""

    @model_validator(mode="after")
    def _one(self) -> GateRequestDesign:
        if (self.design is None) == (self.text is None):
            raise refusal("one-of", "give exactly one of design and text")
        return self


def _parse_percent(text: str) -> float:
    value = read_number(text.strip().removesuffix("%"))
    if value is None:
        raise argparse.ArgumentTypeError(f"expected a number of per cent; got {text!r}")
    if not 0 <= value <= 1_000_000:
        raise argparse.ArgumentTypeError(f"expected 0 or more per cent; got {text}")
    return float(value)


POLICY = Flag("rules and limits (default: the designs' own requirements)", metavar="FILE", of_file=True)
WAIVERS = Flag("findings that are accepted for now", metavar="FILE", of_file=True)
BASELINE = Flag("record of an earlier gate (--format baseline=FILE)", metavar="FILE", of_file=True)
MODE = Flag("analytic: estimate. verify: simulate (Monte Carlo). auto (default): simulate near a limit")
RISE = "allowed rise of P95 over the baseline (default: policy)"
REGRESSION = Flag(RISE, name="max-regression", metavar="PCT", parse=_parse_percent)
INCONCLUSIVE = Flag("what an open question counts as (default: exit code 4)")


class GateRequest(Record):
    """Body of ``POST /v1/gates``."""

    designs: Annotated[list[GateRequestDesign], Field(min_length=1), NO_FLAG]
    """The designs to judge."""
    policy: Annotated[dict[str, Any] | None, POLICY] = None
    """The policy (schema policy). Absent: the designs' own requirements, default rules."""
    waivers: Annotated[dict[str, Any] | None, WAIVERS] = None
    """Waivers (schema waivers)."""
    baseline: Annotated[dict[str, Any] | None, BASELINE] = None
    """The answer of an earlier gate (schema gate)."""
    present: Annotated[Annotated[list[FileName], Field(max_length=10_000)] | None, NO_FLAG] = Field(
        default=None, examples=[["designs/other.yaml"]]
    )
    """Files of the baseline that are still there and not among these designs. A design of the baseline whose file is
    neither here nor judged may be one of these designs under another name."""
    mode: Annotated[Mode, MODE] = Field(default="auto", examples=["analytic"])
    """analytic: first order, answered at once. verify: Monte Carlo for every design. auto: Monte Carlo where first
    order is near a limit."""
    seed: Annotated[Annotated[int, Field(ge=0, lt=2**63)] | None, NO_FLAG] = None
    """Seed. Absent: the baseline's, else the policy's."""
    today: Annotated[Annotated[str, Field(pattern=r"^\d{4}-\d{2}-\d{2}$")] | None, NO_FLAG] = None
    """Day by which waivers are judged, YYYY-MM-DD. Absent: the service's, UTC."""
    fail_level: Annotated[Level, Flag("findings that fail")] = "error"
    """Findings of this severity fail the gate."""
    on_inconclusive: Annotated[Fold | None, INCONCLUSIVE] = None
    """What an open question counts as. Absent: 4."""
    max_regression_percent: Annotated[Annotated[float, Field(ge=0, le=1e6)] | None, REGRESSION] = None
    """Allowed rise of P95 over the baseline. Absent: the policy's."""
