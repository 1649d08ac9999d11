"""A study of coupling as text and as a figure."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from tailstack.studies.coupling import CouplingCase, Ratio, StudyCoupling, decimals_of, per_cent

from ...report.svg import BLUE, FAINT, INK, MUTED, VERMILION, box, line, printable, rounded, text
from ..tables import number, percent, table, wrapped
from ..verdict import design_line, joined, provenance_text
from .page import around, bottom_axis, page

MOST_DECIMALS = 3  # in a table; --json has all
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
    shown = _shown(study, target)
    others = len({case.target for case in study.cases}) - 1
    more = f" ({others} more with --json)" if others else ""
    confidence = percent(study.confidence, 0)
    return joined(
        _heading(study),
        wrapped(f"installation: {study.installation}") + "\n" + wrapped(f"noise: {study.noise}"),
        wrapped(
            f"P95 of the {study.error} error at {shown[0].target}{more}, mm; ratios as per cent above or below one, ± "
            f"half of the {confidence} % interval (each by itself)"
        ),
        *(_reading(name, [case for case in shown if case.reading == name]) for name in READINGS),
        wrapped(f"intervals: {study.interval_method}."),
        "\n".join(wrapped(case.sentence, first="· ", indent="  ") for case in shown),
        "\n".join(wrapped(said, first="* ", indent="  ") for said in study.conclusions),
        wrapped(f"validity of first order: {study.validity.statement}"),
        provenance_text(study.provenance),
    )


def _heading(study: StudyCoupling) -> str:
    made = study.provenance
    how = (
        f"installation error and noise together against the parts · {study.trials:,} trials of each case, seed "
        f"{study.seed} · both readings · {made.rotation_form.replace('_', ' ')} rotation · {made.triangulation} "
        f"triangulation · tailstack {made.tailstack_version}"
    )
    return design_line(made) + "\n" + wrapped(how)


def _shown(study: StudyCoupling, target: str | None) -> tuple[CouplingCase, ...]:
    if target is None:
        designed = [case for case in study.cases if case.rotation_deg is None]
        target = max(designed, key=lambda case: case.p95_together_mm).target
    return tuple(case for case in study.cases if case.target == target)


def _reading(name: str, cases: Sequence[CouplingCase]) -> str:
    return f"{name} reading: {READINGS[name]}\n\n{_quantiles(cases)}\n\n{_ratios(cases)}"


def _quantiles(cases: Sequence[CouplingCase]) -> str:
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
        "installation\nerror", "installation\nalone", "noise\nalone", "both\ntogether", "added as\nvectors",
        "first\norder", "noise rms\nnominal", "noise rms\nbiased",
    )  # fmt: skip
    return table(header, rows)


def _ratios(cases: Sequence[CouplingCase]) -> str:
    rows = []
    for case in cases:
        ratios = [which(case) for _, _, which in COMPARISONS]
        rows.append((case.installation, *(_with_half_width(ratio) for ratio in ratios)))
        rows.append(("  first order", *(_predicted(ratio) for ratio in ratios)))
    header = ("installation\nerror", *(name.replace(" over ", " over\n", 1) for name, _, _ in COMPARISONS))
    return table(header, rows)


def _with_half_width(ratio: Ratio | None) -> str:
    if ratio is None:
        return "none"
    decimals = min(decimals_of(ratio), MOST_DECIMALS)
    return f"{per_cent(ratio, decimals)[:-2]} ± {50 * (ratio.interval[1] - ratio.interval[0]):.{decimals}f}"


def _predicted(ratio: Ratio | None) -> str:
    return "" if ratio is None or ratio.first_order is None else f"{round(100 * (ratio.first_order - 1), 2) + 0.0:+.2f}"


# --- figure ---------------------------------------------------------------------------------------

LABELS, CELL, GAP, ROW, TOP = 178, 186, 16, 26, 92


def coupling_svg(study: StudyCoupling, target: str | None = None) -> str:
    """Each ratio with its interval, a row for each installation error and reading; diamonds are first order's own."""
    shown = _shown(study, target)
    bottom = TOP + ROW * len(shown)
    width = LABELS + len(COMPARISONS) * (CELL + GAP) + 10
    parts = [
        text(15, 44, printable(f"{study.provenance.design_name}; {study.error} error at {shown[0].target}", 150)),
    ]
    for row, case in enumerate(shown):
        y = TOP + ROW * (row + 0.5)
        if row % 2 == 0:
            parts.append(box(10, y - ROW / 2, width - 10, y + ROW / 2, 'fill="#f6f6f6"'))
        parts.append(text(15, y + 4, f"{case.installation}, {case.reading}"))
    for column, (name, under, which) in enumerate(COMPARISONS):
        left = LABELS + column * (CELL + GAP)
        parts += _panel(left, bottom, name, under, [which(case) for case in shown])
    note = f"dot and bar: measured, {percent(study.confidence, 0)} % interval, each by itself; diamond: first order"
    parts.append(text(15, bottom + 56, f"{note}; {study.trials:,} trials each, seed {study.seed}", colour=MUTED))
    words = " ".join(case.sentence for case in shown)
    return page("Installation error and noise: together against the parts", words, width, bottom + 70, parts)


def _panel(left: float, bottom: float, name: str, under: str, ratios: Sequence[Ratio | None]) -> list[str]:
    known = [ratio for ratio in ratios if ratio is not None]
    ends = [100 * (end - 1) for ratio in known for end in (*ratio.interval, ratio.first_order or ratio.value)]
    reach = max([0.01, *(abs(end) for end in ends)])
    scale = around([min([*ends, -0.05 * reach]), max([*ends, 0.05 * reach])], left, left + CELL)
    parts = [text(left, TOP - 24, name, weight="bold"), text(left, TOP - 10, under, colour=MUTED, size=10)]
    parts += bottom_axis(scale, TOP, bottom, "%", 45)
    parts.append(line(scale.at(0), TOP, scale.at(0), bottom, INK, 1.2))
    for row, ratio in enumerate(ratios):
        y = TOP + ROW * (row + 0.5)
        if ratio is None:
            parts.append(text(left + CELL / 2, y + 4, "no standard deviation", anchor="middle", colour=MUTED, size=10))
            continue
        low, at, high = (scale.at(100 * (end - 1)) for end in (ratio.interval[0], ratio.value, ratio.interval[1]))
        if ratio.first_order is not None:
            parts.append(_diamond(scale.at(100 * (ratio.first_order - 1)), y))
        parts.append(line(low, y, high, y, BLUE, 2.2))
        parts += [line(x, y - 4, x, y + 4, BLUE, 1.4) for x in (low, high)]
        parts.append(f'<circle cx="{rounded(at)}" cy="{rounded(y)}" r="3.4" fill="{BLUE}"/>')
    parts.append(line(left, TOP, left + CELL, TOP, FAINT))
    return parts


def _diamond(x: float, y: float) -> str:
    corners = ((x, y - 7), (x + 6, y), (x, y + 7), (x - 6, y))
    points = " ".join(f"{rounded(across)},{rounded(down)}" for across, down in corners)
    return f'<polygon points="{points}" fill="#ffffff" stroke="{VERMILION}" stroke-width="1.5"/>'
