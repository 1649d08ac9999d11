"""S2 against its parts, and what S4's two columns can carry."""

from __future__ import annotations

from collections.abc import Mapping
from math import hypot, sqrt

import numpy as np

from ..estimation.resection import project, resect
from ..estimation.triangulation import triangulate
from ..propagation.chain import estimator_geometry
from ..system import Array, Reading, System
from .paper_records import Additivity, LevelRatio, LevelShape, PaperCell
from .published import LEVELS, S2, Setting
from .settings import under


def additivity(cells: Mapping[tuple[str, float], PaperCell], compared: bool) -> tuple[Additivity, ...]:
    """Cells of S2, by level and noise, that have both parts."""
    printed = {(cell.row.partition(",")[0], cell.setting.noise_px): cell.value_mm for cell in S2}
    rows = []
    for (level, noise), joint in cells.items():
        if level == "L0" or noise == 0:
            continue
        bias, alone = cells[level, 0.0].value_mm, cells["L0", noise].value_mm
        rows.append(
            Additivity(
                row=joint.row,
                joint_mm=joint.value_mm,
                first_order_mm=joint.first_order_mm,
                bias_mm=bias,
                noise_mm=alone,
                quadrature_mm=hypot(bias, alone),
                sum_mm=bias + alone,
                printed_joint_mm=printed[level, noise] if compared else None,
                printed_quadrature_mm=hypot(printed[level, 0.0], printed["L0", noise]) if compared else None,
            )
        )
    return tuple(rows)


def level_ratios(system: System, target: int, noisy_px: Mapping[str, float]) -> tuple[LevelRatio, ...]:
    """Every level without noise, by the plain estimator: matrices estimated there, and matrices of L0 kept.

    noisy_px: mean RMS reprojection error of the chain with noise, by level, passed on."""
    fiducials = system.fiducials_mm
    seen_at_rest = [project(view.projection, fiducials) for view in system.views]
    kept = np.array([resect(fiducials, seen) for seen in seen_at_rest])
    position = system.targets[target].position_mm
    rows = []
    for level, (degrees, millimetres) in LEVELS.items():
        here = under(system, Setting(degrees, millimetres, 0.0))
        seen_by, told, _ = estimator_geometry(here)
        # What is imaged, in the estimator's own coordinates: effective projections of the fiducials it is told.
        images = [project(matrix, told) for matrix in seen_by]
        estimated = np.array([resect(told, image) for image in images])
        aims = np.array([project(view.projection, position[None])[0] for view in system.views])
        found = triangulate(estimated, aims, told, system.triangulation)
        error = float(np.linalg.norm(found - position))
        # With the matrices of L0: a moved structure is seen elsewhere (physical), or looked for elsewhere (Eq 18).
        looked_for = told if system.reading is Reading.EQ18 else fiducials
        kept_px = _rms([project(m, looked_for) - image for m, image in zip(kept, images, strict=True)])
        rows.append(
            LevelRatio(
                level=level,
                rotation_deg=degrees,
                translation_mm=millimetres,
                error_mm=error,
                reprojection_estimated_px=_rms(
                    [project(m, told) - image for m, image in zip(estimated, images, strict=True)]
                ),
                reprojection_noisy_px=noisy_px[level],
                reprojection_kept_px=kept_px,
                mm_per_px=error / kept_px if level != "L0" else None,
            )
        )
    return tuple(rows)


def shape(level: str, errors: Array) -> LevelShape:
    """Where the P95 of the norm of errors (3, n), mm, stands."""
    norms = np.linalg.norm(errors, axis=0)
    mean, p95 = float(norms.mean()), float(np.quantile(norms, 0.95))
    return LevelShape(level, p95 / mean, (p95 - mean) / float(norms.std()))


def _rms(differences: list[Array]) -> float:
    """RMS over fiducials and views of the length of (N, 2) differences, px."""
    squared = np.concatenate([(difference**2).sum(axis=1) for difference in differences])
    return sqrt(float(squared.mean()))
