"""First-order quantile of the error over each half-width, from nothing to a few times its own, the others staying."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from tailstack.budget import Line
    from tailstack.design import Design
    from tailstack.propagation.linear import LinearModel

MOST = 12  # curves: those that could change the quantile most
FACTORS = (0.0, 0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 2.0, 2.5, 3.0)
CLOSE = 1e-5  # of the limit: how well the half-width that meets it is found
STEPS = 40


@dataclass(frozen=True, slots=True)
class ToleranceCurve:
    """The quantile as one half-width changes.  ``half_width`` is sigma for image noise."""

    contributor: str  # as in the budget
    component: str
    label: str  # what people call the contributor
    unit: str
    half_width: float  # as it is
    half_widths: tuple[float, ...]
    quantile_mm: tuple[float, ...]  # at those
    # The largest half-width that meets the limit: null where even none does, or where no limit is stated or met by all
    largest: float | None
    meets: Literal["always", "up to largest", "never", "no limit"]  # within the range that was looked at


@dataclass(frozen=True, slots=True)
class ToleranceCurves:
    """Curves of one error at one target, the steepest first."""

    target: str
    error: Literal["tcp", "localisation"]
    quantile: float
    quantile_mm: float  # as it is
    limit_mm: float | None
    curves: tuple[ToleranceCurve, ...]
    left_out: int  # sources that change the quantile less


def tolerance_curves(
    design: Design,
    target: str,
    *,
    error: Literal["tcp", "localisation"] = "tcp",
    quantile: float = 0.95,
    limit_mm: float | None = None,
    most: int = MOST,
) -> ToleranceCurves:
    """First-order quantile over the half-width of each source, each by itself, 0 to 3 times what it is.

    Everything else stays, and so does the geometry: a half-width changes neither bias nor sensitivities.  Raises
    DesignError, IllPosedError; ValueError for a target that the design does not have.
    """
    from tailstack.budget import lines_of
    from tailstack.design import compile_design
    from tailstack.propagation.linear import linearise

    system = compile_design(design)
    found = next((entry for entry in system.targets if entry.name == target), None)
    if found is None:
        raise ValueError(f"the design has no target {target!r}")
    model = linearise(system, found)
    now = _quantile(model, error, quantile)
    ranked = []
    for line in _single(lines_of(model)):
        if _half_width(line) > 0:
            ends = [_scaled(model, line, factor, error, quantile) for factor in (FACTORS[0], FACTORS[-1])]
            ranked.append((ends[1] - ends[0], line))
    ranked = sorted((entry for entry in ranked if entry[0] > 1e-9), key=lambda entry: -entry[0])
    return ToleranceCurves(
        target=target,
        error=error,
        quantile=quantile,
        quantile_mm=now,
        limit_mm=limit_mm,
        curves=tuple(_curve(model, line, error, quantile, now, limit_mm) for _, line in ranked[:most]),
        left_out=max(len(ranked) - most, 0),
    )


def _single(lines: Sequence[Line]) -> list[Line]:
    """Lines that do not overlap: components, and contributors whose sources are all alike."""
    return [line for line in lines if len(line.sources) == 1 or line.block.grouped]


def _half_width(line: Line) -> float:
    return float(line.block.half_width[line.sources[0]])


def _quantile(model: LinearModel, error: str, quantile: float) -> float:
    from tailstack.contributors import error_law
    from tailstack.tail.declared import law_quantile

    return law_quantile(error_law(model, error, quantile).law, quantile).quantile_mm


def _scaled(model: LinearModel, line: Line, factor: float, error: str, quantile: float) -> float:
    """The quantile with the sources of a line ``factor`` times as wide."""
    block = line.block
    wide, std = block.half_width.copy(), block.std.copy()
    wide[list(line.sources)] *= factor
    std[list(line.sources)] *= factor
    changed = block._replace(half_width=wide, std=std)
    blocks = tuple(changed if k == line.number else other for k, other in enumerate(model.blocks))
    return _quantile(replace(model, blocks=blocks), error, quantile)


def _curve(
    model: LinearModel, line: Line, error: str, quantile: float, now: float, limit_mm: float | None
) -> ToleranceCurve:
    from tailstack.contributors import unit_for_people

    values = [now if f == 1.0 else _scaled(model, line, f, error, quantile) for f in FACTORS]
    unit, people = unit_for_people(line.block.units[line.sources[0]])
    own = _half_width(line) * people
    meets: Literal["always", "up to largest", "never", "no limit"] = "no limit"
    largest = None
    if limit_mm is not None:
        within = [value <= limit_mm for value in values]
        meets = "always" if all(within) else "up to largest" if within[0] else "never"
        if meets == "up to largest":
            k = within.index(False)
            ends = ((FACTORS[k - 1], values[k - 1]), (FACTORS[k], values[k]))
            largest = own * _crossing(model, line, error, quantile, limit_mm, *ends)
    return ToleranceCurve(
        contributor=line.block.contributor,
        component=line.component,
        label=line.block.label,
        unit=unit,
        half_width=own,
        half_widths=tuple(own * factor for factor in FACTORS),
        quantile_mm=tuple(values),
        largest=largest,
        meets=meets,
    )


def _crossing(
    model: LinearModel, line: Line, error: str, quantile: float, limit_mm: float,
    low: tuple[float, float], high: tuple[float, float],
) -> float:  # fmt: skip
    """The factor at which the quantile meets the limit, by the Illinois form of false position; from below."""
    (a, fa), (b, fb) = (low[0], low[1] - limit_mm), (high[0], high[1] - limit_mm)
    best = a
    side = 0
    for _ in range(STEPS):
        if fb - fa <= 0:
            break
        c = (a * fb - b * fa) / (fb - fa)
        fc = _scaled(model, line, c, error, quantile) - limit_mm
        if fc <= 0:
            a, fa, best = c, fc, c
            fb = fb / 2 if side == -1 else fb
            side = -1
        else:
            b, fb = c, fc
            fa = fa / 2 if side == 1 else fa
            side = 1
        if -CLOSE * limit_mm <= fc <= 0:
            break
    return best
