"""A seat as a drawing states it: what each feature says, how many motions it holds, and the law of what it leaves.

A feature holds m motions of the part at *contacts*: at point p along the unit vector n the part is off by
``n . (t + w x (p - pivot)) = delta``, as at a locator.  Features that hold six together are a seat, and its torsor is
linear in the deltas (``compile.torsor_from_locators``).  Each kind says which deltas are possible (its *domain*) and
how likely each is.  In the frame of a feature z is its ``normal``, x its ``along``.

*Pad*, a x b.  Flatness and parallelism are zones between two parallel planes t apart that may lie at any height: the
plane that the part rests on, ``z = rx y - ry x + w`` at ``|x| <= a/2``, ``|y| <= b/2``, fits between them exactly where
``|rx| b + |ry| a <= t``.  That diamond is a square in the heights of two neighbouring corners against the middle,
``u = (rx b - ry a) / 2`` and ``v = (-rx b - ry a) / 2``: ``|u| <= t/2``, ``|v| <= t/2``.  Uniform in the diamond is u
and v uniform and independent: exact, in support and in law.  The height w is another dimension (``height_mm``).

*Pin in a hole.*  A clearance c leaves the axis of the hole a disc of diameter c.  The sizes are uniform within their
limits and the part sits anywhere in the disc that they leave, alike: the variance along each axis is ``E[c^2]/16``,
the reach ``c_max/2``.  Along and across are uncorrelated, not independent.  They are taken for independent: along each,
a sum of independent uniform or triangular laws with *that* standard deviation and *that* reach.  Covariance and the
reach of every motion in the frame of the feature are exact; on the diagonal two reaches add up to sqrt(2) of the
disc's.  For ``bounded`` it is an octagon about the disc instead, at most 8.2 % wider (1/cos 22.5 deg).

*Pin in a slot* holds across the slot only: ``|y| <= c/2``, of variance ``E[c^2]/12``.

*Spigot.*  A round fit as the hole; with a length it holds tilt too.  Its axis stays within the bore where both ends of
the length are in the disc; uniform in that domain is each end uniform in the disc, independently.

*Position* of a hole: the axis is anywhere in a zone of diameter t, of variance ``t^2/16`` along each axis.  At maximum
material t grows by what the hole is larger than its smallest: ``E[(t + b)^2]/16`` and ``(t + b_max)/2``, b of the
hole's size.  Clearance and zone grow together, but their directions are independent: uncorrelated, and so added.

*Vee* at 90 deg, *rest*: flanks or the face anywhere within their profile t, +-t/2 along their own normals.

*Triangular*, the law of a process that keeps to the middle: sizes have ``w^2/24`` of their width w for ``w^2/12``,
zones are less dense the further out, evenly (a cone: ``3 t^2/80`` along each axis), faces triangular.  Where a pin sits
in its clearance no process holds.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from math import ceil, cos, pi, sin, sqrt
from typing import Annotated, Any, Literal, NamedTuple, Self

import numpy as np
from pydantic import AfterValidator, Discriminator, Field, Tag, ValidationInfo, model_validator

from ..fields import Direction, Name, Point, Record, are_parallel, only_one, refusal
from ..geometry.arrays import Array
from ..ranges import SEAT_MM, AnySize
from .iso286 import Deviations, read_fit

MOTIONS = 6
ROUND = (
    "a round clearance or zone is taken for independent laws along and across it, of its own spread and reach; on "
    "the diagonal they reach up to 41 % further than it does (bounded: 8 %, in between)"
)
PRESSED = (
    "interference is not modelled: state sizes that leave a clearance, as H7/g6 does; a pin that is pressed in has no "
    "play: hole_mm: [0, 0], pin_mm: [0, 0]"
)
_Zone = Annotated[float, Field(ge=0, le=10), SEAT_MM]
_Size = Annotated[float, Field(gt=0, le=1e4), AnySize("of a part, as it is drawn")]
_Deviation = Annotated[float, Field(ge=-10, le=10)]


def _refuse_swapped(limits: tuple[float, float], info: ValidationInfo) -> tuple[float, float]:
    upper, lower = limits
    if upper < lower:
        detail = f"[upper, lower]: {upper:g} is below {lower:g}"
        raise refusal("order", detail, f"{info.field_name}: [{lower:g}, {upper:g}]")
    return limits


_Limits = Annotated[
    tuple[_Deviation, _Deviation],
    Field(strict=False),
    AfterValidator(_refuse_swapped),
    AnySize("judged with each other, as limits"),
]


class Part(NamedTuple):
    """A scalar of an item: its law, its half-width in mm, and what one mm of it does at the contacts (m,)."""

    law: str
    half_width: float
    weights: Array


class FeatureItem(NamedTuple):
    """What a drawing states once, and the independent scalars that it becomes."""

    name: str
    parts: tuple[Part, ...]


class Stated(NamedTuple):
    """A number of a drawing that a process holds: half the width of its zone, mm."""

    name: str
    field: str
    half_width: float


_HELD = {  # fields of numbers that a process holds, and what they are of
    **{f"{zone}_mm": zone for zone in ("flatness", "parallelism", "profile", "height", "hole", "pin")},
    "true_position_mm": "position",
}


def spread_sum(half_width: float, std: float) -> list[tuple[str, float]]:
    """Laws and half-widths of independent scalars whose sum reaches ``half_width`` and has ``std``, both exactly.

    Of n scalars of one law one is A wide and the others B: ``A + (n - 1) B = 1``, ``A^2 + (n - 1) B^2 = q``, which has
    a solution for 1/n <= q <= 1; uniform ones have q = 3 std^2 / half_width^2, triangular ones twice that.
    """
    if std <= 1e-100:
        return []
    law, q = "uniform", 3 * (std / half_width) ** 2
    if q <= 0.5:
        law, q = "triangular", 2 * q
    others = max(ceil(1 / q - 1e-9), 1) - 1
    if others == 0:
        return [(law, half_width)]
    narrow = (others - sqrt(max(others**2 - (others**2 + others) * (1 - q), 0.0))) / (others**2 + others)
    widths = [1 - others * narrow, *[narrow] * others]
    return [(law, width * half_width) for width in widths if width > 1e-9]


class _Feature(Record):
    name: Name = Field(examples=["A"])
    """Name of the feature, unique in the interface."""
    position_mm: Point = Field(examples=[[0.0, 0.0, -95.0]])
    """Its middle in con, mm."""
    normal: Direction = Field(default=(0.0, 0.0, 1.0), examples=[[0, 0, 1]])
    """Its normal, or the axis of a round one, in con; any length. Default z."""
    along: Direction = Field(default=(1.0, 0.0, 0.0), examples=[[1, 0, 0]])
    """Its first side, or the way that a slot or a vee runs, in con; any length. Default x."""
    distribution: Literal["uniform", "triangular", "bounded"] = Field(default="uniform", examples=["uniform"])
    """uniform: anything within what the drawing allows alike. triangular: its middle likelier, as of a process that is
    held there. bounded: no law is claimed, only the worst case counts. Default uniform."""

    @model_validator(mode="after")
    def _has_a_frame(self) -> Self:
        if are_parallel(self.normal, self.along):
            detail, cure = f"along is parallel to the normal, {self.normal}", "give two directions at an angle"
            raise refusal("zero-direction", detail, cure, "along")
        return self

    @property
    def frame(self) -> Array:
        """(3, 3) rows x, y, z of the feature in con."""
        z = np.array(self.normal) / np.linalg.norm(self.normal)
        x = np.array(self.along) - (np.array(self.along) @ z) * z
        x /= np.linalg.norm(x)
        return np.array([x, np.cross(z, x), z])

    def at(self, x: float, y: float, z: float = 0.0) -> Array:
        """(3,) con, mm, of a place in the frame of the feature."""
        return np.array(self.position_mm) + np.array([x, y, z]) @ self.frame

    @property
    def contacts(self) -> list[tuple[Array, Array]]:
        """Point and normal of each motion that it holds, in con."""
        raise NotImplementedError

    def items(self) -> Iterator[FeatureItem]:
        """What it states, and what that does at its contacts, in their order."""
        raise NotImplementedError

    @property
    def offset(self) -> Array:
        """(m,) mm: where its contacts are in the middle of what is stated."""
        height = getattr(self, "height_mm", None)
        return np.full(len(self.contacts), 0.0 if height is None else Deviations(*height).middle)

    def numbers(self) -> Iterator[Stated]:
        """Its numbers that a process holds, in the order of their fields."""
        for field in filter(_HELD.get, type(self).model_fields):
            if (value := getattr(self, field)) is not None:
                width = Deviations(*value).width if isinstance(value, tuple) else value
                yield Stated(_HELD[field], field, width / 2)

    @property
    def words(self) -> str:
        """What it states, in a line."""
        raise NotImplementedError


class Pad(_Feature):
    """A flat face that the part rests on: holds two tilts and the height."""

    kind: Literal["pad"] = Field(examples=["pad"])
    """pad: a flat face, holds three motions."""
    size_mm: Annotated[tuple[_Size, _Size], Field(strict=False), AnySize("of a part, as it is drawn")] = Field(
        examples=[[60, 40]]
    )
    """Its length along ``along`` and across it, mm."""
    flatness_mm: _Zone | None = Field(default=None, examples=[0.02])
    """Flatness t, mm: of the face by itself."""
    parallelism_mm: _Zone | None = Field(default=None, examples=[0.02])
    """Parallelism t, mm, to the face that it is measured from. Either this or flatness."""
    height_mm: _Limits | None = Field(default=None, examples=[[0.02, 0.0]])
    """Deviations of its height along the normal, mm: [upper, lower]. Default exact."""

    _one_zone = only_one("flatness_mm", "parallelism_mm", needed="flatness_mm: 0.02")

    @property
    def _zone(self) -> tuple[str, float]:
        """The field and t, mm."""
        if self.flatness_mm is not None:
            return "flatness", self.flatness_mm
        return "parallelism", self.parallelism_mm or 0.0

    @property
    def contacts(self) -> list[tuple[Array, Array]]:
        """The middle, and two neighbouring corners."""
        a, b = self.size_mm
        return [(self.at(x, y), self.frame[2]) for x, y in ((0.0, 0.0), (a / 2, b / 2), (a / 2, -b / 2))]

    def items(self) -> Iterator[FeatureItem]:
        name, t = self._zone
        corners = np.eye(3)[1:]
        yield FeatureItem(name, tuple(Part(self.distribution, t / 2, corner) for corner in corners))
        if self.height_mm is not None:
            yield FeatureItem("height", (Part(self.distribution, Deviations(*self.height_mm).width / 2, np.ones(3)),))

    @property
    def words(self) -> str:
        name, t = self._zone
        height = "" if self.height_mm is None else f", height {_say(Deviations(*self.height_mm))}"
        return f"pad {self.size_mm[0]:g} x {self.size_mm[1]:g}: {name} {t:g}{height}"


class FittedFeature(_Feature):
    """What a pin and a hole leave each other."""

    _called = "fit"
    _clearance_over = 16  # by which the mean square of a clearance is divided: of a disc along an axis

    diameter_mm: _Size = Field(examples=[6])
    """Nominal diameter, mm."""
    fit: Annotated[str, Field(max_length=20)] | None = Field(default=None, examples=["H7/g6"])
    """ISO 286: class of the hole, a stroke, class of the pin. Either this, or hole_mm and pin_mm."""
    hole_mm: _Limits | None = Field(default=None, examples=[[0.012, 0.0]])
    """Deviations of the hole, mm: [upper, lower]."""
    pin_mm: _Limits | None = Field(default=None, examples=[[-0.004, -0.012]])
    """Deviations of the pin, mm: [upper, lower]."""
    true_position_mm: _Zone | None = Field(default=None, examples=[0.05])
    """Position tolerance of the axis, mm: the diameter of its zone. Default exact."""
    at_maximum_material: bool = Field(default=False, examples=[True])
    """Whether the zone grows by what the hole is larger than its smallest (the sign M on a drawing)."""

    @model_validator(mode="after")
    def _fits(self) -> Self:
        sizes = self.hole_mm is not None, self.pin_mm is not None
        if (self.fit is not None) == any(sizes) or any(sizes) != all(sizes):
            cure = "leave out hole_mm and pin_mm" if self.fit is not None else "fit: H7/g6"
            raise refusal("one-of", "give fit, or hole_mm and pin_mm together", cure)
        try:
            hole, pin = self.limits
        except ValueError as error:
            pressed = re.search(r"/\s*[kn-z]|^\s*[KMNP-Z]", self.fit or "")
            cure = PRESSED if pressed else "or state hole_mm and pin_mm, as the standard's table has them"
            raise refusal("unknown-fit", str(error), cure, "fit") from None
        self._refuse_sizes()
        if hole.lower < pin.upper:
            detail = f"the pin may be larger than the hole: {_say(pin)} in {_say(hole)}"
            raise refusal("interference", detail, PRESSED, "pin_mm" if self.fit is None else "fit")
        if self.at_maximum_material and self.true_position_mm is None:
            detail = "at_maximum_material is read only with true_position_mm"
            raise refusal("unused-field", detail, "state the zone, or leave this out", "at_maximum_material")
        return self

    def _refuse_sizes(self) -> None:
        """Sizes where deviations belong: half the diameter and more is none."""
        nominal = self.diameter_mm
        for field, limits in (("hole_mm", self.hole_mm or ()), ("pin_mm", self.pin_mm or ())):
            far = [value for value in limits if abs(value) > nominal / 2]
            if far:
                detail = f"{far[0]:g} mm is no deviation from a diameter of {nominal:g} mm"
                beyond = ", ".join(f"{value - nominal * (value in far):.6g}" for value in limits)
                cure = f"[upper, lower] from the nominal diameter: {field}: [{beyond}]"
                raise refusal("out-of-range", detail, cure if min(far) > 0 else cure.partition(":")[0], field)

    @property
    def limits(self) -> tuple[Deviations, Deviations]:
        """Of hole and pin.  Raises ValueError for a fit that is not known."""
        if self.fit is not None:
            return read_fit(self.fit, self.diameter_mm)
        assert self.hole_mm is not None
        assert self.pin_mm is not None
        return Deviations(*self.hole_mm), Deviations(*self.pin_mm)

    @property
    def clearance(self) -> tuple[float, float]:
        """The largest, mm, and the mean of its square, mm^2, over sizes within their limits."""
        hole, pin = self.limits
        mean = hole.middle - pin.middle
        return hole.upper - pin.lower, mean**2 + (hole.width**2 + pin.width**2) / self._width_over

    @property
    def zone(self) -> tuple[float, float]:
        """The diameter of the position zone: the largest, mm, and the mean of its square, mm^2."""
        t = self.true_position_mm or 0.0
        bonus = self.limits[0].width if self.at_maximum_material else 0.0
        return t + bonus, (t + bonus / 2) ** 2 + bonus**2 / self._width_over

    @property
    def _width_over(self) -> int:
        """By which the square of the width of a size's limits is divided: its variance."""
        return 24 if self.distribution == "triangular" else 12

    def items(self) -> Iterator[FeatureItem]:
        yield FeatureItem("fit", tuple(self._parts(*self.clearance, self._clearance_over)))
        if self.true_position_mm:
            yield FeatureItem("position", tuple(self._parts(*self.zone, 80 / 3 if self._width_over == 24 else 16)))

    def _parts(self, largest: float, square: float, over: float) -> Iterator[Part]:
        """Scalars of round places that reach half of ``largest`` mm, and vary by ``square / over`` mm^2 along each
        axis; of one axis as well."""
        law, reach, every = self.distribution, largest / 2, np.eye(len(self.contacts))
        for first in range(0, len(every), 2):
            axes = every[:, first : first + 2]  # x and y of a round place, or y alone, at the contacts
            if law == "bounded" and axes.shape[1] == 2:
                side = reach / (1 + sqrt(2))
                yield from (Part(law, side, axes @ [cos(k * pi / 4), sin(k * pi / 4)]) for k in range(4))
            elif law == "bounded":
                yield Part(law, reach, axes[:, 0])
            else:
                for way in axes.T:
                    yield from (Part(each, width, way) for each, width in spread_sum(reach, sqrt(square / over)))

    def numbers(self) -> Iterator[Stated]:
        for size, limits in zip(("hole", "pin"), self.limits, strict=True) if self.fit is not None else ():
            yield Stated(size, "fit", limits.width / 2)
        yield from super().numbers()

    @property
    def words(self) -> str:
        hole, pin = self.limits
        largest, least = hole.upper - pin.lower, hole.lower - pin.upper
        fit = f" {self.fit}" if self.fit is not None else ""
        zone = "" if self.true_position_mm is None else f", position {self.true_position_mm:g}"
        zone += " at maximum material" if self.at_maximum_material else ""
        return (
            f"{self._called} {self.diameter_mm:g}{fit}: hole {_say(hole)}, pin {_say(pin)}, "
            f"clearance {(largest + least) / 2:.4g} ± {(largest - least) / 2:.4g} mm{zone}"
        )


class PinInHole(FittedFeature):
    """A pin in a round hole: holds its axis, two motions."""

    kind: Literal["pin_in_hole"] = Field(examples=["pin_in_hole"])
    """pin_in_hole: holds two motions."""
    _called = "pin in hole"

    @property
    def contacts(self) -> list[tuple[Array, Array]]:
        return [(self.at(0.0, 0.0), self.frame[k]) for k in range(2)]


class PinInSlot(FittedFeature):
    """A pin in a slot that runs along ``along``: holds across it, one motion."""

    kind: Literal["pin_in_slot"] = Field(examples=["pin_in_slot"])
    """pin_in_slot: holds one motion."""
    _called = "pin in slot"
    _clearance_over = 12  # of a line

    @property
    def contacts(self) -> list[tuple[Array, Array]]:
        return [(self.at(0.0, 0.0), self.frame[1])]


class Spigot(FittedFeature):
    """A spigot in a bore: holds its axis, two motions, and with a length two tilts."""

    kind: Literal["spigot"] = Field(examples=["spigot"])
    """spigot: holds two motions, with length_mm four."""
    length_mm: _Size | None = Field(default=None, examples=[25])
    """Length in the bore, mm, where it holds tilt. Default: a short one."""
    _called = "spigot"

    @property
    def contacts(self) -> list[tuple[Array, Array]]:
        ends = [0.0] if self.length_mm is None else [self.length_mm / 2, -self.length_mm / 2]
        return [(self.at(0.0, 0.0, z), self.frame[k]) for z in ends for k in range(2)]


class Vee(_Feature):
    """A ball in a vee groove of 90 degrees that runs along ``along``: holds across it and the height, two motions."""

    kind: Literal["vee"] = Field(examples=["vee"])
    """vee: a ball in a groove of 90 degrees, two motions."""
    profile_mm: _Zone = Field(examples=[0.004])
    """Profile t of each flank, mm: +-t/2 along its normal."""

    @property
    def contacts(self) -> list[tuple[Array, Array]]:
        _, y, z = self.frame
        return [(self.at(0.0, 0.0), (z + side * y) / sqrt(2)) for side in (1, -1)]

    def items(self) -> Iterator[FeatureItem]:
        yield FeatureItem("profile", tuple(Part(self.distribution, self.profile_mm / 2, flank) for flank in np.eye(2)))

    @property
    def words(self) -> str:
        return f"vee: profile {self.profile_mm:g}"


class RestPoint(_Feature):
    """A small face or a stop: holds one motion, along its normal."""

    kind: Literal["rest"] = Field(examples=["rest"])
    """rest: a stop, holds one motion."""
    height_mm: _Limits = Field(examples=[[0.01, -0.01]])
    """Deviations of its height along the normal, mm: [upper, lower]."""

    @property
    def contacts(self) -> list[tuple[Array, Array]]:
        return [(self.at(0.0, 0.0), self.frame[2])]

    def items(self) -> Iterator[FeatureItem]:
        yield FeatureItem("height", (Part(self.distribution, Deviations(*self.height_mm).width / 2, np.ones(1)),))

    @property
    def words(self) -> str:
        return f"rest: height {_say(Deviations(*self.height_mm))}"


FEATURES: tuple[type[_Feature], ...] = (Pad, PinInHole, PinInSlot, Spigot, Vee, RestPoint)
FEATURE_KINDS = {f"<{kind.model_fields['kind'].examples[0]}>": kind for kind in FEATURES}  # type: ignore[index]


def _kind_of(value: Any) -> str | None:
    if isinstance(value, dict):
        tag = f"<{value.get('kind')}>"
        return tag if tag in FEATURE_KINDS else None
    return next((tag for tag, kind in FEATURE_KINDS.items() if isinstance(value, kind)), None)


Feature = Annotated[
    Annotated[Pad, Tag("<pad>")]
    | Annotated[PinInHole, Tag("<pin_in_hole>")]
    | Annotated[PinInSlot, Tag("<pin_in_slot>")]
    | Annotated[Spigot, Tag("<spigot>")]
    | Annotated[Vee, Tag("<vee>")]
    | Annotated[RestPoint, Tag("<rest>")],
    Discriminator(
        _kind_of,
        custom_error_type="feature-kind",
        custom_error_message="a feature is a mapping with a kind: pad, pin_in_hole, pin_in_slot, spigot, vee or rest",
    ),
]


def refuse_overheld(features: Sequence[_Feature]) -> None:
    """Raises a refusal where features hold more than six motions: which of them gives way is not modelled."""
    held = [len(feature.contacts) for feature in features]
    if sum(held) > MOTIONS:
        each = ", ".join(f"{feature.name} {count}" for feature, count in zip(features, held, strict=True))
        cure = "leave out what gives way: a second hole is a slot, a spigot on a pad has no length_mm"
        detail = f"the features hold {sum(held)} motions and a part has six: {each}"
        raise refusal("overheld", detail, cure, "features")


def _say(limits: Deviations) -> str:
    """A zone as a drawing has it, and as middle and half-width where it is not symmetric."""
    if abs(limits.middle) < 1e-12:
        return f"±{limits.upper:.4g}"
    return f"{limits} ({limits.middle:+.4g} ± {limits.width / 2:.4g})"
