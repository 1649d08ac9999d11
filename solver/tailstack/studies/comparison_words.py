"""What a comparison says, in sentences that only its tests and intervals decide."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from math import inf, log
from typing import Literal

from ..results import Finding, Interval
from .comparison_records import Explanation, LevelCompared, SpreadCompared, TestName

MOST_LISTED = 6
NORMAL_P95 = 1.645  # standard deviations from the mean of a normal law to its P95
UNKNOWN = 100  # trials that are simulated where their number is not stated: only the prediction is shown
Verdict = Literal["agrees", "differs", "not testable"]


def verdict_of(levels: Sequence[LevelCompared]) -> Verdict:
    tests = [test for level in levels for test in level.tests]
    if not tests:
        return "not testable"
    return "differs" if any(test.differs for test in tests) else "agrees"


def said_of_test(level: LevelCompared, test: TestName, differs: bool) -> str:
    """One line on what a test found."""
    if test == "mean":
        if not differs:
            return "the mean is one of those that such a bench would give"
        if level.bias is not None:
            out = [
                f"{axis} by {_beyond(value, ends):+.3g} mm"
                for axis, value, ends in zip("xyz", level.bias.measured_mm, level.bias.predicted_range_mm, strict=True)
                if _beyond(value, ends)
            ]
            where = f": outside the predicted range in {', '.join(out)}" if out else ": no axis alone, but together"
            return f"the mean is not one that such a bench would give{where}"
        side = "above" if level.norm.measured_mm > level.norm.predicted_mm else "below"
        return f"the mean error is {side} what such a bench would give"
    if test == "tail":
        return "the largest tenth is " + ("not " if differs else "") + "as such a bench would give"
    spread = level.spread if test == "spread" else level.spread_between
    what = "the spread from trial to trial" if test == "spread" else "the spread between installations"
    if not differs:
        return f"{what} cannot be told from the prediction{_times(spread)}"
    return f"{what} is not as predicted{_times(spread)}"


def _beyond(value: float, ends: Interval) -> float:
    """How far a value is out of an interval; 0 inside."""
    return min(value - ends[0], 0.0) + max(value - ends[1], 0.0)


def _times(spread: SpreadCompared | None) -> str:
    if spread is None:
        return ""
    if spread.interval is None:
        return f": {spread.ratio:.3g} times"
    low, high = spread.interval
    return f": {spread.ratio:.3g} times ({low:.3g} .. {high:.3g})"


def findings_of(levels: Sequence[LevelCompared], same_ratio: float) -> tuple[Finding, ...]:
    """What the numbers of the file themselves give away."""
    found = []
    for level in levels:
        if level.not_tested:
            found.append(Finding("not-tested", "warning", f"level {level.level} at {level.target}: {level.not_tested}"))
        elif level.spread is not None and level.spread.measured_mm == 0:
            message = f"level {level.level} at {level.target}: all trials are alike to the last digit"
            found.append(Finding("no-spread", "warning", message))
    if any(level.trials is None for level in levels):
        message = (
            f"where the number of trials is not stated, the prediction beside it is of benches of {UNKNOWN} trials"
        )
        found.append(Finding("assumed-trials", "note", message))
    ratios = [level.ratio_to_reprojection_mm_per_px for level in levels]
    known = [ratio for ratio in ratios if ratio]
    if len(known) >= 2 and max(known) - min(known) <= same_ratio * max(known):
        message = (
            f"error over reprojection error is the same in all {len(known)} rows that have both, {known[0]:.3g} mm/px "
            f"to within {100 * same_ratio:g} %: the two columns are one quantity times a constant, and carry one "
            "degree of freedom between them"
        )
        found.append(Finding("constant-ratio", "warning", message, value=known[0]))
    return (*found, *_shapes(levels))


def _shapes(levels: Sequence[LevelCompared]) -> list[Finding]:
    """What a stated P95 says of the tail, without a number of trials."""
    shapes = [(level, level.tail_shape) for level in levels if level.tail_shape is not None]
    found = []
    for level, shape in shapes:
        if shape.standard_deviations is None:
            continue
        ours = shape.predicted_standard_deviations
        message = (
            f"level {level.level} at {level.target}: P95 stands {shape.standard_deviations:.2f} standard deviations "
            f"above the mean, where a normal law has {NORMAL_P95}"
            + ("" if ours is None else f" and benches like this one {ours:.2f}")
            + ("" if shape.standard_deviations > NORMAL_P95 else ": no heavy tail at P95")
        )
        found.append(Finding("tail-shape", "note", message, value=shape.standard_deviations))
    if len(shapes) > 1:
        listed = ", ".join(f"{shape.p95_over_mean:.4g}" for _, shape in shapes)
        grows = all(a.p95_over_mean < b.p95_over_mean for (_, a), (_, b) in pairwise(shapes))
        words = "grows from level to level" if grows else "does not grow with the level"
        found.append(Finding("tail-growth", "note", f"P95 over mean {words}: {listed}"))
    return found


def conclusions(levels: Sequence[LevelCompared], explained: Sequence[Explanation], verdict: Verdict) -> tuple[str, ...]:
    """The verdict and, where there is a difference, what alone would explain it."""
    tests = [(level, test) for level in levels for test in level.tests]
    if verdict == "not testable":
        return ("Nothing in the file can be tested against the prediction; it is only shown beside it.",)
    if verdict == "agrees":
        ratios = [level.spread for level in levels if level.tests and level.spread is not None]
        said = [f"None of {len(tests)} tests tells the measurements from the prediction (5 % for all together)."]
        known = [spread.interval for spread in ratios if spread.interval is not None]
        if known:
            low, high = min(ends[0] for ends in known), max(ends[1] for ends in known)
            said.append(
                f"That is not equality: a spread {low:.2g} to {high:.2g} times the predicted one would look the same."
            )
        return tuple(said)
    differing = [(level, test) for level, test in tests if test.differs]
    said = [f"{len(differing)} of {len(tests)} tests tell the measurements from the prediction (5 % for all together)."]
    said += [
        f"Level {level.level} at {level.target}: {test.says} (p = {test.p_value:.2g})." for level, test in differing
    ]
    for target in dict.fromkeys(one.target for one in explained):
        here = [test.test for level, test in differing if level.target == target]
        if here:
            said.append(_what_explains([one for one in explained if one.target == target], here, target))
    return tuple(said)


def _what_explains(explained: Sequence[Explanation], differing: Sequence[str], target: str) -> str:
    """Factors are held against mean and spread; a fixed value can only explain a mean."""
    factors = sorted((one for one in explained if one.kind == "factor" and one.intervals), key=_from_one)
    values = sorted((one for one in explained if one.kind == "value" and one.intervals), key=_in_half_widths)
    only_mean = set(differing) <= {"mean", "tail"}
    said = []
    if factors:
        said.append("one contributor alone, if it were this many times as large: " + _listed(factors))
    if values and only_mean:
        said.append("a fixed value of one component: " + _listed(values))
    if said:
        return f"At {target} this would explain it: {'; or '.join(said)}."
    if values and "mean" in differing:
        return (
            f"At {target} no contributor's size alone explains all of it. A fixed value of one component would explain "
            f"the mean, and not the spread: {_listed(values)}."
        )
    return f"At {target} no contributor alone explains it, of whatever size: look for several, or for a wrong datum."


def _from_one(one: Explanation) -> float:
    return abs(log((one.most_plausible or 0.0) + 1e-9))


def _in_half_widths(one: Explanation) -> float:
    return abs(one.most_plausible or 0.0) / one.declared if one.declared else inf


def _listed(explained: Sequence[Explanation]) -> str:
    parts = []
    for one in explained[:MOST_LISTED]:
        name = one.contributor if one.kind == "factor" else f"{one.contributor}.{one.component}"
        parts.append(f"{name} {interval_text(one)}" + (f" {one.unit}" if one.unit else ""))
    more = len(explained) - MOST_LISTED
    return ", ".join(parts) + (f" and {more} more" if more > 0 else "")


def interval_text(one: Explanation) -> str:
    """``0.31 (0.25 .. 0.37)``; an end of the search is not an end."""
    if one.most_plausible is None:
        return "none"
    ends = []
    for low, high in one.intervals:
        upper = "no upper end" if one.kind == "factor" and high >= one.search_end else f"{high:.3g}"
        ends.append(f"{low:.3g} .. {upper}")
    return f"{one.most_plausible:.3g} ({' or '.join(ends)})"
