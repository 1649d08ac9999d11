"""Where fiducials may go, may not go, and how they repeat: shapes in con, keep-out zones, symmetries."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import ConfigDict, Field, model_validator

from .fields import Direction, Length, Name, Point, Record, refusal


class SearchBox(Record):
    """Axis-parallel box in con."""

    min_mm: Point = Field(description="Lowest corner, con, mm.", examples=[[-50.0, -50.0, -90.0]])
    max_mm: Point = Field(description="Highest corner, con, mm.", examples=[[50.0, 50.0, 10.0]])

    @model_validator(mode="after")
    def _ordered(self) -> SearchBox:
        for axis, low, high in zip("xyz", self.min_mm, self.max_mm, strict=True):
            if low > high:
                raise refusal("empty-box", f"min_mm is above max_mm along {axis}: {low} > {high}", at="min_mm")
        return self


class SearchCylinder(Record):
    """Cylinder in con, or the tube between two radii."""

    base_mm: Point = Field(description="Centre of the base, con, mm.", examples=[[0.0, 0.0, -90.0]])
    axis: Direction = Field(
        default=(0.0, 0.0, 1.0), description="Direction from base to top; any length. Default z.", examples=[[0, 0, 1]]
    )
    height_mm: Annotated[float, Field(ge=0, le=1e5)] = Field(description="Height along the axis, mm.", examples=[100.0])
    radius_mm: Length = Field(description="Outer radius, mm.", examples=[50.0])
    inner_radius_mm: Annotated[float, Field(ge=0, le=1e5)] = Field(
        default=0.0,
        description="Inner radius of a tube, mm; equal to radius_mm: on the surface. Default 0.",
        examples=[40.0],
    )

    @model_validator(mode="after")
    def _shape(self) -> SearchCylinder:
        _check_radii(self.inner_radius_mm, self.radius_mm)
        if max(map(abs, self.axis)) < 1e-9:
            raise refusal("zero-direction", "an axis needs a direction; [0, 0, 0] arrived", at="axis")
        return self


class SearchBall(Record):
    """Ball in con, or the shell between two radii."""

    centre_mm: Point = Field(description="Centre, con, mm.", examples=[[0.0, 0.0, -40.0]])
    radius_mm: Length = Field(description="Outer radius, mm.", examples=[60.0])
    inner_radius_mm: Annotated[float, Field(ge=0, le=1e5)] = Field(
        default=0.0,
        description="Inner radius of a shell, mm; equal to radius_mm: on the surface. Default 0.",
        examples=[50.0],
    )

    @model_validator(mode="after")
    def _shape(self) -> SearchBall:
        _check_radii(self.inner_radius_mm, self.radius_mm)
        return self


def _check_radii(inner: float, outer: float) -> None:
    if inner > outer:
        message = f"the region is empty: inner_radius_mm {inner:g} is above radius_mm {outer:g}"
        raise refusal("empty-region", message, "make inner_radius_mm the smaller one", at="inner_radius_mm")


_SHAPES = ("box", "cylinder", "ball")
_ONE_SHAPE: dict[str, Any] = {"oneOf": [{"required": [name]} for name in _SHAPES]}


class Shaped(Record):
    """A region by exactly one shape."""

    model_config = ConfigDict(json_schema_extra=_ONE_SHAPE)

    box: SearchBox | None = Field(default=None, description="Axis-parallel box.")
    cylinder: SearchCylinder | None = Field(default=None, description="Cylinder or tube.")
    ball: SearchBall | None = Field(default=None, description="Ball or shell.")

    @model_validator(mode="after")
    def _one_shape(self) -> Shaped:
        given = [name for name in _SHAPES if getattr(self, name) is not None]
        if len(given) != 1:
            got = " and ".join(given) or "none"
            raise refusal("one-of", f"give exactly one of box, cylinder and ball; {got} arrived")
        return self

    @property
    def shape(self) -> SearchBox | SearchCylinder | SearchBall:
        found = self.box or self.cylinder or self.ball
        assert found is not None  # the validator's work
        return found


class FiducialRegion(Shaped):
    """Where some fiducials may go, when they do not all share one region."""

    fiducials: Annotated[list[Name], Field(min_length=1)] = Field(
        description="Labels of the fiducials this region holds for.", examples=[["F1", "F2"]]
    )


class KeepOutZone(Shaped):
    """Where no moved fiducial may be."""

    name: Name = Field(description="What is there: it is named when it binds.", examples=["clamp"])
    clearance_mm: Annotated[float, Field(ge=0, le=1e4)] = Field(
        default=0.0, description="Distance fiducial centres keep from the zone, mm. Default 0.", examples=[3.0]
    )


class Mirror(Record):
    """Reflection in a plane."""

    point_mm: Point = Field(
        default=(0.0, 0.0, 0.0), description="A point of the plane, con, mm. Default origin.", examples=[[0, 0, 0]]
    )
    normal: Direction = Field(description="Normal of the plane, con; any length.", examples=[[1, 0, 0]])


class Turn(Record):
    """Rotation by a fraction of a full turn."""

    point_mm: Point = Field(
        default=(0.0, 0.0, 0.0), description="A point of the axis, con, mm. Default origin.", examples=[[0, 0, 0]]
    )
    axis: Direction = Field(
        default=(0.0, 0.0, 1.0), description="Direction of the axis, con. Default z.", examples=[[0, 0, 1]]
    )
    order: Annotated[int, Field(ge=2, le=24)] = Field(
        description="Copies per turn: 3 repeats the pattern every 120 degrees.", examples=[3]
    )


class Symmetry(Record):
    """Free fiducials come in groups, in the order of the document, that map onto each other."""

    mirror: Mirror | None = Field(default=None, description="Pairs mirrored in a plane.")
    rotation: Turn | None = Field(default=None, description="Groups turned about an axis.")

    @model_validator(mode="after")
    def _one(self) -> Symmetry:
        if (self.mirror is None) == (self.rotation is None):
            given = "both" if self.mirror is not None else "neither"
            raise refusal("one-of", f"give exactly one of mirror and rotation; {given} arrived")
        direction = self.mirror.normal if self.mirror is not None else self.rotation.axis if self.rotation else ()
        if max(map(abs, direction)) < 1e-9:
            raise refusal("zero-direction", "a symmetry needs a direction; [0, 0, 0] arrived")
        return self
