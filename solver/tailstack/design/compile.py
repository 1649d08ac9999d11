"""Design -> System: degrees to radians, views to projections, locators to torsors, regions to points, once.

Presets of views are filled in, poses are read, and the rounding of written rotations is taken out.
"""

from __future__ import annotations

from itertools import chain, product
from math import radians
from typing import Any

import numpy as np

from ..arrays import Array, frozen
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
from ..geometry.image_shifts import field_powers
from ..geometry.naming import direction_name, point_name
from ..geometry.rotation import rigid_transform, rigidity_defect, rotation_from_quaternion, rotation_xyz
from ..results import Finding, ViewCheck
from ..system import (
    INTRINSICS,
    TORSOR_COMPONENTS,
    Balls,
    ImageField,
    IntrinsicsError,
    Law,
    Mount,
    Requirement,
    Sources,
    System,
    Target,
    Temperature,
    View,
    no_sources,
)
from .consistency import axis_counts, sample_count
from .document import (
    Bias,
    Compliance,
    DistanceView,
    Execution,
    Fiducials,
    FocalError,
    HandEye,
    ImageFieldDocument,
    Interface,
    Interfaces,
    IntrinsicsErrorDocument,
    IntrinsicsPrior,
    MatrixView,
    Motion,
    PinholeView,
    Pose,
    PresetView,
    PrincipalPointError,
    Region,
    Repeatability,
    RequirementDocument,
    TargetDocument,
    TemperatureDocument,
    Tolerances,
)
from .loading import Design
from .plausibility import explain_refusal, find_implausible
from .presets import PRESETS
from .refusals import place

DEFAULT_COVERAGE = 2.0


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
    unread = [view.name for view in document.views if view.intrinsics_prior or view.intrinsics_error]
    if unread and not document.model.estimator.believes_intrinsics:
        notes.append(
            f"what is said of the intrinsics of view {', '.join(unread)} has no effect: the estimator "
            f"{document.model.estimator} estimates them without being told any"
        )
    samples = {target.name: expand_target(target) for target in document.targets}
    targets = tuple(chain.from_iterable(samples.values()))
    refuse_behind_detector(design, views, fiducials, targets)
    execution_bias, execution = _execution(document.execution)
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
        manufacturing_coverage_factor=1.0 if made is None else _coverage(made.distribution, made.coverage_factor),
        structure_connector=_interface(document.interfaces.structure_connector, "structure_connector"),
        connector_flange=_interface(document.interfaces.connector_flange, "connector_flange"),
        T_flange_con=compile_transform(transforms.T_flange_con, "/transforms/T_flange_con", notes),
        T_tcp_flange=compile_transform(transforms.T_tcp_flange, "/transforms/T_tcp_flange", notes),
        hand_eye=_hand_eye(document.execution.hand_eye),
        execution_bias_mm=execution_bias,
        execution=execution,
        targets=targets,
        requirements=tuple([_requirement(item, samples) for item in document.requirements]),
        reading=document.model.installation_reading,
        rotation_form=document.model.rotation,
        estimator=document.model.estimator,
        triangulation=document.model.triangulation,
        temperature=_temperature(document.temperature, document.interfaces),
        balls=_balls(document.fiducials),
        loss_probability=_loss_probability(document.fiducials, len(fiducials)),
        notes=tuple(notes),
    )


# --- mounts -----------------------------------------------------------------------------------------


def _perfect(name: str) -> Mount:
    return Mount(name, frozen(np.zeros(3)), frozen(np.zeros(6)), no_sources(6))


def _coverage(distribution: str, factor: float | None) -> float:
    if distribution != "normal":
        return 1.0
    return DEFAULT_COVERAGE if factor is None else factor


def _interface(interface: Interface | None, name: str) -> Mount:
    if interface is None:
        return _perfect(name)
    pivot = frozen(interface.pivot_mm)
    sources = no_sources(6)
    if interface.tolerances is not None:
        sources = _torsor_sources(interface.tolerances)
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
            frozen([_coverage(locator.distribution, locator.coverage_factor) for locator in held]),
            ("mm",) * 6,
            frozen(direction),
        )
    return Mount(name, pivot, _bias(interface.bias), sources, interface.label)


def _hand_eye(hand_eye: HandEye | None) -> Mount:
    if hand_eye is None:
        return _perfect("hand_eye")
    sources = _torsor_sources(hand_eye.tolerances)
    return Mount("hand_eye", frozen(hand_eye.pivot_mm), _bias(hand_eye.bias), sources, "hand-eye calibration")


def _bias(bias: Bias) -> Array:
    turns = [radians(bias.rx_deg), radians(bias.ry_deg), radians(bias.rz_deg)]
    return frozen([*turns, bias.tx_mm, bias.ty_mm, bias.tz_mm])


def _motion(motion: Motion | None, view: str) -> Mount | None:
    if motion is None:
        return None
    label = motion.label or f"motion before shot {view}"
    sources = _torsor_sources(motion.tolerances)
    return Mount(f"motion:{view}", frozen(motion.pivot_mm), frozen(np.zeros(6)), sources, label)


def _torsor_sources(tolerances: Tolerances) -> Sources:
    """One source per declared component; its direction is that unit torsor."""
    given = [(k, name, getattr(tolerances, name)) for k, name in enumerate(TORSOR_COMPONENTS)]
    given = [entry for entry in given if entry[2] is not None]
    return Sources(
        tuple(name for _, name, _ in given),
        tuple(Law(item.distribution) for _, _, item in given),
        frozen([radians(item.half_width_deg) if k < 3 else item.half_width_mm for k, _, item in given]),
        frozen([_coverage(item.distribution, item.coverage_factor) for _, _, item in given]),
        tuple("rad" if k < 3 else "mm" for k, _, _ in given),
        frozen(np.eye(6)[:, [k for k, _, _ in given]]),
    )


def _execution(execution: Execution) -> tuple[Array, Sources]:
    parts = []
    bias = np.zeros(3)
    if execution.repeatability is not None:
        parts.append(_repeatability(execution.repeatability))
    if execution.compliance is not None:
        bias = np.array(execution.compliance.matrix_mm_per_n) @ np.array(execution.compliance.load_n)
        if execution.compliance.load_half_width_n is not None:
            parts.append(_load(execution.compliance))
    if not parts:
        return frozen(bias), no_sources(3)
    if len(parts) == 1:
        return frozen(bias), parts[0]
    return frozen(bias), Sources(
        tuple(name for part in parts for name in part.names),
        tuple(law for part in parts for law in part.laws),
        frozen(np.concatenate([part.half_width for part in parts])),
        frozen(np.concatenate([part.coverage_factor for part in parts])),
        tuple(unit for part in parts for unit in part.units),
        frozen(np.hstack([part.direction for part in parts])),
    )


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
    coverage = _coverage(law, scatter.coverage_factor)
    return _along_axes("repeatability", "mm", scatter.half_width_mm, law, coverage, np.eye(3))


def _load(compliance: Compliance) -> Sources:
    law = compliance.distribution or "normal"
    coverage = _coverage(law, compliance.coverage_factor)
    matrix = np.array(compliance.matrix_mm_per_n)
    return _along_axes("load", "N", compliance.load_half_width_n, str(law), coverage, matrix)


# --- what is wrong in the images of a unit ---------------------------------------------------------


def _image_field(field: ImageFieldDocument | None, size: tuple[int, int] | None) -> ImageField | None:
    """The coefficients of every degree that has some half-width, first those of u, then those of v."""
    if field is None:
        return None
    assert size is not None  # consistency has made sure
    degrees = [degree for degree, half_width in enumerate(field.half_widths_px) if half_width > 0]
    one = np.concatenate([np.zeros((0, 2), dtype=np.int64), *map(field_powers, degrees)])
    powers, axis = np.tile(one, (2, 1)), np.repeat([0, 1], len(one))
    coverage = _coverage(field.distribution, field.coverage_factor)
    sources = Sources(
        tuple(f"{'uv'[along]}.x{i}y{j}" for along, (i, j) in zip(axis, powers.tolist(), strict=True)),
        (Law(field.distribution),) * len(axis),
        frozen([field.half_widths_px[i + j] for i, j in powers.tolist()]),
        frozen([coverage] * len(axis)),
        ("px",) * len(axis),
        frozen(np.eye(len(axis))),
    )
    return ImageField(frozen(image_centre_px(size)), float(np.hypot(*size)) / 2, axis, powers, sources)


def _temperature(temperature: TemperatureDocument | None, interfaces: Interfaces) -> Temperature | None:
    if temperature is None:
        return None

    def place(given: Any, interface: Interface | None) -> Array:
        if given is None:
            given = (0.0, 0.0, 0.0) if interface is None else interface.pivot_mm
        return frozen(given)

    sources = no_sources(1)
    if temperature.half_width_k > 0:
        law = str(temperature.distribution)
        coverage = frozen([_coverage(law, temperature.coverage_factor)])
        width = frozen([temperature.half_width_k])
        sources = Sources(("difference",), (Law(law),), width, coverage, ("K",), frozen(np.eye(1)))
    return Temperature(
        difference_k=temperature.difference_k,
        sources=sources,
        structure_per_k=temperature.structure_expansion_um_per_m_k * 1e-6,
        connector_per_k=temperature.connector_expansion_um_per_m_k * 1e-6,
        seat_mm=place(temperature.seat_mm, interfaces.structure_connector),
        flange_seat_mm=place(temperature.flange_seat_mm, interfaces.connector_flange),
        at_pivots=(temperature.seat_mm is None, temperature.flange_seat_mm is None),
    )


def _loss_probability(fiducials: Fiducials, count: int) -> tuple[float, ...]:
    every = fiducials.loss_probability or 0.0
    own = [point.loss_probability for point in fiducials.points or ()] or [None] * count
    each = tuple(every if probability is None else probability for probability in own)
    return each if any(each) else ()


def _balls(fiducials: Fiducials) -> Balls | None:
    if fiducials.diameter_mm is None:
        return None
    return Balls(fiducials.diameter_mm / 2, 0.8 if fiducials.image_point == "shadow" else 1.0)


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
        _intrinsics_error(view.intrinsics_error, prior),
        _motion(view.motion, view.name),
        _image_field(view.image_field, size),
    )


def _intrinsics_error(error: IntrinsicsErrorDocument | None, prior: IntrinsicsPrior | None) -> IntrinsicsError | None:
    """As declared; otherwise the prior is taken at its word."""
    if error is None:
        if prior is None:
            return None
        error = IntrinsicsErrorDocument(
            focal=FocalError(half_width_rel=prior.focal_rel_sd, distribution="normal", coverage_factor=1.0),
            principal_point=PrincipalPointError(
                half_width_px=prior.principal_point_px_sd, distribution="normal", coverage_factor=1.0
            ),
        )
    focal, centre = error.focal or FocalError(), error.principal_point or PrincipalPointError()
    widths = (focal.half_width_rel, centre.half_width_px, centre.half_width_px)
    parts = [(k, (focal, centre, centre)[k]) for k in range(3) if widths[k]]
    laws = tuple(Law(part.distribution or "normal") for _, part in parts)
    return IntrinsicsError(
        frozen([focal.bias_rel, *centre.bias_px]),
        Sources(
            tuple(INTRINSICS[k] for k, _ in parts),
            laws,
            frozen([widths[k] for k, _ in parts]),
            frozen([_coverage(law, part.coverage_factor) for law, (_, part) in zip(laws, parts, strict=True)]),
            tuple(("1", "px", "px")[k] for k, _ in parts),
            frozen(np.eye(3)[:, [k for k, _ in parts]]),
        ),
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
        problems = [*error.problems, *explain_refusal(design, system)]
        raise IllPosedError([place(problem, source) for problem in problems]) from None
    return system, (*findings, *find_implausible(design, system)), views


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
