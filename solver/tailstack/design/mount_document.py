"""Installation and execution errors of the document: biases, tolerances, locators, compliance."""

from __future__ import annotations

from typing import Annotated

from pydantic import ConfigDict, Field, model_validator

from .fields import (
    COVERAGE_WORDS,
    LAW_WORDS,
    AnyLaw,
    Coordinate,
    CoverageFactor,
    Degrees,
    Direction,
    Force,
    HalfWidth,
    HalfWidthDegrees,
    HalfWidths,
    Name,
    Point,
    RandomLaw,
    Record,
    Rotation3,
    check_coverage,
    exactly_one,
    not_both,
    refusal,
)

_BOUNDED = LAW_WORDS + "; bounded: no law is claimed, only the worst case over +-h counts."


class RotationTolerance(Record):
    """Half-width of one rotation."""

    half_width_deg: HalfWidthDegrees = Field(description="Half-width h of the rotation, degrees.", examples=[0.05])
    distribution: AnyLaw = Field(description=_BOUNDED, examples=["uniform"])
    coverage_factor: CoverageFactor | None = Field(default=None, description=COVERAGE_WORDS, examples=[2.0])

    @model_validator(mode="after")
    def _coverage(self) -> RotationTolerance:
        check_coverage(self.distribution, self.coverage_factor)
        return self


class TranslationTolerance(Record):
    """Half-width of one translation."""

    half_width_mm: HalfWidth = Field(description="Half-width h of the translation, mm.", examples=[0.02])
    distribution: AnyLaw = Field(description=_BOUNDED, examples=["uniform"])
    coverage_factor: CoverageFactor | None = Field(default=None, description=COVERAGE_WORDS, examples=[2.0])

    @model_validator(mode="after")
    def _coverage(self) -> TranslationTolerance:
        check_coverage(self.distribution, self.coverage_factor)
        return self


class Tolerances(Record):
    """One tolerance per component of the torsor; a component that is not given does not vary."""

    rx: RotationTolerance | None = Field(default=None, description="Rotation about x through the pivot.")
    ry: RotationTolerance | None = Field(default=None, description="Rotation about y through the pivot.")
    rz: RotationTolerance | None = Field(default=None, description="Rotation about z through the pivot.")
    tx: TranslationTolerance | None = Field(default=None, description="Translation of the pivot along x.")
    ty: TranslationTolerance | None = Field(default=None, description="Translation of the pivot along y.")
    tz: TranslationTolerance | None = Field(default=None, description="Translation of the pivot along z.")


class Bias(Record):
    """A known displacement: X -> R (X - pivot) + pivot + t with R = Rx(rx) Ry(ry) Rz(rz)."""

    rx_deg: Degrees = Field(default=0.0, description="Rotation about x, degrees.", examples=[0.1])
    ry_deg: Degrees = Field(default=0.0, description="Rotation about y, degrees.", examples=[0.0])
    rz_deg: Degrees = Field(default=0.0, description="Rotation about z, degrees.", examples=[0.0])
    tx_mm: Coordinate = Field(default=0.0, description="Translation along x, mm.", examples=[0.0])
    ty_mm: Coordinate = Field(default=0.0, description="Translation along y, mm.", examples=[0.0])
    tz_mm: Coordinate = Field(default=0.0, description="Translation along z, mm.", examples=[0.05])


class Locator(Record):
    """One point contact: the seat holds the part at this point along this normal."""

    name: Name = Field(description="Name of the locator, unique in the interface.", examples=["A1"])
    position_mm: Point = Field(description="Contact point in con, mm.", examples=[[40.0, 0.0, -95.0]])
    normal: Direction = Field(
        description="Direction along which the contact constrains the part, in con; any length.",
        examples=[[0.0, 0.0, 1.0]],
    )
    half_width_mm: HalfWidth = Field(
        description="Half-width of the contact's deviation along the normal, mm.", examples=[0.01]
    )
    distribution: AnyLaw = Field(description=_BOUNDED, examples=["uniform"])
    coverage_factor: CoverageFactor | None = Field(default=None, description=COVERAGE_WORDS, examples=[2.0])

    @model_validator(mode="after")
    def _coverage(self) -> Locator:
        check_coverage(self.distribution, self.coverage_factor)
        if max(map(abs, self.normal)) < 1e-9:
            raise refusal("zero-direction", "a normal needs a direction; [0, 0, 0] arrived", at="normal")
        return self


class Interface(Record):
    """A mechanical interface: a known bias and either tolerances or six locators."""

    model_config = ConfigDict(json_schema_extra=not_both("tolerances", "locators"))

    label: Annotated[str, Field(max_length=200)] = Field(
        default="", description="What the drawing calls it.", examples=["two-dowel seat"]
    )
    pivot_mm: Point = Field(
        description="Point in con that the displacement is reduced at, mm: rotations turn about it.",
        examples=[[0.0, 0.0, -95.0]],
    )
    bias: Bias = Field(default_factory=Bias, description="Known, fixed displacement. Default none.")
    tolerances: Tolerances | None = Field(
        default=None,
        description="Half-width and law per component. Either this or locators; neither means it does not vary.",
    )
    locators: Annotated[list[Locator], Field(min_length=6, max_length=6)] | None = Field(
        default=None,
        description="Six point contacts (3-2-1). Contact i deviates by delta_i along its normal n_i, and the torsor "
        "(t, w) at the pivot p follows from n_i . (t + w x (p_i - p)) = delta_i.",
    )

    @model_validator(mode="after")
    def _one_description(self) -> Interface:
        if self.tolerances is not None and self.locators is not None:
            raise refusal(
                "one-of", "give tolerances or locators; both arrived", "the torsor follows from locators", "locators"
            )
        names = [locator.name for locator in self.locators or ()]
        for index, name in enumerate(names):
            if name in names[:index]:
                raise refusal("duplicate-name", f"two locators are called {name!r}", at=f"locators/{index}/name")
        return self


class Interfaces(Record):
    """The two interfaces of the chain; one that is absent is perfect."""

    structure_connector: Interface | None = Field(
        default=None, description="Seat of the fiducial structure on the connector (T_err1). Absent: perfect."
    )
    connector_flange: Interface | None = Field(
        default=None, description="Connector on the end-effector flange (T_err2). Absent: perfect."
    )


class HandEye(Record):
    """Error of the calibrated transform to the tool, acting in the tcp frame."""

    pivot_mm: Point = Field(
        default=(0.0, 0.0, 0.0),
        description="Reduction point in the tcp frame, mm. Default its origin.",
        examples=[[0, 0, 0]],
    )
    bias: Bias = Field(default_factory=Bias, description="Known, fixed part. Default none.")
    tolerances: Tolerances = Field(default_factory=Tolerances, description="Half-width and law per component.")


class Repeatability(Record):
    """Scatter of the robot's positioning, drawn at every shot, per axis of the tcp frame."""

    model_config = ConfigDict(json_schema_extra=exactly_one("std_mm", "half_width_mm"))

    std_mm: HalfWidth | HalfWidths | None = Field(
        default=None,
        description="Standard deviation of a normal law, mm: one number for the three axes, or [x, y, z]. Either this "
        "or half_width_mm.",
        examples=[0.02],
    )
    half_width_mm: HalfWidth | HalfWidths | None = Field(
        default=None, description="Half-width, mm: one number for the three axes, or [x, y, z].", examples=[0.05]
    )
    distribution: RandomLaw | None = Field(
        default=None, description=LAW_WORDS + ". Required with half_width_mm.", examples=["normal"]
    )
    coverage_factor: CoverageFactor | None = Field(default=None, description=COVERAGE_WORDS, examples=[3.0])

    @model_validator(mode="after")
    def _one_size(self) -> Repeatability:
        if (self.std_mm is None) == (self.half_width_mm is None):
            given = "both" if self.std_mm is not None else "neither"
            raise refusal("one-of", f"give exactly one of std_mm and half_width_mm; {given} arrived", "std_mm: 0.02")
        if self.std_mm is not None:
            for field in ("distribution", "coverage_factor"):
                if getattr(self, field) is not None:
                    raise refusal("unused-field", f"std_mm already means a normal law; {field} says more", at=field)
        elif self.distribution is None:
            raise refusal("missing-field", "half_width_mm needs a distribution", "distribution: normal")
        else:
            check_coverage(self.distribution, self.coverage_factor)
        return self


class Compliance(Record):
    """Elastic deflection of the tool under a load: d = C f, in the tcp frame."""

    matrix_mm_per_n: Rotation3 = Field(
        description="Compliance C, row by row: deflection in mm per newton, tcp frame.",
        examples=[[[0.002, 0, 0], [0, 0.002, 0], [0, 0, 0.0005]]],
    )
    load_n: Force = Field(
        default=(0.0, 0.0, 0.0),
        description="Nominal load in newtons, tcp frame. Its deflection is a known bias. Default none.",
        examples=[[0.0, 0.0, -8.0]],
    )
    load_half_width_n: HalfWidth | HalfWidths | None = Field(
        default=None,
        description="Half-width of the load about its nominal value, N: one number or [x, y, z]. Absent: it is "
        "constant.",
        examples=[2.0],
    )
    distribution: AnyLaw | None = Field(
        default=None, description=_BOUNDED + " Required with load_half_width_n.", examples=["uniform"]
    )
    coverage_factor: CoverageFactor | None = Field(default=None, description=COVERAGE_WORDS, examples=[2.0])

    @model_validator(mode="after")
    def _law(self) -> Compliance:
        if self.load_half_width_n is None:
            for field in ("distribution", "coverage_factor"):
                if getattr(self, field) is not None:
                    raise refusal("unused-field", f"{field} is read only with load_half_width_n", at=field)
        elif self.distribution is None:
            raise refusal("missing-field", "load_half_width_n needs a distribution", "distribution: uniform")
        else:
            check_coverage(self.distribution, self.coverage_factor)
        return self


class Execution(Record):
    """What happens between the navigated position and the tool."""

    repeatability: Repeatability | None = Field(
        default=None, description="Positioning scatter at every shot. Absent: none."
    )
    hand_eye: HandEye | None = Field(
        default=None, description="Hand-eye calibration error, drawn once per unit. Absent: none."
    )
    compliance: Compliance | None = Field(default=None, description="Deflection under load. Absent: rigid.")
