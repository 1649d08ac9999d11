"""What a scene is made of: items in space, layers that are shown or hidden, directions to look from."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Literal

from tailstack.arrays import Array

Point3 = tuple[float, float, float]
Kind = Literal["mark", "line", "face", "ellipsoid", "arrow"]


@dataclass(frozen=True, slots=True)
class Item:
    """One thing to draw: a mark at a point, a line or face through points, an arrow between two, an ellipsoid.

    ``points``: con, mm; of an ellipsoid its centre and the ends of its three semi-axes, each from the centre.
    ``look``: of a mark its shape, else the key of a style.
    """

    kind: Kind
    layer: str
    look: str
    points: tuple[Point3, ...]
    label: str = ""
    title: str = ""


@dataclass(frozen=True, slots=True)
class Layer:
    """Items that are shown or hidden together."""

    key: str
    label: str
    shown: bool


@dataclass(frozen=True, slots=True)
class Camera:
    """A direction to look from, at infinite distance: ``right`` and ``up`` of the page in con."""

    key: str
    label: str
    right: Point3
    up: Point3


@dataclass(frozen=True, slots=True)
class Scene:
    """A layout in con, mm.  ``near`` and ``far``: points that have to be in sight, of the structure, of everything."""

    title: str
    words: str  # the scene for those who do not see it
    magnification: float  # of ellipsoids and biases; 0 where there are none
    note: str  # what is drawn to which scale
    layers: tuple[Layer, ...]
    cameras: tuple[Camera, ...]
    items: tuple[Item, ...]
    near: tuple[Point3, ...]
    far: tuple[Point3, ...]
    before: str = "before"  # what the layout below is called, where this one is drawn over another


LOOKS: dict[str, dict[str, Any]] = {  # of lines, faces, arrows and ellipsoids
    "floor": {"stroke": "#c8c8c8", "width": 0.6, "fill": "#efefef", "opacity": 0.7},
    "drop": {"stroke": "#9a9a9a", "width": 0.7, "dash": [1, 2.5]},
    "ray": {"stroke": "#6b7780", "width": 0.9},
    "axis": {"stroke": "#6b7780", "width": 0.8, "dash": [6, 3]},
    "beam": {"stroke": "#4b5660", "width": 1.6},
    "detector": {"stroke": "#4b5660", "width": 1.1, "fill": "#9fb3c4", "opacity": 0.25},
    "guessed": {"stroke": "#4b5660", "width": 1.1, "fill": "#9fb3c4", "opacity": 0.15, "dash": [4, 3]},
    "region": {"stroke": "#d55e00", "width": 0.9, "dash": [3, 2]},
    "room": {"stroke": "#0072b2", "width": 0.8, "dash": [2, 3]},
    "keep-out": {"stroke": "#b3261e", "width": 1.1, "dash": [5, 2]},
    "frame": {"stroke": "#222222", "width": 1.3},
    "locator": {"stroke": "#222222", "width": 1.4},
    "lever": {"stroke": "#00795a", "width": 0.9, "dash": [8, 2, 2, 2]},
    "moved": {"stroke": "#8a8a8a", "width": 0.9},
    "tcp": {"stroke": "#a84600", "width": 1.1, "fill": "#e69f00", "opacity": 0.3},
    "tcp-before": {"stroke": "#6b7780", "width": 1.0, "fill": "#9aa4ad", "opacity": 0.2, "dash": [3, 2]},
    "localisation": {"stroke": "#00618f", "width": 1.0, "fill": "#56b4e9", "opacity": 0.25},
    "bias": {"stroke": "#8c1d5b", "width": 1.8},
    "bias-before": {"stroke": "#6b7780", "width": 1.4},
}


def point(values: Array) -> Point3:
    x, y, z = (round(float(v), 3) + 0.0 for v in values)
    return (x, y, z)


def points_of(values: Iterable[Array]) -> tuple[Point3, ...]:
    return tuple(point(value) for value in values)


def place_in_words(values: Array) -> str:
    x, y, z = (round(float(v), 2) + 0.0 for v in values)
    return f"x {x:.2f}, y {y:.2f}, z {z:.2f} mm"
