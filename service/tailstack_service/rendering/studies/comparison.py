"""Bench measurements against prediction, as text."""

from __future__ import annotations

from collections.abc import Sequence

from tailstack.results import ERRORS, Interval
from tailstack.results.score import source_name
from tailstack.studies.bench.compare import StudyComparison, write_interval
from tailstack.studies.bench.explain import Explanation
from tailstack.studies.bench.levels import LevelCompared, QuantilePoint

from ..page import current
from ..sentences import trust_sentence
from ..tables import number, paint, percent, table, visible, wrap
from ..verdict import design_line, findings_text, heading, join_blocks, more_text, provenance_text

TAIL_ROWS, MOST_TAILS = 6, 4
VERDICT_COLOUR = {"agrees": "pass", "differs": "fail", "not testable": "inconclusive"}


def comparison_text(study: StudyComparison) -> str:
    """Bias and spread with intervals, every test, the tail, what would explain a difference, and what all that says."""
    details = current().details
    if details:
        trust = wrap(f"validity of first order: {study.validity.statement}")
    else:
        trust = wrap(f"{trust_sentence(study.validity)}.", first="how good the prediction is: ", indent="  ")
    return join_blocks(
        _heading(study),
        "\n".join(wrap(said, first="* ", indent="  ") for said in study.conclusions),
        _means(study),
        _biases(study.levels, study.frame),
        *((_tests(study.levels), _tails(study.levels)) if details else ()),
        _factors(study.explanations),
        _values(study),
        findings_text(study.findings),
        trust,
        provenance_text(study.provenance),
        more_text(),
        paint(f"measurements and prediction: {study.verdict}", VERDICT_COLOUR[study.verdict]),
    )


def _heading(study: StudyComparison) -> str:
    made, file = study.provenance, study.file
    benches = max((level.benches for level in study.levels), default=0)
    held = f"against {benches:,} simulated benches, seed {study.seed}" if benches else "beside the prediction"
    if not current().details:
        what = f"{visible(file.name)}, {file.rows} rows, {held}: {ERRORS[study.error]}"
        return "\n".join([heading(made, what, ""), *(wrap(note, first="note: ", indent="  ") for note in file.notes)])
    how = (
        f"{visible(file.name)} (sha256 {file.sha256[:12]}): {file.rows} rows, {file.form} in {file.unit} · "
        f"{study.error} error, frame {study.frame} · {held} · {made.reading} reading · tailstack "
        f"{made.tailstack_version}"
    )
    notes = "".join("\n" + wrap(note, first="note: ", indent="  ") for note in file.notes)
    return design_line(made) + "\n" + wrap(how) + notes


def _between(interval: Interval | None, digits: int = 3) -> str:
    return "-" if interval is None else f"{number(interval[0], digits)} .. {number(interval[1], digits)}"


def _label(level: LevelCompared) -> str:
    return f"{level.level}, {level.target}"


def _means(study: StudyComparison) -> str:
    rows = []
    for level in study.levels:
        spread = level.spread
        rows.append((
            _label(level),
            ("-" if level.trials is None else str(level.trials)) + f" ({level.installations})",
            number(level.norm.measured_mm),
            _between(level.norm.interval_mm),
            number(level.norm.predicted_mm),
            _between(level.norm.predicted_range_mm),
            "-" if spread is None else number(spread.ratio, 3),
            "-" if spread is None else _between(spread.interval),
        ))  # fmt: skip
    header = (
        "level, target", "trials\n(inst.)", "mean\nmm", "interval\nmm", "predicted\nmm", "range of such\nbenches, mm",
        "spread\nratio", "interval\n",
    )  # fmt: skip
    if not current().details:
        title = "size of the error: its mean, and its spread from trial to trial over the predicted spread"
        kept = (0, 1, 2, 4, 5, 6)
        return wrap(title) + "\n" + table([header[k] for k in kept], [[row[k] for k in kept] for row in rows])
    of = {level.spread.of for level in study.levels if level.spread is not None}
    what = "root of the trace of the covariance" if of == {"vectors"} else "standard deviation of the error norm"
    title = f"mean error norm, and spread from trial to trial over the predicted one ({what}); "
    return wrap(title + f"{percent(study.confidence, 0)} % each") + "\n" + table(header, rows)


def _biases(levels: Sequence[LevelCompared], frame: str) -> str:
    rows = []
    for level in levels:
        bias = level.bias
        if bias is None:
            continue
        for k, axis in enumerate("xyz"):
            low, high = bias.predicted_range_mm[k]
            rows.append((
                _label(level) if k == 0 else "",
                axis,
                number(bias.measured_mm[k]),
                _between(bias.interval_mm[k]),
                number(bias.predicted_mm[k]),
                _between(bias.predicted_range_mm[k]),
                "" if low <= bias.measured_mm[k] <= high else "outside",
            ))  # fmt: skip
    if not rows:
        return ""
    header = (
        "level, target", "axis", "measured\nmm", "interval\nmm", "predicted\nmm", "range of such\nbenches, mm", "",
    )  # fmt: skip
    if not current().details:
        kept = (0, 1, 2, 4, 5, 6)
        text = table([header[k] for k in kept], [[row[k] for k in kept] for row in rows], left=2)
        return f"mean error along each axis, frame {frame}\n{text}"
    owner = " and ".join(dict.fromkeys(level.bias.interval_of for level in levels if level.bias is not None))
    return f"mean error vector; the interval is of the mean of {owner}\n" + table(header, rows, left=2)


def _tests(levels: Sequence[LevelCompared]) -> str:
    rows = [
        (_label(level), test.test, number(test.p_value, 2), number(test.p_adjusted, 2), "yes" if test.differs else "no")
        for level in levels
        for test in level.tests
    ]
    if not rows:
        return ""
    header = ("level, target", "test", "p", "p, all tests\ntogether", "differs")
    return table(header, rows, left=2)


def _tails(levels: Sequence[LevelCompared]) -> str:
    shown = [level for level in levels if level.quantiles]
    if not shown:
        return ""
    rows = []
    for level in shown[:MOST_TAILS]:
        points = level.quantiles[-TAIL_ROWS:]
        rows += [_tail_row(_label(level) if k == 0 else "", point) for k, point in enumerate(points)]
    header = ("level, target", "quantile\n%", "measured\nmm", "predicted\nmm", "95 % of benches\nmm", "")
    more = f" ({len(shown) - MOST_TAILS} more with --json)" if len(shown) > MOST_TAILS else ""
    title = (
        f"largest errors against the same places in simulated benches{more}; neighbours move together, so the test "
        "called tail is what judges"
    )
    return wrap(title) + "\n" + table(header, rows)


def _tail_row(label: str, point: QuantilePoint) -> tuple[str, ...]:
    return (
        label,
        f"{100 * point.probability:.1f}",
        number(point.measured_mm),
        number(point.predicted_mm),
        _between(point.envelope_mm),
        "outside" if point.outside else "",
    )


def _factors(explained: Sequence[Explanation]) -> str:
    chosen = [one for one in explained if one.kind == "factor"]
    if not chosen:
        return ""
    several = len({one.target for one in chosen}) > 1
    rows = [
        ((f"{one.target}: " if several else "") + source_name(one), write_interval(one), one.explains) for one in chosen
    ]
    header = ("contributor", "plausible factor", "held against")
    return (
        wrap("one contributor alone: how many times its declared size is plausible (95 %), all else as declared")
        + "\n"
        + table(header, rows)
    )


def _values(study: StudyComparison) -> str:
    """Fixed values of components, where a mean differs."""
    wanted = {level.target for level in study.levels if any(t.differs and t.test == "mean" for t in level.tests)}
    chosen = [one for one in study.explanations if one.kind == "value" and one.target in wanted]
    if not chosen:
        return ""
    several = len(wanted) > 1
    rows = [
        (
            (f"{one.target}: " if several else "") + source_name(one),
            write_interval(one) + (f" {one.unit}" if one.intervals else ""),
            "-" if one.declared is None else f"{number(one.declared, 3)} {one.unit}",
            "-" if not one.declared or one.most_plausible is None else f"{abs(one.most_plausible) / one.declared:.1f}",
        )
        for one in chosen
    ]
    header = ("component", "plausible value", "declared\nhalf-width", "half-\nwidths")
    return "one component alone, at a fixed value that explains the mean (95 %)\n" + table(header, rows)
