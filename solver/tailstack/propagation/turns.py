"""What first order leaves out where mounts turn, and beside a known error, against the whole error: three numbers.

A mount that is turned by small angles a beyond its bias moves a point whose lever (from the pivot, as it stands at the
bias) is l by ``K_i l a_i`` to first order, and to second order by ``1/2 sum_ij K_i K_j l a_i a_j``, ``i <= j`` in the
order of ``Rx Ry Rz``; K_i is the cross product with the axis of angle i as it stands at the bias.  A rotation that is
undone (the structure's, in the physical reading) has the factors the other way round.  A turn also turns the errors of
all that comes before it.  So the second order ``x2 = 1/2 z'Hz`` of the mounts is known in closed form, with z their
torsors and the error of localisation by the images, and the levers hold every known error of what comes before.

**Size**: ``sqrt(E|x2|^2 / E|e|^2)``, e the whole error to first order, its known part included.  Without a known error
P95 errs in proportion to its square.  A structure that its mount turns is seen from elsewhere, so that the gains of
images are others; the second moment of their change times the noise is part of it, counted twice, for P95 errs by up to
twice its square and by some 0.7 of the rest.

**Along the bias**: a known error b that lies along the lever is shortened by every turn, whatever its sign, and P95
errs in proportion to the turn itself: with b = L s u (L the lever, s the turn about each of two axes) by b L s^2 u^2
and so on.  With ``c1 = E|e|^2`` and ``2 c2`` the variance of ``|e|^2``, x2 changes them, S = J C J' the covariance of
the error and ``T_k = (J C) H_k (J C)'``, by

    dc1 = 2 b.m,    dc2 = 2 (2 b'S m + 2 sum_k (T_k b)_k + sum_k b_k tr T_k),    m = E x2,

for normal z, and ``P95^2 = c1 + kappa sqrt(c2)``, where kappa is that of the chi-squared law with the same third
cumulant (Pearson's form).  The number is the relative change of P95, both terms taken
to have the same sign.

**Images beside the bias**: what images do has a second order too, and nu is its standard deviation over the first.
Without a known error P95 errs in proportion to the square of nu.  A known error lies on one side, where the error is
longer, or shorter, by the factor ``1 + nu z``, and P95 errs in proportion to nu.  Which z that is nu does not tell: the
number is the same change of P95 for ``x2 = nu z x1`` with z along the longest axis of the error by the images.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import sqrt
from typing import NamedTuple

import numpy as np

from ..geometry.arrays import Array
from ..geometry.rotation import Displacement
from ..system import DirectEffect

NORMAL_95 = 1.6448536269514722
ANGLES_1, SHIFTS_1, IMAGES = slice(0, 3), slice(3, 6), slice(6, 9)
ANGLES_2, SHIFTS_2, ANGLES_3, SHIFTS_3 = slice(9, 12), slice(12, 15), slice(15, 18), slice(18, 21)
SIZE = 21


class Turns(NamedTuple):
    """What first order leaves out where mounts turn (see the module)."""

    size: float = 0.0
    along_bias: float = 0.0
    images_beside_bias: float = 0.0

    def larger(self, other: Turns) -> Turns:
        return Turns(*map(max, self, other))


NO_TURNS = Turns()
UPPER = np.triu(np.ones((3, 3)))
STRICTLY_UPPER = np.triu(np.ones((3, 3)), 1)


def _axes(act: Displacement) -> Array:
    """(3, 3, 3): of each angle the cross product with its axis, at the bias."""
    return np.asarray(act.by_angle @ act.rotation.T)


def _bent(axes: Array, lever: Array, undone: bool = False) -> Array:
    """(3, 3, 3) second derivative of a turned lever by two angles; first index: the component."""
    twice = (axes @ (axes @ lever).T).transpose(1, 0, 2)
    if undone:
        twice = twice.transpose(0, 2, 1)
    return np.asarray(UPPER * twice + (STRICTLY_UPPER * twice).transpose(0, 2, 1))


def _along(turn: Array, second: Array) -> Array:
    """A second derivative (3, n, n) turned (3, 3)."""
    return np.asarray((turn @ second.reshape(3, -1)).reshape(second.shape))


def second_order(
    acts: Sequence[Displacement],
    mounts: Sequence[DirectEffect],
    to_tool: Array,
    points: Sequence[Array],
    physical: bool,
) -> tuple[Array, Array, Array, Array]:
    """Derivatives of the error of localisation, con, and at the tool, tcp, by z: (3, SIZE) and (3, SIZE, SIZE) each.

    z: torsor of the first mount, error of localisation by the images (con), torsors of the second and of hand-eye.
    acts, mounts: of these three; to_tool (3, 3) the rotation con -> tcp; points: (3,) mm that the three displace, the
    first in con as it is reconstructed, whether the first is undone (physical) or not.
    """
    first, second, third = acts
    axes = [_axes(act) for act in acts]
    levers = [act.rotation @ (point - mount.pivot_mm) for act, point, mount in zip(acts, points, mounts, strict=True)]
    jacobian, bent = np.zeros((3, SIZE)), np.zeros((3, SIZE, SIZE))
    jacobian[:, IMAGES] = np.eye(3)
    back = first.rotation.T if physical else np.eye(3)
    sign = -1.0 if physical else 1.0
    jacobian[:, ANGLES_1] = sign * back @ (axes[0] @ levers[0]).T
    jacobian[:, SHIFTS_1] = sign * back
    bent[:, ANGLES_1, ANGLES_1] = _along(back, _bent(axes[0], levers[0], physical))
    if physical:  # what is undone is the shifted point
        mixed = (back @ axes[0]).transpose(1, 0, 2)
        bent[:, ANGLES_1, SHIFTS_1] = mixed
        bent[:, SHIFTS_1, ANGLES_1] = mixed.transpose(0, 2, 1)
    local = jacobian, bent
    for act, own, lever, angles, shifts, turn in (
        (second, axes[1], levers[1], ANGLES_2, SHIFTS_2, np.eye(3)),
        (third, axes[2], levers[2], ANGLES_3, SHIFTS_3, to_tool),
    ):
        onward = act.rotation @ turn
        before = onward @ jacobian
        bent = _along(onward, bent)
        turned = (own @ before).transpose(1, 0, 2)  # (3, angle, SIZE)
        bent[:, angles] += turned
        bent[:, :, angles] += turned.transpose(0, 2, 1)
        bent[:, angles, angles] += _bent(own, lever)
        jacobian = before
        jacobian[:, angles] += (own @ lever).T
        jacobian[:, shifts] += np.eye(3)
    return *local, jacobian, bent


def images_beside_bias(nu: float, covariance: Array, to_error: Array, total: Array, bias: Array) -> float:
    """The third number of one error.

    covariance (3, 3) mm^2 of localisation by the images; to_error (3, 3) from that to this error; total (3, 3) mm^2,
    covariance of the whole error, and its bias (3,) mm.
    """
    squares, axes = np.linalg.eigh(covariance)
    if squares[2] <= 0.0 or not bias.any():
        return 0.0
    per_mm = nu / sqrt(squares[2]) * axes[:, 2]  # nu z, by mm of the error
    once = np.eye(3)[:, :, None] * per_mm
    second = once + once.transpose(0, 2, 1)
    return turns_of(to_error, _along(to_error, second), covariance, total, bias).along_bias


def turns_of(
    jacobian: Array, second: Array, covariance: Array, total: Array, bias: Array, gains_moved: float = 0.0
) -> Turns:
    """The first two numbers of one error.

    jacobian (3, SIZE) and second (3, SIZE, SIZE): its derivatives by z; covariance (SIZE, SIZE) of z; total (3, 3)
    mm^2, covariance of the whole error, and its bias (3,) mm; gains_moved mm^2: see the module.
    """
    c1 = float(total.trace() + bias @ bias)
    through = second @ covariance
    mean = 0.5 * through.trace(axis1=1, axis2=2)
    square = float(mean @ mean) + 0.5 * float((through * through.transpose(0, 2, 1)).sum()) + 2.0 * gains_moved
    if square <= 0.0 or c1 <= 0.0:
        return NO_TURNS
    size, pulled = sqrt(square / c1), total @ bias
    c2 = float((total * total).sum() + 2.0 * bias @ pulled)
    c3 = float(((total @ total) * total).sum() + 3.0 * pulled @ pulled)
    if c2 <= 0.0 or c3 <= 0.0:  # nothing random, or so little that its powers are no numbers any more
        return Turns(size, 0.0)
    bent = (jacobian @ covariance) @ through @ jacobian.T
    wide = c2 * (c2 / c3) ** 2
    kappa = sqrt(wide) * ((1.0 - 2.0 / (9.0 * wide) + NORMAL_95 * sqrt(2.0 / (9.0 * wide))) ** 3 - 1.0)
    of_mean = 2.0 * float(bias @ mean)
    by_spread = float(2.0 * pulled @ mean + 2.0 * (bent @ bias).trace() + bias @ bent.trace(axis1=1, axis2=2))
    change = abs(of_mean) + abs(by_spread) * kappa / sqrt(c2)
    return Turns(size, change / (2.0 * (c1 + kappa * sqrt(c2))))
