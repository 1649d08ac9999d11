"""A sweep as a figure: curves over one axis, a curve for each value of the other, or a map where those are many."""

from __future__ import annotations

from collections.abc import Sequence
from math import isclose

from tailstack.errors import Problem
from tailstack.results.sweep import Sweep, SweepAxis, SweepPoint

from ..problems import RequestError
from ..report.svg import FAINT, INK, MUTED, box, line, printable, text
from .studies.chart import COLOURS, Curve, Mark, drawn, fitted, mark
from .studies.page import page
from .tables import number

WIDTH, LEFT, RIGHT, TOP, BOTTOM = 900.0, 70.0, 660.0, 120.0, 370.0
MOST_CURVES = 6
MOST_CELLS = 40  # of a map, along each axis
PALE, DARK = (228, 239, 248), (0, 62, 107)
Key = tuple[float, ...]


def refuse_undrawable(axes: Sequence[Sequence[float]]) -> None:
    """Before the work: values of every axis of a sweep that no figure can show.  Raises RequestError."""
    wide = [values for values in axes if len(set(values)) > 1]
    if len(wide) not in (1, 2) or any(len(set(values)) < len(values) for values in axes):
        detail = f"a figure shows one or two axes of several different values; this sweep has {len(wide)}"
        raise RequestError(Problem("", "no-figure", detail, "take fewer axes, or --csv for a program that draws"))
    longest = max(map(len, wide))
    if min(map(len, wide)) > MOST_CURVES and len(wide) == 2 and longest > MOST_CELLS:
        detail = f"a map has at most {MOST_CELLS} values along an axis; this sweep has {longest}"
        raise RequestError(Problem("", "no-figure", detail, "take fewer values, or --csv for a program that draws"))


def sweep_svg(sweep: Sweep) -> str:
    """P95 of the TCP error over one axis of several values, or two.  Raises RequestError for more, or for none."""
    refuse_undrawable([axis.values for axis in sweep.axes])
    if not any(point.targets for point in sweep.points):
        raise RequestError(Problem("", "no-figure", "every point was refused: there is nothing to draw"))
    wide = [place for place, axis in enumerate(sweep.axes) if len(axis.values) > 1]
    if len(wide) == 2 and min(len(sweep.axes[place].values) for place in wide) > MOST_CURVES:
        return _map(sweep, wide[0], wide[1])
    return _curves(sweep, wide)


def _name(axis: SweepAxis) -> str:
    return printable(axis.pointer + (f", {axis.unit}" if axis.unit else ""), 100)


def _curves(sweep: Sweep, wide: Sequence[int]) -> str:
    """Targets are curves where one axis varies; where two do, the values of the shorter one, at the worst target."""
    along = max(wide, key=lambda place: (len(sweep.axes[place].values), place))
    other = next((place for place in wide if place != along), None)
    chosen: dict[str, list[tuple[float, SweepPoint]]] = {}
    for point in sweep.points:
        x = point.values[along]
        if other is not None:
            unit = f" {sweep.axes[other].unit}" if sweep.axes[other].unit else ""
            chosen.setdefault(f"{point.values[other]:g}{unit}", []).append((x, point))
    shown = "" if other is None else f"; curves: {_name(sweep.axes[other])}; the target with the largest P95"
    if other is None:
        worst: dict[str, float] = {}
        for point in sweep.points:
            for target in point.targets:
                worst[target.name] = max(worst.get(target.name, 0.0), target.p95_mm)
        names = sorted(worst, key=lambda name: -worst[name])[:MOST_CURVES]
        if len(worst) > len(names):
            shown = f"; the {len(names)} of {len(worst)} targets with the largest P95"
        chosen = {name: [(point.values[along], point) for point in sweep.points] for name in names}
    curves: list[Curve] = []
    for k, (name, points) in enumerate(chosen.items()):
        curves += _curve(name, sorted(points, key=lambda pair: pair[0]), COLOURS[k % len(COLOURS)], other is None)
    axes = fitted(curves, LEFT, RIGHT, TOP, BOTTOM)
    refused = sum(not point.targets for point in sweep.points)
    if refused:
        shown += f"; {refused} of {len(sweep.points)} points were refused and are not drawn"
    parts = drawn(axes, curves, "P95 of the error at the tool", _name(sweep.axes[along]), "P95, mm") + _legend(sweep)
    base = sweep.axes[along].base
    if base is not None and axes.x.low <= base <= axes.x.high:
        x = axes.x.at(base)
        parts.append(line(x, TOP, x, BOTTOM, FAINT, 1.0, "4 3"))
        parts.append(text(x + 4, TOP + 11, "as designed", colour=MUTED))
    words = "; ".join(
        f"{curve.name}: {curve.points[0][1]:.4g} mm at {curve.points[0][0]:g}, {curve.points[-1][1]:.4g} mm at "
        f"{curve.points[-1][0]:g}"
        for curve in curves
        if curve.name
    )
    title = f"Sweep: {printable(sweep.provenance.design_name, 80)}"
    return page(
        title, f"P95 over {_name(sweep.axes[along])}{shown}. {words}.", WIDTH, BOTTOM + 50, [*parts, _how(sweep, shown)]
    )


def _how(sweep: Sweep, shown: str) -> str:
    how = "first order" if sweep.check == "score" else f"Monte Carlo, seed {sweep.seed}; bars: intervals"
    return text(15, 46, printable(how + shown, 140), colour=MUTED)


def _legend(sweep: Sweep) -> list[str]:
    if not any(point.verdict == "fail" for point in sweep.points):
        return []
    return [mark("ring", 22, 62, INK), text(32, 66, "the design fails a requirement there", colour=MUTED)]


def _curve(name: str, points: list[tuple[float, SweepPoint]], colour: str, by_target: bool) -> list[Curve]:
    found, errors, failing = [], [], []
    for x, point in points:
        targets = [target for target in point.targets if target.name == name] if by_target else list(point.targets)
        if not targets:
            continue  # refused: a gap
        target = max(targets, key=lambda one: one.p95_mm)
        found.append((x, target.p95_mm))
        low, high = target.p95_interval_mm or (target.p95_mm, target.p95_mm)
        errors.append((high - low) / 2)
        if point.verdict == "fail":
            failing.append((x, target.p95_mm))
    if not found:
        return []
    bars = errors if any(error > 0 for error in errors) else None
    shape: Mark = "disc"
    curves = [Curve(name, found, colour, mark=shape, errors=bars)]
    return [*curves, Curve("", failing, colour, joined=False, mark="ring")] if failing else curves


def _map(sweep: Sweep, down: int, across: int) -> str:
    """Cells coloured by P95 of the worst target."""
    columns, rows = sweep.axes[across].values, sweep.axes[down].values
    found: dict[Key, SweepPoint] = {(point.values[down], point.values[across]): point for point in sweep.points}
    values = [max(one.p95_mm for one in point.targets) for point in found.values() if point.targets]
    low, high = min(values), max(values)
    wide, tall = (RIGHT + 120 - LEFT) / len(columns), max(300 / len(rows), 14.0)
    bottom = TOP + tall * len(rows)
    parts = []
    for j, row in enumerate(sorted(rows)):
        y = bottom - (j + 1) * tall
        parts.append(text(LEFT - 6, y + tall / 2 + 4, f"{row:.4g}", anchor="end", colour=MUTED))
        for k, column in enumerate(sorted(columns)):
            point = found[row, column]
            x = LEFT + k * wide
            if not point.targets:
                parts.append(box(x, y, x + wide - 1, y + tall - 1, f'fill="#ffffff" stroke="{FAINT}"'))
                continue
            value = max(one.p95_mm for one in point.targets)
            share = 0.0 if isclose(high, low) else (value - low) / (high - low)
            colour = "#" + "".join(f"{round(a + share * (b - a)):02x}" for a, b in zip(PALE, DARK, strict=True))
            parts.append(box(x, y, x + wide - 1, y + tall - 1, f'fill="{colour}"'))
            if wide >= 40 and tall >= 14:
                ink = "#ffffff" if share > 0.45 else INK
                parts.append(text(x + wide / 2, y + tall / 2 + 4, number(value, 3), anchor="middle", colour=ink))
    for k, column in enumerate(sorted(columns)):
        if k % max(len(columns) // 12, 1) == 0:
            parts.append(text(LEFT + (k + 0.5) * wide, bottom + 16, f"{column:.4g}", anchor="middle", colour=MUTED))
    parts.append(text((LEFT + RIGHT) / 2, bottom + 34, _name(sweep.axes[across]), anchor="middle", colour=MUTED))
    parts.append(text(15, TOP - 12, f"up: {_name(sweep.axes[down])}", colour=MUTED))
    parts.append(
        text(15, TOP - 28, "P95 of the error at the tool, mm, at the target where it is largest", weight="bold")
    )
    title = f"Sweep: {printable(sweep.provenance.design_name, 80)}"
    words = f"P95 from {low:.4g} to {high:.4g} mm over {_name(sweep.axes[down])} and {_name(sweep.axes[across])}."
    return page(title, words, WIDTH, bottom + 50, [*parts, _how(sweep, "; empty: refused")])
