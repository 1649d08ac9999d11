"""The chain compiled to flat tables for the kernel, with the order in which random inputs are drawn.

Random inputs of one trial, in this order ("columns" of z; a block without inputs is absent):

=====================  ============================================================  ============
block                  columns                                                       stream
=====================  ============================================================  ============
fiducial_noise:VIEW    2 N: fiducial by fiducial (u, v)                              shot
target_noise:VIEW      2 for each target (u, v); follows its view's fiducials        shot
fiducial_manufacturing 3 N, fiducial by fiducial (x, y, z); absent when all zero     installation
structure_connector            one per source that is not BOUNDED                            installation
connector_flange            likewise                                                      installation
hand_eye               likewise                                                      installation
execution              likewise                                                      shot
motion:VIEW            likewise, of each view that has one                           shot
image_field:VIEW       likewise                                                      installation
temperature            likewise                                                      shot
assumed_intrinsics:VIEW likewise, where the estimator believes them                   installation
=====================  ============================================================  ============

Deviates are *standardised*: NORMAL is N(0, 1) times half-width / coverage factor; UNIFORM is on [-1, 1]
and TRIANGULAR on [-1, 1] with its mode at 0, both times the half-width.  BOUNDED sources are not random:
they stand at a vertex, given as fractions of their half-widths.

Which fiducials a shot misses is no column: it is drawn from a stream of its own (``chain.draw_losses``), so that the
deviates of a shot are the same whether or not the design says how often fiducials are missed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, frozen
from ..errors import OutOfRangeError, Problem
from ..estimation.least_squares import precisions, weights_at_rest
from ..estimation.resection import homogeneous
from ..geometry.image_shifts import field_shifts, outline_shifts
from ..system import (
    STD_PER_HALF_WIDTH,
    Law,
    Reading,
    RotationForm,
    Sources,
    System,
    Target,
    Triangulation,
    no_sources,
)

LAW_CODE = {Law.NORMAL: 0, Law.UNIFORM: 1, Law.TRIANGULAR: 2}
INSTALLATION, SHOT = 0, 1


class Tables(NamedTuple):
    """What the compiled code reads.  C-contiguous float64 unless said; object frame: see ChainPlan."""

    segments: NDArray[np.int64]  # (n, 4): first column, end column, law code, stream
    counts: NDArray[np.int64]  # (15,): N, V, T, manufacturing?, eq18?, small angle?, d, active-mount bits, published?,
    # whether a view does not see all fiducials, bits of the views with a motion, image shifts?, temperature?,
    # unknowns of a view by least squares (0: DLT), target by its images?
    starts: NDArray[np.int64]  # (6 + 3 V,): first column of manufacturing, and of every slot
    nominal: Array  # (N, 3) fiducials in the object frame
    products: (
        Array  # (V, N, 10) upper triangle of y~ y~^T, row by row, in the frame of each view; 0 where it is not seen
    )
    diagonal: Array  # (V, 8) D, then 1 / D, of each view
    view_frames: Array  # (V, 12) object frame -> frame of the view: linear part, then shift
    spread: Array  # (N, 3) scale of one manufacturing deviate, mm
    into_frame: Array  # (9,) con mm -> object frame, linear part
    out_of_frame: Array  # (9,) object frame -> con mm, linear part
    object_scale: Array  # (2,) length in the object frame over mm, and its square's inverse
    cameras: Array  # (V, 12) projection of con mm, pixels counted from the fiducials' nominal mean image
    fixed_images: Array  # (V, 12) projection of the object frame (where images do not move)
    intrinsics: (
        Array  # (V, 11) focal lengths and skew (u, skew, v), principal point from the same origin, px; then by how
    )
    # much the assumed ones are off with the bounded sources at their vertex: focal length (relative), principal point;
    # and the precision of each of these three as a prior has it, px^2 (``least_squares.precisions``)
    target_images: Array  # (T, V, 2) px from the same origin
    row_factors: Array  # (T, V, 3) L' of the weight L L' of a view's rows in triangulation: l00, l10, l11
    noise: Array  # (V, 2) px standard deviations: fiducials, targets
    gains: Array  # scaled directions one after another: mounts' (6, k), execution's (3, k), motions' (6, k), fields'
    # (2 (N + T), k), px by image, of one deviate of temperature: of the fiducials, object frame, and at the flange; and
    # of the assumed intrinsics (3, k)
    gain_starts: NDArray[np.int64]  # (5 + 3 V, 2): offset into gains, k
    torsors: Array  # (4 + V, 6) bias of mounts and motions with the bounded sources at their vertex; row 3: not read
    image_shifts: Array  # (V, N + T, 2) px: balls, and fields with the bounded coefficients at their vertex
    growth: Array  # (N + 1, 3) known: of the fiducials, object frame, and what moves con at the flange, mm
    centre: Array  # (3,) centroid of the fiducials, con
    pivots: Array  # (4 + V, 3) pivots: con, con, tcp, none, con
    targets: Array  # (T, 3) con
    targets_frame: Array  # (T, 3) object frame
    targets_tcp: Array  # (T, 3) tcp
    to_tcp: Array  # (9,) rotation of T_tcp_con
    execution_bias: Array  # (3,) tcp


@dataclass(frozen=True, slots=True)
class Block:
    """Columns ``start:stop`` of z."""

    name: str
    start: int
    stop: int
    laws: tuple[Law, ...]
    stream: int  # INSTALLATION or SHOT


@dataclass(frozen=True, slots=True, eq=False)
class ChainPlan:
    """A system compiled for simulation; arrays are read-only.

    The object frame is the fiducials' Hartley frame (centroid 0, RMS distance sqrt(3)) turned to their
    principal axes, so that ``D = sum y~ y~^T`` is diagonal.  DLT and triangulation are equivariant to it; where they
    are told other coordinates, or triangulate in others, the norm that they minimise in is carried over to it.

    A view that does not see all fiducials is resected in the same frame of those that it sees, a similarity away.
    """

    system: System
    tables: Tables
    blocks: tuple[Block, ...]
    bounded: tuple[str, ...]  # "structure_connector.rz", ...
    vertex: tuple[float, ...]  # of the bounded sources, fractions of the half-width
    shots_per_unit: int

    @property
    def dimension(self) -> int:
        """Number of deviates in a trial (columns of z)."""
        return int(self.tables.counts[6])

    def columns_of(self, name: str) -> slice:
        """Where the deviates of a block stand; empty where it has none."""
        return next((slice(block.start, block.stop) for block in self.blocks if block.name == name), slice(0, 0))

    @property
    def inputs(self) -> int:
        """The same number, by the name the second-order correction asks for."""
        return self.dimension

    @property
    def laws(self) -> tuple[Law, ...]:
        return tuple(law for block in self.blocks for law in block.laws)

    @property
    def standard_std(self) -> Array:
        """(d,) standard deviation of each standardised deviate: 1, 1/sqrt(3) or 1/sqrt(6)."""
        return np.array([1.0 if law is Law.NORMAL else STD_PER_HALF_WIDTH[law] for law in self.laws])


def scale_directions(sources: Sources) -> tuple[Array, tuple[Law, ...]]:
    """Directions scaled to standardised deviates, and laws, of the sources that have a law."""
    keep = [j for j, law in enumerate(sources.laws) if law is not Law.BOUNDED]
    scale = [sources.half_width[j] / (sources.coverage_factor[j] if sources.laws[j] is Law.NORMAL else 1) for j in keep]
    return sources.direction[:, keep] * np.array(scale, dtype=float), tuple(sources.laws[j] for j in keep)


def _list_bounded(sources: Sources) -> list[int]:
    return [j for j, law in enumerate(sources.laws) if law is Law.BOUNDED]


class _Slot(NamedTuple):
    """One place of the chain at which sources act.

    Rows of their direction: a torsor (6); at the tool (3); the images of fiducials and targets in one view, u and v of
    each; x, y and z of each fiducial, object frame, and of what moves con at the flange; three intrinsics.
    """

    name: str
    stream: int
    sources: Sources
    fixed: Array  # (rows,) bias of the same
    pivot_mm: Array = np.zeros(3)


def _slots(system: System) -> list[_Slot]:
    """Every place, with sources or without.

    Three mounts, execution, of each view its motion, its image field, heat, of each view its assumed intrinsics.
    """
    slots = [
        _Slot(mount.name, INSTALLATION, mount.sources, mount.bias, mount.pivot_mm)
        for mount in (*system.interfaces, system.hand_eye)
    ]
    slots.append(_Slot("execution", SHOT, system.execution, system.execution_bias_mm))
    for view in system.views:
        if (motion := view.motion) is None:
            slots.append(_Slot(f"motion:{view.name}", SHOT, no_sources(6), np.zeros(6)))
        else:
            slots.append(_Slot(motion.name, SHOT, motion.sources, motion.bias, motion.pivot_mm))
    points = np.vstack([system.fiducials_mm, [target.position_mm for target in system.targets]])
    for view in system.views:
        fixed, sources = np.zeros(2 * len(points)), no_sources(2 * len(points))
        if (balls := system.balls) is not None:
            shifts = outline_shifts(view.projection, system.fiducials_mm, balls.radius_mm)
            fixed[: shifts.size] = balls.share * shifts.ravel()
        if (field := view.image_field) is not None:
            images = images_of(view.projection, points)
            moved = field_shifts(images, field.centre_px, field.half_diagonal_px, field.axis, field.powers)
            sources = replace(field.sources, direction=moved.reshape(2 * len(points), -1))
        slots.append(_Slot(f"image_field:{view.name}", INSTALLATION, sources, fixed))
    fixed, sources = np.zeros(3 * len(system.fiducials_mm) + 3), no_sources(3 * len(system.fiducials_mm) + 3)
    if (heat := system.temperature) is not None:
        away = heat.structure_per_k * (system.fiducials_mm - heat.seat_mm)
        into = object_frame(system.fiducials_mm).into
        per_k = np.append(product(away, into.T), -heat.connector_mm_per_k)
        fixed, sources = (
            heat.difference_k * per_k,
            replace(heat.sources, direction=per_k[:, None] * heat.sources.direction),
        )
    slots.append(_Slot("temperature", SHOT, sources, fixed))
    for view in system.views:  # behind everything that seeds drew before there were such sources
        fixed, sources = np.zeros(3), no_sources(3)
        if system.estimator.believes_intrinsics and (error := view.intrinsics_error) is not None:
            fixed, sources = error.bias, error.sources
        slots.append(_Slot(f"assumed_intrinsics:{view.name}", INSTALLATION, sources, fixed))
    return slots


def bounded_names(system: System) -> tuple[str, ...]:
    """Names of the sources that have no law, "contributor.component", in the order of a vertex array."""
    return tuple(f"{slot.name}.{slot.sources.names[j]}" for slot in _slots(system) for j in _list_bounded(slot.sources))


def _vertex_values(system: System, vertex: Mapping[str, float] | Array | None) -> tuple[float, ...]:
    names = bounded_names(system)
    if vertex is None:
        return (0.0,) * len(names)
    if isinstance(vertex, Mapping):
        unknown = sorted(set(vertex) - set(names))
        if unknown:
            detail = f"vertex names {', '.join(unknown)}, which is not a bounded source"
            raise OutOfRangeError(
                Problem("", "unknown-vertex", detail, f"bounded sources: {', '.join(names) or 'none'}")
            )
        return tuple(float(vertex.get(name, 0.0)) for name in names)
    values = np.asarray(vertex, dtype=float)
    if values.shape != (len(names),) or not np.isfinite(values).all():
        detail = f"a vertex takes {len(names)} finite values, one per bounded source; got shape {values.shape}"
        raise OutOfRangeError(Problem("", "vertex-shape", detail))
    return tuple(float(v) for v in values)


def product(a: Array, b: Array) -> Array:
    """Matrix product by plain sums.  BLAS picks its order of summation by processor; these tables decide digits."""
    return np.asarray((a[:, :, None] * b[None, :, :]).sum(axis=1))


def images_of(projection: Array, points: Array) -> Array:
    """Pinhole projection (Eq 1) by plain sums: (3, 4), (n, 3) -> (n, 2)."""
    homogeneous_images = product(homogeneous(points), projection.T)
    return np.asarray(homogeneous_images[:, :2] / homogeneous_images[:, 2:])


def principal_axes(moment: Array) -> Array:
    """Eigenvectors (rows, right-handed) of a symmetric (3, 3), by cyclic Jacobi rotations (Golub and Van Loan 8.5)."""
    m, axes = moment.copy(), np.eye(3)
    for _ in range(12):  # quadratic convergence: six sweeps reach rounding
        for p, q in ((0, 1), (0, 2), (1, 2)):
            if abs(m[p, q]) <= 1e-17 * (abs(m[p, p]) + abs(m[q, q])):
                continue
            ratio = (m[q, q] - m[p, p]) / (2 * m[p, q])
            t = (1.0 if ratio >= 0 else -1.0) / (abs(ratio) + sqrt(ratio * ratio + 1))
            c = 1 / sqrt(t * t + 1)
            turn = np.eye(3)
            turn[p, p] = turn[q, q] = c
            turn[p, q], turn[q, p] = -t * c, t * c
            m = product(product(turn, m), turn.T)
            axes = product(turn, axes)
    return axes


class ObjectFrame(NamedTuple):
    """``X = E y + centroid``: the fiducials' Hartley frame, turned to their principal axes."""

    out: Array  # (3, 3) E
    into: Array  # (3, 3) its inverse
    centroid: Array  # (3,) mm, con
    points: Array  # (N, 3) y of the fiducials: centred, RMS distance sqrt(3)


def object_frame(points: Array) -> ObjectFrame:
    """The object frame of fiducials (N, 3), mm."""
    centroid = points.mean(axis=0)
    centred = points - centroid
    scale = sqrt(3) / sqrt((centred**2).sum(axis=1).mean())
    into = scale * principal_axes(product(centred.T, centred))
    return ObjectFrame(into.T / scale**2, into, centroid, product(centred, into.T))


def compile_plan(
    system: System, *, vertex: Mapping[str, float] | Array | None = None, shots_per_unit: int = 1
) -> ChainPlan:
    """Compile a system for simulation.

    vertex: where the BOUNDED sources stand, fractions of their half-widths, by name
    ("structure_connector.rz": 1.0) or as an array in the order of ``bounded_names``; default 0.
    shots_per_unit: this many consecutive trials share one installation.
    Raises OutOfRangeError for an unknown vertex or a count below 1.
    """
    if shots_per_unit < 1:
        raise OutOfRangeError(Problem("", "shots-per-unit", f"shots_per_unit must be at least 1, got {shots_per_unit}"))
    values = _vertex_values(system, vertex)
    sources = _compile_sources(system, values)
    blocks, starts = _lay_out(system, sources)
    views = len(system.views)
    tables = Tables(
        segments=_segments(blocks),
        counts=_counts(system, sources, blocks[-1].stop if blocks else 0),
        starts=starts,
        **_compile_geometry(system, sources),
        spread=_spread(system),
        noise=np.array([(v.fiducial_noise_px, v.target_noise_px) for v in system.views]),
        gains=np.concatenate([gain.ravel() for gain in sources.gains]),
        gain_starts=sources.gain_starts,
        torsors=np.array([np.resize(fixed, 6) for fixed in sources.fixed[: 4 + views]]),
        image_shifts=np.array(sources.fixed[4 + views : 4 + 2 * views]).reshape(views, -1, 2),
        growth=sources.fixed[4 + 2 * views].reshape(-1, 3),
        pivots=np.array([slot.pivot_mm for slot in sources.slots[: 4 + views]]),
        execution_bias=sources.fixed[3],
    )
    tables = Tables(*(frozen(table, table.dtype) for table in tables))
    return ChainPlan(system, tables, blocks, bounded_names(system), values, shots_per_unit)


def hide_fiducials(system: System, lost: NDArray[np.bool_]) -> System:
    """The system in which no view sees these fiducials (N,)."""
    labels = np.array(system.fiducial_labels)
    views = tuple(
        replace(view, sees=tuple(labels[(seen > 0) & ~lost].tolist()))
        for view, seen in zip(system.views, system.sees, strict=True)
    )
    return replace(system, views=views, loss_probability=())


def replan(plan: ChainPlan, system: System) -> ChainPlan:
    """The plan of a system of which some fiducials were hidden: columns and their deviates stay what they are."""
    tables = plan.tables
    counts = tables.counts.copy()
    counts[9] = 1  # a view does not see all
    out, into = tables.out_of_frame.reshape(3, 3), tables.into_frame.reshape(3, 3)
    seen = _tables_of_views(system, ObjectFrame(out, into, tables.centre, tables.nominal))
    own = {name: frozen(table, table.dtype) for name, table in (seen | {"counts": counts}).items()}
    return replace(plan, system=system, tables=tables._replace(**own))


def _compile_geometry(system: System, sources: _SourceTables) -> dict[str, Array]:
    """The tables of fiducials, views and targets."""
    frame = object_frame(system.fiducials_mm)
    scale2 = float((frame.into**2).sum()) / 3
    positions = np.array([t.position_mm for t in system.targets])
    tcp_con = product(system.T_tcp_flange, system.T_flange_con)
    out = np.block([[frame.out, frame.centroid[:, None]], [np.zeros((1, 3)), np.ones((1, 1))]])
    cameras, intrinsics, known = [], [], precisions(system)
    for v, view in enumerate(system.views):
        origin = images_of(view.projection, system.fiducials_mm).mean(axis=0)
        cameras.append(view.projection - np.array([*origin, 0.0])[:, None] * view.projection[2])
        assumed = sources.fixed[5 + 2 * len(system.views) + v]
        intrinsics.append(np.concatenate([_intrinsics_of(cameras[-1]), assumed, known[v]]))
    return {
        "nominal": frame.points,
        **_tables_of_views(system, frame),
        "into_frame": frame.into.ravel(),
        "out_of_frame": frame.out.ravel(),
        "object_scale": np.array([sqrt(scale2), 1 / scale2]),
        "cameras": np.array([camera.ravel() for camera in cameras]),
        "fixed_images": np.array([product(camera, out).ravel() for camera in cameras]),
        "intrinsics": np.array(intrinsics),
        "target_images": np.swapaxes(np.array([images_of(camera, positions) for camera in cameras]), 0, 1),
        "centre": frame.centroid,
        "targets": positions,
        "targets_frame": product(positions - frame.centroid, frame.into.T),
        "targets_tcp": product(positions, tcp_con[:3, :3].T) + tcp_con[:3, 3],
        "to_tcp": tcp_con[:3, :3].ravel(),
    }


def _intrinsics_of(camera: Array) -> Array:
    """(5,) focal length along u, skew, focal length along v, principal point (u, v), px; ``|camera[2, :3]| = 1``."""
    rows, third = camera[:2, :3], camera[2, :3]
    point = (rows * third).sum(axis=1)
    u, v = rows - point[:, None] * third
    focal_v = sqrt(float((v * v).sum()))
    skew = float((u * v).sum()) / focal_v
    rest = u - skew * v / focal_v
    return np.array([sqrt(float((rest * rest).sum())), skew, focal_v, *point])


def _tables_of_views(system: System, frame: ObjectFrame) -> dict[str, NDArray[Any]]:
    """The tables that hang on which fiducials a view sees."""
    every = [tuple((seen > 0).tolist()) for seen in system.sees]
    own = {seen: _view_tables(system, frame, np.array(seen)) for seen in set(every)}  # most often they are alike
    each = zip(*(own[seen] for seen in every), strict=True)
    tables = dict(zip(("products", "diagonal", "view_frames"), map(np.array, each), strict=True))
    return tables | {"row_factors": np.array([_row_factors(system, target) for target in system.targets])}


def _row_factors(system: System, target: Target) -> Array:
    """(V, 3): l00, l10 and l11 of L L' = the weight of each view's rows in triangulation; all alike unless weighted."""
    if system.triangulation is not Triangulation.WEIGHTED:
        return np.tile([1.0, 0.0, 1.0], (len(system.views), 1))
    (a, b), (_, c) = np.moveaxis(weights_at_rest(system, target), 0, -1)
    first = np.sqrt(a)
    return np.stack([first, b / first, np.sqrt(c - (b / first) ** 2)], axis=-1)


def _view_tables(system: System, frame: ObjectFrame, seen: NDArray[np.bool_]) -> tuple[Array, Array, Array]:
    """Products (N, 10), diagonal (8,) and frame (12,) of a view that sees these of the fiducials (N,)."""
    own = frame if seen.all() else object_frame(system.fiducials_mm[seen])
    y1, upper = homogeneous(own.points), np.triu_indices(4)
    diagonal = (y1**2).sum(axis=0)
    products = np.zeros((len(seen), 10))
    products[seen] = y1[:, upper[0]] * y1[:, upper[1]]
    linear = np.eye(3) if own is frame else product(own.into, frame.out)
    shift = (own.into * (frame.centroid - own.centroid)).sum(axis=1)
    with np.errstate(divide="ignore"):  # of fiducials in one plane, which the lanes are not asked for
        inverse = 1 / diagonal
    return products, np.array([*diagonal, *inverse]), np.array([*linear.ravel(), *shift])


def _spread(system: System) -> Array:
    """(N, 3) mm: scale of one manufacturing deviate."""
    normal = system.manufacturing_law is Law.NORMAL
    coverage = system.manufacturing_coverage_factor if normal else 1.0
    return np.asarray(system.manufacturing_half_width_mm / coverage, dtype=np.float64)


class _SourceTables(NamedTuple):
    """The sources of every slot, in their order: the bounded ones at their vertex."""

    slots: list[_Slot]
    gains: list[Array]  # (rows, k) of those that have a law
    gain_starts: NDArray[np.int64]  # (slots, 2): offset of each among all, k
    laws: list[tuple[Law, ...]]
    fixed: list[Array]  # (rows,) of each slot

    def acts(self, place: int) -> bool:
        """Whether a slot moves anything."""
        return bool(self.laws[place]) or bool(self.fixed[place].any())


def _compile_sources(system: System, vertex: tuple[float, ...]) -> _SourceTables:
    slots = _slots(system)
    gains, laws, fixed, taken = [], [], [], 0
    for slot in slots:
        sources = slot.sources
        gain, own = scale_directions(sources)
        gains.append(gain)
        laws.append(own)
        bounded = _list_bounded(sources)
        at = np.array(vertex[taken : taken + len(bounded)])
        taken += len(bounded)
        fixed.append(slot.fixed + (sources.direction[:, bounded] * (sources.half_width[bounded] * at)).sum(axis=1))
    offsets = np.cumsum([0, *(gain.size for gain in gains[:-1])])
    starts = np.array([(offset, len(own)) for offset, own in zip(offsets, laws, strict=True)])
    return _SourceTables(slots, gains, starts, laws, fixed)


def _lay_out(system: System, sources: _SourceTables) -> tuple[tuple[Block, ...], NDArray[np.int64]]:
    """The blocks that have columns, and the first column of manufacturing and of every slot."""
    count, targets = len(system.fiducials_mm), len(system.targets)
    manufactured = bool(np.any(_spread(system) != 0))
    every: list[tuple[str, tuple[Law, ...], int]] = []
    for view in system.views:
        every.append((f"fiducial_noise:{view.name}", (Law.NORMAL,) * (2 * count), SHOT))
        every.append((f"target_noise:{view.name}", (Law.NORMAL,) * (2 * targets), SHOT))
    every.append(("fiducial_manufacturing", (system.manufacturing_law,) * (3 * count * manufactured), INSTALLATION))
    for slot, laws in zip(sources.slots, sources.laws, strict=True):
        every.append((slot.name, laws, slot.stream))
    ends = np.cumsum([0, *(len(laws) for _, laws, _ in every)])
    blocks = (
        Block(name, int(start), int(start) + len(laws), laws, stream)
        for start, (name, laws, stream) in zip(ends, every, strict=False)
    )
    return tuple(block for block in blocks if block.stop > block.start), ends[2 * len(system.views) : -1]


def _counts(system: System, sources: _SourceTables, dimension: int) -> NDArray[np.int64]:
    views = len(system.views)
    return np.array(
        [
            len(system.fiducials_mm),
            len(system.views),
            len(system.targets),
            bool(np.any(_spread(system) != 0)),
            system.reading is Reading.EQ18,
            system.rotation_form is RotationForm.SMALL_ANGLE,
            dimension,
            sum(1 << k for k in range(3) if sources.acts(k)),
            system.triangulation is Triangulation.PUBLISHED,
            not system.sees.all(),
            sum(1 << v for v in range(views) if sources.acts(4 + v)),
            any(sources.acts(4 + views + v) for v in range(views)),
            sources.acts(4 + 2 * views),
            system.estimator.unknowns,
            system.triangulation is Triangulation.REPROJECTION,
        ]
    )


def _segments(blocks: tuple[Block, ...]) -> NDArray[np.int64]:
    """Runs of columns with one law and one stream: the unit in which deviates are drawn."""
    runs: list[list[int]] = []
    for block in blocks:
        for k, law in enumerate(block.laws):
            column, code = block.start + k, LAW_CODE[law]
            if runs and runs[-1][1:] == [column, code, block.stream]:
                runs[-1][1] = column + 1
            else:
                runs.append([column, column + 1, code, block.stream])
    return np.array(runs, dtype=np.int64).reshape(-1, 4)
