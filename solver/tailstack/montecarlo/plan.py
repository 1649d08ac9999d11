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
=====================  ============================================================  ============

Deviates are *standardised*: NORMAL is N(0, 1) times half-width / coverage factor; UNIFORM is on [-1, 1]
and TRIANGULAR on [-1, 1] with its mode at 0, both times the half-width.  BOUNDED sources are not random:
they stand at a vertex, given as fractions of their half-widths.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..errors import OutOfRangeError, Problem
from ..estimation.resection import homogeneous
from ..system import STD_PER_HALF_WIDTH, Law, Mount, Reading, RotationForm, Sources, System, Triangulation

LAW_CODE = {Law.NORMAL: 0, Law.UNIFORM: 1, Law.TRIANGULAR: 2}
INSTALLATION, SHOT = 0, 1


class Tables(NamedTuple):
    """What the compiled code reads.  C-contiguous float64 unless said; object frame: see ChainPlan."""

    segments: NDArray[np.int64]  # (n, 4): first column, end column, law code, stream
    counts: NDArray[np.int64]  # (9,): N, V, T, manufacturing?, eq18?, small angle?, d, active-mount bits, published?
    starts: NDArray[np.int64]  # (5,): first column of manufacturing, the three mounts, execution
    nominal: Array  # (N, 3) fiducials in the object frame
    products: Array  # (N, 10) upper triangle of y~ y~^T, row by row
    diagonal: Array  # (8,) D, then 1 / D
    spread: Array  # (N, 3) scale of one manufacturing deviate, mm
    into_frame: Array  # (9,) con mm -> object frame, linear part
    out_of_frame: Array  # (9,) object frame -> con mm, linear part
    object_scale: Array  # (2,) length in the object frame over mm, and its square's inverse
    cameras: Array  # (V, 12) projection of con mm, pixels counted from the fiducials' nominal mean image
    fixed_images: Array  # (V, 12) projection of the object frame (where images do not move)
    target_images: Array  # (T, V, 2) px from the same origin
    noise: Array  # (V, 2) px standard deviations: fiducials, targets
    gains: Array  # mounts' (6, k) scaled directions, one after another, then execution's (3, k)
    gain_starts: NDArray[np.int64]  # (4, 2): offset into gains, k
    torsors: Array  # (3, 6) bias of each mount with the bounded sources at their vertex
    centre: Array  # (3,) centroid of the fiducials, con
    pivots: Array  # (3, 3) pivots: con, con, tcp
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


def read_only(values: Array) -> Array:
    array = np.ascontiguousarray(values, dtype=np.float64)
    if array is values:
        array = array.copy()
    array.setflags(write=False)
    return array


def _random(sources: Sources) -> tuple[Array, tuple[Law, ...]]:
    """Directions scaled to standardised deviates, and laws, of the sources that have a law."""
    keep = [j for j, law in enumerate(sources.laws) if law is not Law.BOUNDED]
    scale = [sources.half_width[j] / (sources.coverage_factor[j] if sources.laws[j] is Law.NORMAL else 1) for j in keep]
    return sources.direction[:, keep] * np.array(scale, dtype=float), tuple(sources.laws[j] for j in keep)


def _bounded(sources: Sources) -> list[int]:
    return [j for j, law in enumerate(sources.laws) if law is Law.BOUNDED]


def _named_sources(system: System) -> list[tuple[str, Sources]]:
    mounts: list[Mount] = [*system.interfaces, system.hand_eye]
    return [(m.name, m.sources) for m in mounts] + [("execution", system.execution)]


def bounded_names(system: System) -> tuple[str, ...]:
    """Names of the sources that have no law, "contributor.component", in the order of a vertex array."""
    return tuple(f"{name}.{sources.names[j]}" for name, sources in _named_sources(system) for j in _bounded(sources))


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


def object_frame(points: Array) -> tuple[Array, Array, Array, Array]:
    """(E, E^-1, centroid, y): ``X = E y + centroid``, y (N, 3) centred, RMS sqrt(3), on principal axes."""
    centroid = points.mean(axis=0)
    centred = points - centroid
    scale = sqrt(3) / sqrt((centred**2).sum(axis=1).mean())
    into = scale * principal_axes(product(centred.T, centred))
    return into.T / scale**2, into, centroid, product(centred, into.T)


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
    points = system.fiducials_mm
    count, views, targets = len(points), len(system.views), len(system.targets)
    out, into, centroid, y = object_frame(points)
    y1 = homogeneous(y)
    upper = np.triu_indices(4)
    diagonal: Array = np.asarray((y1**2).sum(axis=0), dtype=np.float64)

    cameras, fixed, images = [], [], []
    positions = np.array([t.position_mm for t in system.targets])
    frame = np.block([[out, centroid[:, None]], [np.zeros((1, 3)), np.ones((1, 1))]])
    for view in system.views:
        origin = images_of(view.projection, points).mean(axis=0)
        shifted = view.projection - np.array([*origin, 0.0])[:, None] * view.projection[2]
        cameras.append(shifted.ravel())
        fixed.append(product(shifted, frame).ravel())
        images.append(images_of(shifted, positions))

    values = _vertex_values(system, vertex)
    taken = 0
    gains, gain_starts, shifts, offset = [], [], [], 0
    source_laws: list[tuple[Law, ...]] = []
    for _, sources in _named_sources(system):
        gain, laws = _random(sources)
        gains.append(gain.ravel())
        gain_starts.append((offset, len(laws)))
        offset += gain.size
        source_laws.append(laws)
        held = _bounded(sources)
        at = np.array(values[taken : taken + len(held)])
        taken += len(held)
        shifts.append((sources.direction[:, held] * (sources.half_width[held] * at)).sum(axis=1))
    mounts = (*system.interfaces, system.hand_eye)
    torsors = np.array([m.bias + s for m, s in zip(mounts, shifts[:3], strict=True)])

    standard = system.manufacturing_half_width_mm / (
        system.manufacturing_coverage_factor if system.manufacturing_law is Law.NORMAL else 1.0
    )
    manufactured = bool(np.any(standard != 0))
    blocks: list[Block] = []

    def add(name: str, laws: tuple[Law, ...], stream: int) -> int:
        start = blocks[-1].stop if blocks else 0
        blocks.append(Block(name, start, start + len(laws), laws, stream))
        return start

    for view in system.views:
        add(f"fiducial_noise:{view.name}", (Law.NORMAL,) * (2 * count), SHOT)
        add(f"target_noise:{view.name}", (Law.NORMAL,) * (2 * targets), SHOT)
    starts = [add("fiducial_manufacturing", (system.manufacturing_law,) * (3 * count * manufactured), INSTALLATION)]
    starts += [add(m.name, source_laws[k], INSTALLATION) for k, m in enumerate(mounts)]
    starts.append(add("execution", source_laws[3], SHOT))
    kept = tuple(block for block in blocks if block.stop > block.start)

    scale2 = float((into**2).sum()) / 3
    published = system.triangulation is Triangulation.PUBLISHED
    small = system.rotation_form is RotationForm.SMALL_ANGLE
    eq18 = system.reading is Reading.EQ18
    active = sum(1 << k for k in range(3) if source_laws[k] or np.any(torsors[k] != 0))
    tcp_con = product(system.T_tcp_flange, system.T_flange_con)
    tables = Tables(
        segments=_segments(kept),
        counts=np.array([count, views, targets, manufactured, eq18, small, blocks[-1].stop, active, published]),
        starts=np.array(starts),
        nominal=read_only(y),
        products=read_only(y1[:, upper[0]] * y1[:, upper[1]]),
        diagonal=read_only(np.array([*diagonal, *(1 / diagonal)])),
        spread=read_only(np.asarray(standard, dtype=np.float64)),
        into_frame=read_only(into.ravel()),
        out_of_frame=read_only(out.ravel()),
        object_scale=read_only(np.array([sqrt(scale2), 1 / scale2])),
        cameras=read_only(np.array(cameras)),
        fixed_images=read_only(np.array(fixed)),
        target_images=read_only(np.swapaxes(np.array(images), 0, 1)),
        noise=read_only(np.array([(v.fiducial_noise_px, v.target_noise_px) for v in system.views])),
        gains=read_only(np.concatenate(gains)),
        gain_starts=np.array(gain_starts),
        torsors=read_only(torsors),
        centre=read_only(centroid),
        pivots=read_only(np.array([m.pivot_mm for m in mounts])),
        targets=read_only(positions),
        targets_frame=read_only(product(positions - centroid, into.T)),
        targets_tcp=read_only(product(positions, tcp_con[:3, :3].T) + tcp_con[:3, 3]),
        to_tcp=read_only(tcp_con[:3, :3].ravel()),
        execution_bias=read_only(system.execution_bias_mm + shifts[3]),
    )
    for table in tables:
        table.setflags(write=False)
    return ChainPlan(system, tables, kept, bounded_names(system), values, shots_per_unit)


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
