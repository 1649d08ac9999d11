"""Arms of joints and links: forward kinematics, and what errors of joints and links do between two poses.

A joint is a fixed transform, its motion about or along an axis, and another fixed transform.  An error at a frame T of
the arm is a small screw s there: ``T exp(s e)`` in place of T.  Carried to the base, exact errors multiply, in the
order of the arm: ``F~(q) = E_1 E_2 ... F(q)`` with ``E_k = exp(s_k e_k)``, s_k the screw in the base at the nominal
pose.

A twist is (w, v): it moves a point x by ``w x x + v``; w has length one (a turn, rad) or is 0 (v then has length one, a
shift, mm).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from .arrays import Array
from .rotation import rigid_transform, skew


def screw(twist: Array, amount: Any) -> Array:
    """(..., 4, 4) finite motions by a twist (6,), amount (...) rad or mm."""
    w, v, amount = twist[:3], twist[3:], np.asarray(amount)[..., None]
    if not w.any():
        return rigid_transform(np.eye(3), v * amount)
    k = skew(w)
    turn = np.eye(3) + np.sin(amount)[..., None] * k + (1 - np.cos(amount))[..., None] * (k @ k)
    away = np.cross(w, v)  # of its axis from the origin
    return rigid_transform(turn, away - turn @ away + w * (w @ v) * amount)


def carry(transform: Array, twists: Array) -> Array:
    """Twists (..., 6) in the frame that a rigid transform (..., 4, 4) maps to."""
    turn, shift = transform[..., :3, :3], transform[..., :3, 3]
    w, v = ((turn @ each[..., None])[..., 0] for each in (twists[..., :3], twists[..., 3:]))
    return np.concatenate([w, v + np.cross(shift, w)], axis=-1)


def undo(transform: Array) -> Array:
    """(..., 4, 4) inverses of rigid ones."""
    back = np.swapaxes(transform[..., :3, :3], -1, -2)
    return rigid_transform(back, -(back @ transform[..., :3, 3:])[..., 0])


def move_at(twist: Array, point: Array) -> Array:
    """(..., 3) mm: how a twist (..., 6) moves a point (..., 3), per unit."""
    return np.asarray(np.cross(twist[..., :3], point) + twist[..., 3:])


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
