"""The arm between the shots and the tool: errors of its joints and links, where the tool is set at another pose.

The structure rides on the flange, so that the shots find the target where it is against the flange at the imaging pose
q1, whatever the arm believes of itself.  The arm then goes to q2.  With F the kinematics that the controller computes
by and F~ those of the arm, a point x of the flange at q1 should meet the tool, and misses it by

    e = G x - x,  G = F~(q1)^-1 F~(q2) F(q2)^-1 F(q1)  (flange at q1; 1 where q1 = q2; where the base is, is no matter).

To first order ``e = (J(q2, x) - J(q1, x)) dp``, J(q, x) the columns ``w x x + v`` of the errors dp at pose q, all in
the flange at q1 and at the same point x: what both poses share acts by the difference, what is drawn at each by its
own.  At the tool it is ``e`` turned by T_tcp_flange: in tcp as it stood at q1, as all that is located.

A joint is a fixed transform, its motion about or along an axis, and another fixed transform.  An error at a frame T of
the arm is a small screw s there: ``T exp(s e)`` in place of T.  Carried to the base, exact errors multiply, in the
order of the arm: ``F~(q) = E_1 E_2 ... F(q)`` with ``E_k = exp(s_k e_k)``, s_k the screw in the base at the nominal
pose.  So G is a product of screws: those at q2, then those at q1 undone.  Screws that are the same at both poses undo
one another and are left out; so does the whole arm where q1 = q2.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import takewhile
from math import radians
from typing import Annotated, Any, Literal, NamedTuple, Self

import numpy as np
from pydantic import Field, model_validator

from ..errors import Problem
from ..fields import (
    Angles,
    Coordinate,
    Degrees,
    Direction,
    Name,
    Point,
    Record,
    Typical,
    leave_out_later,
    only_one,
    refusal,
)
from ..geometry.arrays import Array, frozen
from ..geometry.rotation import carry, move_at, rigid_transform, screw, undo
from ..laws import Drawn
from ..ranges import JOINT_SD_DEG, LINK_SD_DEG, LINK_SD_MM, AnySize
from ..system import Act, Effect, Place, Scene, System
from ..tolerances import HowOften, Source, gather_sources, level_field
from .kind import EffectKind, Limit, Pivots, Proportional, Setting

GRAVITY = 9.80665  # m/s^2
MOST_JOINTS = 10
MOST_LINKS = 30  # joints that move and joints that are fixed
LARGEST_DEG = 1.0  # first order leaves out half the angle of what it turns by: at most 0.9 %

_BY_JOINT = (
    "joints_imaging_deg", "joints_executing_deg", "joint_sd_deg", "repeatability_sd_deg", "stiffness_nm_per_rad",
)  # fmt: skip
_ANY = AnySize("an arm has links of any size and stands in any pose")
_Turn = Annotated[Degrees, Typical(-120, 120), _ANY]
_Length = Annotated[Coordinate, Typical(-400, 400), _ANY]
_Turns = Annotated[list[_Turn], Field(min_length=1, max_length=MOST_JOINTS)]
_Sd = Annotated[float, Field(ge=0, le=LARGEST_DEG), Typical(0.002, 0.05), JOINT_SD_DEG]
_Sds = Annotated[list[_Sd], Field(min_length=1, max_length=MOST_JOINTS)]
_Stiffness = Annotated[
    float, Field(ge=1, le=1e8), Typical(1e4, 1e6), AnySize("of a joint, or of a slide, from 1 to rigid")
]
_Stiffnesses = Annotated[list[_Stiffness], Field(min_length=1, max_length=MOST_JOINTS)]
_Mass = Annotated[
    float, Field(ge=0, le=1000), Typical(0.5, 5), AnySize("from a probe to a C-arm, and known by weighing")
]

# --- the arm: forward kinematics, and what errors of joints and links do at a pose ------------------------

TWIST = dict(zip(("rx", "ry", "rz", "x", "y", "z"), np.eye(6), strict=True))


class LinkParameter(NamedTuple):
    """A parameter of the arm that may be off: its name, and its twist in the frame where it acts."""

    name: str
    twist: Array  # (6,)


@dataclass(frozen=True, slots=True, eq=False)
class Joint:
    """A joint and the links beside it.  In the order of the arm: ``before``, errors of its links ``leading``, its
    motion, ``after``, errors ``trailing``; of DH parameters, whose screws lie between, see :func:`dh_joint`."""

    name: str
    twist: Array  # (6,) of its motion, in its frame
    before: Array  # (4, 4)
    after: Array  # (4, 4)
    leading: tuple[LinkParameter, ...] = ()
    trailing: tuple[LinkParameter, ...] = ()

    @property
    def turns(self) -> bool:
        return bool(self.twist[:3].any())

    @property
    def moves(self) -> bool:
        return bool(self.twist.any())


def dh_joint(
    name: str, lengths_mm: tuple[float, float], angles: tuple[float, float], turns: bool, modified: bool
) -> Joint:
    """A joint of Denavit-Hartenberg parameters: lengths a and d, mm, angles alpha and theta, rad.

    Standard (Denavit and Hartenberg 1955): ``Rz(theta) Tz(d) Tx(a) Rx(alpha)``; modified (Craig):
    ``Rx(alpha) Tx(a) Rz(theta) Tz(d)``.  What moves adds to theta, or to d where it slides.
    """
    (a, d), (alpha, theta) = lengths_mm, angles
    along_z = screw(TWIST["rz"], theta) @ screw(TWIST["z"], d)
    along_x = screw(TWIST["x"], a) @ screw(TWIST["rx"], alpha)
    # screws about one line commute: a and alpha act at the end of x, or before it, and d along z, as theta does
    of_x = (LinkParameter("a", TWIST["x"]), LinkParameter("alpha", TWIST["rx"]))
    of_z = LinkParameter("d", TWIST["z"]) if turns else LinkParameter("theta", TWIST["rz"])
    twist = TWIST["rz" if turns else "z"]
    if modified:
        return Joint(name, twist, along_x, along_z, (*of_x, of_z))
    return Joint(name, twist, np.eye(4), along_z @ along_x, (of_z,), of_x)


def rpy_joint(name: str, place_mm: Array, rpy: Array, twist: Array) -> Joint:
    """A joint of URDF: it stands at an origin, ``Rz(yaw) Ry(pitch) Rx(roll)``, rad; twist 0: it is fixed.

    Its frame is off in six ways, or in five beside that in which it moves, which is off by its zero.
    """
    turns = [screw(TWIST[axis], angle) for axis, angle in zip(("rx", "ry", "rz"), rpy, strict=True)]
    origin = rigid_transform((turns[2] @ turns[1] @ turns[0])[:3, :3], place_mm)
    ways = dict(TWIST)
    if twist.any():  # a reflection lays the nearest way along it, and the others beside it
        nearest = max(TWIST, key=lambda way: abs(TWIST[way] @ twist))
        away = twist - np.sign(TWIST[nearest] @ twist) * ways.pop(nearest)
        ways = {way: each - 2 * away * (away @ each) / max(float(away @ away), 1e-300) for way, each in ways.items()}
    return Joint(name, twist, origin, np.eye(4), tuple(LinkParameter(*each) for each in ways.items()))


class PlacedError(NamedTuple):
    """An error of an arm at a pose: the joint it belongs to, its name there, and its twist (6,) in the base."""

    joint: int
    name: str
    twist: Array  # (..., 6)


MOTION = "joint"  # the name of the error of a joint's own motion


def place_errors(arm: Sequence[Joint], values: Iterable[Any]) -> tuple[list[PlacedError], Array]:
    """The errors of an arm in the order that they act in, and the pose (..., 4, 4) of its tip in its base; values: of
    the joints, rad or mm, (...) each."""
    frame, errors = np.eye(4), []
    for index, (joint, value) in enumerate(zip(arm, values, strict=True)):
        frame = frame @ joint.before
        errors += _place(index, (*joint.leading, LinkParameter(MOTION, joint.twist)), frame)
        frame = frame @ screw(joint.twist, value) @ joint.after
        errors += _place(index, joint.trailing, frame)
    return errors, frame


def _place(joint: int, parameters: Sequence[LinkParameter], frame: Array) -> list[PlacedError]:
    twists = carry(frame[..., None, :, :], np.array([each.twist for each in parameters]).reshape(-1, 6))
    return [PlacedError(joint, each.name, twists[..., k, :]) for k, each in enumerate(parameters)]


# --- the section of the document --------------------------------------------------------------------------


class DhJoint(Record):
    """A joint by its four Denavit-Hartenberg parameters; lengths in mm, angles in degrees, as data sheets have them."""

    name: Name | None = Field(default=None, examples=["elbow"])
    """Name; default J1, J2, ... by position."""
    type: Literal["revolute", "prismatic"] = Field(default="revolute", examples=["revolute"])
    """Whether it turns (theta is its value) or slides (d is). Default revolute."""
    a_mm: _Length = Field(default=0.0, examples=[-425.0])
    """a, mm. Default 0."""
    alpha_deg: _Turn = Field(default=0.0, examples=[90.0])
    """alpha, degrees. Default 0."""
    d_mm: _Length = Field(default=0.0, examples=[162.5])
    """d, mm; of a slide, where its value is 0."""
    theta_deg: _Turn = Field(default=0.0, examples=[0.0])
    """theta, degrees; of a turn, where its value is 0."""


class ArmJoint(Record):
    """A joint as URDF has it, in mm and degrees: the frame in which it moves, in that of the joint before it."""

    name: Name = Field(examples=["elbow_joint"])
    """Name."""
    type: Literal["revolute", "prismatic", "fixed"] = Field(default="revolute", examples=["revolute"])
    """Whether it turns, slides, or is fixed and has no value. Default revolute."""
    xyz_mm: Annotated[Point, _ANY] = Field(default=(0.0, 0.0, 0.0), examples=[[0.0, 0.0, 162.5]])
    """Origin, mm. Default 0."""
    rpy_deg: Annotated[Angles, _ANY] = Field(default=(0.0, 0.0, 0.0), examples=[[0.0, 90.0, 0.0]])
    """Roll, pitch and yaw, degrees: Rz(yaw) Ry(pitch) Rx(roll). Default 0."""
    axis: Direction = Field(default=(0.0, 0.0, 1.0), examples=[[0, 0, 1]])
    """About or along which it moves. Default its z."""

    @property
    def joint(self) -> Joint:
        axis, still = np.array(self.axis) / np.linalg.norm(self.axis), np.zeros(3)
        halves = {"revolute": (axis, still), "prismatic": (still, axis), "fixed": (still, still)}[self.type]
        return rpy_joint(self.name, np.array(self.xyz_mm), np.deg2rad(self.rpy_deg), np.concatenate(halves))


class UrdfChain(Record):
    """Where the joints stand in a URDF file."""

    file: Annotated[str, Field(min_length=1, max_length=400)] = Field(examples=["robots/arm.urdf"])
    """URDF file beside the design (relative path); not in a request, which has joints."""
    base_link: Name | None = Field(default=None, examples=["base"])
    """Link at the base. Default its root."""
    tip_link: Name | None = Field(default=None, examples=["tool0"])
    """Link that is the flange of transforms.T_flange_con. Default its only end."""


class ParameterSd(Record):
    """Standard deviations of the geometry: how well the arm was calibrated."""

    length_mm: Annotated[float, Field(ge=0, le=10), Typical(0.01, 0.2), LINK_SD_MM] = Field(
        default=0.0, examples=[0.05]
    )
    """Of each length, mm. Default 0."""
    angle_deg: Annotated[float, Field(ge=0, le=LARGEST_DEG), Typical(0.002, 0.05), LINK_SD_DEG] = Field(
        default=0.0, examples=[0.01]
    )
    """Of each angle between links, degrees. Default 0."""


class Robot(Record):
    """The arm, in both poses, and how far it may be off.  A slide's values are in mm where joints' are in degrees."""

    dh: Annotated[list[DhJoint], Field(min_length=1, max_length=MOST_JOINTS)] | None = None
    """The arm by Denavit-Hartenberg parameters, from the base to the flange. Either this, joints or urdf."""
    dh_convention: Literal["standard", "modified"] | None = Field(default=None, examples=["standard"])
    """With dh. standard: Rz(theta) Tz(d) Tx(a) Rx(alpha) of each joint; modified (Craig): Rx(alpha) Tx(a) Rz(theta)
    Tz(d)."""
    joints: Annotated[list[ArmJoint], Field(min_length=1, max_length=MOST_LINKS)] | None = None
    """The arm by the frames of its joints, from the base to the flange."""
    urdf: UrdfChain | None = None
    """The arm by a file, which is read into joints."""
    joints_imaging_deg: _Turns = Field(examples=[[0.0, -90.0, 90.0, 0.0, 90.0, 0.0]])
    """Values of the joints where the shots are taken, degrees (a slide: mm)."""
    joints_executing_deg: _Turns = Field(examples=[[20.0, -70.0, 80.0, 10.0, 90.0, 0.0]])
    """Values of the joints where the tool is at work, degrees (a slide: mm)."""
    joint_sd_deg: _Sd | _Sds | None = Field(default=None, examples=[0.01])
    """Standard deviation of the zero of each joint's encoder, degrees (a slide: mm): one number, or one a joint.
    Absent: exact."""
    parameter_sd: ParameterSd | None = None
    """Of lengths and angles. Absent: exact."""
    repeatability_sd_deg: _Sd | _Sds | None = Field(default=None, examples=[0.002])
    """Standard deviation of each joint about what it is told, degrees (a slide: mm), drawn anew at each of the two
    poses: backlash and scatter. One number, or one a joint. Absent: none."""
    stiffness_nm_per_rad: _Stiffnesses | None = Field(default=None, examples=[[4e4, 4e4, 3e4, 1e4, 1e4, 1e4]])
    """Stiffness of each joint, Nm/rad (a slide: N/mm), where the controller does not allow for the sag of the payload.
    Only with payload_kg. Absent: rigid."""
    payload_kg: _Mass | None = Field(default=None, examples=[2.5])
    """Mass on the flange, kg."""
    payload_centre_mm: Annotated[Point, Typical(-100, 100)] = Field(
        default=(0.0, 0.0, 0.0), examples=[[0.0, 0.0, 80.0]]
    )
    """Its centre of mass in flange, mm."""
    up: Annotated[Direction, Typical(-1, 1)] = Field(default=(0.0, 0.0, 1.0), examples=[[0, 0, 1]])
    """Upwards, in the base of the arm. Default its z."""
    drawn: HowOften = level_field(Drawn.UNIT, "what belongs to the arm (encoders, links)")

    _as_before = leave_out_later("drawn")

    _one_arm = only_one("dh", "joints", "urdf", needed="urdf: {file: arm.urdf}")

    @model_validator(mode="after")
    def _fit(self) -> Self:
        for first, second in (("dh", "dh_convention"), ("stiffness_nm_per_rad", "payload_kg")):
            stated = [name for name in (first, second) if getattr(self, name) is not None]
            if len(stated) == 1:
                missing = second if stated[0] == first else first
                detail = f"{stated[0]} is read only with {missing}"
                raise refusal("missing-field", detail, f"state {missing}", stated[0])
        return self

    @property
    def arm(self) -> tuple[Joint, ...]:
        """Its joints, mm and rad; of a file, those that were read of it."""
        if self.dh is None:
            return tuple(each.joint for each in self.joints or ())
        return tuple(
            dh_joint(
                joint.name or f"J{index + 1}",
                (joint.a_mm, joint.d_mm),
                (radians(joint.alpha_deg), radians(joint.theta_deg)),
                joint.type == "revolute",
                self.dh_convention == "modified",
            )
            for index, joint in enumerate(self.dh)
        )


class OfExecution(Record):
    """What the execution says of it."""

    robot: Robot | None = None
    """The arm that carries the structure from the shots to where the tool is at work, and its errors. Absent: it does
    so exactly."""


@dataclass(frozen=True, slots=True, eq=False)
class RobotEffect(Effect):
    """Parameters turn the screws of an arm by ``amounts``; they act on a point one after another, the first first."""

    twists: Array  # (S, 6) flange at the imaging pose, of all effects of the arm
    amounts: Array  # (S, m) of each parameter

    def act(self, scene: Scene) -> tuple[Act, ...]:
        return (Act(Place.ARM, None, self.amounts, twists=self.twists),)

    @property
    def places(self) -> tuple[tuple[Place, str | None], ...]:
        return ((Place.ARM, None),)


class Screw(NamedTuple):
    """One of the screws of the arm: of which pose (0: imaging), and undone there."""

    pose: int
    error: PlacedError

    @property
    def sign(self) -> float:
        return 1.0 if self.pose else -1.0


def screws_of(
    first: Sequence[PlacedError], second: Sequence[PlacedError], flange: Array, anew: bool
) -> tuple[list[Screw], Array]:
    """The screws that act on a point, in their order, and their twists (S, 6) in the flange at the imaging pose.

    first, flange: the errors there and the pose (4, 4) of the flange, second: the errors at the executing pose; anew:
    whether joints have errors that the poses do not share.
    """

    def are_shared(pair: tuple[PlacedError, PlacedError]) -> bool:
        return np.array_equal(pair[0].twist, pair[1].twist) and not (anew and pair[0].name == MOTION)

    same = len(list(takewhile(are_shared, zip(first, second, strict=True))))
    screws = [*(Screw(1, each) for each in reversed(second[same:])), *(Screw(0, each) for each in first[same:])]
    twists = np.array([each.error.twist for each in screws]).reshape(-1, 6)
    return screws, frozen(carry(undo(flange), twists))


def _values(arm: Sequence[Joint], stated: Any) -> list[Any]:
    """What a document says of each joint that moves, rad and mm, and 0 of those that are fixed; one number says it of
    all."""
    each = iter(stated if isinstance(stated, list) else [stated or 0.0] * len(arm))
    values = [next(each) if joint.moves else 0.0 for joint in arm]
    return [np.deg2rad(value) if joint.turns else value for joint, value in zip(arm, values, strict=True)]


class _Compiled(NamedTuple):
    arm: tuple[Joint, ...]
    screws: list[Screw]
    twists: Array
    sag: Array  # (2, joints) rad and mm: what the payload turns each joint by, at each pose


def _sag(robot: Robot, arm: Sequence[Joint], errors: Sequence[PlacedError], flange: Array) -> list[Any]:
    """How far the payload turns each joint, rad and mm; errors, flange: of one pose, or of many (...)."""
    if robot.stiffness_nm_per_rad is None or robot.payload_kg is None:
        return [0.0] * len(arm)
    up = np.array(robot.up) / np.linalg.norm(robot.up)
    centre = flange[..., :3, :3] @ np.array(robot.payload_centre_mm) + flange[..., :3, 3]
    motions, stiffness = (each for each in errors if each.name == MOTION), iter(robot.stiffness_nm_per_rad)
    sag: list[Any] = []
    for joint, motion in zip(arm, motions, strict=True):
        push = -robot.payload_kg * GRAVITY * (move_at(motion.twist, centre) @ up)  # N mm, of a slide N
        sag.append(push * (1e-3 if joint.turns else 1.0) / next(stiffness) if joint.moves else 0.0)
    return sag


def _compile_arm(robot: Robot) -> _Compiled:
    arm = robot.arm
    first, flange = place_errors(arm, _values(arm, robot.joints_imaging_deg))
    second, there = place_errors(arm, _values(arm, robot.joints_executing_deg))
    sag = np.array([_sag(robot, arm, first, flange), _sag(robot, arm, second, there)])
    anew = robot.repeatability_sd_deg is not None or bool(sag.any())
    screws, twists = screws_of(first, second, flange, anew)
    return _Compiled(arm, screws, twists, sag)


def _compile(section: OfExecution, setting: Setting) -> Iterator[Effect]:
    """An effect for each joint: its zero, its links, and how far it sags at each pose; then the scatter at each."""
    if (robot := section.robot) is None:
        return
    compiled, at = _compile_arm(robot), f"{setting.pointer}/robot"
    arm, screws, twists, sag = compiled
    sizes = robot.parameter_sd or ParameterSd()
    for index, (joint, zero) in enumerate(zip(arm, _values(arm, robot.joint_sd_deg), strict=True)):
        stated = [(MOTION, "rad" if joint.turns else "mm", zero)]
        for link in (*joint.leading, *joint.trailing):
            turns = bool(link.twist[:3].any())
            width = radians(sizes.angle_deg) if turns else sizes.length_mm
            stated.append((link.name, "rad" if turns else "mm", width))
        parameters = [name for name, _, _ in stated]
        amounts = np.zeros((len(screws), len(parameters) + 2))
        for row, each in enumerate(screws):
            if each.error.joint == index:
                amounts[row, parameters.index(each.error.name)] = each.sign
                if each.error.name == MOTION:
                    amounts[row, len(parameters) + each.pose] = each.sign
        ways = np.eye(len(parameters) + 2)
        pairs = zip(stated, ways, strict=False)
        given = [Source(name, "normal", width, 1.0, unit, way) for (name, unit, width), way in pairs if width > 0]
        sources = gather_sources(given, len(ways))
        known = frozen([*np.zeros(len(parameters)), *sag[:, index]])
        name, label = f"robot:{joint.name}", f"robot, {joint.name}"
        yield RobotEffect(name, label, at, robot.drawn, sources, known, twists, frozen(amounts))
    if robot.repeatability_sd_deg is not None:
        yield _scatter(compiled, _values(arm, robot.repeatability_sd_deg), at)


def _scatter(compiled: _Compiled, widths: Sequence[float], at: str) -> RobotEffect:
    """What every joint does at each pose anew, standard deviations rad and mm."""
    arm, screws, twists, _ = compiled
    stated, amounts = [], np.zeros((len(screws), 2 * len(arm)))
    for index, (joint, width) in enumerate(zip(arm, widths, strict=True)):
        if not joint.moves:
            continue
        for pose, word in enumerate(("imaging", "executing")):
            way = np.eye(2 * len(arm))[2 * index + pose]
            stated.append(Source(f"{joint.name}.{word}", "normal", width, 1.0, "rad" if joint.turns else "mm", way))
    for row, each in enumerate(screws):
        if each.error.name == MOTION:
            amounts[row, 2 * each.error.joint + each.pose] = each.sign
    name = "joint_scatter"
    known = frozen(np.zeros(2 * len(arm)))
    sources = gather_sources(stated, 2 * len(arm))
    return RobotEffect(name, name.replace("_", " "), at, Drawn.SHOT, sources, known, twists, frozen(amounts))


class ErrorsAt(NamedTuple):
    """What n poses of the tool make of the error of a point of the flange, by first order; in the axes of the flange at
    the imaging pose."""

    known: Array  # (n, 3) mm
    covariance: Array  # (n, 3, 3) mm^2
    place: Array  # (n, 3) mm: where the point then is, in the base


def errors_at(robot: Robot, effects: Sequence[Effect], executing: Array, point_mm: Array) -> ErrorsAt:
    """executing (n, joints that move) deg and mm, in place of the robot's own; effects: that it compiles to; point (3,)
    mm, flange."""
    arm = robot.arm
    first, flange = place_errors(arm, _values(arm, robot.joints_imaging_deg))
    second, there = place_errors(arm, _values(arm, list(executing.T)))
    sags = zip(_sag(robot, arm, first, flange), _sag(robot, arm, second, there), strict=True)
    spread = {
        (each.name, name): std
        for each in effects
        for name, std in zip(each.sources.names, each.sources.std, strict=True)
    }
    point = flange[:3, :3] @ point_mm + flange[:3, 3]
    known, columns = np.zeros((len(executing), 3)), []
    for one, other in zip(first, second, strict=True):
        name, gains = arm[one.joint].name, (-move_at(one.twist, point), move_at(other.twist, point))
        columns.append(spread.get((f"robot:{name}", one.name), 0.0) * (gains[0] + gains[1]))
        if one.name == MOTION:
            for gain, word, sag in zip(gains, ("imaging", "executing"), next(sags), strict=True):
                columns.append(spread.get(("joint_scatter", f"{name}.{word}"), 0.0) * gain)
                known += gain * np.asarray(sag)[..., None]
    moved = np.stack(np.broadcast_arrays(known, *columns)[1:], axis=-1)  # (n, 3, K)
    turn, place = flange[:3, :3], there[:, :3, :3] @ point_mm + there[:, :3, 3]
    return ErrorsAt(known @ turn, turn.T @ (moved @ np.swapaxes(moved, 1, 2)) @ turn, place)


def _check(section: OfExecution, pivots_mm: Pivots) -> Iterator[Problem]:
    """Lists are as long as the arm has joints that move, and names differ."""
    if (robot := section.robot) is None:
        return
    arm, at = robot.arm, "/execution/robot"
    count = sum(joint.moves for joint in arm)
    for field in _BY_JOINT:
        value = getattr(robot, field)
        if isinstance(value, list) and len(value) != count:
            detail = f"{field} has {len(value)} values; {count} joints of the arm move"
            yield Problem(f"{at}/{field}", "wrong-length", detail, "one value a joint, from the base to the flange")
    names = [joint.name for joint in arm]
    if twice := [name for name in names if names.count(name) > 1]:
        field = "joints" if robot.dh is None else "dh"  # a file was read into joints
        yield Problem(f"{at}/{field}", "duplicate-name", f"two joints are called {twice[0]!r}", "names are unique")


def _not_modelled(system: System) -> str:
    if not system.effects_at(Place.ARM):
        return "errors of the robot between the pose of the shots and that of the tool"
    return "flexibility of the robot's links, and the turn of the tool's axes from the pose of the shots to its own"


def _limits(system: System) -> Iterator[Limit]:
    """First order leaves out half the angle of what an arm's joints turn by together, at twice their deviation."""
    total = 0.0
    for effect in system.effects_at(Place.ARM):
        turns = np.array([unit == "rad" for unit in effect.sources.units], dtype=bool)
        total += float(((2 * effect.sources.std[turns]) ** 2).sum())
    yield Proportional("a robot whose joints and links turn by {} %", total**0.5)


KIND = EffectKind(
    host="execution", section=OfExecution, compile=_compile, check=_check, not_modelled=_not_modelled, limits=_limits
)
