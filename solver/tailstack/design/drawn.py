"""Values of a drawing that a search may set: fits and zones of features, what each costs, and what it becomes.

A value becomes a few independent scalars, more or fewer and of other laws from one fit to the next.  Here they have
the same places whatever the value: for each law and each way as many as any of the values needs, those that one does
not need being 0 wide.  A search then only sets half-widths.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydantic import ValidationError

from ..errors import Problem
from ..geometry.arrays import Array
from ..system import Law, std_per_half_width
from .features import Feature, FittedFeature, Pad, Part
from .iso286 import find_grade
from .optimise_document import FreeTolerance, Grade

SAME = 1e-9  # relative: a size that near that of a value is that of the value
FIELD_OF = {  # of each item that may be set
    **{zone: f"{zone}_mm" for zone in ("flatness", "parallelism", "profile")},
    "fit": "fit",
    "position": "true_position_mm",
}
Key = tuple[str, str]  # feature and item
Items = Mapping[Key, tuple[Part, ...]]


def find_drawn(features: Sequence[Feature]) -> dict[str, tuple[Feature, str]]:
    """What may be set, by the name of its line in the budget (``pin 1 fit``): the feature that states it, and the item.
    A zone at maximum material is not: it grows with the fit, and is not chosen apart from it."""
    return {
        f"{feature.name} {item.name}": (feature, item.name)
        for feature in features
        for item in feature.items()
        if item.name in FIELD_OF and not (item.name == "position" and _grows(feature))
    }


def _find_freed(features: Sequence[Feature], free: FreeTolerance) -> list[tuple[Feature, str]]:
    """What is free, and what gets the same value."""
    known = find_drawn(features)
    return [known[name] for name in (free.component, *free.also)]


def _grows(feature: Feature) -> bool:
    return isinstance(feature, FittedFeature) and feature.at_maximum_material


def redraw_data(stated: Mapping[str, Any], item: str, value: Any) -> dict[str, Any]:
    """What a feature states, as plain data, with another value of an item; a fit takes the place of limits."""
    limits = ("hole_mm", "pin_mm") if item == "fit" else ()
    return {name: each for name, each in stated.items() if name not in limits} | {FIELD_OF[item]: value}


def redraw(features: Sequence[Feature], free: FreeTolerance, value: Any) -> list[Feature]:
    """The features with another value of what is free.  Raises ValidationError."""
    items = {feature.name: item for feature, item in _find_freed(features, free)}
    return [
        type(each).model_validate(redraw_data(each.model_dump(exclude_unset=True), items[each.name], value))
        if each.name in items
        else each
        for each in features
    ]


def say_drawn(feature: Feature, item: str) -> str:
    """What it states of an item: ``H7/g6``, ``0.02``, or limits."""
    value = getattr(feature, FIELD_OF[item])
    if isinstance(feature, FittedFeature) and value is None:
        return " in ".join(str(limits) for limits in reversed(feature.limits))
    return f"{value:g}" if isinstance(value, float) else str(value)


def price_of(feature: Feature, grade: Grade, prices: Mapping[Any, float] | None) -> float | None:
    """Of a value, its own or that of the standard tolerance grades ``IT5`` to ``IT11``; None: neither is stated."""
    if grade.price is not None or prices is None:
        return grade.price
    if grade.fit is not None:
        numbers = re.findall(r"\d+", grade.fit)
    else:
        size = max(feature.size_mm) if isinstance(feature, Pad) else getattr(feature, "diameter_mm", np.inf)
        numbers = [find_grade(grade.zone_mm or 0.0, size, (int(name[2:]) for name in prices))]
    each = [prices.get(f"IT{number}", np.nan) for number in numbers]
    return sum(each) if np.isfinite(each).all() else None


def check_freed(
    features: Sequence[Feature], free: FreeTolerance, pointer: str, prices: Mapping[Any, float] | None
) -> Iterator[Problem]:
    """What is wrong with values that a search shall choose from."""
    known = find_drawn(features)
    if unknown := [name for name in (free.component, *free.also) if name not in known]:
        detail = f"no feature states {unknown[0]!r} as a fit or a zone that may be set"
        yield Problem(f"{pointer}/component", "unknown-name", detail, f"one of {', '.join(known)}")
        return
    feature, item = known[free.component]
    field = "fit" if item == "fit" else "zone_mm"
    if free.grades is None or any(getattr(grade, field) is None for grade in free.grades):
        detail = f"{free.component} is chosen from values of a drawing, each with its {field}"
        yield Problem(f"{pointer}/grades", "missing-field", detail, f"grades: [{{ {field}: ... }}, ...]")
        return
    for k, grade in enumerate(free.grades):
        at = f"{pointer}/grades/{k}"
        if price_of(feature, grade, prices) is None:
            detail = f"{grade.label} has no price, and grade_prices say none for it"
            yield Problem(at, "missing-field", detail, "give its price, or those of more grades in grade_prices")
        try:
            redraw(features, free, grade.drawn_value)
        except ValidationError as error:
            said = error.errors()[0]
            detail = f"{free.component} cannot be {grade.label}: {said['msg']}"
            yield Problem(at, "no-such-value", detail, str(said.get("ctx", {}).get("hint", "")))


@dataclass(frozen=True, slots=True, eq=False)
class DrawnValues:
    """A value of a drawing that may be set, as the n scalars that it becomes, which have one size between them.

    The size is the half-width of a uniform law with their root mean square along each way: variances go as its square,
    exactly from one value to the next.  Between two values the law is taken to be that of the middle one.
    """

    names: tuple[str, ...]  # of the sources
    per_square: Array  # (n,) weight of the square of each half-width in that of the size
    sizes: tuple[float, ...]  # of what the drawing says and of the values
    half_widths: tuple[Array, ...]  # (n,) of the scalars, of each
    now: str  # what the drawing says
    places: Items  # of the scalars, as wide as they are now

    def size_of(self, half_widths: Array) -> float:
        """From half-widths (n,) of the scalars."""
        return float(np.sqrt(self.per_square @ half_widths**2))

    @property
    def widens(self) -> bool:
        """Whether no scalar becomes narrower from a size to the next: then errors only grow."""
        return bool((np.diff([self.half_widths[k] for k in self._order], axis=0) >= 0).all())

    @property
    def ratios(self) -> Array:
        """(n,) half-widths for a size of 1, between values."""
        middle = self._order[len(self.sizes) // 2]
        return self.half_widths[middle] / self.sizes[middle]

    @property
    def _order(self) -> list[int]:
        """The places of the sizes, the smallest first."""
        return sorted(range(len(self.sizes)), key=self.sizes.__getitem__)

    def half_widths_at(self, size: float) -> Array:
        """(n,)"""
        known = zip(self.sizes, self.half_widths, strict=True)
        return next((own for each, own in known if abs(size - each) <= SAME * each), size * self.ratios)


def read_values(features: Sequence[Feature], free: FreeTolerance) -> DrawnValues:
    """What is free of features, with a place for whatever each of the values needs."""
    each = [_items_of(features), *(_items_of(redraw(features, free, grade.drawn_value)) for grade in free.grades or ())]
    named = _find_freed(features, free)
    keys = [(feature.name, item) for feature, item in named]
    keys += [(feature.name, "position") for feature, item in named if item == "fit" and _grows(feature)]
    shared = {key: _share_places([items.get(key, ()) for items in each]) for key in keys}
    rows = [np.concatenate([_fill(places, items.get(key, ())) for key, places in shared.items()]) for items in each]
    kinds = [(key, _kind(part)) for key, places in shared.items() for part in places]
    ways = len({(key, way) for key, (_, way) in kinds})
    per = np.array([3 * (std_per_half_width(Law(law)) ** 2 or 1 / 3) for _, (law, _) in kinds]) / ways
    widths = iter(rows[0].tolist())
    wide = {key: tuple(place._replace(half_width=next(widths)) for place in places) for key, places in shared.items()}
    names = (" ".join(key) + (f", {k + 1}" if k else "") for key, places in shared.items() for k in range(len(places)))
    return DrawnValues(
        names=tuple(names),
        per_square=per,
        sizes=tuple(float(np.sqrt(per @ row**2)) for row in rows),
        half_widths=tuple(rows),
        now=say_drawn(*named[0]),
        places=wide,
    )


def _items_of(features: Sequence[Feature]) -> Items:
    return {(feature.name, item.name): item.parts for feature in features for item in feature.items()}


def _kind(part: Part) -> tuple[str, tuple[float, ...]]:
    return part.law, tuple(part.weights.tolist())


def _share_places(each: Sequence[tuple[Part, ...]]) -> tuple[Part, ...]:
    """One place for each law and way, as often as any of these needs it."""
    places: list[Part] = []
    for parts in each:
        for kind in map(_kind, parts):
            wanted = sum(_kind(part) == kind for part in parts) - sum(_kind(part) == kind for part in places)
            places += [Part(kind[0], 0.0, np.array(kind[1]))] * max(wanted, 0)
    return tuple(places)


def _fill(places: Sequence[Part], parts: Sequence[Part]) -> Array:
    """(n,) half-widths at the places, 0 where nothing is."""
    left = {kind: [part.half_width for part in parts if _kind(part) == kind] for kind in map(_kind, places)}
    return np.array([left[_kind(place)].pop(0) if left[_kind(place)] else 0.0 for place in places])
