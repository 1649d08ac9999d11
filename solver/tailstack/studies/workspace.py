"""Where the arm may go: the share of poses of the tool at which the limit holds, and maps of it.

The structure rides on the flange, so the arm's own error grows with the way from the pose of the shots to that of the
tool (``effects/robot.py``).  Poses are drawn at random about the former; of each, P95 is that of a score with the tool
at work there: only the robot's part of the law differs from pose to pose.  Bounded components have their worst ends at
each pose for itself.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ..contributors import bounded_columns, declared_law
from ..design import Design, compile_design
from ..effects.robot import errors_at
from ..errors import Problem, StudyError
from ..geometry.arrays import Array
from ..montecarlo.estimators import bound_share
from ..propagation.linear import linearise
from ..results import Interval, Provenance
from ..results.record import Published
from ..results.verdicts import P95
from ..scoring import provenance, tightest_limit
from ..system import Place, System
from ..tail.bounded import worst_case
from ..tail.declared import law_quantile
from ..tail.gaussian import norm_quantile_jit, sound

BLOCK = 4096  # poses that are computed in one go
CELLS = 16  # fields along each side of a map
Plane = Literal["from above", "from the side"]
PLANES: tuple[tuple[Plane, int], ...] = (("from above", 1), ("from the side", 2))  # with the axis beside x


@dataclass(frozen=True, slots=True)
class WorkspaceField:
    """Poses with the target in one field of a map."""

    plane: Plane
    """from above: x and y of the robot's base; from the side: x and z."""
    x_mm: float
    """Middle of the field along x, mm."""
    beside_mm: float
    """Middle of the field along y or z, mm."""
    poses: int
    """How many poses there are."""
    within: int
    """At how many of them the limit holds."""


@dataclass(frozen=True, slots=True, repr=False)
class StudyWorkspace(Published):
    """Where the arm may go."""

    schema: Literal["tailstack/study-workspace/1"]
    target: str
    """Target whose error at the tool is studied."""
    limit_mm: float
    """Limit of its P95, mm."""
    reach_deg: float
    """How far each joint is from the pose of the shots at most, deg; a slide, mm."""
    poses: int
    """How many poses were drawn."""
    seed: int
    """Seed of the poses."""
    share: float
    """Share of them at which P95 is within the limit, 0 to 1."""
    share_interval: Interval
    """Its interval of 95 % (Clopper and Pearson)."""
    median_p95_mm: float
    """P95 that half of the poses keep, mm."""
    largest_p95_mm: float
    """The largest P95 of all poses, mm."""
    largest_at_deg: tuple[float, ...]
    """Values of the joints there, deg; of a slide mm."""
    p95_at_shots_mm: float
    """P95 with the tool at work at the pose of the shots, mm."""
    field_mm: float
    """Side of a field of the maps, mm."""
    fields: tuple[WorkspaceField, ...]
    """Every field of both maps that has a pose."""
    conclusions: tuple[str, ...]
    """What it comes to for a designer."""
    provenance: Provenance


def study_workspace(
    design: Design,
    *,
    poses: int = 10_000,
    reach_deg: float = 30.0,
    limit_mm: float | None = None,
    target: str | None = None,
    seed: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> StudyWorkspace:
    """Draw poses of the tool, every joint uniform within ``reach_deg`` of the pose of the shots, and score each.

    limit_mm: of P95 of the error at the tool; absent: the tightest that the design requires there.  target: its name;
    absent: the first.  ``progress(done, total)`` is called after each block of poses.  Raises DesignError,
    IllPosedError; StudyError for a design without a robot, a limit or the target, or whose law differs by more.
    """
    system = compile_design(design)
    robot, limit_mm = refuse_unstudied(design, system, limit_mm, target)
    aim = next(each for each in system.targets if target in (None, each.name))
    arm = system.effects_at(Place.ARM)
    model = linearise(replace(system, effects=tuple(each for each in system.effects if each not in arm)), aim)
    law = declared_law(model, "tcp", model.bias_mm("tcp"))
    bounded = bounded_columns(model, "tcp")
    to_tcp = model.tcp_from_flange @ system.T_flange_con[:3, :3].T
    at_flange = system.T_flange_con[:3, :3] @ aim.position_mm + system.T_flange_con[:3, 3]
    shots = np.array(robot.joints_imaging_deg)
    ends = np.maximum(shots - reach_deg, -360.0), np.minimum(shots + reach_deg, 360.0)
    drawn = np.vstack([shots, np.random.default_rng(seed).uniform(*ends, (poses, len(shots)))])
    p95_mm, places = np.empty(poses + 1), np.empty((poses + 1, 3))
    for start in range(0, poses + 1, BLOCK):
        part = slice(start, start + BLOCK)
        at = errors_at(robot, arm, drawn[part], at_flange)
        places[part] = at.place
        each = zip(law.mean + at.known @ to_tcp.T, law.covariance + to_tcp @ at.covariance @ to_tcp.T, strict=True)
        if law.columns.size or bounded.size:
            laws = (replace(law, mean=mean, covariance=covariance) for mean, covariance in each)
            found = (worst_case(one, bounded, P95).quantile if bounded.size else law_quantile(one, P95) for one in laws)
            p95_mm[part] = [each.quantile_mm for each in found]
        else:
            p95_mm[part] = [sound(norm_quantile_jit(*one, P95), "P95", *one) for one in each]
        if progress is not None:
            progress(min(start + BLOCK, poses), poses)
    within, worst = p95_mm[1:] <= limit_mm, int(p95_mm[1:].argmax()) + 1
    count = int(within.sum())
    study = StudyWorkspace(
        schema="tailstack/study-workspace/1",
        target=aim.name,
        limit_mm=limit_mm,
        reach_deg=reach_deg,
        poses=poses,
        seed=seed,
        share=count / poses,
        share_interval=bound_share(count, poses, 0.025),
        median_p95_mm=float(np.median(p95_mm[1:])),
        largest_p95_mm=float(p95_mm[worst]),
        largest_at_deg=tuple(drawn[worst].tolist()),
        p95_at_shots_mm=float(p95_mm[0]),
        field_mm=float(np.ptp(places[1:], axis=0).max() / CELLS) or 1.0,
        fields=(),
        conclusions=(),
        provenance=provenance(system),
    )
    return replace(study, fields=_map(places[1:], within, study.field_mm), conclusions=_conclude(study))


def refuse_unstudied(design: Design, system: System, limit_mm: float | None, target: str | None) -> tuple[Any, float]:
    """The robot, and the limit, mm.  Raises StudyError."""
    robot = getattr(design.document.execution, "robot", None)
    if robot is None:
        detail = "the design has no robot, and every pose is as good as any other"
        raise StudyError(Problem("/execution", "missing-field", detail, "state execution.robot"))
    if system.loss_probability:
        detail = "fiducials may be missed; what that does to P95 differs from pose to pose, and is not looked for here"
        raise StudyError(Problem("", "not-studied", detail, "state no loss_probability"))
    names = [each.name for each in system.targets]
    name = names[0] if target is None else target
    if name not in names:
        detail = f"no target is called {name!r}; there are {', '.join(names[:20])}"
        raise StudyError(Problem("/target", "unknown-target", detail, f"--target {names[0]}"))
    limit_mm = tightest_limit(system, name, "tcp") if limit_mm is None else limit_mm
    if limit_mm is None:
        detail = f"no requirement limits P95 of the error at the tool at {name}"
        raise StudyError(Problem("/limit_mm", "missing-field", detail, "state limit_mm"))
    return robot, limit_mm


def _map(places: Array, within: NDArray[np.bool_], side: float) -> tuple[WorkspaceField, ...]:
    """The fields of both maps; places (n, 3) mm, base."""
    low, found = places.min(axis=0), []
    at = np.minimum((places - low) // side, CELLS - 1).astype(int)
    for plane, axis in PLANES:
        counts = np.zeros((CELLS, CELLS, 2), dtype=int)
        np.add.at(counts, (at[:, 0], at[:, axis]), np.column_stack([np.ones_like(within), within]).astype(int))
        for i, j in np.argwhere(counts[..., 0]).tolist():
            middle = low[[0, axis]] + side * (np.array([i, j]) + 0.5)
            found.append(WorkspaceField(plane, *middle.tolist(), *counts[i, j].tolist()))
    return tuple(found)


def _conclude(study: StudyWorkspace) -> tuple[str, ...]:
    low, high = (f"{100 * each:.1f}" for each in study.share_interval)
    joints = ", ".join(f"{each:.0f}" for each in study.largest_at_deg)
    return (
        f"P95 of the error at the tool at {study.target} is within {study.limit_mm:g} mm at {100 * study.share:.1f} % "
        f"of the poses within {study.reach_deg:g} deg a joint of that of the shots (between {low} and {high} %).",
        f"Half of them keep {study.median_p95_mm:.3f} mm; the largest is {study.largest_p95_mm:.3f} mm, with the "
        f"joints at {joints}.",
        f"With the tool at work where the shots were taken it is {study.p95_at_shots_mm:.3f} mm.",
    )
