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
robot:JOINT             likewise                                                      installation
joint_scatter           likewise                                                      shot
=====================  ============================================================  ============

Deviates are *standardised*: NORMAL is N(0, 1) times half-width / coverage factor; every other law is on [-1, 1] about
0, times the half-width.  BOUNDED sources are not random:
they stand at a vertex, given as fractions of their half-widths.

Which fiducials a shot misses is no column: it is drawn from a stream of its own (``chain.draw_losses``), so that the
deviates of a shot are the same whether or not the design says how often fiducials are missed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from math import sqrt
from typing import NamedTuple, assert_never

import numpy as np
from numpy.typing import NDArray

from ..errors import OutOfRangeError, Problem
from ..estimation.least_squares import weights_at_rest
from ..estimation.missed import hide_fiducials
from ..estimation.resection import homogeneous
from ..geometry.arrays import Array, frozen
from ..geometry.camera import intrinsics_of
from ..geometry.rotation import RotationForm, carry, undo
from ..laws import SUMS, Drawn
from ..system import Act, Effect, Law, Place, Reading, Sources, System, Target, View, Weighing, std_per_half_width
from .tables import (
    BY_IMAGES,
    DEVIATES,
    EQ18,
    EXECUTION,
    FIDUCIALS,
    GROWING,
    HIDDEN,
    INSTALLATION,
    MANUFACTURED,
    MOUNTS,
    MOVING,
    PUBLISHED,
    SCREWS,
    SEAT,
    SHIFTING,
    SHOT,
    SMALL_ANGLE,
    TARGETS,
    UNKNOWNS,
    VIEWS,
    Tables,
    arm_slot,
    beads_slot,
    images_slot,
    intrinsics_slot,
    moves,
    shot_slot,
)

SHOT_PLACES = (Place.SHOT, Place.BEADS, Place.CONNECTOR, Place.TOOL)  # of motion, growth and robot
LAW_CODE = {Law.NORMAL: 0} | {law: place for place, law in enumerate(SUMS, 1)}


@dataclass(frozen=True, slots=True)
class DeviateColumns:
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
    assume other coordinates, or triangulate in others, the norm that they minimise in is carried over to it.

    A view that does not see all fiducials is resected in the same frame of those that it sees, a similarity away.
    """

    system: System
    tables: Tables
    blocks: tuple[DeviateColumns, ...]
    vertex: tuple[float, ...]  # of the bounded sources, fractions of the half-width
    shots_per_unit: int

    @property
    def dimension(self) -> int:
        """Number of deviates in a trial (columns of z)."""
        return int(self.tables.counts[DEVIATES])

    @property
    def runs_in_lanes(self) -> bool:
        """Whether the kernel follows.

        Not where small angles, which turn nothing rigidly, act on what an estimator assumes (Eq 18), or takes for a
        pose.
        """
        counts = self.tables.counts
        stretched = counts[EQ18] != 0 and moves(counts, SEAT)
        return counts[SMALL_ANGLE] == 0 or not (stretched or 0 < counts[UNKNOWNS] < 11)

    def columns_of(self, name: str) -> slice:
        """Where the deviates of a block stand; empty where it has none."""
        return next((slice(block.start, block.stop) for block in self.blocks if block.name == name), slice(0, 0))

    @property
    def laws(self) -> tuple[Law, ...]:
        return tuple(law for block in self.blocks for law in block.laws)

    @property
    def standard_std(self) -> Array:
        """(d,) standard deviation of each standardised deviate: 1, of uniform ones 1/sqrt(3)."""
        return np.array([std_per_half_width(law) for law in self.laws])


def scale_directions(sources: Sources) -> tuple[Array, tuple[Law, ...]]:
    """Directions scaled to standardised deviates, and laws, of the sources that have a law."""
    keep = [j for j, law in enumerate(sources.laws) if law is not Law.BOUNDED]
    scale = [sources.half_width[j] / (sources.coverage_factor[j] if sources.laws[j] is Law.NORMAL else 1) for j in keep]
    return sources.direction[:, keep] * np.array(scale, dtype=float), tuple(sources.laws[j] for j in keep)


def _list_bounded(sources: Sources) -> list[int]:
    return [j for j, law in enumerate(sources.laws) if law is Law.BOUNDED]


class _Part(NamedTuple):
    """A contributor that acts in a slot."""

    name: str
    stream: int
    sources: Sources  # their direction (rows, k) is that of the slot
    fixed: Array  # (rows,) what is known of it


class _Slot(NamedTuple):
    """One place of the chain, and the contributors that act there.

    Rows of their directions: a torsor (6); at the tool (3); the images of fiducials and targets in one view, u and v of
    each; x, y and z of each fiducial, object frame, and of what moves con at the flange; three intrinsics; the screws
    of an arm.
    """

    rows: int
    parts: tuple[_Part, ...]
    pivot_mm: Array = np.zeros(3)
    twists: Array = np.zeros((0, 6))  # (rows, 6) con: the screws of an arm

    @property
    def known(self) -> Array:
        return sum((part.fixed for part in self.parts), np.zeros(self.rows))


def _stream(drawn: Drawn, place: Place, held: Drawn | None) -> int:
    """The stream that something is drawn from.  By its place where every trial draws everything: how often a design
    says that it is drawn is then no matter, and changes no digit."""
    again = place in SHOT_PLACES if held is None else not drawn.is_held(held)
    return SHOT if again else INSTALLATION


def _slots(system: System, held: Drawn | None = None) -> list[_Slot]:
    """Every place, with contributors or without; held: see ``compile_plan``.

    Three mounts, execution, of each view its motion, the images of each view, what moves the fiducials, of each view
    its assumed intrinsics, the arm: the order in which seeds draw.
    """
    slots = [
        _Slot(
            len(link.known),
            (_Part(link.name, _stream(link.drawn, link.place, held), link.sources, link.known),),
            link.pivot_mm,
        )
        for link in system.links
    ]
    scene = system.scene(np.array([target.position_mm for target in system.targets]), images_of)
    acts = [(effect, _place(act)) for effect in system.effects for act in effect.act(scene)]

    def at(place: Place, view: str) -> tuple[tuple[Effect, Act], ...]:
        return tuple((effect, act) for effect, act in acts if act.place is place and act.view in (None, view))

    def parts(pairs: Sequence[tuple[Effect, Act]]) -> tuple[_Part, ...]:
        return tuple(_part(effect, act, held) for effect, act in pairs)

    for view in system.views:
        moved = at(Place.SHOT, view.name)
        if len(moved) > 1:
            detail = f"two effects move the structure before shot {view.name}: {', '.join(e.name for e, _ in moved)}"
            raise OutOfRangeError(Problem("", "two-motions", detail, "state one torsor that holds both"))
        slots.append(_Slot(6, parts(moved), moved[0][1].pivot_mm if moved else np.zeros(3)))
    points = len(system.fiducials_mm) + len(system.targets)
    slots += [_Slot(2 * points, parts(at(Place.IMAGES, view.name))) for view in system.views]
    slots.append(_Slot(3 * len(system.fiducials_mm) + 3, _parts_of_beads(system, acts, held)))
    believed = zip(system.views, system.believed_errors, strict=True)
    slots += [_Slot(3, parts(at(Place.INTRINSICS, view.name)) if error else ()) for view, error in believed]
    arm = tuple(pair for pair in acts if pair[1].place is Place.ARM)
    twists = carry(undo(system.T_flange_con), arm[0][1].twists if arm else np.zeros((0, 6)))
    return [*slots, _Slot(len(twists), parts(arm), twists=twists)]


def _place(act: Act) -> Act:
    """The same, of which the plan knows where it belongs."""
    match act.place:
        case Place.SHOT | Place.IMAGES | Place.INTRINSICS | Place.BEADS | Place.CONNECTOR | Place.ARM:
            return act  # a slot of each view; ``_parts_of_beads`` for two; the last slot
        case Place.SEAT | Place.FLANGE | Place.HAND_EYE | Place.TOOL:
            raise AssertionError(act.place)  # ``System.links`` alone
        case _:
            assert_never(act.place)


def _part(effect: Effect, act: Act, held: Drawn | None) -> _Part:
    sources = replace(effect.sources, direction=act.by(effect.sources.direction))
    return _Part(effect.name, _stream(effect.drawn, act.place, held), sources, act.by(effect.known))


def _parts_of_beads(system: System, acts: Sequence[tuple[Effect, Act]], held: Drawn | None) -> tuple[_Part, ...]:
    """What moves the fiducials, object frame, and what is at the flange; both by the same deviates."""
    count = 3 * len(system.fiducials_mm)
    into, parts = object_frame(system.fiducials_mm).into, []
    for effect in system.effects:
        each = np.eye(len(effect.known))
        rows = np.zeros((count + 3, len(each)))
        for _, act in (own for own in acts if own[0] is effect):
            if act.place is Place.BEADS:
                for j, column in enumerate(act.by(each).T):
                    rows[:count, j] += product(column.reshape(-1, 3), into.T).ravel()
            elif act.place is Place.CONNECTOR:
                rows[count:] += act.by(each)
        if rows.any():
            parts.append(_part(effect, Act(Place.BEADS, None, rows), held))
    return tuple(parts)


def bounded_names(system: System) -> tuple[str, ...]:
    """Names of the sources that have no law, "contributor.component", in the order of a vertex array."""
    return _name_bounded(_slots(system))


def _name_bounded(slots: Sequence[_Slot]) -> tuple[str, ...]:
    each = [part for slot in slots for part in slot.parts]
    return tuple(f"{part.name}.{part.sources.names[j]}" for part in each for j in _list_bounded(part.sources))


def _vertex_values(names: tuple[str, ...], vertex: Mapping[str, float] | Array | None) -> tuple[float, ...]:
    if vertex is None:
        return (0.0,) * len(names)
    if isinstance(vertex, Mapping):
        unknown = sorted(set(vertex) - set(names))
        if unknown:
            detail = f"vertex names {', '.join(unknown)}, which is not a bounded source"
            hint = f"bounded sources: {', '.join(names) or 'none'}"
            raise OutOfRangeError(Problem("", "unknown-vertex", detail, hint))
        return tuple(float(vertex.get(name, 0.0)) for name in names)
    values = np.asarray(vertex, dtype=float)
    if values.shape != (len(names),) or not np.isfinite(values).all():
        detail = f"a vertex takes {len(names)} finite values, one per bounded source; got shape {values.shape}"
        raise OutOfRangeError(Problem("", "vertex-shape", detail))
    return tuple(float(v) for v in values)


def product(a: Array, b: Array) -> Array:
    """Matrix products (..., i, k), (..., k, j) by plain sums.  BLAS picks its order of summation by processor; these
    tables decide digits."""
    return np.asarray((a[..., :, :, None] * b[..., None, :, :]).sum(axis=-2))


def images_of(projection: Array, points: Array) -> Array:
    """Pinhole projection (Eq 1) by plain sums: (3, 4), (n, 3) -> (n, 2)."""
    homogeneous_images = product(homogeneous(points), projection.T)
    return np.asarray(homogeneous_images[:, :2] / homogeneous_images[:, 2:])


def principal_axes(moment: Array) -> Array:
    """Eigenvectors (rows, right-handed) of symmetric (..., 3, 3): cyclic Jacobi rotations (Golub and Van Loan 8.5)."""
    m, axes = moment.copy(), np.broadcast_to(np.eye(3), moment.shape)
    for _ in range(12):  # quadratic convergence: six sweeps reach rounding
        for p, q in ((0, 1), (0, 2), (1, 2)):
            off = m[..., p, q]
            turned = ~(np.abs(off) <= 1e-17 * (np.abs(m[..., p, p]) + np.abs(m[..., q, q])))
            if not turned.any():
                continue
            ratio = (m[..., q, q] - m[..., p, p]) / np.where(turned, 2 * off, 1.0)
            t = np.where(ratio >= 0, 1.0, -1.0) / (np.abs(ratio) + np.sqrt(ratio * ratio + 1))
            c = 1 / np.sqrt(t * t + 1)
            turn = np.broadcast_to(np.eye(3), moment.shape).copy()
            turn[..., p, p] = turn[..., q, q] = c
            turn[..., p, q], turn[..., q, p] = -t * c, t * c
            these = turned[..., None, None]
            m = np.where(these, product(product(turn, m), np.swapaxes(turn, -1, -2)), m)
            axes = np.where(these, product(turn, axes), axes)
    return axes


class ObjectFrame(NamedTuple):
    """``X = E y + centroid``: the fiducials' Hartley frame, turned to their principal axes; of one set or of many."""

    out: Array  # (..., 3, 3) E
    into: Array  # (..., 3, 3) its inverse
    centroid: Array  # (..., 3) mm, con
    points: Array  # (..., N, 3) y of the fiducials: centred, RMS distance sqrt(3)


def object_frame(points: Array) -> ObjectFrame:
    """The object frame of fiducials (..., N, 3), mm."""
    centroid = points.mean(axis=-2)
    centred = points - centroid[..., None, :]
    scale = (sqrt(3) / np.sqrt((centred**2).sum(axis=-1).mean(axis=-1)))[..., None, None]
    into = scale * principal_axes(product(np.swapaxes(centred, -1, -2), centred))
    turned = np.swapaxes(into, -1, -2)
    return ObjectFrame(turned / scale**2, into, centroid, product(centred, turned))


def compile_plan(
    system: System,
    *,
    vertex: Mapping[str, float] | Array | None = None,
    shots_per_unit: int = 1,
    held: Drawn | None = None,
) -> ChainPlan:
    """Compile a system for simulation.

    vertex: where the BOUNDED sources stand, fractions of their half-widths, by name
    ("structure_connector.rz": 1.0) or as an array in the order of ``bounded_names``; default 0.
    shots_per_unit: this many consecutive trials share the deviates of the stream INSTALLATION.
    held: throughout what (a unit, a mounting) the deviates of that stream stay; by default a unit where trials share
    them, and where they do not, what is in which stream is a matter of its place alone.
    Raises OutOfRangeError for an unknown vertex or a count below 1.
    """
    if shots_per_unit < 1:
        raise OutOfRangeError(Problem("", "shots-per-unit", f"shots_per_unit must be at least 1, got {shots_per_unit}"))
    if held is None and shots_per_unit > 1:
        held = Drawn.UNIT
    slots = _slots(system, held)
    values = _vertex_values(_name_bounded(slots), vertex)
    sources = _compile_sources(slots, values)
    blocks, starts = _lay_out(system, sources, held)
    views = len(system.views)
    tables = Tables(
        segments=_segments(blocks),
        counts=_counts(system, sources, blocks[-1].stop if blocks else 0),
        starts=starts,
        **_compile_geometry(system, sources),
        spread=_spread(system),
        noise=np.stack([_noise_of(view) for view in system.views]),
        gains=np.concatenate([gain.ravel() for gain in sources.gains]),
        gain_starts=sources.gain_starts,
        torsors=np.array([np.resize(fixed, 6) for fixed in sources.fixed[: images_slot(views, 0)]]),
        image_shifts=np.array(sources.fixed[images_slot(views, 0) : beads_slot(views)]).reshape(views, -1, 2),
        growth=sources.fixed[beads_slot(views)].reshape(-1, 3),
        pivots=np.array([slot.pivot_mm for slot in sources.slots[: images_slot(views, 0)]]),
        execution_bias=sources.fixed[EXECUTION],
        twists=sources.slots[arm_slot(views)].twists,
        screwed=sources.fixed[arm_slot(views)],
    )
    tables = Tables(*(frozen(table, table.dtype) for table in tables))
    return ChainPlan(system, tables, blocks, values, shots_per_unit)


def _noise_of(view: View) -> Array:
    """(2, 3) px: ``Tables.noise`` of a view."""
    factors = np.stack([np.eye(2)] * 2) if view.noise_factors is None else view.noise_factors
    return np.array([view.fiducial_noise_px, view.target_noise_px])[:, None] * factors[:, [0, 1, 1], [0, 0, 1]]


def replan(plan: ChainPlan, lost: NDArray[np.bool_]) -> list[ChainPlan]:
    """Plans in which no view sees fiducials (S, N) that are lost: columns and their deviates stay what they are.

    Their system is that of the plan: what the kernel runs by are the tables.
    """
    tables = plan.tables
    out, into = tables.out_of_frame.reshape(3, 3), tables.into_frame.reshape(3, 3)
    seen = (plan.system.sees > 0) & ~lost[:, None]
    own = _tables_of_views(seen, plan.system.fiducials_mm, ObjectFrame(out, into, tables.centre, tables.nominal))
    weighed = plan.system.triangulation.traits.weighing is Weighing.BY_NOISE
    counts = tables.counts.copy()
    counts[HIDDEN] = 1
    every = {name: frozen(table, table.dtype) for name, table in (own | {"counts": counts}).items()}
    plans = []
    for s, each in enumerate(lost):
        factors = _factors_without(plan, each.tobytes()) if weighed else tables.row_factors
        named = {name: every[name][s] for name in own}
        changed = tables._replace(**named, counts=every["counts"], row_factors=factors)
        plans.append(replace(plan, tables=changed))
    return plans


def _compile_geometry(system: System, sources: _SourceTables) -> dict[str, Array]:
    """The tables of fiducials, views and targets."""
    frame = object_frame(system.fiducials_mm)
    scale2 = float((frame.into**2).sum()) / 3
    positions = np.array([t.position_mm for t in system.targets])
    tcp_con = product(system.T_tcp_flange, system.T_flange_con)
    out = np.block([[frame.out, frame.centroid[:, None]], [np.zeros((1, 3)), np.ones((1, 1))]])
    cameras, intrinsics, known = [], [], system.prior_precisions
    for v, view in enumerate(system.views):
        origin = images_of(view.projection, system.fiducials_mm).mean(axis=0)
        cameras.append(view.projection - np.array([*origin, 0.0])[:, None] * view.projection[2])
        assumed = sources.fixed[intrinsics_slot(len(system.views), v)]
        intrinsics.append(np.concatenate([intrinsics_of(cameras[-1]), assumed, known[v]]))
    of_views = _tables_of_views(system.sees[None] > 0, system.fiducials_mm, frame)
    return {
        "nominal": frame.points,
        **{name: table[0] for name, table in of_views.items()},
        "row_factors": _tabulate_factors(system),
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


def _tables_of_views(seen: NDArray[np.bool_], fiducials: Array, frame: ObjectFrame) -> dict[str, Array]:
    """The tables that hang on which fiducials a view sees, of many sets of views (S, V, N): (S, V, ...) each."""
    several, views, count = seen.shape
    masks, which = np.unique(seen.reshape(-1, count), axis=0, return_inverse=True)  # most often views are alike
    products = np.zeros((len(masks), count, 10))
    diagonal, frames = np.zeros((len(masks), 8)), np.zeros((len(masks), 12))
    sizes = masks.sum(axis=1)
    for size in np.unique(sizes).tolist():
        rows = np.flatnonzero(sizes == size)
        columns = np.nonzero(masks[rows])[1].reshape(len(rows), size)
        own = frame if size == count else object_frame(fiducials[columns])
        products[rows[:, None], columns], diagonal[rows], frames[rows] = _view_tables(frame, own)
    each = which.reshape(several, views)
    return {"products": products[each], "diagonal": diagonal[each], "view_frames": frames[each]}


@lru_cache(maxsize=2**12)
def _factors_without(plan: ChainPlan, lost: bytes) -> Array:
    """:func:`_tabulate_factors` where fiducials (N,) are lost."""
    return frozen(_tabulate_factors(hide_fiducials(plan.system, np.frombuffer(lost, dtype=np.bool_))))


def _tabulate_factors(system: System) -> Array:
    """(T, V, 3) of each target: ``_row_factors``."""
    return np.array([_row_factors(system, target) for target in system.targets])


def _row_factors(system: System, target: Target) -> Array:
    """(V, 3): l00, l10 and l11 of L L' = the weight of each view's rows in triangulation; all alike unless weighted."""
    if system.triangulation.traits.weighing is not Weighing.BY_NOISE:
        return np.tile([1.0, 0.0, 1.0], (len(system.views), 1))
    (a, b), (_, c) = np.moveaxis(weights_at_rest(system, target), 0, -1)
    first = np.sqrt(a)
    return np.stack([first, b / first, np.sqrt(c - (b / first) ** 2)], axis=-1)


def _view_tables(frame: ObjectFrame, own: ObjectFrame) -> tuple[Array, Array, Array]:
    """Products (..., n, 10), diagonal (..., 8), frame (..., 12) of views that see the n fiducials of their own frame;
    frame: of all."""
    y1, upper = homogeneous(own.points), np.triu_indices(4)
    diagonal = (y1**2).sum(axis=-2)
    linear = np.eye(3) if own is frame else product(own.into, frame.out)
    shift = (own.into * (frame.centroid - own.centroid)[..., None, :]).sum(axis=-1)
    with np.errstate(divide="ignore"):  # of fiducials in one plane, which the lanes are not asked for
        inverse = 1 / diagonal
    frames = np.concatenate([linear.reshape(*linear.shape[:-2], 9), shift], axis=-1)
    return y1[..., upper[0]] * y1[..., upper[1]], np.concatenate([diagonal, inverse], axis=-1), frames


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
    laws: list[list[tuple[Law, ...]]]  # of each part of each slot
    fixed: list[Array]  # (rows,) of each slot

    def acts(self, place: int) -> bool:
        """Whether a slot moves anything."""
        return any(self.laws[place]) or bool(self.fixed[place].any())


def _compile_sources(slots: list[_Slot], vertex: tuple[float, ...]) -> _SourceTables:
    gains, laws, fixed, taken = [], [], [], 0
    for slot in slots:
        own_gains, own_laws, here = [np.zeros((slot.rows, 0))], [], slot.known
        for part in slot.parts:
            sources = part.sources
            gain, law = scale_directions(sources)
            own_gains.append(gain)
            own_laws.append(law)
            bounded = _list_bounded(sources)
            at = np.array(vertex[taken : taken + len(bounded)])
            taken += len(bounded)
            here = here + (sources.direction[:, bounded] * (sources.half_width[bounded] * at)).sum(axis=1)
        gains.append(np.hstack(own_gains))
        laws.append(own_laws)
        fixed.append(here)
    offsets = np.cumsum([0, *(gain.size for gain in gains[:-1])])
    starts = np.array([(offset, gain.shape[1]) for offset, gain in zip(offsets, gains, strict=True)])
    return _SourceTables(slots, gains, starts, laws, fixed)


def _lay_out(
    system: System, sources: _SourceTables, held: Drawn | None
) -> tuple[tuple[DeviateColumns, ...], NDArray[np.int64]]:
    """The blocks that have columns, and the first column of manufacturing and of every slot."""
    count, targets = len(system.fiducials_mm), len(system.targets)
    manufactured = bool(np.any(_spread(system) != 0))
    every: list[tuple[str, tuple[Law, ...], int]] = []
    for view in system.views:
        every.append((f"fiducial_noise:{view.name}", (Law.NORMAL,) * (2 * count), SHOT))
        every.append((f"target_noise:{view.name}", (Law.NORMAL,) * (2 * targets), SHOT))
    made = INSTALLATION if held is None or system.manufacturing_drawn.is_held(held) else SHOT
    every.append(("fiducial_manufacturing", (system.manufacturing_law,) * (3 * count * manufactured), made))
    firsts = [len(every) - 1]  # of manufacturing, and of every slot
    for slot, laws in zip(sources.slots, sources.laws, strict=True):
        firsts.append(len(every))
        every += [(part.name, own, part.stream) for part, own in zip(slot.parts, laws, strict=True)]
    ends = np.cumsum([0, *(len(laws) for _, laws, _ in every)])
    blocks = (
        DeviateColumns(name, int(start), int(start) + len(laws), laws, stream)
        for start, (name, laws, stream) in zip(ends, every, strict=False)
    )
    return tuple(block for block in blocks if block.stop > block.start), ends[firsts]


def _counts(system: System, sources: _SourceTables, deviates: int) -> NDArray[np.int64]:
    views = len(system.views)
    counts = np.zeros(15, dtype=np.int64)
    counts[FIDUCIALS] = len(system.fiducials_mm)
    counts[VIEWS] = views
    counts[TARGETS] = len(system.targets)
    counts[DEVIATES] = deviates
    counts[UNKNOWNS] = system.estimator.traits.unknowns
    movable = (*MOUNTS, *(shot_slot(views, v) for v in range(views)))
    counts[MOVING] = sum(1 << slot for slot in movable if sources.acts(slot))
    counts[MANUFACTURED] = bool(np.any(_spread(system) != 0))
    counts[GROWING] = sources.acts(beads_slot(views))
    counts[SHIFTING] = any(sources.acts(images_slot(views, v)) for v in range(views))
    counts[HIDDEN] = not system.sees.all()
    counts[EQ18] = system.reading is Reading.EQ18
    counts[SMALL_ANGLE] = system.rotation_form is RotationForm.SMALL_ANGLE
    counts[SCREWS] = sources.slots[arm_slot(views)].rows if sources.acts(arm_slot(views)) else 0
    counts[PUBLISHED] = not system.triangulation.traits.own_frame
    counts[BY_IMAGES] = system.triangulation.traits.weighing is Weighing.BY_IMAGES
    return counts


def _segments(blocks: tuple[DeviateColumns, ...]) -> NDArray[np.int64]:
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
