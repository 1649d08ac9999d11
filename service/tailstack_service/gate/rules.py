"""The rules by id: title, which way is worse, the function that looks, and the page that ``--explain`` prints.

Of a page, docs/rules.md has what the rule finds and what to do; what a policy may set is in the fields of its model.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cache, partial
from textwrap import fill
from typing import Any, Literal

from tailstack.design.document import without_null
from tailstack.fields import describe_fields

from ..shipped import find_manual
from .baseline import find_not_compared, find_regressions, find_relaxed_limits
from .case import Case, find_unjudged
from .design_rules import (
    find_assumed_values,
    find_close_fiducials,
    find_close_images,
    find_failures,
    find_fatal_losses,
    find_first_order_gaps,
    find_implausible_values,
    find_narrow_margins,
    find_open_questions,
    find_tight_tolerances,
    find_unseen_slips,
    find_weaknesses,
)
from .policy import Policy, Rules
from .reading import Remark


@dataclass(frozen=True, slots=True)
class Rule:
    """One rule of the gate."""

    id: str  # stable
    title: str
    find: Callable[[Case], Iterable[Remark]] | None = None  # None: not about one design that was computed
    worse: Literal["more", "less", "fixed"] = "fixed"  # fixed: it has no value and cannot be waived
    unit: str = ""

    @property
    def severity(self) -> Literal["error", "warning", "note"]:
        """Unless the policy says otherwise."""
        return find_severity(Rules(), self.id)  # type: ignore[return-value]

    @property
    def page(self) -> str:
        """What it finds and what to do; what a policy may set, and up to what a waiver accepts it."""
        return "\n\n".join([_read_pages()[self.id], *_describe_settings(self.id), _describe_waiver(self)])


@cache
def _read_pages() -> dict[str, str]:
    """By rule, what stands below its title in docs/rules.md."""
    sections = (find_manual() / "rules.md").read_text(encoding="utf-8").split("\n## ")[1:]
    return {text.partition("\n")[0]: text.split("\n\n", 2)[2].strip() for text in sections}


def _describe_settings(rule: str) -> list[str]:
    """The fields that a policy has of a rule, one a line; none of a rule that no policy can change."""
    entry = getattr(Rules(), rule.replace("-", "_"), None)
    if entry is None:
        return []
    lines = []
    for name, field in describe_fields(type(entry)).items():
        said = str(field.description)
        default = "" if "Default" in said or field.default is None else f" Default {field.default}."
        lines.append(fill(f"- {name}: {said}{default}", 120, subsequent_indent="  "))
    return ["In a policy:\n\n" + "\n".join(lines)]


def _describe_waiver(rule: Rule) -> str:
    if rule.worse == "fixed":
        return "It has no waiver of its own."
    bound = "max_value" if rule.worse == "more" else "min_value"
    unit = rule.unit or "in the unit of the finding"
    return f"In a waiver: {bound}, {unit}; the worse end of an interval must keep it."


def find_severity(rules: Rules, rule: str) -> str:
    """The weight that a policy gives a rule, "off" among them; of what no policy can change, error."""
    entry = getattr(rules, rule.replace("-", "_"), None)
    return "error" if entry is None else str(entry.severity)


def _limit(rule: str, title: str, worse: Literal["more", "less"], unit: str) -> Rule:
    return Rule(rule, title, partial(find_failures, rule=rule), worse, unit)


# The order is that of the findings of a design, and of the pages.
_RULES = (
    _limit("p95", "P95 (or another quantile) of the error is above its limit", "more", "mm"),
    _limit("cvar", "The mean of the worst 5 % of errors is above its limit", "more", "mm"),
    _limit("exceedance", "Too many shots miss by more than the limit", "more", "mm"),
    _limit("per-unit-yield", "Too few installed units are good", "less", "fraction"),
    Rule("statistic", "A mean, a CVaR or a probability is above its limit", partial(find_failures, rule="statistic")),
    Rule("first-order-gap", "Estimate and Monte Carlo disagree", find_first_order_gaps, "more", "%"),
    Rule("conditioning", "The layout barely determines the answer", find_weaknesses, "less"),
    Rule("plausibility", "A value is allowed and hardly ever meant", find_implausible_values),
    Rule("assumed-values", "The verdict rests on values that nobody stated", find_assumed_values, "more"),
    Rule("fiducial-spacing", "Two fiducials are too close", find_close_fiducials, "less", "mm"),
    Rule("survives-loss", "A limit is not kept when fiducials are lost", find_fatal_losses, "more", "mm"),
    Rule("reliability", "A slipped image does too much before it is noticed", find_unseen_slips, "more", "mm"),
    Rule("visibility", "A fiducial is imaged too near the border", find_narrow_margins, "less", "px"),
    Rule("overlap", "Two images may not be told apart", find_close_images, "less", "px"),
    Rule(
        "process-capability",
        "A tolerance is tighter than its process can hold",
        find_tight_tolerances,
        "less",
        "deg or mm",
    ),
    Rule("process-unused", "A process judges nothing"),
    Rule("regression", "Worse than the baseline", find_regressions, "more", "%"),
    Rule("limit-relaxed", "Asked for less than in the baseline", find_relaxed_limits),
    Rule("not-compared", "The baseline has nothing to compare with", find_not_compared),
    Rule("not-judged", "A requirement was not judged", find_unjudged),
    Rule("class-relaxed", "A class switches off what is an error"),
    Rule("class-unused", "A class, or a pattern of one, chooses nothing"),
    Rule("inconclusive", "An interval holds the limit", find_open_questions),
    Rule("waiver-expired", "A waiver is beyond its date"),
    Rule("waiver-unused", "A waiver accepts nothing"),
    Rule("waiver-wide", "A waiver accepts more than anybody looked at"),
    Rule("model-version", "The baseline was computed by another version"),
    Rule("invalid-design", "The design document is not valid"),
    Rule("invalid-input", "Policy, waivers, baseline or an option cannot be used"),
    Rule("not-evaluated", "The design could not be evaluated"),
)

RULES: dict[str, Rule] = {rule.id: rule for rule in _RULES}


def explain(rule: Rule) -> str:
    """The page of a rule, as ``tailstack gate --explain`` prints it."""
    return f"{rule.id}: {rule.title}\n\n{rule.page}\n"


def policy_json_schema() -> dict[str, Any]:
    """JSON Schema (2020-12) of ``tailstack/policy/1``."""
    head = {
        "title": "tailstack policy, version 1",
        "description": "What a gate judges by: rules by id with their severity and limits, and classes of designs with "
        "rules of their own. Unknown fields, NaN and infinities are refused.",
    }
    schema = without_null(Policy.model_json_schema(by_alias=True))
    for name, entry in schema["$defs"]["Rules"]["properties"].items():
        entry["description"] = f"{RULES[name].title}."
    return {**schema, **head}
