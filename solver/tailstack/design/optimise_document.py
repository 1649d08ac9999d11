"""The ``optimise`` section of the document: what may change, what must be kept, what is asked for.

Where fiducials may go, may not go and how they repeat is said by shapes in con, keep-out zones and symmetries.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Discriminator, Field, Tag, model_validator

from ..fields import (
    Direction,
    Distance,
    HalfWidth,
    HalfWidthDegrees,
    Length,
    Name,
    Point,
    Record,
    Transform,
    exactly_one,
    leave_out_later,
    only_one,
    refusal,
)
from ..ranges import (
    CONE_DEG,
    COUNT,
    DISTANCE_PX,
    EXTENT_MM,
    LIMIT_MM,
    MONEY,
    MOVE_MM,
    SEAT_DEG,
    SEAT_MM,
    SPACING_MM,
    TARGET_MM,
    AnySize,
    Meant,
)
from ..system import ROTATIONS

InterfaceName = Literal["structure_connector", "connector_flange"]
FREE_DEG = replace(SEAT_DEG, what="half-width that is free", most=5.0, high="wider than anybody leaves a seat")
FREE_MM = replace(SEAT_MM, what="half-width that is free", most=5.0, high="wider than anybody leaves a seat")
WIDTH_DEG = AnySize("a sector of any width below a full turn is one", "deg")
REACH_MM = Meant(
    "source to isocentre, where it is free",
    "mm",
    200.0,
    "nearer than any C-arm that can be moved (530 to 810 mm)",
    3000.0,
    "further than any C-arm",
    "length-too-small",
    "length-too-large",
)
_Weight = Annotated[float, Field(gt=0, le=1e9), MONEY]
_Degrees = Annotated[float, Field(ge=1e-4, le=10), FREE_DEG]
_Millimetres = Annotated[float, Field(ge=1e-5, le=100), FREE_MM]
_Spacing = Annotated[float, Field(ge=0, le=1e4), DISTANCE_PX]
ToleranceGrade = Literal["IT5", "IT6", "IT7", "IT8", "IT9", "IT10", "IT11"]
Price = Annotated[float, Field(ge=0, le=1e9), MONEY]
_Count = Annotated[int, Field(ge=6, le=1000), COUNT]


class Count(Record):
    """How many fiducials the structure may have."""

    min: _Count = Field(examples=[8])
    """Fewest fiducials, fixed ones included; at least 6."""
    max: _Count = Field(examples=[16])
    """Most fiducials, fixed ones included."""
    cost_per_fiducial: Price = Field(default=0.0, examples=[20.0])
    """Added to the cost for each fiducial. Default 0."""

    @model_validator(mode="after")
    def _check_order(self) -> Count:
        if self.min > self.max:
            raise refusal("out-of-range", f"min {self.min} is above max {self.max}", at="min")
        return self


class Survive(Record):
    """What holds when fiducials are lost."""

    lost: Literal[1, 2] = Field(examples=[1])
    """So many fiducials may be lost in all views, whichever."""
    limit_mm: Annotated[Length, LIMIT_MM] = Field(examples=[0.5])
    """P95 of the error at the tool stays within this then, at every target that a requirement names, mm."""


class Stay(Record):
    """What speaks against moving a fiducial from where it is."""

    model_config, _one_way = exactly_one("cost_per_mm", "at_most_mm", needed="at_most_mm: 10")

    cost_per_mm: _Weight | None = Field(default=None, examples=[2.0])
    """Price of each mm that a free fiducial is away from its place, in the unit of the cost; objective: cost, with
    bounds and curves."""
    at_most_mm: Annotated[float, Field(ge=0.01, le=1e4), MOVE_MM] | None = Field(default=None, examples=[10.0])
    """No free fiducial moves further than that, mm. Any objective."""


_Reach = Annotated[tuple[Distance, Distance], Field(strict=False), REACH_MM]


def _check_reach(record: Any) -> Any:
    """Raises a refusal of two distances that are not in order."""
    low, high = record.source_isocentre_mm or (0.0, 0.0)
    if low > high:
        raise refusal("out-of-range", f"the smallest, {low:g}, is above {high:g}", at="source_isocentre_mm")
    return record


class FreeView(Record):
    """A view whose beam may turn, or whose source may come nearer or go further."""

    view: Name = Field(examples=["LAT"])
    """Name of the view: one that is aimed, by a preset or by distances."""
    cone_deg: Annotated[float, Field(ge=0, le=90), CONE_DEG] = Field(default=0.0, examples=[30.0])
    """How far its beam may turn about isocentre_mm from where it is, deg; the image turns with it. Default 0."""
    source_isocentre_mm: _Reach | None = Field(default=None, examples=[[600.0, 800.0]])
    """Smallest and largest distance from its source to isocentre_mm, mm; that to the detector stays. Default: as it is.
    """

    @model_validator(mode="after")
    def _check_freedom(self) -> FreeView:
        if self.cone_deg == 0 and self.source_isocentre_mm is None:
            raise refusal("nothing-free", "give cone_deg above zero, source_isocentre_mm or both", "cone_deg: 30")
        return self

    _in_order = model_validator(mode="after")(_check_reach)


class AddedView(Record):
    """A view that the design does not have: it is added where it saves more than its price."""

    add: Name = Field(examples=["OBL"])
    """Name of the new view; no view of the design has it."""
    like: Name = Field(examples=["AP"])
    """The aimed view that it is a copy of, isocentre, detector, noise and all, but for its direction."""
    price: Price = Field(examples=[300.0])
    """What it costs, in the unit of what is minimised. It is added where it saves more than that, or where no design
    keeps the limits without it."""
    cone_deg: Annotated[float, Field(gt=0, le=90), CONE_DEG] = Field(default=90.0, examples=[60.0])
    """How far its beam may be turned from that of `like` about isocentre_mm, deg; the image turns with it. Default 90:
    half of all directions, and the others are nearly the same from behind."""
    source_isocentre_mm: _Reach | None = Field(default=None, examples=[[600.0, 800.0]])
    """Smallest and largest distance from its source to isocentre_mm, mm. Default: that of `like`."""

    _in_order = model_validator(mode="after")(_check_reach)


FREE_VIEW_KINDS: dict[str, type[Record]] = {"<view>": FreeView, "<add>": AddedView}


def _free_view_kind(value: Any) -> str:
    adds = any(field in value for field in ("add", "like", "price")) if isinstance(value, dict) else False
    return "<add>" if adds or isinstance(value, AddedView) else "<view>"


_FreeViewEntry = Annotated[
    Annotated[FreeView, Tag("<view>")] | Annotated[AddedView, Tag("<add>")], Discriminator(_free_view_kind)
]


class CostCurve(Record):
    """What a half-width h costs; falling with h."""

    curve: Literal["reciprocal", "reciprocal_square", "exponential"] = Field(
        default="reciprocal", examples=["reciprocal_square"]
    )
    """reciprocal: weight / h. reciprocal_square: weight / h^2. exponential: weight exp(-h / scale). h in radians for
    rotations, mm for translations and locators. Default reciprocal."""
    weight: _Weight = Field(default=1.0, examples=[1.0])
    """Weight of the curve. Default 1."""
    scale_deg: _Degrees | None = Field(default=None, examples=[0.1])
    """exponential, rotations: widening by this divides the cost by e."""
    scale_mm: _Millimetres | None = Field(default=None, examples=[0.02])
    """exponential, translations and locators: the same in mm."""

    @model_validator(mode="after")
    def _scale(self) -> CostCurve:
        given = [name for name in ("scale_deg", "scale_mm") if getattr(self, name) is not None]
        if self.curve == "exponential" and len(given) != 1:
            raise refusal("missing-field", "exponential needs scale_deg (rotations) or scale_mm", "scale_deg: 0.1")
        if self.curve != "exponential" and given:
            raise refusal("unused-field", f"{given[0]} is read only with curve: exponential", at=given[0])
        return self


class Grade(Record):
    """One process, or one value of a drawing, and what it costs."""

    name: Name | None = Field(default=None, examples=["ground, IT5"])
    """Name of the process grade, unique in its table. Default, of a value of a drawing, that value."""
    half_width_deg: Annotated[HalfWidthDegrees, SEAT_DEG] | None = Field(default=None, examples=[0.05])
    """Half-width it holds, degrees (rotations)."""
    half_width_mm: Annotated[HalfWidth, SEAT_MM] | None = Field(default=None, examples=[0.01])
    """Half-width it holds, mm (translations and locators)."""
    fit: Annotated[str, Field(max_length=20)] | None = Field(default=None, examples=["H7/f7"])
    """Fit of ISO 286 of the feature of a drawing."""
    zone_mm: Annotated[float, Field(gt=0, le=10), SEAT_MM] | None = Field(default=None, examples=[0.05])
    """Flatness, parallelism, position or profile of the feature of a drawing, mm."""
    price: Price | None = Field(default=None, examples=[120.0])
    """What it costs. Default, of a value of a drawing, what grade_prices say."""

    @property
    def drawn_value(self) -> str | float | None:
        """The value of a drawing."""
        return self.fit if self.fit is not None else self.zone_mm

    @property
    def label(self) -> str:
        """Its name, or what is drawn."""
        return self.name or (f"{self.drawn_value:g}" if isinstance(self.drawn_value, float) else self.drawn_value or "")

    _one_value = only_one("half_width_deg", "half_width_mm", "fit", "zone_mm", needed="half_width_mm: 0.01")

    @model_validator(mode="after")
    def _complete(self) -> Grade:
        if self.drawn_value is None and not (self.half_width_deg or self.half_width_mm):
            raise refusal("out-of-range", "a grade holds a half-width above zero; 0 arrived")
        if self.drawn_value is None and (self.price is None or self.name is None):
            raise refusal("missing-field", "a process grade has a name and a price")
        return self


class RotationBounds(Record):
    """Bounds and cost of a free rotational half-width."""

    min_deg: _Degrees = Field(examples=[0.01])
    """Smallest half-width the shop can hold, degrees."""
    max_deg: _Degrees = Field(examples=[0.5])
    """Largest half-width worth having, degrees."""
    cost_weight: _Weight = Field(default=1.0, examples=[1.0])
    """c of the cost c / half-width in radians. Default 1."""
    cost: CostCurve | None = None
    """Another cost curve, instead of cost_weight."""

    @model_validator(mode="after")
    def _check(self) -> RotationBounds:
        _check_bounds(self, "deg")
        return self


class TranslationBounds(Record):
    """Bounds and cost of a free translational half-width."""

    min_mm: _Millimetres = Field(examples=[0.005])
    """Smallest half-width the shop can hold, mm."""
    max_mm: _Millimetres = Field(examples=[0.2])
    """Largest half-width worth having, mm."""
    cost_weight: _Weight = Field(default=1.0, examples=[1.0])
    """c of the cost c / half-width in mm. Default 1."""
    cost: CostCurve | None = None
    """Another cost curve, instead of cost_weight."""

    @model_validator(mode="after")
    def _check(self) -> TranslationBounds:
        _check_bounds(self, "mm")
        return self


class FreeTolerance(Record):
    """One half-width that the optimiser may set, between bounds or from a table of grades."""

    interface: InterfaceName = Field(examples=["structure_connector"])
    """Which interface."""
    component: Name = Field(examples=["rz"])
    """rx, ry, rz (rotations), tx, ty, tz (translations), the name of a locator, or what a feature states, by the name
    of its line in the budget: face flatness, pin 1 fit."""
    also: Annotated[list[Name], Field(max_length=11)] = Field(default=[], examples=[["pin 2 fit"]])
    """More that features of this interface state, made alike: they get the same value, for one price."""
    min_deg: _Degrees | None = Field(default=None, examples=[0.01])
    """Rotation: smallest half-width."""
    max_deg: _Degrees | None = Field(default=None, examples=[0.5])
    """Rotation: largest half-width."""
    min_mm: _Millimetres | None = Field(default=None, examples=[0.005])
    """Translation or locator: smallest half-width."""
    max_mm: _Millimetres | None = Field(default=None, examples=[0.2])
    """Translation or locator: largest half-width."""
    cost_weight: _Weight = Field(default=1.0, examples=[1.0])
    """c of the cost c / half-width (rad or mm). Default 1."""
    cost: CostCurve | None = None
    """Another cost curve, instead of cost_weight."""
    grades: Annotated[list[Grade], Field(min_length=1, max_length=40)] | None = None
    """Process grades to choose from, instead of bounds and a curve; for every free tolerance, with objective: cost
    only."""

    _as_before = leave_out_later("also")

    @property
    def unit(self) -> Literal["deg", "mm"]:
        """What its half-width is given in."""
        return "deg" if self.component in ROTATIONS else "mm"

    @model_validator(mode="after")
    def _complete(self) -> FreeTolerance:
        unit, other = ("deg", "mm") if self.unit == "deg" else ("mm", "deg")
        for field in (f"min_{other}", f"max_{other}"):
            if getattr(self, field) is not None:
                raise refusal("unused-field", f"{self.component} is in {unit}; {field} does not apply", at=field)
        bounds = [getattr(self, f"{end}_{unit}") for end in ("min", "max")]
        if self.grades is not None:
            self._check_grades(bounds, unit)
        elif None in bounds:
            raise refusal("missing-field", f"give min_{unit} and max_{unit}, or grades")
        _check_bounds(self, unit)
        return self

    def _check_grades(self, bounds: list[float | None], unit: str) -> None:
        if any(bound is not None for bound in bounds) or self.cost is not None:
            raise refusal("one-of", "give grades, or bounds with a cost curve; both arrived", at="grades")
        grades = self.grades or []
        names, drawn = [grade.label for grade in grades], all(grade.drawn_value is not None for grade in grades)
        for index, grade in enumerate(grades):
            if not drawn and getattr(grade, f"half_width_{unit}") is None:
                at = f"grades/{index}"
                raise refusal("missing-field", f"{self.component} needs half_width_{unit} in each grade", at=at)
            if grade.label in names[:index]:
                at = f"grades/{index}{'/name' if grade.name else ''}"
                raise refusal("duplicate-name", f"two grades are called {grade.label!r}", at=at)


def _check_bounds(record: RotationBounds | TranslationBounds | FreeTolerance, unit: str) -> None:
    """Raises a refusal of bounds that are not in order, of two costs, and of a cost curve in the other unit."""
    low, high = (getattr(record, f"{end}_{unit}") for end in ("min", "max"))
    if low is not None and low > high:
        raise refusal("out-of-range", f"min_{unit} {low} is above max_{unit} {high}", at=f"min_{unit}")
    if record.cost is None:
        return
    if "cost_weight" in record.model_fields_set:
        raise refusal("one-of", "give cost_weight or cost; both arrived", at="cost_weight")
    wrong = {"deg": "scale_mm", "mm": "scale_deg"}[unit]
    if getattr(record.cost, wrong) is not None:
        raise refusal("unused-field", f"this half-width is in {unit}: give scale_{unit}", at=f"cost/{wrong}")


class FreePivot(Record):
    """A pivot that may move: where the seat's rotations turn about."""

    interface: InterfaceName = Field(examples=["connector_flange"])
    """Which interface; it declares tolerances, not locators."""
    box: SearchBox
    """Where its pivot may be."""


class Front(Record):
    """Limits at which the least cost is found."""

    points: Annotated[int, Field(ge=2, le=50), COUNT] = Field(default=9, examples=[9])
    """Points. Default 9."""
    min_limit_mm: Annotated[Length, LIMIT_MM] | None = Field(default=None, examples=[0.6])
    """Tightest limit, mm. Default just above the smallest attainable."""
    max_limit_mm: Annotated[Length, LIMIT_MM] | None = Field(default=None, examples=[2.0])
    """Loosest limit, mm. Default twice the requirement's."""

    @model_validator(mode="after")
    def _check_order(self) -> Front:
        if self.min_limit_mm and self.max_limit_mm and self.min_limit_mm >= self.max_limit_mm:
            message = f"min_limit_mm {self.min_limit_mm} is not below max_limit_mm {self.max_limit_mm}"
            raise refusal("out-of-range", message, at="min_limit_mm")
        return self


_REGIONS = ("box", "region", "regions")
THIN_MM = 0.3  # a spline of the squared distance has no room for less
ALONG = 1e-6  # of the sine of an angle: along an axis


class Optimise(Record):
    """What the optimiser may change, what it must keep, and what is asked for."""

    requirement: Name | Annotated[list[Name], Field(min_length=1)] | None = Field(
        default=None, examples=["tip-accuracy"]
    )
    """Name, or names, of the requirements whose limits must hold. Default all of them. The others are judged on the new
    design all the same."""
    objective: Literal["cost", "quantile", "scaling", "pareto"] | None = Field(default=None, examples=["cost"])
    """cost: least cost within the limit. quantile: least quantile (P95) within cost_limit. scaling: one factor on all
    free half-widths, as large as the limit allows. pareto: least cost at a row of limits. Default cost, or quantile
    when no tolerance is free."""
    cost_limit: Annotated[float, Field(gt=0, le=1e27), MONEY] | None = Field(default=None, examples=[2000])
    """objective: quantile with free tolerances only; what may be spent."""
    front: Front | None = None
    """objective: pareto only; which limits. Default nine."""
    box: SearchBox | None = None
    """Where the fiducials may go, as a box. Short for region: { box }."""
    region: SearchRegion | None = None
    """Where the fiducials may go: box, cylinder, ball or near a surface."""
    regions: Annotated[list[FiducialRegion], Field(min_length=1)] | None = None
    """A region for each group of fiducials; those in no group stay."""
    keep_out: list[KeepOutZone] = Field(default=[])
    """Zones no moved fiducial may be in. Default none."""
    symmetry: Symmetry | None = None
    """Symmetry of the free fiducials. Default none."""
    fixed: list[Name] = Field(default=[], examples=[["F1"]])
    """Labels of fiducials that stay. Default none."""
    count: Count | None = None
    """How many fiducials may be used. Absent: as many as there are."""
    stay: Stay | None = None
    """A price of moving fiducials, or a bound of it; new ones may be anywhere. Default neither."""
    fewest_moves: bool = False
    """Whether the answer says what each move buys alone and which few keep most of it: up to three more optima for each
    fiducial. Default false."""
    survive: Survive | None = None
    """What must hold when fiducials are lost, beside the limits with all of them. Default nothing."""
    views: Annotated[list[_FreeViewEntry], Field(min_length=1, max_length=4)] | None = None
    """Views that may be aimed otherwise, beside what else is free: the best of a few directions that are tried. One
    entry may add a view at a price. Default none."""
    min_spacing_mm: Annotated[_Spacing, SPACING_MM] = Field(default=10.0, examples=[12.0])
    """Smallest distance between two fiducials, mm. Default 10."""
    min_projected_spacing_px: _Spacing = Field(default=25.0, examples=[25.0])
    """Smallest distance between two fiducials' images in any view, px. Default 25."""
    image_margin_px: _Spacing = Field(default=20.0, examples=[20.0])
    """Images of fiducials keep this distance from the image border, px. Default 20."""
    target_clearance_px: _Spacing = Field(default=0.0, examples=[25.0])
    """Smallest distance between the image of a fiducial and that of a target, px. Default 0."""
    rotation_bounds: RotationBounds | None = None
    """Frees every rotational tolerance that the two interfaces declare, with these bounds, except those listed in
    tolerances."""
    translation_bounds: TranslationBounds | None = None
    """Frees every translational tolerance that the two interfaces declare, likewise."""
    tolerances: list[FreeTolerance] = Field(default=[])
    """Tolerances that are free, one by one."""
    grade_prices: Annotated[dict[ToleranceGrade, Price], Field(min_length=1)] | None = Field(
        default=None, examples=[{"IT6": 60, "IT7": 35, "IT8": 20}]
    )
    """What the standard tolerance grades of ISO 286 cost, for grades of a drawing without a price: a fit costs those of
    its hole and its pin, a zone the coarsest that is as narrow on the size of its feature."""
    pivots: Annotated[list[FreePivot], Field(max_length=2)] = Field(default=[])
    """Pivots that may move. Default none."""
    starts: Annotated[int, Field(ge=1, le=256), COUNT] = Field(default=8, examples=[8])
    """Number of starting layouts. Default 8."""
    seed: Annotated[int, Field(ge=0, le=2**63 - 1), AnySize("any number is a seed")] = Field(default=1, examples=[1])
    """Seed of the starts and of the check. Default 1."""

    _as_before = leave_out_later("fewest_moves", "grade_prices")

    @property
    def frees_tolerances(self) -> bool:
        return bool(self.rotation_bounds or self.translation_bounds or self.tolerances)

    @property
    def goal(self) -> Literal["cost", "quantile", "scaling", "pareto"]:
        """The objective, its default filled in."""
        return self.objective or ("cost" if self.frees_tolerances else "quantile")

    @property
    def free_views(self) -> list[FreeView]:
        """Views of the design that may be aimed otherwise."""
        return [each for each in self.views or () if isinstance(each, FreeView)]

    @property
    def added_view(self) -> AddedView | None:
        """The view that may be added."""
        return next((each for each in self.views or () if isinstance(each, AddedView)), None)

    _one_region = only_one(*_REGIONS)

    @model_validator(mode="after")
    def _consistent(self) -> Optimise:
        given = any(getattr(self, name) is not None for name in _REGIONS)
        if not (given or self.frees_tolerances or self.pivots):
            detail = "give box, region, regions, rotation_bounds, tolerances or pivots: nothing may change"
            raise refusal("nothing-free", detail, "add a box")
        for field in ("keep_out", "symmetry", "count", "stay", "fewest_moves"):
            if getattr(self, field) and not given:
                raise refusal("unused-field", f"{field} is read only with a region for the fiducials", at=field)
        if self.count is not None and self.regions is not None:
            raise refusal("one-of", "count needs one region for all: give box or region, not regions", at="count")
        self._check_objective()
        for field in ("tolerances", "pivots"):
            named = [
                (index, (free.interface, name))
                for index, free in enumerate(getattr(self, field))
                for name in (getattr(free, "component", ""), *getattr(free, "also", ()))
            ]
            for k, (index, pair) in enumerate(named):
                if pair in [other for _, other in named[:k]]:
                    what = ".".join(filter(None, pair))
                    raise refusal("duplicate-name", f"{what} is freed twice", at=f"{field}/{index}")
        return self

    def _check_objective(self) -> None:
        free = self.frees_tolerances
        if self.goal in ("cost", "scaling", "pareto") and not free:
            raise refusal("nothing-free", f"objective: {self.goal} needs free tolerances", "add rotation_bounds")
        if self.goal == "quantile" and free and self.cost_limit is None:
            raise refusal("missing-field", "objective: quantile needs cost_limit when tolerances are free")
        if self.cost_limit is not None and not (self.goal == "quantile" and free):
            message = "cost_limit is read only with objective: quantile and free tolerances"
            raise refusal("unused-field", message, at="cost_limit")
        for field in ("survive", "views") if self.goal == "pareto" else ():
            if getattr(self, field) is not None:
                cure = f"objective: cost, or leave out {field}"
                raise refusal("unsupported", f"a front is not traced with {field}", cure)
        added = [index for index, each in enumerate(self.views or ()) if isinstance(each, AddedView)]
        if added and self.goal != "cost":
            detail = f"a view is added where it saves more than its price, and objective: {self.goal} saves no cost"
            cure = "objective: cost with free tolerances; what one more view does to P95 says tailstack study views"
            raise refusal("unsupported", detail, cure, at=f"views/{added[0]}/price")
        if len(added) > 1:
            at = f"views/{added[1]}"
            raise refusal("too-many", "one view is added at a time", "optimise the new design again", at)
        if self.stay is not None and self.stay.cost_per_mm is not None:
            self._check_price(self.stay.cost_per_mm)
        if self.front is not None and self.goal != "pareto":
            raise refusal("unused-field", "front is read only with objective: pareto", at="front")
        graded = [index for index, free in enumerate(self.tolerances) if free.grades is not None]
        if graded and self.goal != "cost":
            detail = f"grades go with objective: cost; it is {self.goal}"
            raise refusal("unsupported", detail, at=f"tolerances/{graded[0]}")
        between = [name for name in ("rotation_bounds", "translation_bounds") if getattr(self, name)]
        between += [f"tolerances/{index}" for index in range(len(self.tolerances)) if index not in graded]
        if graded and between:
            detail = f"every free tolerance is chosen from grades, as tolerances/{graded[0]} is, or none"
            cure = "give grades here too, the values of its cost curve at some half-widths"
            cure = cure if between[0].startswith("tol") else f"leave {between[0]} out, or give each of them grades"
            raise refusal("unsupported", detail, cure, at=between[0])

    def _check_price(self, cost_per_mm: float) -> None:
        """A price of moving is weighed against the cost of tolerances, by a programme with slopes."""
        against = None if self.goal == "cost" else f"objective: {self.goal} weighs no cost"
        if any(free.grades is not None for free in self.tolerances):
            against = "grades are bought one by one, at a layout that is then placed for room, not for its price"
        if against is not None:
            detail = f"cost_per_mm {cost_per_mm:g} goes with objective: cost and cost curves, and {against}"
            hint = "give at_most_mm instead, which goes with everything, or bounds with objective: cost"
            raise refusal("unsupported", detail, hint, at="stay/cost_per_mm")


class SearchBox(Record):
    """Axis-parallel box in con."""

    min_mm: Annotated[Point, TARGET_MM] = Field(examples=[[-50.0, -50.0, -90.0]])
    """Lowest corner, con, mm."""
    max_mm: Annotated[Point, TARGET_MM] = Field(examples=[[50.0, 50.0, 10.0]])
    """Highest corner, con, mm."""

    @model_validator(mode="after")
    def _check_order(self) -> SearchBox:
        for axis, low, high in zip("xyz", self.min_mm, self.max_mm, strict=True):
            if low > high:
                raise refusal("empty-box", f"min_mm is above max_mm along {axis}: {low} > {high}", at="min_mm")
        return self


class Sector(Record):
    """The part of a cylinder or tube within an angle about its axis."""

    towards: Direction = Field(examples=[[1.0, 0.0, 0.0]])
    """Where its middle looks from the axis, con; any length, what it has along the axis is left out."""
    width_deg: Annotated[float, Field(gt=0, lt=360), WIDTH_DEG] = Field(examples=[120.0])
    """Its whole angle about the axis, deg; above 180 for a tube alone."""


def _check_radii(record: Any) -> Any:
    inner, outer = record.inner_radius_mm, record.radius_mm
    if inner > outer:
        message = f"the region is empty: inner_radius_mm {inner:g} is above radius_mm {outer:g}"
        raise refusal("empty-region", message, "make inner_radius_mm the smaller one", at="inner_radius_mm")
    return record


class SearchCylinder(Record):
    """Cylinder in con, or the tube between two radii, or a sector of either."""

    base_mm: Annotated[Point, TARGET_MM] = Field(examples=[[0.0, 0.0, -90.0]])
    """Centre of the base, con, mm."""
    axis: Direction = Field(default=(0.0, 0.0, 1.0), examples=[[0, 0, 1]])
    """Direction from base to top; any length. Default z."""
    height_mm: Annotated[float, Field(ge=0, le=1e5), EXTENT_MM] = Field(examples=[100.0])
    """Height along the axis, mm."""
    radius_mm: Annotated[Length, EXTENT_MM] = Field(examples=[50.0])
    """Outer radius, mm."""
    inner_radius_mm: Annotated[float, Field(ge=0, le=1e5), EXTENT_MM] = Field(default=0.0, examples=[40.0])
    """Inner radius of a tube, mm; equal to radius_mm: on the surface. Default 0."""
    sector: Sector | None = None
    """The part within an angle. Default all round."""

    @model_validator(mode="after")
    def _shape(self) -> SearchCylinder:
        _check_radii(self)
        if self.sector is not None:
            self._check_sector(self.sector)
        return self

    def _check_sector(self, sector: Sector) -> None:
        across = float(np.linalg.norm(np.cross(self.axis, sector.towards)))
        if across < ALONG * float(np.linalg.norm(self.axis) * np.linalg.norm(sector.towards)) + 1e-300:
            detail = f"the middle of a sector looks away from the axis; {list(sector.towards)} lies along it"
            raise refusal("zero-direction", detail, "name a direction across the axis", "sector/towards")
        if sector.width_deg > 180 and self.inner_radius_mm == 0:
            detail = f"a sector of {sector.width_deg:g} deg has a corner at the axis that points into it"
            raise refusal("unsupported", detail, "give inner_radius_mm, or 180 deg at most", "sector/width_deg")


class SearchBall(Record):
    """Ball in con, or the shell between two radii."""

    centre_mm: Annotated[Point, TARGET_MM] = Field(examples=[[0.0, 0.0, -40.0]])
    """Centre, con, mm."""
    radius_mm: Annotated[Length, EXTENT_MM] = Field(examples=[60.0])
    """Outer radius, mm."""
    inner_radius_mm: Annotated[float, Field(ge=0, le=1e5), EXTENT_MM] = Field(default=0.0, examples=[50.0])
    """Inner radius of a shell, mm; equal to radius_mm: on the surface. Default 0."""

    _in_order = model_validator(mode="after")(_check_radii)


class SearchSurface(Record):
    """What is near a surface of triangles, an STL file."""

    file: Annotated[str, Field(min_length=1, max_length=400)] | None = Field(default=None, examples=["forearm.stl"])
    """STL file beside the design (relative path), binary or text, at most 20,000 triangles; with content, what that was
    called."""
    content: Annotated[str, Field(min_length=1, max_length=1_000_000)] | None = Field(
        default=None, examples=["c29saWQgcGFydAplbmRzb2xpZCBwYXJ0Cg=="]
    )
    """The bytes of that file, or of it after gzip, in base64, where no file can be read: in a request. Default: it is
    read."""
    unit: Literal["um", "mm", "cm", "m", "in"] = Field(default="mm", examples=["mm"])
    """What its numbers are in; STL does not say. Default mm."""
    T_con_file: Transform | None = None
    """Maps its coordinates (mm) to con. Default identity."""
    distance_mm: Annotated[float, Field(ge=0.1, le=1e4), SPACING_MM] = Field(examples=[3.0])
    """No centre of a fiducial is further from the surface, mm."""
    at_least_mm: Annotated[float, Field(ge=0, le=1e4), SPACING_MM] = Field(default=0.0, examples=[1.5])
    """None is nearer to it, mm; equal to distance_mm: at that distance. Default 0."""
    side: Literal["both", "inside", "outside"] = Field(default="both", examples=["inside"])
    """On which side: inside and outside need a closed surface. Default both."""

    @model_validator(mode="after")
    def _distances(self) -> SearchSurface:
        if self.file is None and self.content is None:
            raise refusal("missing-field", "name the file, or give its content", "file: part.stl", "file")
        if self.at_least_mm > self.distance_mm:
            detail = f"the region is empty: at_least_mm {self.at_least_mm:g} is above distance_mm {self.distance_mm:g}"
            raise refusal("empty-region", detail, "make at_least_mm the smaller one", "at_least_mm")
        if self.side == "both" and self.distance_mm < THIN_MM:
            detail = f"a layer on both sides is at least {THIN_MM:g} mm thick each way; {self.distance_mm:g} arrived"
            raise refusal("out-of-range", detail, f"name a side, or distance_mm: {THIN_MM:g}", "distance_mm")
        return self


SearchShape = SearchBox | SearchCylinder | SearchBall | SearchSurface
_SHAPES, A_BOX = ("box", "cylinder", "ball"), "box: {min_mm: [-50, -50, -90], max_mm: [50, 50, 10]}"


class Shaped(Record):
    """A region by exactly one shape."""

    model_config, _one_shape = exactly_one(*_SHAPES, needed=A_BOX)

    box: SearchBox | None = None
    """Axis-parallel box."""
    cylinder: SearchCylinder | None = None
    """Cylinder or tube."""
    ball: SearchBall | None = None
    """Ball or shell."""

    @property
    def solid(self) -> SearchBox | SearchCylinder | SearchBall:
        region = self.box or self.cylinder or self.ball
        assert region is not None  # the validator's work
        return region


class SearchRegion(Shaped):
    """Where fiducials may go."""

    model_config, _one_shape = exactly_one(*_SHAPES, "surface", needed=A_BOX)

    surface: SearchSurface | None = None
    """Near a surface of triangles."""

    @property
    def shape(self) -> SearchShape:
        return self.surface or self.solid


class FiducialRegion(SearchRegion):
    """Where some fiducials may go, when they do not all share one region."""

    fiducials: Annotated[list[Name], Field(min_length=1)] = Field(examples=[["F1", "F2"]])
    """Labels of the fiducials this region holds for."""


class KeepOutZone(Shaped):
    """Where no moved fiducial may be; all round, without a sector."""

    name: Name = Field(examples=["clamp"])
    """What is there: it is named when it binds."""
    clearance_mm: Annotated[float, Field(ge=0, le=1e4), SPACING_MM] = Field(default=0.0, examples=[3.0])
    """Distance fiducial centres keep from the zone, mm. Default 0."""

    @model_validator(mode="after")
    def _all_round(self) -> KeepOutZone:
        if self.cylinder is not None and self.cylinder.sector is not None:
            detail = "a zone that is kept out is the whole cylinder"
            raise refusal("unsupported", detail, "leave sector out", "cylinder/sector")
        return self


class Mirror(Record):
    """Reflection in a plane."""

    point_mm: Point = Field(default=(0.0, 0.0, 0.0), examples=[[0, 0, 0]])
    """A point of the plane, con, mm. Default origin."""
    normal: Direction = Field(examples=[[1, 0, 0]])
    """Normal of the plane, con; any length."""


class Turn(Record):
    """Rotation by a fraction of a full turn."""

    point_mm: Point = Field(default=(0.0, 0.0, 0.0), examples=[[0, 0, 0]])
    """A point of the axis, con, mm. Default origin."""
    axis: Direction = Field(default=(0.0, 0.0, 1.0), examples=[[0, 0, 1]])
    """Direction of the axis, con. Default z."""
    order: Annotated[int, Field(ge=2, le=24), COUNT] = Field(examples=[3])
    """Copies per turn: 3 repeats the pattern every 120 degrees."""


def surfaces_in(section: Optimise | None) -> dict[str, SearchSurface]:
    """The surfaces that regions of a section are near, by their pointers in the document."""
    if section is None:
        return {}
    regions = {"/optimise/region": section.region}
    regions |= {f"/optimise/regions/{index}": each for index, each in enumerate(section.regions or ())}
    return {f"{at}/surface": each.surface for at, each in regions.items() if each is not None and each.surface}


def put_surface(section: Optimise | None, pointer: str, surface: SearchSurface) -> Optimise:
    """The section with another surface at a pointer of ``surfaces_in``."""
    assert section is not None  # it has surfaces
    regions = list(section.regions or ())
    if not regions and section.region is not None:
        return section.model_copy(update={"region": section.region.model_copy(update={"surface": surface})})
    index = int(pointer.split("/")[3])
    regions[index] = regions[index].model_copy(update={"surface": surface})
    return section.model_copy(update={"regions": regions})


class Symmetry(Record):
    """Free fiducials come in groups, in the order of the document, that map onto each other."""

    mirror: Mirror | None = None
    """Pairs mirrored in a plane."""
    rotation: Turn | None = None
    """Groups turned about an axis."""

    _one = only_one("mirror", "rotation", needed="mirror: {normal: [1, 0, 0]}")
