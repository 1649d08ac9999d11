"""A torsor as a design states it, known part and tolerances, and what they compile to: rad, mm, laws.

Interfaces, hand-eye calibration and motion between the shots are all stated in it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import radians, sqrt
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from pydantic import Field, model_validator

from .fields import (
    BOUNDED_WORDS,
    COVERAGE_WORDS,
    AnyLaw,
    Coordinate,
    CoverageFactor,
    Degrees,
    Distribution,
    HalfWidth,
    HalfWidthDegrees,
    Record,
    leave_out_later,
    one_of,
    refusal,
    with_law,
)
from .geometry.arrays import Array, frozen
from .laws import Drawn
from .ranges import KNOWN_DEG, KNOWN_MM, SEAT_DEG, SEAT_MM, AnySize
from .system import TORSOR_COMPONENTS, Law, Sources, correlate, no_sources

DEFAULT_COVERAGE = 2.0
LEAST_EIGENVALUE = -1e-9  # of a correlation: below it is not rounding
SYMMETRIC = 1e-6  # relative to both standard deviations
HowOften = Annotated[Drawn, one_of(Drawn)]


def level_field(usual: Drawn, what: str = "this") -> Any:
    """The field that says how often something takes new values."""
    return Field(
        default=usual,
        description=f"How often {what} takes new values. unit: once per installed unit; mounting: each time that the "
        f"structure is mounted; shot: at every shot. Default {usual}.",
        examples=["mounting"],
    )


class Bias(Record):
    """A known displacement: X -> R (X - pivot) + pivot + t with R = Rx(rx) Ry(ry) Rz(rz)."""

    rx_deg: Annotated[Degrees, KNOWN_DEG] = Field(default=0.0, examples=[0.1])
    """Rotation about x, degrees."""
    ry_deg: Annotated[Degrees, KNOWN_DEG] = Field(default=0.0, examples=[0.0])
    """Rotation about y, degrees."""
    rz_deg: Annotated[Degrees, KNOWN_DEG] = Field(default=0.0, examples=[0.0])
    """Rotation about z, degrees."""
    tx_mm: Annotated[Coordinate, KNOWN_MM] = Field(default=0.0, examples=[0.0])
    """Translation along x, mm."""
    ty_mm: Annotated[Coordinate, KNOWN_MM] = Field(default=0.0, examples=[0.0])
    """Translation along y, mm."""
    tz_mm: Annotated[Coordinate, KNOWN_MM] = Field(default=0.0, examples=[0.05])
    """Translation along z, mm."""

    @property
    def torsor(self) -> Array:
        """(6,) rad, mm."""
        turns = [radians(self.rx_deg), radians(self.ry_deg), radians(self.rz_deg)]
        return frozen([*turns, self.tx_mm, self.ty_mm, self.tz_mm])


class RotationTolerance(Record):
    """Half-width of one rotation."""

    half_width_deg: Annotated[HalfWidthDegrees, SEAT_DEG] = Field(examples=[0.05])
    """Half-width h of the rotation, degrees."""
    distribution: AnyLaw = Field(description=BOUNDED_WORDS, examples=["uniform"])
    coverage_factor: CoverageFactor | None = Field(default=None, description=COVERAGE_WORDS, examples=[2.0])

    _law = with_law("half_width_deg")

    @property
    def width(self) -> float:
        """The half-width, deg."""
        return self.half_width_deg


class TranslationTolerance(Record):
    """Half-width of one translation."""

    half_width_mm: Annotated[HalfWidth, SEAT_MM] = Field(examples=[0.02])
    """Half-width h of the translation, mm."""
    distribution: AnyLaw = Field(description=BOUNDED_WORDS, examples=["uniform"])
    coverage_factor: CoverageFactor | None = Field(default=None, description=COVERAGE_WORDS, examples=[2.0])

    _law = with_law("half_width_mm")

    @property
    def width(self) -> float:
        """The half-width, mm."""
        return self.half_width_mm


Component = Literal["rx", "ry", "rz", "tx", "ty", "tz"]
_Term = Annotated[float, Field(ge=-1e5, le=1e5)]
_Row = Annotated[tuple[_Term, _Term, _Term, _Term, _Term, _Term], Field(strict=False)]
Covariance = Annotated[
    tuple[_Row, _Row, _Row, _Row, _Row, _Row],
    Field(strict=False),
    AnySize("its terms are judged together: they are a covariance, or refused"),
]


class Correlation(Record):
    """How two components go together."""

    between: Annotated[tuple[Component, Component], Field(strict=False)] = Field(examples=[["rx", "ty"]])
    """The two components, each with a tolerance of its own."""
    coefficient: Annotated[float, Field(ge=-1, le=1), AnySize("its domain is what anybody means")] = Field(
        examples=[-0.9]
    )
    """Coefficient of correlation, -1 to 1."""


class Tolerances(Record):
    """One tolerance per component of the torsor; a component that is not given does not vary."""

    rx: RotationTolerance | None = None
    """Rotation about x through the pivot."""
    ry: RotationTolerance | None = None
    """Rotation about y through the pivot."""
    rz: RotationTolerance | None = None
    """Rotation about z through the pivot."""
    tx: TranslationTolerance | None = None
    """Translation of the pivot along x."""
    ty: TranslationTolerance | None = None
    """Translation of the pivot along y."""
    tz: TranslationTolerance | None = None
    """Translation of the pivot along z."""

    correlation: Annotated[list[Correlation], Field(min_length=1, max_length=15)] | None = None
    """Components that go together, pair by pair; all of them normal. Absent: every component is independent of the
    others."""
    covariance_deg_mm: Covariance | None = Field(
        default=None, examples=[np.diag([0.0025, 0.0025, 0.0004, 0.01, 0.01, 0.0025]).tolist()]
    )
    """Instead of components: their covariance, 6 rows of 6 in the order rx, ry, rz, tx, ty, tz, in deg and mm
    (rotations deg^2, mixed terms deg mm, translations mm^2), jointly normal. A calibration's report has it. Half-widths
    are then two standard deviations."""

    _as_before = leave_out_later("correlation", "covariance_deg_mm")

    @model_validator(mode="after")
    def _go_together(self) -> Tolerances:
        if self.covariance_deg_mm is not None:
            self._check_covariance(np.array(self.covariance_deg_mm))
        elif self.correlation is not None:
            self._check_correlation(self.correlation)
        return self

    def _check_covariance(self, matrix: Array) -> None:
        at = "covariance_deg_mm"
        if given := [name for name in (*TORSOR_COMPONENTS, "correlation") if getattr(self, name) is not None]:
            detail = f"a covariance states every component; {given[0]} arrived beside it"
            raise refusal("one-of", detail, f"keep {at}, or leave it out and state components", at)
        for k, name in enumerate(TORSOR_COMPONENTS):
            if matrix[k, k] < 0:
                detail = f"the variance of {name} is {matrix[k, k]:g}: none is negative"
                raise refusal("not-a-covariance", detail, "give the covariance, not its inverse", f"{at}/{k}/{k}")
            if sqrt(matrix[k, k]) > (22.5 if k < 3 else 500):
                detail = f"the standard deviation of {name}, {sqrt(matrix[k, k]):.3g}, is beyond 22.5 deg or 500 mm"
                raise refusal("out-of-range", detail, "rotations in deg^2, not in other units", f"{at}/{k}/{k}")
        scale = _scale(matrix)
        skew = np.abs(matrix - matrix.T) / np.outer(scale, scale)
        i, j = np.unravel_index(int(skew.argmax()), skew.shape)
        if skew[i, j] > SYMMETRIC:
            first, second = TORSOR_COMPONENTS[i], TORSOR_COMPONENTS[j]
            detail = f"{first} with {second} is {matrix[i, j]:g}, {second} with {first} is {matrix[j, i]:g}"
            raise refusal("not-a-covariance", detail, "a covariance is symmetric", f"{at}/{i}/{j}")
        refuse_indefinite(matrix / np.outer(scale, scale), TORSOR_COMPONENTS, at)

    def _check_correlation(self, pairs: list[Correlation]) -> None:
        for index, pair in enumerate(pairs):
            at = f"correlation/{index}/between"
            if pair.between[0] == pair.between[1]:
                raise refusal("same-name", f"{pair.between[0]} goes with itself: 1, always", "name another", at)
            if any(set(pair.between) == set(earlier.between) for earlier in pairs[:index]):
                words = " and ".join(pair.between)
                raise refusal("duplicate-name", f"the correlation of {words} is stated twice", "keep one of them", at)
            for name in pair.between:
                if (item := getattr(self, name)) is None:
                    cure = f"state {name}, or leave out the correlation"
                    raise refusal("missing-field", f"{name} has no tolerance that could go with another", cure, at)
                if item.distribution != "normal":
                    detail = (
                        f"{name} is {item.distribution}: a coefficient says how normal components go together, and of "
                        "others their joint law is not known by it"
                    )
                    raise refusal("law-not-joint", detail, "make it normal, or leave out the correlation", at)
        refuse_indefinite(self._coefficients, TORSOR_COMPONENTS, "correlation")

    @property
    def _coefficients(self) -> Array:
        """(6, 6) coefficients of correlation, 0 beside the diagonal where none is stated."""
        if self.covariance_deg_mm is not None:
            matrix = np.array(self.covariance_deg_mm)
            matrix = (matrix + matrix.T) / 2
            scale = _scale(matrix)
            return np.asarray(matrix / np.outer(scale, scale))
        matrix = np.eye(6)
        for pair in self.correlation or ():
            i, j = map(TORSOR_COMPONENTS.index, pair.between)
            matrix[i, j] = matrix[j, i] = pair.coefficient
        return matrix

    @property
    def components(self) -> dict[str, RotationTolerance | TranslationTolerance | None]:
        """The tolerance of each component; of a covariance, normal ones of two standard deviations."""
        if self.covariance_deg_mm is None:
            return {name: getattr(self, name) for name in TORSOR_COMPONENTS}
        widths = [DEFAULT_COVERAGE * sqrt(self.covariance_deg_mm[k][k]) for k in range(6)]
        turns = [RotationTolerance(half_width_deg=width, distribution=Distribution.NORMAL) for width in widths[:3]]
        shifts = [TranslationTolerance(half_width_mm=width, distribution=Distribution.NORMAL) for width in widths[3:]]
        return dict(zip(TORSOR_COMPONENTS, [*turns, *shifts], strict=True))

    def is_correlated(self, name: str) -> bool:
        """Whether a component goes together with others."""
        return bool(np.count_nonzero(self._coefficients[TORSOR_COMPONENTS.index(name)]) > 1)

    @property
    def sources(self) -> Sources:
        """One source per declared component; its direction (6,) is that unit torsor, or, where components go together,
        as ``system.correlate`` has it."""
        sources = compile_sources(self.components)
        if self.correlation is None and self.covariance_deg_mm is None:
            return sources
        kept = [TORSOR_COMPONENTS.index(name) for name in sources.names]
        return correlate(sources, self._coefficients[np.ix_(kept, kept)])


def _scale(matrix: Array) -> Array:
    """(k,) standard deviations of a covariance, 1 for what does not vary."""
    return np.sqrt(np.where(matrix.diagonal() > 0, matrix.diagonal(), 1.0))


def refuse_indefinite(correlation: Array, names: tuple[str, ...], at: str) -> None:
    """Raises a refusal where coefficients of correlation (k, k) of these components have a negative eigenvalue."""
    values, vectors = np.linalg.eigh((correlation + correlation.T) / 2)
    if values[0] >= LEAST_EIGENVALUE:
        return
    vector = vectors[:, 0] * np.sign(vectors[np.abs(vectors[:, 0]).argmax(), 0])
    terms = " ".join(f"{x:+.2f} {name}" for name, x in zip(names, vector, strict=True) if abs(x) >= 0.005)
    detail = (
        f"no components vary like this: {terms.removeprefix('+')}, each by its standard deviation, would have the "
        f"variance {values[0]:.3g} (the eigenvalue of the correlation)"
    )
    most = np.floor(1000 / (1 - values[0])) / 1000
    cure = f"give more digits if they were rounded; beside the diagonal, {most:.3f} of each is the most that can be"
    raise refusal("not-positive-semidefinite", detail, cure, at)


class Source(NamedTuple):
    """A scalar source as a design states it, its half-width in rad, mm, N, K, px or as a part of one."""

    name: str
    law: str
    half_width: float
    coverage_factor: float | None
    unit: str
    direction: Array  # (d,)


def gather_sources(stated: Sequence[Source], dimension: int) -> Sources:
    """Independent sources that act on a vector of ``dimension`` d."""
    if not stated:
        return no_sources(dimension)
    names, laws, half_widths, factors, units, directions = zip(*stated, strict=True)
    coverage = [coverage_of(law, factor) for law, factor in zip(laws, factors, strict=True)]
    ways = frozen(np.column_stack(directions))
    return Sources(names, tuple(map(Law, laws)), frozen(half_widths), frozen(coverage), units, ways)


def compile_sources(components: Mapping[str, RotationTolerance | TranslationTolerance | None]) -> Sources:
    """One source for each of d components that has a tolerance, rad or mm; its direction (d,) is that component."""
    stated = []
    for (name, item), way in zip(components.items(), np.eye(len(components)), strict=True):
        if item is not None:
            turns = isinstance(item, RotationTolerance)
            width, unit = (radians(item.width), "rad") if turns else (item.width, "mm")
            stated.append(Source(name, item.distribution, width, item.coverage_factor, unit, way))
    return gather_sources(stated, len(components))


def coverage_of(law: str, factor: float | None) -> float:
    """Standard deviations in a half-width under a normal law, 1 under others."""
    if law != "normal":
        return 1.0
    return DEFAULT_COVERAGE if factor is None else factor


def say_law(law: str, factor: float | None) -> str:
    """A law in words, of a normal one with how many standard deviations its half-width is."""
    return f"{law}, {coverage_of(law, factor):g} standard deviations" if law == "normal" else law
