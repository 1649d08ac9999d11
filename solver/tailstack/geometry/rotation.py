"""Rotations, rigid motions, and small displacement torsors (Eqs 11-13), with the derivatives the linear model needs.

A rotation is three angles (rx, ry, rz), rad, composed as ``R = Rx(rx) Ry(ry) Rz(rz)`` (Eq 12).  The
small-angle form is ``R = I + [omega]x`` (Eq 13): first order in the angles, and *not* a rotation.

A twist is (w, v): it moves a point x by ``w x x + v``; w has length one (a turn, rad) or is 0 (v then has length one, a
shift, mm).
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np

from .arrays import Array


class RotationForm(StrEnum):
    """How small rotations act."""

    FULL = "full"  # Rx Ry Rz (Eq 12)
    SMALL_ANGLE = "small_angle"  # I + [omega]x (Eq 13)


def unit(vector: Array) -> Array:
    """(3,) of length one in the same direction."""
    return np.asarray(vector / np.linalg.norm(vector))


def turn_by(vector: Array) -> Array:
    """Rotation about a vector (..., 3) by its length, rad (Rodrigues)."""
    angle = np.linalg.norm(vector, axis=-1)[..., None, None]
    cross = skew(vector)
    return np.asarray(
        np.eye(3) + np.sinc(angle / np.pi) * cross + 0.5 * np.sinc(angle / (2 * np.pi)) ** 2 * (cross @ cross)
    )


def left_jacobian(vector: Array) -> Array:
    """(3, 3): ``turn_by(vector + d)`` is ``turn_by(left_jacobian(vector) @ d) @ turn_by(vector)`` to first order."""
    angle, cross = float(np.linalg.norm(vector)), skew(vector)
    third = (angle - np.sin(angle)) / angle**3 if angle > 1e-4 else 1 / 6
    return np.asarray(np.eye(3) + 0.5 * np.sinc(angle / (2 * np.pi)) ** 2 * cross + third * cross @ cross)


def skew(vector: Array) -> Array:
    """``[v]x`` with ``[v]x w = v x w``.  (..., 3) -> (..., 3, 3)."""
    v = np.asarray(vector, dtype=float)
    out = np.zeros((*v.shape, 3))
    out[..., 0, 1], out[..., 0, 2] = -v[..., 2], v[..., 1]
    out[..., 1, 0], out[..., 1, 2] = v[..., 2], -v[..., 0]
    out[..., 2, 0], out[..., 2, 1] = -v[..., 1], v[..., 0]
    return out


# What turns about x, y, z: what stays, what a cosine is of, what a sine is of; (3, 3, 3), axis first.
_TURNING = skew(np.eye(3))
_ALONG = np.eye(3) - _TURNING @ np.swapaxes(_TURNING, -1, -2)
_PLANE = np.eye(3) - _ALONG


def _axis_rotations(angles: Array) -> tuple[Array, Array]:
    """Rx, Ry, Rz stacked (..., 3, 3, 3), and the derivative of each by its own angle."""
    a = np.asarray(angles, dtype=float)[..., None, None]
    c, s = np.cos(a), np.sin(a)
    return _ALONG + c * _PLANE + s * _TURNING, c * _TURNING - s * _PLANE


def rotation_xyz(angles: Array, form: RotationForm = RotationForm.FULL) -> Array:
    """``Rx(rx) Ry(ry) Rz(rz)`` (Eq 12), or ``I + [omega]x`` (Eq 13).  angles (..., 3) rad -> (..., 3, 3)."""
    if form is RotationForm.SMALL_ANGLE:
        return np.eye(3) + skew(angles)
    r, _ = _axis_rotations(angles)
    return np.asarray(r[..., 0, :, :] @ r[..., 1, :, :] @ r[..., 2, :, :])


def rotation_derivatives(angles: Array, form: RotationForm = RotationForm.FULL) -> Array:
    """dR/d(rx), dR/d(ry), dR/d(rz) at ``angles``.  (..., 3) rad -> (..., 3, 3, 3), angle first."""
    if form is RotationForm.SMALL_ANGLE:
        a = np.asarray(angles, dtype=float)
        return np.broadcast_to(skew(np.eye(3)), (*a.shape[:-1], 3, 3, 3)).copy()
    r, d = _axis_rotations(angles)
    rx, ry, rz = r[..., 0, :, :], r[..., 1, :, :], r[..., 2, :, :]
    dx, dy, dz = d[..., 0, :, :], d[..., 1, :, :], d[..., 2, :, :]
    return np.stack([dx @ ry @ rz, rx @ dy @ rz, rx @ ry @ dz], axis=-3)


def torsor_transform(torsor: Array, pivot_mm: Array, form: RotationForm = RotationForm.FULL) -> Array:
    """The displacement ``X -> R (X - p) + p + t`` as a matrix (Eq 11 about a pivot).

    torsor (..., 6): (rx, ry, rz, tx, ty, tz), rad and mm; pivot_mm (3,), in the frame the displacement
    acts in.  Returns (..., 4, 4).
    """
    torsor = np.asarray(torsor, dtype=float)
    rotation = rotation_xyz(torsor[..., :3], form)
    out = np.zeros((*torsor.shape[:-1], 4, 4))
    out[..., :3, :3] = rotation
    out[..., :3, 3] = pivot_mm - rotation @ pivot_mm + torsor[..., 3:]
    out[..., 3, 3] = 1.0
    return out


def apply(matrix: Array, vector: Array) -> Array:
    """(..., 3, 3) times (..., 3), leading dimensions broadcast."""
    return np.asarray((matrix @ vector[..., None])[..., 0])


@dataclass(frozen=True, slots=True, eq=False)
class Displacement:
    """``x -> R x + s`` with the derivative of R by its three angles: what a mount does at its bias, for any point.

    Leading dimensions (...) are displacements side by side, and those of points are broadcast with them.
    """

    pivot_mm: Array  # (..., 3)
    rotation: Array  # (..., 3, 3)
    shift_mm: Array  # (..., 3) p - R p + t
    by_angle: Array  # (..., 3, 3, 3), angle first

    def move(self, point_mm: Array) -> Array:
        """(..., 3) -> (..., 3)."""
        return np.asarray(apply(self.rotation, point_mm) + self.shift_mm)

    def by_torsor(self, point_mm: Array) -> Array:
        """Derivative of the displaced point by the torsor at a point (..., 3) -> (..., 3, 6), mm/rad and mm/mm."""
        turned = apply(self.by_angle, (point_mm - self.pivot_mm)[..., None, :])  # angle first
        both = np.swapaxes(turned, -1, -2)
        return np.concatenate([both, np.broadcast_to(np.eye(3), both.shape)], axis=-1)

    def matrix(self) -> Array:
        """(..., 4, 4)."""
        return rigid_transform(self.rotation, self.shift_mm)


def displacement(torsor: Array, pivot_mm: Array, form: RotationForm = RotationForm.FULL) -> Displacement:
    """The displacement of a torsor (..., 6) about a pivot (..., 3), rad and mm, as :func:`torsor_transform` has it."""
    rotation = rotation_xyz(torsor[..., :3], form)
    shift = pivot_mm - apply(rotation, pivot_mm) + torsor[..., 3:]
    return Displacement(pivot_mm, rotation, shift, rotation_derivatives(torsor[..., :3], form))


def transform_points(transform: Array, points: Array) -> Array:
    """Apply (..., 4, 4) to points (..., N, 3) or to one point (3,)."""
    rotation, translation = transform[..., :3, :3], transform[..., :3, 3]
    if np.ndim(points) == 1:
        return np.asarray(rotation @ points + translation)
    return np.asarray(points @ np.swapaxes(rotation, -1, -2) + translation[..., None, :])


def rotation_from_quaternion(wxyz: Array) -> Array:
    """Rotation of a quaternion (w, x, y, z), scalar first; (4,) -> (3, 3).  It is normalised here."""
    q = np.asarray(wxyz, dtype=float)
    w, v = q[0] / np.linalg.norm(q), q[1:] / np.linalg.norm(q)
    return np.asarray((w * w - v @ v) * np.eye(3) + 2 * np.outer(v, v) + 2 * w * skew(v))


def rigid_transform(rotation: Array, translation_mm: Array) -> Array:
    """(..., 3, 3) and (..., 3) -> (..., 4, 4)."""
    out = np.zeros((*np.shape(translation_mm)[:-1], 4, 4))
    out[..., :3, :3] = rotation
    out[..., :3, 3] = translation_mm
    out[..., 3, 3] = 1.0
    return out


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


def rigidity_defect(rotation: Array) -> float:
    """How far (3, 3) is from a rotation: the largest entry of ``R'R - I``, or infinity for a reflection."""
    if np.linalg.det(rotation) <= 0:
        return float("inf")
    return float(np.abs(rotation.T @ rotation - np.eye(3)).max())
