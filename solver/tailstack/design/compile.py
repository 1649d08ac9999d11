"""Design -> System: degrees to radians, views to projections, locators to torsors, regions to points, once.

Presets of views are filled in, poses are read, and the rounding of written rotations is taken out.
"""

from __future__ import annotations

from itertools import chain, product
from typing import Any

import numpy as np

from ..arrays import Array, frozen
from ..effects import EFFECTS
from ..errors import DesignError, IllPosedError, Problem
from ..estimation.checks import examine
from ..geometry.camera import (
    depths,
    image_centre_px,
    intrinsic_matrix,
    projection_from_distances,
    projection_from_pose,
    scale_to_unit_depth,
)
from ..geometry.naming import direction_name, point_name
from ..geometry.rotation import rigid_transform, rigidity_defect, rotation_from_quaternion, rotation_xyz
from ..results import Finding, ViewCheck
from ..system import (
    DirectEffect,
    Law,
    Place,
    Requirement,
    Sources,
    System,
    Target,
    View,
    execution_of,
    mount,
    no_sources,
)
from ..tolerances import coverage_of
from .consistency import axis_counts, sample_count
from .document import (
    Compliance,
    DistanceView,
    Execution,
    Fiducials,
    HandEye,
    Interface,
    MatrixView,
    PinholeView,
    Pose,
    PresetView,
    Region,
    Repeatability,
    RequirementDocument,
    TargetDocument,
)
from .loading import Design
from .plausibility import explain_refusal, find_implausible
from .presets import PRESETS
from .refusals import place


def compile_design(design: Design) -> System:
    """Compile a design; mm, rad and px from here on.

    Raises DesignError (a transform that is not rigid) and IllPosedError (locators that leave a motion
    free, a projection without a source), with the place in the document.
    """
    try:
        return _compile(design)
    except (DesignError, IllPosedError) as error:
        source = design.source.placed()
        slips = explain_refusal(design) if isinstance(error, IllPosedError) else []
        raise type(error)([place(problem, source) for problem in (*error.problems, *slips)]) from None


def _compile(design: Design) -> System:
    document = design.document
    fiducials = frozen(design.fiducials.positions_mm)
    notes = list(design.fiducials.notes)
    views = tuple(compile_view(view, f"/views/{index}", fiducials, notes) for index, view in enumerate(document.views))
    made = document.fiducials.manufacturing
    transforms = document.transforms
    if transforms.T_flange_con is None and transforms.T_tcp_flange is None:
        notes.append("no transforms are given: the tcp frame is the connector frame")
    effects = tuple([effect for kind in EFFECTS for effect in kind.compile(document, views)])
    unread = [str(view) for effect in effects for place, view in effect.places if place is Place.INTRINSICS]
    if unread and not document.model.estimator.believes_intrinsics:
        notes.append(
            f"what is said of the intrinsics of view {', '.join(unread)} has no effect: the estimator "
            f"{document.model.estimator} estimates them without assuming any"
        )
    samples = {target.name: expand_target(target) for target in document.targets}
    targets = tuple(chain.from_iterable(samples.values()))
    refuse_behind_detector(design, views, fiducials, targets)
    half_width = np.empty(fiducials.shape)
    half_width[:] = 0.0 if made is None else made.half_width_mm
    return System(
        design_sha256=design.sha256,
        name=document.name,
        views=views,
        fiducial_labels=design.fiducials.labels,
        fiducials_mm=fiducials,
        manufacturing_law=Law.NORMAL if made is None else Law(made.distribution),
        manufacturing_half_width_mm=frozen(half_width),
        manufacturing_coverage_factor=1.0 if made is None else coverage_of(made.distribution, made.coverage_factor),
        structure_connector=_interface(document.interfaces.structure_connector, "structure_connector"),
        connector_flange=_interface(document.interfaces.connector_flange, "connector_flange"),
        T_flange_con=compile_transform(transforms.T_flange_con, "/transforms/T_flange_con", notes),
        T_tcp_flange=compile_transform(transforms.T_tcp_flange, "/transforms/T_tcp_flange", notes),
        hand_eye=_hand_eye(document.execution.hand_eye),
        execution=_execution(document.execution),
        targets=targets,
        requirements=tuple([_requirement(item, samples) for item in document.requirements]),
        reading=document.model.installation_reading,
        rotation_form=document.model.rotation,
        estimator=document.model.estimator,
        triangulation=document.model.triangulation,
        effects=effects,
        fiducial_radius_mm=None if document.fiducials.diameter_mm is None else document.fiducials.diameter_mm / 2,
        loss_probability=_loss_probability(document.fiducials, len(fiducials)),
        notes=tuple(notes),
    )


# --- mounts -----------------------------------------------------------------------------------------


def _perfect(name: str) -> DirectEffect:
    return mount(name, frozen(np.zeros(3)), frozen(np.zeros(6)), no_sources(6))


def _interface(interface: Interface | None, name: str) -> DirectEffect:
    if interface is None:
        return _perfect(name)
    pivot = frozen(interface.pivot_mm)
    sources = no_sources(6)
    if interface.tolerances is not None:
        sources = interface.tolerances.sources
    elif interface.locators is not None:
        held = interface.locators
        direction = torsor_from_locators(
            np.array([locator.position_mm for locator in held]),
            np.array([locator.normal for locator in held]),
            pivot,
            f"/interfaces/{name}/locators",
        )
        sources = Sources(
            tuple(locator.name for locator in held),
            tuple(Law(locator.distribution) for locator in held),
            frozen([locator.half_width_mm for locator in held]),
            frozen([coverage_of(locator.distribution, locator.coverage_factor) for locator in held]),
            ("mm",) * 6,
            frozen(direction),
        )
    return mount(name, pivot, interface.bias.torsor, sources, interface.label)


def _hand_eye(hand_eye: HandEye | None) -> DirectEffect:
    if hand_eye is None:
        return _perfect("hand_eye")
    sources = hand_eye.tolerances.sources
    return mount("hand_eye", frozen(hand_eye.pivot_mm), hand_eye.bias.torsor, sources, "hand-eye calibration")


def _execution(execution: Execution) -> DirectEffect:
    parts = []
    bias = np.zeros(3)
    if execution.repeatability is not None:
        parts.append(_repeatability(execution.repeatability))
    if execution.compliance is not None:
        bias = np.array(execution.compliance.matrix_mm_per_n) @ np.array(execution.compliance.load_n)
        if execution.compliance.load_half_width_n is not None:
            parts.append(_load(execution.compliance))
    parts = parts or [no_sources(3)]
    sources = Sources(
        tuple(name for part in parts for name in part.names),
        tuple(law for part in parts for law in part.laws),
        frozen(np.concatenate([part.half_width for part in parts])),
        frozen(np.concatenate([part.coverage_factor for part in parts])),
        tuple(unit for part in parts for unit in part.units),
        frozen(np.hstack([part.direction for part in parts])),
    )
    return execution_of(sources, frozen(bias))


def _along_axes(name: str, unit: str, half_width: Any, law: str, coverage: float, direction: Array) -> Sources:
    widths = [half_width] * 3 if isinstance(half_width, float | int) else half_width
    keep = [k for k in range(3) if direction[:, k].any()]
    return Sources(
        tuple(f"{name}.{'xyz'[k]}" for k in keep),
        (Law(law),) * len(keep),
        frozen([widths[k] for k in keep]),
        frozen([coverage] * len(keep)),
        (unit,) * len(keep),
        frozen(direction[:, keep]),
    )


def _repeatability(scatter: Repeatability) -> Sources:
    if scatter.std_mm is not None:
        return _along_axes("repeatability", "mm", scatter.std_mm, "normal", 1.0, np.eye(3))
    law = scatter.distribution or "normal"
    coverage = coverage_of(law, scatter.coverage_factor)
    return _along_axes("repeatability", "mm", scatter.half_width_mm, law, coverage, np.eye(3))


def _load(compliance: Compliance) -> Sources:
    law = compliance.distribution or "normal"
    coverage = coverage_of(law, compliance.coverage_factor)
    matrix = np.array(compliance.matrix_mm_per_n)
    return _along_axes("load", "N", compliance.load_half_width_n, str(law), coverage, matrix)


def _loss_probability(fiducials: Fiducials, count: int) -> tuple[float, ...]:
    every = fiducials.loss_probability or 0.0
    own = [point.loss_probability for point in fiducials.points or ()] or [None] * count
    each = tuple(every if probability is None else probability for probability in own)
    return each if any(each) else ()


# --- targets ----------------------------------------------------------------------------------------


def expand_target(target: TargetDocument) -> tuple[Target, ...]:
    """The named points of a target; a region's are called name[0], name[1], ..."""
    if target.region is None:
        return (Target(target.name, frozen(target.position_mm)),)
    points = _box_points(target.region) if target.region.box is not None else _sphere_points(target.region)
    assert len(points) == sample_count(target)
    return tuple([Target(f"{target.name}[{k}]", frozen(point), target.name) for k, point in enumerate(points)])


def _box_points(region: Region) -> list[Array]:
    box = region.box
    assert box is not None
    axes = [
        centre + (np.linspace(-0.5, 0.5, count) if count > 1 else np.zeros(1)) * size
        for centre, size, count in zip(box.centre_mm, box.size_mm, axis_counts(box), strict=True)
    ]
    return [np.array(point) for point in product(*axes)]


def _sphere_points(region: Region) -> list[Array]:
    """Centre, 6 axis points, 8 diagonals: the 14 surface points are a spherical design of degree 5."""
    sphere = region.sphere
    assert sphere is not None
    centre = np.array(sphere.centre_mm)
    axial = [sign * axis for axis in np.eye(3) for sign in (-1.0, 1.0)]
    diagonal = [np.array(signs) / np.sqrt(3) for signs in product((-1.0, 1.0), repeat=3)]
    return [centre, *(centre + sphere.radius_mm * direction for direction in axial + diagonal)]


def _requirement(item: RequirementDocument, samples: dict[str, tuple[Target, ...]]) -> Requirement:
    wanted = [found for name, found in samples.items() if item.targets == "all" or name in item.targets]
    names = tuple([sample.name for sample in chain.from_iterable(wanted)])
    return Requirement(
        item.name, item.error, item.quantile, item.limit_mm, item.confidence, names, item.risk, item.min_yield
    )


RIGID = 1e-4  # largest entry of R'R - I that rounding in a document may leave; beyond it, it is not a rotation


def seen_by(view: Any) -> tuple[str, ...] | None:
    """The labels of the fiducials that a view of the document lists; None: all of them."""
    return None if view.sees is None else tuple(view.sees)


def compile_view(view: Any, pointer: str, fiducials: Array, notes: list[str]) -> View:
    """A view of the document with its projection, con mm to px; ``notes`` is added to."""
    projection, size = _projection(view, pointer, fiducials, notes)
    prior = view.intrinsics_prior
    return View(
        view.name,
        frozen(projection),
        view.fiducial_noise_px,
        view.target_noise_px,
        size,
        seen_by(view),
        None if prior is None else (prior.focal_rel_sd, prior.principal_point_px_sd),
    )


def _projection(view: Any, pointer: str, fiducials: Array, notes: list[str]) -> tuple[Array, tuple[int, int] | None]:
    """Con mm to px, and the size of the image where it is stated."""
    if isinstance(view, PresetView | DistanceView):
        return _aim_view(view)
    if isinstance(view, PinholeView):
        k = intrinsic_matrix(view.intrinsics.focal_px, view.intrinsics.principal_point_px, view.intrinsics.skew_px)
        return projection_from_pose(k, compile_transform(view.pose, f"{pointer}/pose", notes)), view.image_size_px
    assert isinstance(view, MatrixView)
    return _read_matrix(view, pointer, fiducials), view.image_size_px


def _aim_view(view: PresetView | DistanceView) -> tuple[Array, tuple[int, int]]:
    """A preset fills in what the view leaves open; loading has made sure that nothing stays open."""
    preset = PRESETS[view.preset] if isinstance(view, PresetView) else None

    def number(name: str) -> Any:
        own = getattr(view, name)
        return own if own is not None else getattr(preset, name)

    size: tuple[int, int] = number("image_size_px")
    pixel = float(number("pixel_mm"))
    projection = projection_from_distances(
        number("source_detector_mm"),
        number("source_isocentre_mm"),
        (pixel, pixel),
        view.principal_point_px or image_centre_px(size),
        np.array(view.isocentre_mm),
        np.array(view.beam),
        np.array(view.up_direction),
    )
    return projection, size


def refuse_behind_detector(
    design: Design, views: tuple[View, ...], fiducials: Array, targets: tuple[Target, ...]
) -> None:
    """A distance to the detector is known for aimed views only; the System no longer holds it."""
    points = np.concatenate([fiducials, [target.position_mm for target in targets]])
    labels = design.fiducials.labels
    for index, (compiled, detector) in enumerate(zip(views, detector_distances(design).tolist(), strict=True)):
        depth = depths(compiled.projection, points)
        if compiled.sees is not None:
            depth[: len(labels)][[label not in compiled.sees for label in labels]] = -np.inf
        worst = depth.argmax()
        if depth[worst] > detector:
            count = len(fiducials)
            name = f"target {targets[worst - count].name}" if worst >= count else f"fiducial {labels[worst]}"
            raise IllPosedError(
                Problem(
                    f"/views/{index}",
                    "behind-detector",
                    f"{name} lies {depth[worst]:.4g} mm from the source of view {compiled.name}, behind its detector "
                    f"at {detector:g} mm",
                    "check the isocentre, the direction of the beam and the frame of the coordinates",
                )
            )


def detector_distances(design: Design) -> Array:
    """(V,) mm from the source of each view to its detector; infinite where the document does not say."""
    return np.array([
        view.source_detector_mm or PRESETS[getattr(view, "preset", "")].source_detector_mm
        if isinstance(view, PresetView | DistanceView)
        else np.inf
        for view in design.document.views
    ])  # fmt: skip


def _read_matrix(view: MatrixView, pointer: str, fiducials: Array) -> Array:
    matrix = np.array(view.projection)
    left = matrix[:, :3] / max(float(np.abs(matrix[:, :3]).max()), 1e-300)
    # rows of a projection differ by the focal length in px; scaling each makes the rank a matter of directions
    rows = np.linalg.norm(left, axis=1)
    if rows.min() == 0 or np.linalg.svd(left / rows[:, None], compute_uv=False)[-1] < 1e-9:
        raise IllPosedError(
            Problem(
                f"{pointer}/projection",
                "no-source",
                "the left 3x3 block of the projection is singular: it has no finite X-ray source",
                "give a perspective projection that maps con millimetres to pixels",
            )
        )
    if np.abs(matrix).max() > 1e12 * np.linalg.norm(matrix[2, :3]):
        detail = "the rows of the projection differ by more than a factor of 1e12: no camera has such a focal length"
        raise IllPosedError(Problem(f"{pointer}/projection", "no-source", detail, "it maps con millimetres to pixels"))
    return scale_to_unit_depth(matrix, fiducials)


def compile_transform(value: Pose | Any | None, pointer: str, notes: list[str]) -> Array:
    """4x4 of a pose or a matrix; rounding in the document is taken out, anything more is refused."""
    matrix, remarks = _transform(value, pointer)
    notes += remarks
    return matrix


def _transform(value: Pose | Any | None, pointer: str) -> tuple[Array, tuple[str, ...]]:
    if value is None:
        return frozen(np.eye(4)), ()
    if isinstance(value, Pose):
        translation = np.array(value.translation_mm)
        if value.rotation_deg is not None:
            return frozen(rigid_transform(rotation_xyz(np.deg2rad(value.rotation_deg)), translation)), ()
        if value.quaternion_wxyz is not None:
            norm = float(np.linalg.norm(value.quaternion_wxyz))
            if abs(norm - 1) > 1e-3:
                raise _refuse_not_rigid(f"{pointer}/quaternion_wxyz", f"the quaternion's norm is {norm:.6g}, not 1")
            rotation = rotation_from_quaternion(np.array(value.quaternion_wxyz))
            return frozen(rigid_transform(rotation, translation)), ()
        rotation = np.eye(3) if value.rotation is None else np.array(value.rotation)
        pointer += "/rotation"
    else:
        matrix = np.array(value)
        if np.abs(matrix[3] - [0.0, 0.0, 0.0, 1.0]).max() > 0:
            raise _refuse_not_rigid(f"{pointer}/3", f"the last row is {matrix[3].tolist()}, not [0, 0, 0, 1]")
        if np.abs(matrix[:3, 3]).max() > 1e5:
            raise DesignError(Problem(pointer, "out-of-range", "the translation is longer than 100 m"))
        rotation, translation = matrix[:3, :3], matrix[:3, 3]
    size = float(np.abs(rotation).max())
    defect = rigidity_defect(rotation) if size < 10 else float("inf")
    if not defect <= RIGID:
        what = (
            "it is a reflection, or far from a rotation" if defect == float("inf") else f"R'R - I reaches {defect:.2g}"
        )
        raise _refuse_not_rigid(pointer, f"its rotation is not a rotation: {what}")
    if defect > 1e-12:
        left, _, right = np.linalg.svd(rotation)
        rotation = left @ right
    rounded = f"{pointer}: replaced by the nearest rotation (R'R - I reached {defect:.1g})"
    return frozen(rigid_transform(rotation, translation)), (rounded,) if defect > 1e-9 else ()


def _refuse_not_rigid(pointer: str, detail: str) -> DesignError:
    return DesignError(
        Problem(
            pointer,
            "not-rigid",
            f"a transform is rigid; {detail} (accepted: {RIGID:g})",
            "give more digits, or use rotation_deg",
        )
    )


def check_design(design: Design) -> tuple[System, tuple[Finding, ...], tuple[ViewCheck, ...]]:
    """Compile and check: the system, remarks on its geometry and on implausible values, and what each view sees.

    Raises DesignError and IllPosedError with the file, line and column of the section they are about.
    """
    system = compile_design(design)
    try:
        findings, views = examine(system)
    except IllPosedError as error:
        source = design.source.placed()
        problems = [*error.problems, *_name_left_out(design), *explain_refusal(design, system)]
        raise IllPosedError([place(problem, source) for problem in problems]) from None
    return system, (*findings, *find_implausible(design, system)), views


def _name_left_out(design: Design) -> list[Problem]:
    """What a fiducial file holds and the design does not: it may be why too little is there."""
    origin, pointer = (
        design.fiducials.origin,
        "/fiducials" + ("" if design.document.fiducials.file is None else "/file"),
    )
    if origin is None:
        return []
    said = [
        origin.describe_left_out(),
        *(f"{origin.file}: {remark}" for remark in origin.remarks if "left out" in remark),
    ]
    return [Problem(pointer, "left-out", each) for each in said if each]


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
