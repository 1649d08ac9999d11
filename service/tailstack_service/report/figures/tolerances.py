"""The quantile over each half-width as small pictures on one scale: what is, what could be, where the limit is met."""

from __future__ import annotations

from collections.abc import Callable
from math import ceil, floor

from ...rendering.panels import round_step
from ...rendering.score import source_name
from ..svg import FAINT, INK, MUTED, box, line, printable, rounded, text
from .frame import LIMIT_COLOUR, VALUE_COLOUR, WIDTH, picture
from .tolerance_curves import ToleranceCurve, ToleranceCurves

COLUMNS, HEIGHT, GAP = 3, 158, 16  # of pictures; of one with its words
LEFT, PLOT_WIDTH, PLOT_TOP, PLOT_HEIGHT = 38, 188, 38, 84
CAP = 1.6  # the scale ends at so many times what the quantile is: steeper curves leave it
OTHER_COLOUR = "#7a7a7a"

Place = Callable[[float, float], tuple[float, float]]  # half-width, quantile in mm -> page


def curves_svg(
    shown: ToleranceCurves,
    name: str = "tolerances",
    other: ToleranceCurves | None = None,
    called: tuple[str, str] = ("this design", "the other"),
) -> str:
    """One small picture per source, steepest first; the dot is the design as it is.

    ``other``: the same of another design, drawn dashed where it has the same source; ``called``: what the two are.
    """
    low, high = _range(shown, other)
    others = {} if other is None else {(curve.contributor, curve.component): curve for curve in other.curves}
    parts: list[str] = []
    for k, curve in enumerate(shown.curves):
        left, top = (WIDTH // COLUMNS) * (k % COLUMNS), HEIGHT * (k // COLUMNS) + 4
        second = others.get((curve.contributor, curve.component))
        parts += _small(curve, shown, second, other, left, top, (low, high), f"{name}-{k + 1}")
    bottom = HEIGHT * ceil(len(shown.curves) / COLUMNS) + 16
    parts += _legend(shown, other, called, bottom)
    quantile, error = f"P{100 * shown.quantile:g}", _error(shown)
    title = f"{quantile} of the {error} error at target {shown.target} over each half-width"
    return picture(name, title, _words(shown), bottom + (26 if other is None else 42), parts)


def _error(shown: ToleranceCurves) -> str:
    return "TCP" if shown.error == "tcp" else "localisation"


def _range(shown: ToleranceCurves, other: ToleranceCurves | None) -> tuple[float, float]:
    both = [shown, *([] if other is None else [other])]
    values = [value for each in both for curve in each.curves for value in curve.quantile_mm]
    now = [each.quantile_mm for each in both]
    limits = [each.limit_mm for each in both if each.limit_mm is not None]
    visible = [limit for limit in limits if limit < 2 * CAP * max(now)]
    cap = max(CAP * max(now), *(1.1 * limit for limit in visible)) if visible else CAP * max(now)
    high = min(max([*values, *now, *visible]), cap)
    low = min([*values, *now, *visible])
    pad = 0.07 * max(high - low, 1e-6 * high, 1e-9)
    return max(low - pad, 0.0), high + pad


def _small(
    curve: ToleranceCurve, shown: ToleranceCurves, second: ToleranceCurve | None, other: ToleranceCurves | None,
    left: float, top: float, ends: tuple[float, float], name: str,
) -> list[str]:  # fmt: skip
    x0, y0 = left + LEFT, top + PLOT_TOP
    x1, y1 = x0 + PLOT_WIDTH, y0 + PLOT_HEIGHT
    widest = max(curve.half_widths[-1], *(second.half_widths[-1:] if second else [0.0]))

    def place(half_width: float, value: float) -> tuple[float, float]:
        up = (value - ends[0]) / (ends[1] - ends[0])
        return x0 + PLOT_WIDTH * half_width / widest, y1 - PLOT_HEIGHT * up

    colour = {"never": LIMIT_COLOUR, "always": "#176332"}.get(curve.meets, INK)
    parts = [
        text(x0 - 30, top + 12, printable(f"{source_name(curve)}", 36), weight="bold"),
        text(x0 - 30, top + 27, _met(curve, shown), colour=colour),
        box(x0, y0, x1, y1, f'fill="#ffffff" stroke="{FAINT}" stroke-width="0.7"'),
    ]
    parts += _ticks(x0, y0, x1, y1, ends, place)
    clip = f"{name}-clip"
    parts.append(
        f'<clipPath id="{clip}"><rect x="{rounded(x0)}" y="{rounded(y0)}" width="{PLOT_WIDTH}" height="{PLOT_HEIGHT}"/>'
        "</clipPath>"
    )
    drawn, crossing = [], ""
    if shown.limit_mm is not None:
        _, y = place(0.0, shown.limit_mm)
        if y0 <= y <= y1:
            drawn.append(line(x0, y, x1, y, LIMIT_COLOUR, 1.4, "5 3"))
        if curve.largest is not None:
            x, _ = place(curve.largest, shown.limit_mm)
            drawn.append(line(x, y, x, y1, LIMIT_COLOUR, 1.0, "2 2"))
            crossing = _diamond(x, y)
    if second is not None and other is not None:
        drawn.append(_path([place(x, y) for x, y in _pairs(second)], OTHER_COLOUR, ' stroke-dasharray="4 3"'))
        drawn.append(_dot(*place(second.half_width, other.quantile_mm), "#ffffff", OTHER_COLOUR))
    drawn.append(_path([place(x, y) for x, y in _pairs(curve)], VALUE_COLOUR, ""))
    drawn.append(crossing)
    drawn.append(_dot(*place(curve.half_width, shown.quantile_mm), VALUE_COLOUR, VALUE_COLOUR))
    parts += [f'<g clip-path="url(#{clip})">', *drawn, "</g>"]
    for factor in range(4):
        x = x0 + PLOT_WIDTH * factor / 3
        last = factor == 3
        words = f"{widest * factor / 3:.3g}" + (f" {curve.unit}" if last else "")
        parts += [
            line(x, y1, x, y1 + 4, FAINT),
            text(x1 + 10 if last else x, y1 + 16, words, anchor="end" if last else "middle", colour=MUTED),
        ]
    return parts


def _pairs(curve: ToleranceCurve) -> list[tuple[float, float]]:
    return list(zip(curve.half_widths, curve.quantile_mm, strict=True))


def _path(places: list[tuple[float, float]], colour: str, dashes: str) -> str:
    path = "M" + "L".join(f"{rounded(x)} {rounded(y)}" for x, y in places)
    return f'<path d="{path}" fill="none" stroke="{colour}" stroke-width="1.8"{dashes}/>'


def _dot(x: float, y: float, fill: str, stroke: str) -> str:
    return f'<circle cx="{rounded(x)}" cy="{rounded(y)}" r="3.6" fill="{fill}" stroke="{stroke}" stroke-width="1.4"/>'


def _diamond(x: float, y: float) -> str:
    """Where the limit is met."""
    corners = ((x, y - 6), (x + 6, y), (x, y + 6), (x - 6, y))
    points = " ".join(f"{rounded(across)},{rounded(down)}" for across, down in corners)
    return f'<polygon points="{points}" fill="#ffffff" stroke="{LIMIT_COLOUR}" stroke-width="1.4"/>'


def _ticks(x0: float, y0: float, x1: float, y1: float, ends: tuple[float, float], place: Place) -> list[str]:
    step = round_step(2.5 * 20 * (ends[1] - ends[0]) / (y1 - y0))
    parts = []
    for k in range(ceil(ends[0] / step), floor(ends[1] / step) + 1):
        _, y = place(0.0, step * k)
        parts.append(line(x0, y, x1, y, "#e6e6e6", 0.7))
        parts.append(text(x0 - 5, y + 4, f"{step * k:g}", anchor="end", colour=MUTED))
    return parts


def _met(curve: ToleranceCurve, shown: ToleranceCurves) -> str:
    """What it is, and how far it may go."""
    word = "σ" if curve.unit == "px" else "±"
    now = f"{word} {curve.half_width:.3g} {curve.unit}"
    if curve.meets == "no limit":
        return now
    if curve.meets == "never":
        return f"{now}; 0 does not meet the limit"
    if curve.meets == "always":
        return f"{now}; within the limit at 3 times"
    return f"{now}; limit met up to {curve.largest:.3g} {curve.unit}"


def _legend(shown: ToleranceCurves, other: ToleranceCurves | None, called: tuple[str, str], y: float) -> list[str]:
    quantile = f"P{100 * shown.quantile:g}"
    words = f"{quantile} of the {_error(shown)} error at {printable(shown.target, 30)}, mm, first order"
    parts = [line(8, y - 4, 26, y - 4, VALUE_COLOUR, 1.8), text(32, y, words)]
    x = 48 + 5.7 * len(words)
    parts += [_dot(x, y - 4, VALUE_COLOUR, VALUE_COLOUR), text(x + 9, y, f"as it is, {shown.quantile_mm:.3f} mm")]
    x += 140
    if shown.limit_mm is not None:
        parts += [line(x, y - 4, x + 18, y - 4, LIMIT_COLOUR, 1.4, "5 3")]
        parts.append(text(x + 24, y, f"limit {shown.limit_mm:g} mm", colour=LIMIT_COLOUR))
    sentence = "Across: half-width of one source, σ for image noise, the others as they are."
    if shown.left_out:
        sentence += f" {shown.left_out} more sources change less."
    parts.append(text(8, y + 17, sentence, colour=MUTED))
    if other is not None:
        names = [printable(name, 40) for name in called]
        parts.append(text(8, y + 33, f"Solid: {names[0]}; dashed, hollow dot: {names[1]}.", colour=MUTED))
    return parts


def _words(shown: ToleranceCurves) -> str:
    listed = "; ".join(
        f"{source_name(curve)} {_met(curve, shown)}, "
        f"{curve.quantile_mm[0]:.3f} mm at 0 and {curve.quantile_mm[-1]:.3f} mm at three times"
        for curve in shown.curves
    )
    limit = "" if shown.limit_mm is None else f" The limit is {shown.limit_mm:g} mm."
    return f"As it is: {shown.quantile_mm:.3f} mm.{limit} {listed}."
