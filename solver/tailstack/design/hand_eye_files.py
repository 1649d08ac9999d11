"""Tables of pairs of poses, as hand-eye calibrations take them: read into the covariance of ``execution.hand_eye``.

At each of n poses the robot says where the flange is in its base (F), and a tracker where it sees the tool (T).  With X
the tool in the flange and Z the tracker in the base, ``F_i X = Z T_i``; between two poses Z drops out, and AX = XB is
left.  All pairs at once, weighed as they belong together, are the least squares of

    T_i = (Z^-1 F_i X) exp(e_i),   e_i normal: sigma_r of each turn, sigma_t of each shift, in the tool

by X exp(d) and Z exp(z), whose design is ``e_i = d - Ad(T_i^-1) z``: its information matrix is inverted to the
covariance of d.  Both deviations are estimated (Helmert's components of variance: residuals over what redundancy each
kind has).  As they are, the covariance is widened: the sum of two such parts, of nu each, has the 95 % point of
Fisher's law with 1.2 nu (sampled: within 3 % for nu of 12 to 114).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..errors import DesignError, Problem
from ..geometry.arrays import Array
from ..geometry.rotation import carry, rigid_transform, rotation_from_quaternion, undo
from ..people_tables import PeopleTable, read_people_table, split_heading
from ..tolerances import Tolerances
from ..units import LENGTHS_MM

ENDINGS = (".csv", ".tsv", ".txt")
MOST_BYTES = 1_000_000
MOST_POSES = 500
NUMBERS = ("x", "y", "z", "qw", "qx", "qy", "qz")
COLUMNS = tuple(f"{frame}_{number}" for frame in ("flange", "tool") for number in NUMBERS)
UNIT = 1e-3  # by which the length of a quaternion may differ from 1
NEAREST_MM, FARTHEST_MM = 10.0, 1e5  # what an arm moves, and is moved in

LEAST_POSES = 6
LEAST_TURN_DEG = 3.0  # of poses about a second axis, root mean square, below which X is hardly known
ROUNDS = 8
MOST_OFF = np.radians(1.0), 10.0  # rad, mm: deviations of poses that are of one calibration
SMALLEST = 1e-9  # rad, mm: deviations of poses without any


def read_pose_pairs(content: bytes, name: str, T_tcp_flange: Array) -> tuple[Array, Tolerances, str]:
    """Where the tool that was seen is (3,) mm, tcp, the tolerances of its turn and shift there, and what to mind.

    Raises DesignError."""
    table = read_people_table(content, name, DesignError, lambda cells: COLUMNS[0] in map(_name, cells))
    places = _find_columns(table)
    poses: list[list[float]] = []
    for line, cells in table.rows:
        numbers = [factor * table.read_number(cells[at], line, at) for at, factor in places]
        for start in (3, 10):
            length = float(np.linalg.norm(numbers[start : start + 4]))
            if abs(length - 1) > UNIT:
                detail = f"a quaternion has the length 1; this one has {length:.4g}"
                raise table.refuse("not-a-rotation", detail, "order: qw, qx, qy, qz", line, places[start][0] + 1)
        poses.append(numbers)
    if len(poses) > MOST_POSES:
        raise table.refuse("too-many", f"{len(poses)} pairs of poses; at most {MOST_POSES} are read")
    flanges, tools = (_poses_of(each) for each in np.hsplit(np.array(poses).reshape(-1, 14), 2))
    far = [float(np.abs(each[:, :3, 3]).max(initial=0.0)) for each in (flanges, tools)]
    if poses and not (min(far) >= NEAREST_MM and max(far) <= FARTHEST_MM):
        detail = f"flanges are up to {far[0]:.3g} mm from their frame, tools {far[1]:.3g} mm"
        raise table.refuse("implausible", detail, "of numbers in m: flange_x_m, ..., tool_z_m", table.header_line)
    fit = fit_hand_eye(flanges, tools)
    seen = T_tcp_flange @ fit.tool_in_flange
    turned = np.kron(np.eye(2), seen[:3, :3]) * np.repeat([np.degrees(1.0), 1.0], 3)[:, None]
    covariance = turned @ fit.covariance @ turned.T
    remark = (
        f"{len(poses)} pairs of poses, off by {np.degrees(fit.turn_sd):.2g} deg and {fit.shift_sd_mm:.2g} mm (standard "
        "deviations): all of that is taken for the tracker's, as what the arm adds cannot be told from it"
    )
    return seen[:3, 3], Tolerances(covariance_deg_mm=((covariance + covariance.T) / 2).tolist()), remark


def _name(cell: str) -> str:
    return split_heading(cell)[0]


def _find_columns(table: PeopleTable) -> list[tuple[int, float]]:
    """Of each of ``COLUMNS`` its place, and what its numbers are multiplied by."""
    units = table.units or [split_heading(cell)[1] for cell in table.header]
    found = dict(zip(map(_name, table.header), zip(range(len(units)), units, strict=True), strict=True))
    if missing := [name for name in COLUMNS if name not in found]:
        detail = f"no column is called {missing[0]}"
        raise table.refuse("csv-header", detail, f"columns: {', '.join(COLUMNS)}", table.header_line)
    if wrong := [name for name in COLUMNS if name[-2] == "_" and found[name][1] not in LENGTHS_MM]:
        raise table.refuse("no-unit", f"{wrong[0]} has no unit of length", f"{wrong[0]}_mm", table.header_line)
    return [(found[name][0], LENGTHS_MM[found[name][1]] if name[-2] == "_" else 1.0) for name in COLUMNS]


def _poses_of(rows: Array) -> Array:
    """(n, 4, 4) mm of (n, 7): a place, and a quaternion."""
    turns = [rotation_from_quaternion(row) for row in rows[:, 3:]]
    return rigid_transform(np.array(turns).reshape(-1, 3, 3), rows[:, :3])


# --- the fit ----------------------------------------------------------------------------------------------


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
        halves = np.split(design, 2, axis=1)
        parts = [(rows / sd, left / sd) for rows, left, sd in zip(halves, residuals, sds, strict=True)]
        information = [np.einsum("nij,nik->jk", rows, rows) for rows, _ in parts]
        inverse = np.linalg.inv(sum(information))
        step = inverse @ sum(np.einsum("nij,ni->j", *part) for part in parts)
        x = x @ rigid_transform(Rotation.from_rotvec(step[:3]).as_matrix(), step[3:6])
        z = z @ rigid_transform(Rotation.from_rotvec(step[6:9]).as_matrix(), step[9:])
        free = [3 * count - np.trace(inverse @ each) for each in information]
        sds = np.maximum([np.sqrt((left**2).sum() / of) for left, of in zip(residuals, free, strict=True)], SMALLEST)
    if sds[0] > MOST_OFF[0] or sds[1] > MOST_OFF[1]:
        detail = f"the poses fit one another to {np.degrees(sds[0]):.2g} deg and {sds[1]:.2g} mm only"
        cure = "is the flange in its base, the tool in the tracker, in mm, and qw first?"
        raise DesignError(Problem("", "poses-disagree", detail, cure))
    widened = 6 * f.ppf(0.95, 6, 0.6 * sum(free)) / chi2.ppf(0.95, 6)
    return HandEyeFit(x, widened * inverse[:6, :6], *sds.tolist())


def _refuse(code: str, detail: str) -> DesignError:
    return DesignError(Problem("", code, detail, "add poses that turn the tool about other axes"))
