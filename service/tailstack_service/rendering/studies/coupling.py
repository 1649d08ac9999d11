"""A study of coupling as text."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from tailstack.results import ERRORS
from tailstack.studies.coupling import CouplingCase, Ratio, StudyCoupling, choose_decimals, write_percent

from ..page import current
from ..tables import number, percent, table, wrap
from ..verdict import design_line, heading, join_blocks, more_text, provenance_text

MOST_DECIMALS = 3  # in a table; --json has all
WHAT = "Do installation error and image noise together make more error than each by itself lets expect?"
SHORT = 5  # columns of the table of P95 without details
READINGS = {
    "physical": "the structure really moves, and its images with it",
    "eq18": "the coordinates told to the estimator move, the images do not",
}
Which = Callable[[CouplingCase], Ratio | None]  # None: of what there is none
COMPARISONS: tuple[tuple[str, str, Which], ...] = (
    ("noise gain", "biased over nominal geometry", lambda case: case.gain),
    ("P95 over quadrature", "root of the sum of squares of the parts", lambda case: case.against_quadrature),
    ("P95 over plain sum", "sum of both P95", lambda case: case.against_sum),
    ("P95 over vector sum", "parts added as vectors, trial by trial", lambda case: case.against_vector_sum),
    ("P95 over first order", "law of |bias + noise|", lambda case: case.against_first_order),
)


def coupling_text(study: StudyCoupling, target: str | None = None) -> str:
    """P95 of the parts and together, every ratio with its interval, and what they say.

    ``target``: whose cases are shown; by default the one with the largest P95 as designed.
    """
    shown = cases_of(study, target)
    others = len({case.target for case in study.cases}) - 1
    more = f" ({others} more with --json)" if others else ""
    confidence = percent(study.confidence, 0)
    if not current().details:
        return join_blocks(
            heading(study.provenance, WHAT, ""),
            "\n".join(wrap(said, first="* ", indent="  ") for said in study.conclusions),
            wrap(f"installation: {study.installation}") + "\n" + wrap(f"noise: {study.noise}"),
            wrap(f"P95 of {ERRORS[study.error]} at {shown[0].target}{more}, mm"),
            *(
                f"{wrap(READINGS[name])}\n\n{_quantiles([case for case in shown if case.reading == name], SHORT)}"
                for name in READINGS
            ),
            provenance_text(study.provenance),
            more_text(),
        )
    return join_blocks(
        _heading(study),
        wrap(f"installation: {study.installation}") + "\n" + wrap(f"noise: {study.noise}"),
        wrap(
            f"P95 of the {study.error} error at {shown[0].target}{more}, mm; ratios as per cent above or below one, ± "
            f"half of the {confidence} % interval (each by itself)"
        ),
        *(_reading(name, [case for case in shown if case.reading == name]) for name in READINGS),
        wrap(f"intervals: {study.interval_method}."),
        "\n".join(wrap(case.sentence, first="· ", indent="  ") for case in shown),
        "\n".join(wrap(said, first="* ", indent="  ") for said in study.conclusions),
        wrap(f"validity of first order: {study.validity.statement}"),
        provenance_text(study.provenance),
    )


def _heading(study: StudyCoupling) -> str:
    made = study.provenance
    how = (
        f"installation error and noise together against the parts · {study.trials:,} trials of each case, seed "
        f"{study.seed} · both readings · {made.rotation_form.replace('_', ' ')} rotation · {made.triangulation} "
        f"triangulation · tailstack {made.tailstack_version}"
    )
    return design_line(made) + "\n" + wrap(how)


def cases_of(study: StudyCoupling, target: str | None) -> tuple[CouplingCase, ...]:
    """Those at a target; by default the one with the largest P95 as designed."""
    if target is None:
        designed = [case for case in study.cases if case.rotation_deg is None]
        target = max(designed, key=lambda case: case.p95_together_mm).target
    return tuple(case for case in study.cases if case.target == target)


def _reading(name: str, cases: Sequence[CouplingCase]) -> str:
    return f"{name} reading: {READINGS[name]}\n\n{_quantiles(cases)}\n\n{_ratios(cases)}"


def _quantiles(cases: Sequence[CouplingCase], kept: int | None = None) -> str:
    rows = [
        (
            case.installation,
            *(
                "none" if value is None else number(value)
                for value in (
                    case.p95_installation_mm, case.p95_noise_mm, case.p95_together_mm, case.p95_vector_sum_mm,
                    case.p95_first_order_mm, case.noise_rms_nominal_mm, case.noise_rms_biased_mm,
                )
            ),
        )
        for case in cases
    ]  # fmt: skip
    header = (
        "installation\nerror", "installation\nalone", "noise\nalone", "both\ntogether", "added shot\nby shot",
        "first\norder", "noise rms\nnominal", "noise rms\nbiased",
    )  # fmt: skip
    return table(header[:kept], [row[:kept] for row in rows])


def _ratios(cases: Sequence[CouplingCase]) -> str:
    rows = []
    for case in cases:
        ratios = [which(case) for _, _, which in COMPARISONS]
        rows.append((case.installation, *(_with_half_width(ratio) for ratio in ratios)))
        rows.append(("  first order", *(_format_prediction(ratio) for ratio in ratios)))
    header = ("installation\nerror", *(name.replace(" over ", " over\n", 1) for name, _, _ in COMPARISONS))
    return table(header, rows)


def _with_half_width(ratio: Ratio | None) -> str:
    if ratio is None:
        return "none"
    decimals = min(choose_decimals(ratio), MOST_DECIMALS)
    return f"{write_percent(ratio, decimals)[:-2]} ± {50 * (ratio.interval[1] - ratio.interval[0]):.{decimals}f}"


def _format_prediction(ratio: Ratio | None) -> str:
    return "" if ratio is None or ratio.first_order is None else f"{round(100 * (ratio.first_order - 1), 2) + 0.0:+.2f}"
