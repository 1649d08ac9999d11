"""Six point contacts (3-2-1) into the small displacement torsor they allow.

A contact at ``p_i`` with unit normal ``n_i`` that deviates by ``delta_i`` moves the part so that

    n_i . (t + w x (p_i - p)) = delta_i,     i = 1 ... 6,

that is ``G (w, t) = delta`` with the rows ``((p_i - p) x n_i, n_i)``; the torsor is ``G^-1 delta``, and the
columns of ``G^-1`` are what one millimetre at each contact does (Bourdet's small displacement torsor).
When G is singular the contacts leave the part free to move, and its null vector is that motion.
"""

from __future__ import annotations

import numpy as np

from ..arrays import Array
from ..errors import IllPosedError, Problem
from ..geometry.naming import direction_name, point_name

SINGULAR = 1e-9  # smallest over largest singular value, rotations measured at the contacts' own radius


def torsor_from_locators(positions_mm: Array, normals: Array, pivot_mm: Array, pointer: str = "") -> Array:
    """Torsor at the pivot per mm of deviation of each contact.

    positions_mm (6, 3), normals (6, 3), pivot_mm (3,), all in con; normals of any length.  Returns (6, 6):
    rows (rx, ry, rz, tx, ty, tz) in rad/mm and mm/mm, columns the contacts.  Raises IllPosedError that
    names the motion the contacts leave free.
    """
    unit = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    centre = positions_mm.mean(axis=0)
    # Solve at the contacts' centre, in units of their radius: conditioning then says something about the seat
    # and nothing about where the pivot was put.
    radius = max(float(np.sqrt(((positions_mm - centre) ** 2).sum(axis=1).mean())), 1e-6)
    rows = np.hstack([np.cross((positions_mm - centre) / radius, unit), unit])
    left, values, right = np.linalg.svd(rows)
    if values[-1] <= SINGULAR * values[0]:
        free = right[values <= SINGULAR * values[0]]
        motions = [describe_motion(vector[:3] / radius, vector[3:], centre, radius) for vector in _tidy(free)]
        raise IllPosedError(
            Problem(
                pointer,
                "free-motion",
                f"the six locators leave {len(motions)} motion(s) of the part free: {'; '.join(motions)}",
                "move or turn a locator so that it resists that motion (3-2-1: three on one face, two on the next, "
                "one on the third)",
            )
        )
    inverse = (right.T / values) @ left.T
    turn, shift = inverse[:3] / radius, inverse[3:]
    return np.vstack([turn, shift + np.cross(turn, pivot_mm - centre, axis=0)])


def _tidy(free: Array) -> Array:
    """A basis of the free motions in which most entries are zero: the one a person would name (row echelon)."""
    rows = free.copy()
    done = 0
    for column in range(rows.shape[1]):
        if done == len(rows):
            break
        pick = done + int(np.argmax(np.abs(rows[done:, column])))
        if abs(rows[pick, column]) < 1e-6:
            continue
        rows[[done, pick]] = rows[[pick, done]]
        rows[done] /= rows[done, column]
        for other in range(len(rows)):
            if other != done:
                rows[other] -= rows[other, column] * rows[done]
        done += 1
    rows[np.abs(rows) < 1e-7] = 0.0
    return np.asarray(rows / np.linalg.norm(rows, axis=1, keepdims=True))


def describe_motion(turn: Array, shift_mm: Array, at_mm: Array, radius_mm: float) -> str:
    """A rigid motion in words: ``turn`` (3,) rad and ``shift_mm`` (3,) of the point ``at_mm``."""
    rate = float(np.linalg.norm(turn))
    if rate * radius_mm < 1e-6 * float(np.linalg.norm(shift_mm)):
        return f"translation along {direction_name(shift_mm)}"
    axis = turn / rate
    point = at_mm + np.cross(axis, shift_mm) / rate  # where the screw axis passes closest to at_mm
    through = f"rotation about {direction_name(axis)} through {point_name(point)}"
    along = float(axis @ shift_mm)
    if abs(along) > 1e-6 * rate * radius_mm:
        return f"{through}, together with {along / np.rad2deg(rate):.3g} mm per degree along it"
    return through
