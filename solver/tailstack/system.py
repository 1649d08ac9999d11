"""The compiled design: frozen records of arrays in mm, rad, px.  Everything downstream starts here.

Conventions (``docs/conventions.md``): ``T_ab`` maps coordinates in frame b to coordinates in frame
a; frames are ``con`` (connector, fiducial coordinates), ``flange``, ``tcp``.  A torsor is ordered
``(rx, ry, rz, tx, ty, tz)`` in rad and mm; its finite rotation is ``R = Rx(rx) Ry(ry) Rz(rz)`` about
the pivot, followed by the translation (Eqs 11-13 of the paper).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from enum import IntEnum, StrEnum
from functools import cached_property, lru_cache
from math import sqrt
from typing import Any, NamedTuple, Self, assert_never

import numpy as np
from numpy.typing import NDArray

from .geometry.arrays import Array, frozen
from .geometry.arrays import ArrayLike as ArrayLike
from .geometry.rotation import RotationForm
from .geometry.weighing import Weighing as Weighing
from .laws import Drawn, count_sigmas, level_of
from .laws import Law as Law
from .measures import MEASURE, Metric, derived_of, metrics_of
from .measures.measure import Channel, MeasuredBody
from .statistic import STATISTIC, Mixture, Statistic, write_text

ROTATIONS, TRANSLATIONS = ("rx", "ry", "rz"), ("tx", "ty", "tz")
TORSOR_COMPONENTS = (*ROTATIONS, *TRANSLATIONS)


def std_per_half_width(law: Law, coverage_factor: float = 1.0) -> float:
    """Standard deviation of a source in its half-widths; 0 where it has no law.  coverage_factor: of a normal one."""
    if law is Law.NORMAL:
        return 1 / coverage_factor
    return 0.0 if law is Law.BOUNDED else 1 / count_sigmas(law)


@lru_cache(maxsize=256)
def _std_per_half_widths(laws: tuple[Law, ...], coverage_factors: tuple[float, ...]) -> Array:
    return frozen(np.array([std_per_half_width(*each) for each in zip(laws, coverage_factors, strict=True)]))


class Reading(StrEnum):
    """What an installation error of the structure does (conventions: *two readings*)."""

    PHYSICAL = "physical"  # the structure moves and so do its images: q_hat = T_err1^-1 q (text after Eq 8)
    EQ18 = "eq18"  # the estimator's coordinates move, images do not: q_hat = T_err1 q (Eqs 8, 18)


class TriangulationTraits(NamedTuple):
    """What sets a triangulation apart: whoever has to know asks for one of these, and never for its name."""

    weighing: Weighing
    own_frame: bool  # solved in the fiducials' Hartley frame; otherwise in connector millimetres


class Triangulation(StrEnum):
    """How the rays to a target are met: by the rows of Eq 5 (the first three), or by its images."""

    NORMALISED = "normalised"  # in the fiducials' Hartley frame: equivariant to motion and units
    PUBLISHED = "published"  # plain 4x4 SVD in connector millimetres (Eqs 4-7)
    WEIGHTED = "weighted"  # as normalised, each view's rows by the inverse of what noise makes of them
    REPROJECTION = "reprojection"  # least squares of the target's images, the projections taken for exact

    @property
    def traits(self) -> TriangulationTraits:
        """Its row of the table."""
        return TRIANGULATIONS[self]


TRIANGULATIONS = {
    Triangulation.NORMALISED: TriangulationTraits(Weighing.ALIKE, True),
    Triangulation.PUBLISHED: TriangulationTraits(Weighing.ALIKE, False),
    Triangulation.WEIGHTED: TriangulationTraits(Weighing.BY_NOISE, True),
    Triangulation.REPROJECTION: TriangulationTraits(Weighing.BY_IMAGES, True),
}
# Those that differ in their second order only.
LINEAR = tuple(form for form in Triangulation if form.traits.weighing is Weighing.ALIKE)

INTRINSICS = ("focal", "principal_point_u", "principal_point_v")  # relative, px, px
INTRINSICS_WORDS = dict(zip(INTRINSICS, ("focal length", "principal point", "principal point"), strict=True))
POSE_UNKNOWNS, ALL_UNKNOWNS = 6, 11  # of a pose, and of a projection whose scale does not matter


class EstimatorTraits(NamedTuple):
    """What sets an estimator apart: whoever has to know asks for one of these, and never for its name."""

    # Numbers of a view that are sought by least squares of the images.  Six to nine: a pose, then intrinsics in the
    # order of ``INTRINSICS``; eleven: the entries of the projection; 0: those too, by linear equations
    unknowns: int
    believes: tuple[str, ...]  # of ``INTRINSICS``, those whose assumed values matter to it
    takes_prior: bool  # whether it weighs how well they are known
    fewest_fiducials: int  # that a view has to see
    seeks: str
    needs: str
    trusted_forms: tuple[Triangulation, ...]  # those that first order was calibrated with
    trusted_fiducials: tuple[int, int]  # fewest and most that it was calibrated with

    @property
    def seeks_pose(self) -> bool:
        """Whether a rotation and a place are sought, and not the entries of a projection."""
        return POSE_UNKNOWNS <= self.unknowns < ALL_UNKNOWNS

    @property
    def free_intrinsics(self) -> int:
        """How many of ``INTRINSICS``, from the first, are sought together with a pose."""
        return self.unknowns - POSE_UNKNOWNS if self.seeks_pose else 0


class Estimator(StrEnum):
    """What a view's projection is estimated as from its fiducials (``docs/estimators.md``)."""

    DLT = "dlt"  # eleven unknowns by linear equations (Eqs 2-3)
    POSE = "pose"  # six: where the view is, its intrinsics taken for exact
    POSE_WITH_PRIOR = "pose_with_prior"  # nine: focal length and principal point too, known as the prior says
    REPROJECTION = "reprojection"  # eleven by least squares of the images

    @property
    def traits(self) -> EstimatorTraits:
        """Its row of the table."""
        return ESTIMATORS[self]

    @property
    def believes_intrinsics(self) -> bool:
        """Whether any of the intrinsics that it assumes matter."""
        return bool(ESTIMATORS[self].believes)


DEFAULT_ESTIMATOR = Estimator.DLT  # of a document that names none
ESTIMATORS = {  # from the one that knows nothing to the one that knows most
    Estimator.DLT: EstimatorTraits(
        0, (), False, 6, "the projection",
        "nothing: eleven unknowns of each view are taken from six fiducials or more, not in one plane",
        (*LINEAR, Triangulation.WEIGHTED), (6, 40),
    ),
    Estimator.REPROJECTION: EstimatorTraits(
        11, (), False, 6, "the projection", "nothing, as dlt; its images' residuals are least",
        (Triangulation.NORMALISED,), (6, 40),
    ),
    Estimator.POSE_WITH_PRIOR: EstimatorTraits(
        9, INTRINSICS, True, 4, "pose and intrinsics",
        "focal length and principal point of each view, and how well they are known",
        (Triangulation.NORMALISED, Triangulation.WEIGHTED), (4, 40),
    ),
    Estimator.POSE: EstimatorTraits(
        6, INTRINSICS, False, 4, "the pose",
        "focal length and principal point of each view, which it takes for exact; four fiducials or more",
        (*LINEAR, Triangulation.WEIGHTED), (4, 40),
    ),
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Sources:
    """k independent scalar error sources that act linearly on a d-vector: ``value = direction @ xi``.

    ``xi[j]`` follows ``laws[j]`` with half-width ``half_width[j]`` (native unit: rad, mm or N).  For
    NORMAL the standard deviation is ``half_width / coverage_factor``.  Of sources that are declared to go together,
    directions are those of :func:`correlate`: to whoever adds them up they are independent.
    """

    names: tuple[str, ...]  # component names, e.g. ("rx", ..., "tz") or locator names
    laws: tuple[Law, ...]  # of each source
    half_width: Array  # (k,) rad | mm | N
    coverage_factor: Array  # (k,) only meaningful for NORMAL, 1 elsewhere
    units: tuple[str, ...]  # native unit of each source: "rad", "mm", "N", "px", "1"
    direction: Array  # (d, k)
    together: tuple[tuple[int, ...], ...] = ()  # groups of sources that are correlated; in none: independent of all

    @cached_property
    def std(self) -> Array:
        """(k,) standard deviation in native units; 0 for BOUNDED."""
        return self.half_width * self.std_per_half_width

    @property
    def std_per_half_width(self) -> Array:
        """(k,) standard deviation in half-widths of each."""
        return _std_per_half_widths(self.laws, tuple(self.coverage_factor.tolist()))

    @property
    def spread(self) -> Array:
        """(k,) how large each is, native units: its standard deviation, or its half-width where it is BOUNDED."""
        return spread_of(self.laws, self.half_width, self.std)

    @property
    def are_bounded(self) -> NDArray[np.bool_]:
        """(k,) which of them are BOUNDED and wider than 0."""
        if Law.BOUNDED not in self.laws:
            return np.zeros(self.count, dtype=np.bool_)
        return np.array([law is Law.BOUNDED for law in self.laws], dtype=np.bool_) & (self.half_width > 0)

    @property
    def count(self) -> int:
        """k."""
        return len(self.names)


def spread_of(laws: tuple[Law, ...], half_width: Array, std: Array) -> Array:
    """(k,) how large sources of these laws are: their standard deviations, half-widths of those that are BOUNDED."""
    if Law.BOUNDED not in laws:
        return std
    return np.where([law is Law.BOUNDED for law in laws], half_width, std)


SINGULAR_PIVOT = 1e-12  # of a correlation: what is left of a component by those before it


def correlate(sources: Sources, correlation: Array) -> Sources:
    """Normal sources with this correlation (k, k), positive semidefinite, instead of independent ones.

    With standard deviations s and C = L L' (Cholesky), ``direction diag(s) L diag(1/s)`` takes independent sources to
    what correlated ones do, as long as their half-widths keep their proportions.  A source of width 0 goes with none.
    """
    wide = sources.half_width > 0
    left = np.where(wide[:, None] & wide, correlation, 0.0)
    tied = left - np.diag(left.diagonal()) != 0
    if not tied.any():
        return sources
    factor = np.zeros_like(left)
    for j in range(sources.count):  # column by column, by plain sums: the tables of the simulation decide digits
        if left[j, j] > SINGULAR_PIVOT:
            factor[j:, j] = left[j:, j] / sqrt(left[j, j])
            left = left - np.outer(factor[:, j], factor[:, j])
    std = np.where(wide, sources.std, 1.0)
    mixed = ((sources.direction * std)[:, :, None] * factor).sum(axis=1) / std
    for _ in range(sources.count):
        tied = (tied[:, :, None] & tied).any(axis=1) | tied
    groups = dict.fromkeys(tuple(np.flatnonzero(row).tolist()) for row in tied if row.any())
    direction = frozen(np.where(tied.any(axis=0), mixed, sources.direction))
    return replace(sources, direction=direction, together=tuple(groups))


def no_sources(dimension: int) -> Sources:
    """Sources that are not there: k = 0."""
    empty = frozen(np.zeros(0))
    return Sources((), (), empty, empty, (), frozen(np.zeros((dimension, 0))))


class Place(IntEnum):
    """Where in the chain something acts, and what the rows of its directions are there; in the order of the chain."""

    INTRINSICS = 0  # what an estimator takes the intrinsics of a view for, less what they are: ``INTRINSICS``
    SHOT = 1  # a torsor about a pivot in con: the structure against the target by the time of one view's shot
    IMAGES = 2  # u and v of the image of each fiducial in one view, then of each target, px
    BEADS = 3  # x, y and z of each fiducial against where the estimator takes it to be, con of the structure, mm
    SEAT = 4  # a torsor about a pivot in con: the structure on the connector, T_err1
    FLANGE = 5  # a torsor about a pivot in con: the connector on the end effector's flange, T_err2
    CONNECTOR = 6  # x, y and z, con, mm: of what is behind the reconstructed point, at the flange
    ARM = 7  # by how much each screw of an arm turns, or shifts, what is at the flange (``effects.robot``)
    HAND_EYE = 8  # a torsor about a pivot in tcp, after T_tcp_flange
    TOOL = 9  # x, y and z of the tool centre point, tcp, mm


class Act(NamedTuple):
    """What the m parameters of an effect do at one place."""

    place: Place
    view: str | None  # name of the view; None: all of them
    direction: ArrayLike | None  # (rows, m) per unit of each parameter; None: the parameters are the rows
    pivot_mm: ArrayLike = np.zeros(3)  # of a torsor
    twists: Array = np.zeros((0, 6))  # (rows, 6) flange, mm: the screws of an arm, the first acts first

    def by(self, parameters: ArrayLike) -> ArrayLike:
        """(rows, ...) of parameters (m, ...), by plain sums: BLAS picks its order of summation by processor, and the
        tables of the simulation decide digits."""
        if self.direction is None:
            return parameters
        shape = (1,) * (parameters.ndim - 1)
        return (self.direction.reshape(*self.direction.shape, *shape) * parameters).sum(axis=1)


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """Where the points are that effects act on, as the design states them."""

    projections: Mapping[str, Array]  # (3, 4) con mm -> px, by the name of the view
    labels: tuple[str, ...]  # N of them, of the fiducials
    fiducials_mm: ArrayLike  # (N, 3) con
    aims_mm: ArrayLike  # (T, 3) con: targets
    imaging: Callable[[Array, ArrayLike], ArrayLike]  # the pinhole projection of points (n, 3): (n, 2) px

    @property
    def points(self) -> int:
        """N + T."""
        return len(self.fiducials_mm) + len(self.aims_mm)

    def project(self, view: str) -> ArrayLike:
        """(N + T, 2) px: images of the fiducials and the targets in a view."""
        return self.imaging(self.projections[view], np.vstack([self.fiducials_mm, self.aims_mm]))


@dataclass(frozen=True, slots=True, eq=False)
class Effect:
    """Something that the design declares to act in the chain, compiled.

    It has m parameters, ``known + sources.direction @ xi``, and what they do is linear in them.  Its class is in
    ``effects/``.
    """

    name: str  # the contributor of the budget: motion:AP, temperature
    label: str  # what people call it
    pointer: str  # of what declares it in the document
    drawn: Drawn
    sources: Sources  # direction (m, k)
    known: Array  # (m,)

    def act(self, scene: Scene) -> tuple[Act, ...]:
        """What its parameters do, place by place."""
        raise NotImplementedError

    def with_seats_at(self, first_pivot_mm: ArrayLike, second_pivot_mm: ArrayLike) -> Self:
        """The same where the pivots of the interfaces are, in con, if it is these that it hangs on."""
        return self

    def with_pivot_in(self, scene: Scene) -> Self:
        """The same about the pivot that it has in a scene, if it is its fiducials that it hangs on."""
        return self

    @property
    def places(self) -> tuple[tuple[Place, str | None], ...]:
        """Where it acts, with the view."""
        raise NotImplementedError

    def acts_at(self, place: Place, view: str | None = None) -> bool:
        """Whether it acts at a place; with ``view``, there in that view."""
        return any(at is place and (view is None or of is None or of == view) for at, of in self.places)

    @property
    def words(self) -> str:
        """What it is called whatever the view: its label, unless that names the view or only repeats the name."""
        kind, *of_view = self.name.split(":")
        return kind.replace("_", " ") if of_view or self.label == kind else self.label

    @property
    def is_grouped(self) -> bool:
        """Whether its sources are all alike, and one line of a budget."""
        return False

    @property
    def of_target(self) -> bool:
        """Whether it is of the target's own image, and each target has another."""
        return False

    @property
    def way(self) -> Way:
        """How its gains are found."""
        return Way.SHARED


class Way(StrEnum):
    """How the gains of an effect on the error are found."""

    IMAGES = "images"  # those of ``image_gains``: what images, fiducials or the intrinsics of a view have of their own
    SHARED = "shared"  # sums of those: what moves the images of all fiducials of a view together
    LINK = "link"  # by the geometry behind the reconstructed point, where no image counts


@dataclass(frozen=True, slots=True, eq=False)
class DirectEffect(Effect):
    """An effect whose parameters are the rows of one place: a torsor, intrinsics, or what each point has of its own."""

    place: Place
    view: str | None
    pivot_mm: Array = field(default_factory=lambda: np.zeros(3))  # of a torsor
    of_target: bool = False  # whether it is the noise of the target's image, not of the fiducials'

    def act(self, scene: Scene) -> tuple[Act, ...]:
        return (Act(self.place, self.view, None, self.pivot_mm),)

    @property
    def places(self) -> tuple[tuple[Place, str | None], ...]:
        return ((self.place, self.view),)

    @property
    def is_grouped(self) -> bool:
        return self.way is Way.IMAGES and self.place is not Place.INTRINSICS

    @property
    def way(self) -> Way:
        match self.place:
            case Place.INTRINSICS | Place.IMAGES | Place.BEADS:
                return Way.IMAGES
            case Place.SHOT:
                return Way.SHARED
            case Place.SEAT | Place.FLANGE | Place.CONNECTOR | Place.ARM | Place.HAND_EYE | Place.TOOL:
                return Way.LINK
            case _:
                assert_never(self.place)


MOUNTED_AT = {"structure_connector": Place.SEAT, "connector_flange": Place.FLANGE, "hand_eye": Place.HAND_EYE}


def mount(
    name: str, pivot_mm: Array, known: Array, sources: Sources, label: str = "", drawn: Drawn = Drawn.UNIT
) -> DirectEffect:
    """A rigid installation error: a known torsor (6,) plus sources (6, k), rad and mm, about a pivot (3,) mm.

    name: one of ``MOUNTED_AT``; label: what the design's author calls it, empty where the design does not say.
    """
    pointer = f"/{'execution' if name == 'hand_eye' else 'interfaces'}/{name}"
    place = MOUNTED_AT[name]
    return DirectEffect(name, label or name, pointer, drawn, sources, known, place, None, pivot_mm)


def execution_of(sources: Sources, known_mm: Array, drawn: Drawn = Drawn.SHOT) -> DirectEffect:
    """What the robot adds at the tool: sources (3, k), and what is known (3,) mm, tcp."""
    return DirectEffect("execution", "execution", "/execution", drawn, sources, known_mm, Place.TOOL, None)


def alike(unit: str, law: Law, half_width: Array, coverage_factor: float) -> Sources:
    """k sources of one law, one along each row of a place, half_width (k,): what points have each of their own."""
    k = len(half_width)
    return Sources(("all",) * k, (law,) * k, half_width, np.full(k, coverage_factor), (unit,) * k, np.eye(k))


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """One X-ray view."""

    name: str  # as in the design
    projection: Array  # (3, 4) con mm -> px, scaled so that |P[2, :3]| = 1 and depths are positive
    fiducial_noise_px: float  # standard deviation per image coordinate
    target_noise_px: float  # the same of the target's image
    image_size_px: tuple[int, int] | None  # (width, height); None: not stated, visibility not checked
    sees: tuple[str, ...] | None = None  # labels of the fiducials that its estimate uses; None: all of them
    intrinsics_prior: tuple[float, float] | None = None  # standard deviations: focal length (relative), centre (px)
    # (2, 2, 2) of fiducials and target: lower triangles by which independent noise of u and v is multiplied, the mean
    # of both variances 1.  None: it is alike in all directions
    noise_factors: Array | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Target:
    """A target point, or one sample of a target region."""

    name: str  # as in the design; zone[3] of a region
    position_mm: Array  # (3,) con
    region: str | None = None  # the target region it samples, if any
    direction: Array | None = None  # (3,) con: in which an instrument comes to it
    entry: str | None = None  # name of the target through which it comes, and which tells the direction
    channel: Channel | None = None  # about the planned axis, in which the executed one has to stay
    two_shots: bool = False  # whether what a shot draws is drawn for the entry and for it


@dataclass(frozen=True, slots=True, eq=False)
class Requirement:
    """A limit on a quantile of an error's norm, or on another statistic of it."""

    name: str  # as in the design
    error: str  # name of the measure
    quantile: float  # 0.95 for P95; of the largest of n shots, that of one; of a probability, 1 less what is allowed
    limit: float  # what the statistic must not exceed, or too many errors, in the unit of the measure
    confidence: float  # two-sided confidence of the interval the verdict is taken from
    targets: tuple[str, ...]  # names of targets, or of the sites of a measure that joins several
    risk: str = "pooled"  # one of ``levels.RISKS``
    min_yield: float | None = None  # required fraction of installed units, or of mountings; pooled: none
    statistic: str = "quantile"  # name of a row of ``STATISTICS``
    n: int | None = None  # max_of_n: of so many shots
    limit_probability: float | None = None  # probability: of errors beyond the limit, what is allowed
    ids: tuple[str, ...] = ()  # what it is called in a system of requirements

    @property
    def level(self) -> Drawn | None:
        """What is read by itself; pooled: none."""
        return level_of(self.risk)

    @property
    def row(self) -> Statistic:
        return STATISTIC[self.statistic]

    @property
    def is_quantile(self) -> bool:
        """Whether what is told is a quantile of the pooled law itself."""
        return self.row.of_law is None

    @property
    def mixture(self) -> Mixture:
        """The quantiles, of one shot's error, that are limited, each with its weight; empty where it is of none."""
        if self.row.by_quantile:
            return ((self.quantile, 1.0),)
        return () if self.row.mixture is None else self.row.mixture(self.quantile)

    def name_value(self, of: str = "") -> str:
        """What is limited, in words; ``of`` what, if that is named."""
        beyond = f"{self.limit:g} {MEASURE[self.error].unit}"
        return write_text(self.row.headline, self.quantile, self.n, beyond, error=of)

    @property
    def limit_text(self) -> str:
        """What it must not exceed, with the unit."""
        if self.limit_probability is not None:
            return f"{self.limit_probability:g}"
        return f"{self.limit:g} {MEASURE[self.error].unit}"

    @property
    def units_fraction(self) -> float | None:
        """The fraction of installed units, or of mountings, that must meet the limit; without ``min_yield`` that of
        the quantile (95 % of units for a P95).  Pooled: none."""
        if self.risk == "pooled":
            return None
        return self.quantile if self.min_yield is None else self.min_yield


@dataclass(frozen=True, eq=False)
class System:
    """A design, compiled.  Immutable; every array is read-only."""

    name: str  # of the design
    views: tuple[View, ...]  # two or more
    fiducial_labels: tuple[str, ...]  # N of them
    fiducials_mm: Array  # (N, 3) con, nominal
    manufacturing_law: Law  # not BOUNDED
    manufacturing_half_width_mm: Array  # (N, 3)
    manufacturing_coverage_factor: float  # only meaningful for NORMAL
    structure_connector: DirectEffect  # the mount at ``Place.SEAT``
    connector_flange: DirectEffect  # the mount at ``Place.FLANGE``
    T_flange_con: Array  # (4, 4) con -> flange, mm
    T_tcp_flange: Array  # (4, 4) flange -> tcp, mm
    hand_eye: DirectEffect  # the mount at ``Place.HAND_EYE``
    execution: DirectEffect  # at ``Place.TOOL``: repeatability and load; known: the deflection under the nominal load
    targets: tuple[Target, ...]  # regions expanded
    requirements: tuple[Requirement, ...]  # none: nothing is judged
    reading: Reading = Reading.PHYSICAL  # of the structure's installation error
    rotation_form: RotationForm = RotationForm.FULL  # of every torsor
    estimator: Estimator = DEFAULT_ESTIMATOR  # of every view
    triangulation: Triangulation = Triangulation.NORMALISED  # of every target
    effects: tuple[Effect, ...] = ()  # whatever else is declared, in the order of ``effects.EFFECTS``
    fiducial_radius_mm: float | None = None  # None: how large fiducials are is not known
    loss_probability: tuple[float, ...] = ()  # of each fiducial in a shot, in all views at once; (): none is ever lost
    design_sha256: str | None = None  # of the document it was compiled from
    notes: tuple[str, ...] = field(default=())  # assumptions recorded on the way (e.g. RAS converted to LPS)
    manufacturing_drawn: Drawn = Drawn.UNIT
    assumed: tuple[str, ...] = ()  # pointers of values that nobody stated
    title_block: Mapping[str, Any] | None = None  # under which number it is kept, and who answers for it
    demands: Mapping[str, tuple[tuple[str, ...], ...]] = field(default_factory=dict)
    """Names of the targets that each requirement on a measure names, by the name of the measure."""
    bodies: tuple[MeasuredBody, ...] = ()

    @property
    def interfaces(self) -> tuple[DirectEffect, DirectEffect]:
        """Both interfaces, in the order of the chain."""
        return self.structure_connector, self.connector_flange

    @property
    def mounts(self) -> tuple[DirectEffect, DirectEffect, DirectEffect]:
        """What is mounted, each a torsor about a pivot, in the order of the chain."""
        return self.structure_connector, self.connector_flange, self.hand_eye

    @property
    def links(self) -> tuple[DirectEffect, ...]:
        """What acts between the reconstructed point and the tool, in the order of the chain."""
        return *self.mounts, self.execution

    def effects_at(self, place: Place, view: str | None = None) -> tuple[Effect, ...]:
        """The effects that act at a place; with ``view``, there in that view."""
        return tuple(effect for effect in self.effects if effect.acts_at(place, view))

    @property
    def shared_image_errors(self) -> tuple[Effect, ...]:
        """The effects that move the images of all fiducials of a view together."""
        return tuple(effect for effect in self.effects if effect.way is Way.SHARED)

    @cached_property
    def believed_errors(self) -> tuple[DirectEffect | None, ...]:
        """For each view the error of the intrinsics that its estimate believes; None where there is none."""
        if not self.estimator.believes_intrinsics:
            return (None,) * len(self.views)
        effects = (effect for effect in self.effects_at(Place.INTRINSICS) if isinstance(effect, DirectEffect))
        errors = {effect.view: effect for effect in effects}
        return tuple(errors.get(view.name) for view in self.views)

    @property
    def prior_precisions(self) -> Array:
        """(V, 3) px^2: variance of a fiducial's image over that of each intrinsic; 0 where nothing is known beforehand,
        or the estimator does not weigh it."""
        out = np.zeros((len(self.views), 3))
        for v, view in enumerate(self.views):
            if self.estimator.traits.takes_prior and view.intrinsics_prior is not None:
                focal, centre = view.intrinsics_prior
                out[v] = (view.fiducial_noise_px / np.array([focal, centre, centre])) ** 2
        return out

    @cached_property
    def errors_of_points(self) -> tuple[DirectEffect, ...]:
        """Noise of the images, view by view, and manufacturing errors of the fiducials, if there are any: what each
        point has of its own."""
        count, effects = len(self.fiducials_mm), []
        for index, view in enumerate(self.views):
            for of, points, sigma in (("fiducial", count, view.fiducial_noise_px), ("target", 1, view.target_noise_px)):
                name, pointer = f"{of}_noise:{view.name}", f"/views/{index}/{of}_noise_px"
                label = name.replace("_", " ").replace(":", ", ")
                sources = alike("px", Law.NORMAL, np.full(2 * points, sigma), 1.0)
                known = np.zeros(sources.count)
                effect = DirectEffect(name, label, pointer, Drawn.SHOT, sources, known, Place.IMAGES, view.name)
                effects.append(replace(effect, of_target=of == "target"))
        if self.manufacturing_std_mm.any():
            name, label, pointer = "fiducial_manufacturing", "fiducial manufacturing", "/fiducials/manufacturing"
            wide = self.manufacturing_half_width_mm.ravel()
            sources = alike("mm", self.manufacturing_law, wide, self.manufacturing_coverage_factor)
            known = np.zeros(sources.count)
            drawn = self.manufacturing_drawn
            effects.append(DirectEffect(name, label, pointer, drawn, sources, known, Place.BEADS, None))
        return tuple(effects)

    def scene(self, aims_mm: ArrayLike, imaging: Callable[[Array, ArrayLike], ArrayLike]) -> Scene:
        """What effects act on: the fiducials and these aims (T, 3), mm, con."""
        projections = {view.name: view.projection for view in self.views}
        return Scene(projections, self.fiducial_labels, self.fiducials_mm, aims_mm, imaging)

    @property
    def projections(self) -> Array:
        """(V, 3, 4) of all views."""
        return np.array([view.projection for view in self.views])

    @property
    def sees(self) -> Array:
        """(V, N) 1 where a view sees a fiducial and its estimate uses it, otherwise 0."""
        labels = self.fiducial_labels
        return np.array([[view.sees is None or label in view.sees for label in labels] for view in self.views], float)

    @cached_property
    def metrics(self) -> tuple[Metric, ...]:
        """Every measure wherever it is read."""
        return metrics_of(self)

    @cached_property
    def derived_metrics(self) -> tuple[Metric, ...]:
        """The last of ``metrics``: of what is made of the errors at targets."""
        return derived_of(self)

    @property
    def T_tcp_con(self) -> Array:
        """(4, 4) con -> tcp, mm."""
        return self.T_tcp_flange @ self.T_flange_con

    @property
    def manufacturing_std_mm(self) -> Array:
        """(N, 3) standard deviation of each fiducial coordinate."""
        per = std_per_half_width(self.manufacturing_law, self.manufacturing_coverage_factor)
        return self.manufacturing_half_width_mm * per


def put_links(system: System, links: Iterable[DirectEffect]) -> System:
    """The system with these of its links in place of those of the same name; effects stay where they hang."""
    named: dict[str, Any] = {link.name: link for link in links}
    return replace(system, **named)


def put_mounts(system: System, first: DirectEffect, second: DirectEffect) -> System:
    """The system with other interfaces, and with the effects that hang on their pivots."""
    effects = tuple(effect.with_seats_at(first.pivot_mm, second.pivot_mm) for effect in system.effects)
    return replace(system, structure_connector=first, connector_flange=second, effects=effects)
