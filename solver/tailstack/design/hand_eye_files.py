"""Tables of pairs of poses, as hand-eye calibrations take them: read into the covariance of ``execution.hand_eye``."""

from __future__ import annotations

import numpy as np

from ..errors import DesignError
from ..estimation.hand_eye import fit_hand_eye
from ..geometry.arrays import Array
from ..geometry.rotation import rigid_transform, rotation_from_quaternion
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
