"""Sections of a design drawn from what their fields say is typical: no effect and no field is named here."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum
from typing import Annotated, Any, Literal, get_args, get_origin

import numpy as np

from tailstack.design import load_design
from tailstack.effects import EFFECTS, EffectKind
from tailstack.errors import DesignError
from tailstack.fields import Record, Typical, domain_of
from tailstack.laws import Drawn

SIZE_PX = 1600
TRIES = 20
# Held against other fields: tests/unit/test_correlation.py and test_robot.py draw them
JOINT = ("correlation", "covariance_deg_mm", "joints", "urdf")
Typicals = Mapping[str, Typical]  # by the field that is meant, "" where it is this one


def _strip(kind: Any, told: Typicals) -> tuple[Any, Typicals, int]:
    """A field's type without None and notes, what is typical, and how many a list holds at most."""
    most = 1
    while True:
        if get_origin(kind) is Annotated:
            kind, *notes = get_args(kind)
            told = {note.of: note for note in notes if isinstance(note, Typical)} | dict(told)
            kept = [part for note in notes for part in (note, *getattr(note, "metadata", ()))]
            most = max([most, *(part.max_length for part in kept if hasattr(part, "max_length"))])
        elif type(None) in get_args(kind):
            kind = next(part for part in get_args(kind) if part is not type(None))
        else:
            return kind, told, most


def draw_record(record: type[Record], rng: np.random.Generator, share: float, told: Typicals) -> dict[str, Any]:
    """A record's fields, each of those that may be left out with this probability, but half-widths and laws always."""
    drawn: dict[str, Any] = {}
    for name, field in record.model_fields.items():
        if name in JOINT:
            continue
        own = {"": told[name]} if name in told else {}
        value = draw_value(field.rebuild_annotation(), rng, share, {**told, **own})
        stays = field.is_required() or name.startswith(("half_width", "distribution"))
        if value is not None and (stays or rng.random() < share):
            drawn[name] = value
    lists = [name for name, value in drawn.items() if isinstance(value, list)]
    for name in lists:  # several of one record are of the same things, and equally long
        drawn[name] = drawn[name][: min(len(drawn[each]) for each in lists)]
    if drawn.get("distribution") != "normal":
        drawn.pop("coverage_factor", None)
    return drawn


def draw_value(kind: Any, rng: np.random.Generator, share: float, told: Typicals) -> Any:
    """A value of a field of this type; None of a text."""
    inner, told, most = _strip(kind, told)
    if get_origin(inner) is Literal:
        return str(rng.choice(get_args(inner)))
    if get_origin(inner) is tuple:
        return [draw_value(part, rng, share, told) for part in get_args(inner)]
    if get_origin(inner) is list:
        count = most if share == 1 else int(rng.integers(1, most + 1))
        values = [draw_value(get_args(inner)[0], rng, share, told) for _ in range(count)]
        return None if None in values else values  # names, which nothing can be drawn for
    if issubclass(inner, Record):
        return draw_record(inner, rng, share, told)
    if inner is Drawn:
        return None  # as usual: ``unit/test_levels.py`` has the others
    if issubclass(inner, StrEnum):
        return str(rng.choice([each for each in inner if each != "bounded"]))
    if issubclass(inner, str):
        return None
    assert "" in told, "say what is typical of the number, beside its type"
    typical, (low, high) = told[""], domain_of(kind)
    assert low <= typical.low <= typical.high <= high, "what is typical of a number lies in its domain"
    if typical.low > 0:
        return float(np.exp(rng.uniform(*np.log([typical.low, typical.high]))))
    return float(rng.uniform(typical.low, typical.high))


def declare(document: dict[str, Any], kind: EffectKind[Any], rng: np.random.Generator, share: float = 0.7) -> bool:
    """Put the sections of an effect into a document, view by view; whether it takes them.  A view that has to state the
    size of its image for it does, where it shows all fiducials and targets near its middle."""
    places = {
        "design": [document],
        "execution": [document.setdefault("execution", {})],
        "fiducials": [document["fiducials"]],
        "view": document["views"],
    }
    taken = [_put(document, place, kind.section, rng, share) for place in places[kind.host]]
    return any(taken)


def _put(
    document: dict[str, Any], place: dict[str, Any], section: type[Record], rng: np.random.Generator, share: float
) -> bool:
    before = dict(place)
    sized = {"image_size_px": [SIZE_PX, SIZE_PX]} if _is_near(document, place) else {}
    for k in range(TRIES):
        fields = section.model_fields.items()
        drawn = {name: draw_value(field.rebuild_annotation(), rng, share, {}) for name, field in fields}
        place.update(drawn | (sized if k % 2 else {}))
        try:
            load_design(document)
        except DesignError:
            place.clear()
            place.update(before)
        else:
            return True
    return False


def _is_near(document: dict[str, Any], view: dict[str, Any]) -> bool:
    if "projection" not in view:
        return False
    points = [each["position_mm"] for each in (*document["fiducials"]["points"], *document["targets"])]
    images = np.column_stack([points, np.ones(len(points))]) @ np.array(view["projection"]).T
    return bool(np.linalg.norm(images[:, :2] / images[:, 2:] - SIZE_PX / 2, axis=1).max() < 1400)


def declare_all(document: dict[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    """The document with all that every effect can declare, everywhere."""
    for kind in EFFECTS:
        assert declare(document, kind, rng, 1.0), kind
    return document


def declare_some(document: dict[str, Any], rng: np.random.Generator, probability: float) -> dict[str, Any]:
    """The document with some of the effects; each draws for itself, so that a new one changes nothing of the others."""
    for kind, own in zip(EFFECTS, rng.spawn(len(EFFECTS)), strict=True):
        if own.random() < probability:
            declare(document, kind, own)
    return document
