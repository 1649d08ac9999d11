"""Hand-eye calibration from pairs of poses, AX = XB, with the covariance of what it finds.

At each of n poses the robot says where the flange is in its base (F), and a tracker where it sees the tool (T).  With X
the tool in the flange and Z the tracker in the base, ``F_i X = Z T_i``; between two poses Z drops out, and AX = XB is
left.  All pairs at once, weighed as they belong together, are the least squares of

    T_i = (Z^-1 F_i X) exp(e_i),   e_i normal: sigma_r of each turn, sigma_t of each shift, in the tool

by X exp(d) and Z exp(z), whose design is ``e_i = d - Ad(T_i^-1) z``: its information matrix is inverted to the
covariance of d.  Both deviations are estimated (Helmert's
components of variance: residuals over what redundancy each kind has).  As they are, the covariance is widened: the sum
of two such parts, of nu each, has the 95 % point of Fisher's law with 1.2 nu (sampled: within 3 % for nu of 12 to 114).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..errors import DesignError, Problem
from ..geometry.arrays import Array
from ..geometry.rotation import carry, rigid_transform, undo

LEAST_POSES = 6
LEAST_TURN_DEG = 3.0  # of poses about a second axis, root mean square, below which X is hardly known
ROUNDS = 8
MOST = np.radians(1.0), 10.0  # rad, mm: deviations of poses that are of one calibration
SMALLEST = 1e-9  # rad, mm: deviations of poses without any


class HandEyeFit(NamedTuple):
    """What pairs of poses say of the tool in the flange."""

    tool_in_flange: Array  # (4, 4) mm
    covariance: Array  # (6, 6) rad and mm: of the turn and the shift of the tool, in its own frame
    turn_sd: float  # rad, of a pose that is seen
    shift_sd_mm: float


def fit_hand_eye(flanges: Array, tools: Array) -> HandEyeFit:
    """flanges: of the flange in the base, tools: of the tool in the tracker, (n, 4, 4) mm.  Raises DesignError."""
    from scipy.spatial.transform import Rotation  # late: of few designs
    from scipy.stats import chi2, f

    count = len(flanges)
    if count < LEAST_POSES:
        raise _refuse("too-few", f"{count} pairs of poses; at least {LEAST_POSES} say how far off they are")
    first, second = np.triu_indices(count, 1)
    a, b = (undo(each[first]) @ each[second] for each in (flanges, tools))
    turns, seen_turns = (Rotation.from_matrix(each[:, :3, :3]).as_rotvec() for each in (a, b))
    clear = np.linalg.norm(turns, axis=1) < np.radians(170)  # of half a turn the axis may point either way
    spread = np.linalg.svd(np.vstack([turns[clear], np.zeros((2, 3))]), compute_uv=False)[1]
    if np.degrees(spread) < LEAST_TURN_DEG * np.sqrt(len(a)):
        detail = "the poses turn about no more than one axis, along which they do not say where the tool is"
        raise _refuse("one-axis", detail)
    turn = Rotation.align_vectors(turns[clear], seen_turns[clear])[0].as_matrix()  # Park and Martin (1994)
    ahead = (turn @ b[:, :3, 3:])[..., 0] - a[:, :3, 3]
    shift = np.linalg.lstsq(np.concatenate(a[:, :3, :3] - np.eye(3)), ahead.ravel(), rcond=None)[0]
    x = rigid_transform(turn, shift)
    z = flanges[0] @ x @ undo(tools[0])
    sds = np.array([1e-3, 0.1])  # rad, mm: to begin with
    for _ in range(ROUNDS):
        foreseen = undo(z) @ flanges @ x
        off = undo(foreseen) @ tools
        residuals = Rotation.from_matrix(off[:, :3, :3]).as_rotvec(), off[:, :3, 3]
        of_tracker = np.swapaxes(carry(undo(foreseen)[:, None], np.eye(6)), 1, 2)
        design = np.concatenate([np.broadcast_to(np.eye(6), of_tracker.shape), -of_tracker], axis=2)
        parts = [
            (rows / sd, left / sd) for rows, left, sd in zip(np.split(design, 2, axis=1), residuals, sds, strict=True)
        ]
        information = [np.einsum("nij,nik->jk", rows, rows) for rows, _ in parts]
        inverse = np.linalg.inv(sum(information))
        step = inverse @ sum(np.einsum("nij,ni->j", *part) for part in parts)
        x, z = (
            each @ rigid_transform(Rotation.from_rotvec(by[:3]).as_matrix(), by[3:])
            for each, by in ((x, step[:6]), (z, step[6:]))
        )
        free = [3 * count - np.trace(inverse @ each) for each in information]
        sds = np.maximum([np.sqrt((left**2).sum() / of) for left, of in zip(residuals, free, strict=True)], SMALLEST)
    if sds[0] > MOST[0] or sds[1] > MOST[1]:
        detail = f"the poses fit one another to {np.degrees(sds[0]):.2g} deg and {sds[1]:.2g} mm only"
        cure = "is the flange in its base, the tool in the tracker, in mm, and qw first?"
        raise DesignError(Problem("", "poses-disagree", detail, cure))
    widened = 6 * f.ppf(0.95, 6, 0.6 * sum(free)) / chi2.ppf(0.95, 6)
    return HandEyeFit(x, widened * inverse[:6, :6], *sds.tolist())


def _refuse(code: str, detail: str) -> DesignError:
    return DesignError(Problem("", code, detail, "add poses that turn the tool about other axes"))
