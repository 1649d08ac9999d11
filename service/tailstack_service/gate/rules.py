"""The rules by id: title, which way is worse, the function that looks, and the page that ``--explain`` prints."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal

from tailstack.design.document import without_null

from .baseline import find_not_compared, find_regressions, find_relaxed_limits
from .case import Case, find_class_names, find_unjudged
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
    find: Callable[[Case], list[Remark]] | None = None  # None: not about one design that was computed
    worse: Literal["more", "less", "fixed"] = "fixed"  # fixed: it has no value and cannot be waived
    unit: str = ""

    @property
    def severity(self) -> Literal["error", "warning", "note"]:
        """Unless the policy says otherwise."""
        return find_severity(Rules(), self.id)  # type: ignore[return-value]

    @property
    def page(self) -> str:
        """What it means, and what to do."""
        return _PAGES[self.id]


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
    Rule("class-by-name", "A design's name would choose its class", find_class_names),
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
    return f"{rule.id}: {rule.title}\n\n{rule.page}\n\nseverity unless the policy says otherwise: {rule.severity}\n"


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


_PAGES = {
    "p95": """\
The error at the tool (or of the localised target) has a quantile, P95 unless the requirement says otherwise, that lies
above its limit: the lower end of its interval does. Judged are all pooled requirements of the design and, if the
policy sets `limit_mm`, the P95 of the TCP error at every target.

To first order the interval is the calibrated error of the linearisation; by Monte Carlo it is made of order statistics,
which takes no law for granted, and holds at all looks together: pass is said of a design that fails, or fail of one
that passes, with a probability of at most (1 - confidence) / 2 each (2.5 %).

What to do: the message names the tolerance with the largest share of the variance; `tailstack score DESIGN` prints
the whole budget, `tailstack optimise DESIGN` looks for the cheapest design that keeps the limit.

Policy: severity, limit_mm, confidence. Waiver: max_value in mm, compared with the upper end of the interval.""",
    "cvar": """\
CVaR95 is the mean error of the worst 5 % of shots: unlike P95 it says how bad the bad ones are. Judged only if the
policy sets `limit_mm`. To first order its interval is twice the calibrated error of the linearisation; by Monte Carlo
it comes from a bound of its standard error, with the normal law of a mean, Bonferroni over the looks.

What to do: as for p95; heavy tails come from few, wide, non-normal contributors.

Policy: severity, limit_mm, confidence. Waiver: max_value in mm, compared with the upper end of the interval.""",
    "exceedance": """\
The probability that the TCP error is beyond `limit_mm` is above `max_probability`. It is decided as the quantile of
order 1 - max_probability against limit_mm, which is the same question with a better interval; the finding's value is
that quantile in mm.

Policy: severity, limit_mm, max_probability, confidence. Waiver: max_value in mm, compared with the upper end of the
interval.""",
    "per-unit-yield": """\
A unit is installed once: its own errors of installation stay. It is good if the quantile over its own shots is within
the limit. The yield is the fraction of units that are good. Judged are the design's requirements with `risk: per_unit`
and, if the policy sets them, `limit_mm` with `min_yield`.

What to do: tighten what is drawn once per unit (interfaces, hand-eye, manufacturing); noise of the images averages
out within a unit.

Policy: severity, limit_mm, min_yield, confidence. Waiver: min_value as a fraction, compared with the lower confidence
limit by Monte Carlo; to first order no waiver covers it.""",
    "first-order-gap": """\
The first-order P95 differs from the verified one by more than `max_percent`, interval included. Where no Monte Carlo
was drawn, the calibrated error of the linearisation is judged instead. First order errs towards optimism when the
fiducials form a small cluster far from the target.

What to do: gate with --mode verify, and do not quote the first-order number. More spread, more fiducials or a target
nearer to them make the chain more linear.

Policy: severity, max_percent. Waiver: max_value in per cent.""",
    "conditioning": """\
The structure is flat (thickness over width), a view is barely resected (second smallest over largest singular value),
or the rays to a target meet at a small angle. Image noise is then amplified about in the inverse ratio. A layout that
does not determine the answer at all is not judged: see not-evaluated.

What to do: the message names the direction that is weak; lift fiducials out of the plane, or turn a view.

Policy: severity. Waiver: min_value in the unit of the finding (mm, ratio or degrees).""",
    "plausibility": """\
A value of the design looks like a slip: radians or metres where degrees or millimetres are asked for, a half-width
finer than a kinematic coupling repeats or wider than a clip-on seat plays, noise below the best that was measured, a
structure that is too small for its beads or too large for a detector, a target at the pivot of a seat. The message
begins with the remark's own name; docs/design.md lists them with the sources of their numbers. Where such a slip makes
the geometry undetermined, the refusal says it: see not-evaluated.

What to do: correct the unit. If the value is meant, list in `remarks` the remarks that are to count: the others are
noted and fail nothing.

Policy: severity, remarks. No waiver covers it: a value that is meant once is meant always.""",
    "assumed-values": """\
The list `assumed` of the design names values that nobody stated: the first guesses of `tailstack init`, `convert` and
the workbench. The limits are judged with them as they are, so a pass holds as far as they do. The finding's value is
how many there are; they are listed under `assumed` of the design in the record, and by `tailstack validate DESIGN`.

What to do: measure the value or ask who knows it, write it into the design and take its pointer off the list.

Policy: severity, max_count. Waiver: max_value, the number of assumed values.""",
    "fiducial-spacing": """\
Two fiducials are closer than `min_mm`, centre to centre. Judged only if the policy sets it: how much wall a bead needs
is a matter of manufacturing. The ten closest pairs are findings of their own, a note says how many more there are.

Policy: severity, min_mm. Waiver: min_value in mm.""",
    "survives-loss": """\
Without one fiducial (or two, as `lost` says), whichever is worst, a requirement of the design or a limit of the policy
is not kept any more, or nothing can be estimated. Fiducials are lost in all views; judged is the estimate of what is
left, without an interval, and `p95` says whether the whole structure keeps the limit. Judged only if the policy sets
`lost`. Two of more than 30 fiducials are not tried and count as not kept, because nobody knows.

What to do: add a fiducial near those that are named, or spread the others; `tailstack score DESIGN` names the worst
losses.

Policy: severity, lost. Waiver: max_value in mm; what cannot be estimated cannot be waived.""",
    "reliability": """\
The image of a fiducial may slip in one view (a bad centroid, a wrong neighbour) and move the tool by more than
`max_effect_mm` before a test of the residuals notices it, at a level of 0.1 % in 80 % of cases. The residuals of a view
with few fiducials say little: with six, a slip is hardly ever noticed, and cannot be waived. Named is the worst
fiducial; `tailstack score DESIGN --reliability` lists all. Judged only if the policy sets `max_effect_mm`.

What to do: add fiducials, or know the intrinsics (`model.estimator`): both leave more to check with.

Policy: severity, max_effect_mm. Waiver: max_value in mm.""",
    "visibility": """\
In some view an image of a fiducial is nearer to the border than `min_margin_px`, at the biased geometry without noise.
A view whose image size is not stated cannot be checked and is remarked as well. A fiducial outside the image is not
judged: see not-evaluated.

What to do: move the isocentre or the source; a longer source_isocentre_mm widens the field.

Policy: severity, min_margin_px. Waiver: min_value in px.""",
    "overlap": """\
In some view the images of two fiducials are closer than `min_px`, or than their diameter asks for where the design
gives it: half of both shadows and 3 px. A segmentation may merge or swap them, which no number of tailstack includes.

What to do: move one of the two across the ray that joins them.

Policy: severity, min_px. Waiver: min_value in px.""",
    "process-capability": """\
A half-width of the design is below what the policy says its process can hold. Such a tolerance makes the budget look
good and the part reject. One that is left out does not vary and counts as 0, and so does each of an interface or a
hand-eye calibration that is left out as a whole, where a pattern names it; not at an interface with locators.

What to do: widen it, or name a better process in the policy.

Policy: severity, processes (name, tolerances as patterns, min_half_width_deg, min_half_width_mm). Waiver: min_value in
the unit of the tolerance.""",
    "process-unused": """\
A pattern of process-capability matches no tolerance of any design that is held to it, or only rotations where the
process states no min_half_width_deg (only lengths and no min_half_width_mm). A slip in a name would be a tolerance that
nobody judges. Nothing is said while a design cannot be read.

What to do: `tailstack score DESIGN` prints the names of the tolerances; mend the pattern or remove it.

Policy: severity.""",
    "regression": """\
The P95 of the TCP error at a target is more than `max_percent` (--max-regression) above that of the baseline, an
earlier gate written with --format json=FILE. Compared is first order, in which there is no chance; where the calibrated
error of first order is above first-order-gap's max_percent and both drew as many trials, Monte Carlo with the same
seed. Absolute limits stay absolute: a failed limit fails whatever the baseline says. What there was nothing to compare
with is said by not-compared.

Policy: severity, max_percent. Waiver: max_value in per cent.""",
    "limit-relaxed": """\
A design states its own requirements, so it could set its own bar. With a baseline it cannot: whatever it was held to
there, by its requirements or by limits of the policy, must still be asked for, by whatever name: a limit that was
raised, a quantile, yield or confidence that was lowered, an error that became another one, a rule that counts less or
is off, a requirement that went, a target that went, is no longer asked for, or stands somewhere else.

What to do: put the requirement back; or, if less is wanted on purpose, write a new baseline in the same merge request,
so that whoever reviews it agrees to it.

Policy: severity.""",
    "not-compared": """\
A design is found again in the baseline by its file; where the baseline has a design whose file is gone, by its
content: all of it, else the most sections in common (the fiducials, or three of views, interfaces, targets, transforms
and execution), else its name. Where several fit equally, none is taken. A design that is found nowhere is held to its
own limits alone, and noted. A design of the baseline whose file went and that no design here is, is a warning at the
baseline: nobody judges it any more, or it was changed beyond recognition under another name. Noted as well: a design
that was compared with one of another file, and a target that the baseline does not have. A baseline of an older
version, which does not say what was asked for, is a warning.

What to do: rename without changing, or write a new baseline in the same merge request.

Policy: severity.""",
    "not-judged": """\
The design states a requirement and nothing was held against it: the rule that judges it (p95, or per-unit-yield) is
off, for all designs or for the design's class. A pass says nothing about it. Each requirement is named, and a note
names targets that no requirement and no limit is about; `not_judged` of the record lists both. A design of which no
limit at all was judged is not evaluated, and the gate leaves with exit code 3: see not-evaluated.

What to do: give the rule a severity of warning or note instead of off: it is then judged and does not fail the gate.

Policy: severity error, warning or note, never off.""",
    "class-relaxed": """\
A class of the policy switches off a rule that is an error for all other designs, or takes away its limit, and a design
of this gate is in it. A class that lets such a rule count less is noted. The finding stands in the policy.

What to do: let the class have a limit of its own instead, or a severity of warning.

Policy: severity (of the policy; a class cannot change it).""",
    "class-unused": """\
A pattern of a class matches no design of this gate, or every design that a class would choose is in a class before it.
A slip in a pattern would be a limit that nobody is held to. Files are compared as files: links are resolved, Unicode is
normalised, and patterns begin at the root of the repository or at a folder between that and the policy. A design that
was given through a link is judged where the file is; the finding then names both.

What to do: mend the pattern or the order of the classes. A gate that is to judge a part of the designs only, as before
a commit, may have the severity note.

Policy: severity (of the policy; a class cannot change it).""",
    "class-by-name": """\
The name of a design is what its author writes, so a name must not choose by which rules the design is judged. The
design's name matches a pattern in `designs` of a class that does not say `by_name: true`: the class was not applied,
the design was judged by the rules that its file gives it.

What to do: give the class patterns of `files` instead, which a reviewer sees; or, if authors may choose,
`by_name: true`. Policies written before this rule need one of the two.

Policy: severity (of the rules the design was judged by).""",
    "inconclusive": """\
Neither pass nor fail can be said: the limit lies within the interval. To first order the calibrated error of the
linearisation is too wide; by Monte Carlo the cap on trials was reached. A design exactly on its limit stays open with
a probability of at least its confidence (95 %). The gate then leaves with exit code 4, which --on-inconclusive folds
into 1 (fail) or 0 (warn).

What to do: --mode verify; a larger verification.max_trials in the policy; or a design that is not on its limit.

Policy: severity error or warning (warning: as --on-inconclusive warn). A waiver of the rule that is open covers it, if
the interval's end is within the waiver's value.""",
    "waiver-expired": """\
The last day of a waiver has passed. It accepts nothing any more, and the gate fails until it is removed or renewed by
its owner (at most 180 days ahead).""",
    "waiver-unused": """\
No finding of this gate was accepted by the waiver: the cause is gone, the value is beyond what was accepted, or its
patterns match no design. A pattern that matches no design is noted as well where others do. Remove it, so that it does
not accept what comes later.

Policy: severity.""",
    "waiver-wide": """\
A waiver accepts one finding that somebody looked at. It is wide if

- it names no design: `designs` is absent, or a pattern with wildcards has fewer than three characters beside them and
  the ending in its last part (`*`, `*.yaml`, `designs/*`);
- it accepts more than `max_limit_ratio` (2) times the limit that it waives, or more than `max_value_ratio` (1.5) times
  the value that it accepts now, the end of the interval. Of min_value the inverse holds; of a yield the misses are
  compared, of per cent the P95 itself (100 % more is twice);
- what it accepts is found by the design's own name and not by its file: any design may be called so.

What to do: name the file, and accept what was measured and little more.

Policy: severity, max_limit_ratio, max_value_ratio (of the policy; a class cannot change them).""",
    "model-version": """\
The baseline was written by another version of tailstack. Numbers may differ for that reason; the changelog says where.
Write a new baseline.

Policy: severity.""",
    "invalid-design": """\
The document cannot be read or breaks a rule of design documents; every problem is a finding of its own. Nothing was
judged, and the gate leaves with exit code 2. `tailstack validate DESIGN` says the same; `tailstack schema design` is
the rule book.""",
    "invalid-input": """\
What the gate judges by, or how it was called, is not usable: a policy that breaks its rules, a waiver without an owner,
a baseline that is no record of a gate or has no numbers, a pattern that matches no file. No design was judged, and the
gate leaves with exit code 2. `tailstack schema policy` and `tailstack schema waivers` are the rule books.""",
    "not-evaluated": """\
The geometry does not determine the answer, a method was outside its range, a computation did not converge, or no
limit was judged: the design states no requirement and the policy sets no limit, or the rules that judge them are off.
Also: the gate itself broke off, was interrupted (exit code 130), was killed, lost the service that it asked, or could
not write one of its outputs: its other outputs then give no verdict either. Otherwise it leaves with exit code 3; a
design that was not judged never passes.""",
}
