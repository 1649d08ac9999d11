"""The compiled design: frozen records of arrays in mm, rad, px.  Everything downstream starts here.

Conventions (``docs/conventions.md``): ``T_ab`` maps coordinates in frame b to coordinates in frame
a; frames are ``con`` (connector, fiducial coordinates), ``flange``, ``tcp``.  A torsor is ordered
``(rx, ry, rz, tx, ty, tz)`` in rad and mm; its finite rotation is ``R = Rx(rx) Ry(ry) Rz(rz)`` about
the pivot, followed by the translation (Eqs 11-13 of the paper).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from enum import StrEnum
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from .arrays import Array

# The interfaces of the chain, called here and in every result as in the design document, in the order of the chain
INTERFACES = ("structure_connector", "connector_flange")
TORSOR_COMPONENTS = ("rx", "ry", "rz", "tx", "ty", "tz")


class Law(StrEnum):
    """Law of one scalar tolerance of half-width h.  BOUNDED has no law: only its worst case counts."""

    NORMAL = "normal"  # standard deviation h / coverage factor
    UNIFORM = "uniform"  # standard deviation h / sqrt(3)
    TRIANGULAR = "triangular"  # standard deviation h / sqrt(6)
    BOUNDED = "bounded"  # anywhere within +-h


STD_PER_HALF_WIDTH = {Law.UNIFORM: 1 / sqrt(3), Law.TRIANGULAR: 1 / sqrt(6), Law.BOUNDED: 0.0}


class Reading(StrEnum):
    """What an installation error of the structure does (conventions: *two readings*)."""

    PHYSICAL = "physical"  # the structure moves and so do its images: q_hat = T_err1^-1 q (text after Eq 8)
    EQ18 = "eq18"  # the estimator's coordinates move, images do not: q_hat = T_err1 q (Eqs 8, 18)


class RotationForm(StrEnum):
    """How small rotations act."""

    FULL = "full"  # Rx Ry Rz (Eq 12)
    SMALL_ANGLE = "small_angle"  # I + [omega]x (Eq 13)


class Estimator(StrEnum):
    """What a view's projection is estimated as from its fiducials (``docs/estimators.md``)."""

    DLT = "dlt"  # eleven unknowns by linear equations (Eqs 2-3)
    POSE = "pose"  # six: where the view is, its intrinsics taken for exact
    POSE_WITH_PRIOR = "pose_with_prior"  # nine: focal length and principal point too, known as the prior says
    REPROJECTION = "reprojection"  # eleven by least squares of the images

    @property
    def believes_intrinsics(self) -> bool:
        """Whether the intrinsics that it is told matter."""
        return self in (Estimator.POSE, Estimator.POSE_WITH_PRIOR)

    @property
    def unknowns(self) -> int:
        """How many numbers of a view it seeks by least squares of the images; 0 for DLT."""
        return {"dlt": 0, "pose": 6, "pose_with_prior": 9, "reprojection": 11}[self.value]


class Triangulation(StrEnum):
    """How the rays to a target are met: by the rows of Eq 5 (the first three), or by its images."""

    NORMALISED = "normalised"  # in the fiducials' Hartley frame: equivariant to motion and units
    PUBLISHED = "published"  # plain 4x4 SVD in connector millimetres (Eqs 4-7)
    WEIGHTED = "weighted"  # as normalised, each view's rows by the inverse of what noise makes of them
    REPROJECTION = "reprojection"  # least squares of the target's images, the projections taken for exact


@dataclass(frozen=True, slots=True, eq=False)
class Sources:
    """k independent scalar error sources that act linearly on a d-vector: ``value = direction @ xi``.

    ``xi[j]`` follows ``laws[j]`` with half-width ``half_width[j]`` (native unit: rad, mm or N).  For
    NORMAL the standard deviation is ``half_width / coverage_factor``.
    """

    names: tuple[str, ...]  # component names, e.g. ("rx", ..., "tz") or locator names
    laws: tuple[Law, ...]  # of each source
    half_width: Array  # (k,) rad | mm | N
    coverage_factor: Array  # (k,) only meaningful for NORMAL, 1 elsewhere
    units: tuple[str, ...]  # native unit of each source: "rad", "mm", "N", "px", "1"
    direction: Array  # (d, k)

    @property
    def std(self) -> Array:
        """(k,) standard deviation in native units; 0 for BOUNDED."""
        each = zip(self.laws, self.half_width.tolist(), self.coverage_factor.tolist(), strict=True)
        return np.array([h * (1 / c if law is Law.NORMAL else STD_PER_HALF_WIDTH[law]) for law, h, c in each])

    @property
    def count(self) -> int:
        """k."""
        return len(self.names)


def no_sources(dimension: int) -> Sources:
    """Sources that are not there: k = 0."""
    empty = np.zeros(0)
    return Sources((), (), empty, empty, (), np.zeros((dimension, 0)))


@dataclass(frozen=True, slots=True, eq=False)
class Mount:
    """A rigid installation error: a known bias plus independent sources, about a pivot."""

    name: str  # the contributor of the budget: one of INTERFACES, or "hand_eye"
    pivot_mm: Array  # (3,) in the frame the error acts in (con for the interfaces, tcp for hand-eye)
    bias: Array  # (6,) rad, mm
    sources: Sources  # direction is (6, k)
    label: str = ""  # what the design's author calls it; empty where the design does not say

    @property
    def title(self) -> str:
        """What people call it: the label that the author gave it, otherwise the name."""
        return self.label or self.name


INTRINSICS = ("focal", "principal_point_u", "principal_point_v")  # relative, px, px


@dataclass(frozen=True, slots=True, eq=False)
class IntrinsicsError:
    """How wrong the intrinsics are that an estimator is told: assumed less true, in the order of ``INTRINSICS``.

    The focal length is relative and scales both axes and the skew alike.
    """

    bias: Array  # (3,) known and fixed
    sources: Sources  # direction is (3, k); drawn once per unit


@dataclass(frozen=True, slots=True, eq=False)
class ImageField:
    """What is left of an image's distortion after its correction, shared by all that the image shows.

    Source j shifts every image point along ``axis[j]`` by its value, px, times ``x**i y**j`` with the powers of its
    row: x and y are the nominal place in the image, from its centre and in units of half its diagonal.
    """

    centre_px: Array  # (2,)
    half_diagonal_px: float
    axis: NDArray[np.int64]  # (k,) 0: u, 1: v
    powers: NDArray[np.int64]  # (k, 2)
    sources: Sources  # direction is the identity (k, k), px


@dataclass(frozen=True, slots=True, eq=False)
class Temperature:
    """Operation at another temperature than that at which the structure was measured: structure and connector grow."""

    difference_k: float  # known
    sources: Sources  # of the difference about it; none, or one in K with direction (1, 1)
    structure_per_k: float  # relative
    connector_per_k: float  # relative
    seat_mm: Array  # (3,) con: where structure and connector hold each other
    flange_seat_mm: Array  # (3,) con: where the connector sits on the flange
    at_pivots: tuple[bool, bool] = (False, False)  # whether the two are the pivots of the interfaces, and go with them

    @property
    def connector_mm_per_k(self) -> Array:
        """(3,) con: how the structure's seat moves away from the flange's."""
        return np.asarray(self.connector_per_k * (self.seat_mm - self.flange_seat_mm))

    def follow(self, first: Mount, second: Mount) -> Temperature:
        """The same where the interfaces' pivots are, by numbers or symbols, if it is these that seats are at."""
        return replace(
            self,
            seat_mm=first.pivot_mm if self.at_pivots[0] else self.seat_mm,
            flange_seat_mm=second.pivot_mm if self.at_pivots[1] else self.flange_seat_mm,
        )


@dataclass(frozen=True, slots=True, eq=False)
class Balls:
    """Fiducials are balls, and what an image shows of one is not centred on the image of its centre."""

    radius_mm: float
    share: float  # of the shift of the outline's centre that the located point has: 1, or 0.8 for a shadow's centroid


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
    intrinsics_error: IntrinsicsError | None = None  # of the assumed intrinsics; None: they are exact
    motion: Mount | None = None  # of the structure against the target by the time of this shot, acts in con
    image_field: ImageField | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Target:
    """A target point, or one sample of a target region."""

    name: str  # as in the design; zone[3] of a region
    position_mm: Array  # (3,) con
    region: str | None = None  # the target region it samples, if any


@dataclass(frozen=True, slots=True, eq=False)
class Requirement:
    """A limit on a quantile of an error's norm."""

    name: str  # as in the design
    error: str  # "tcp" or "localisation"
    quantile: float  # 0.95 for P95
    limit_mm: float  # what the quantile must not exceed
    confidence: float  # two-sided confidence of the interval the verdict is taken from
    targets: tuple[str, ...]  # target names
    risk: str = "pooled"  # or "per_unit"
    min_yield: float | None = None  # per_unit: required fraction of installed units

    @property
    def units_fraction(self) -> float | None:
        """Per unit: the fraction of installed units that must meet the limit, without ``min_yield`` that of the
        quantile (95 % of units for a P95).  Pooled: none."""
        if self.risk == "pooled":
            return None
        return self.quantile if self.min_yield is None else self.min_yield


@dataclass(frozen=True, slots=True, eq=False)
class System:
    """A design, compiled.  Immutable; every array is read-only."""

    name: str  # of the design
    views: tuple[View, ...]  # two or more
    fiducial_labels: tuple[str, ...]  # N of them
    fiducials_mm: Array  # (N, 3) con, nominal
    manufacturing_law: Law  # NORMAL, UNIFORM or TRIANGULAR
    manufacturing_half_width_mm: Array  # (N, 3)
    manufacturing_coverage_factor: float  # only meaningful for NORMAL
    structure_connector: Mount  # seat of the structure on the connector, T_err1, acts in con
    connector_flange: Mount  # connector on the end effector's flange, T_err2, acts in con
    T_flange_con: Array  # (4, 4) con -> flange, mm
    T_tcp_flange: Array  # (4, 4) flange -> tcp, mm
    hand_eye: Mount  # acts in tcp, after T_tcp_flange
    execution_bias_mm: Array  # (3,) tcp: deflection under the nominal load
    execution: Sources  # direction is (3, k), tcp: repeatability and load
    targets: tuple[Target, ...]  # regions expanded
    requirements: tuple[Requirement, ...]  # none: nothing is promised
    reading: Reading = Reading.PHYSICAL  # of the structure's installation error
    rotation_form: RotationForm = RotationForm.FULL  # of every torsor
    estimator: Estimator = Estimator.DLT  # of every view
    triangulation: Triangulation = Triangulation.NORMALISED  # of every target
    temperature: Temperature | None = None
    balls: Balls | None = None  # None: fiducials are points
    loss_probability: tuple[float, ...] = ()  # of each fiducial in a shot, in all views at once; (): none is ever lost
    design_sha256: str | None = None  # of the document it was compiled from
    notes: tuple[str, ...] = field(default=())  # assumptions recorded on the way (e.g. RAS converted to LPS)

    @property
    def interfaces(self) -> tuple[Mount, Mount]:
        """Both interfaces, in the order of the chain."""
        return self.structure_connector, self.connector_flange

    @property
    def common_shifts(self) -> tuple[str, ...]:
        """Where the document declares what moves the images of all fiducials of a view together, as pointers."""
        return (
            *(f"/views/{v}/motion" for v, view in enumerate(self.views) if view.motion),
            *(f"/views/{v}/image_field" for v, view in enumerate(self.views) if view.image_field),
            *(("/temperature",) if self.temperature else ()),
            *(("/fiducials/diameter_mm",) if self.balls else ()),
        )

    @property
    def projections(self) -> Array:
        """(V, 3, 4) of all views."""
        return np.array([view.projection for view in self.views])

    @property
    def sees(self) -> Array:
        """(V, N) 1 where a view sees a fiducial and its estimate uses it, otherwise 0."""
        labels = self.fiducial_labels
        return np.array([[view.sees is None or label in view.sees for label in labels] for view in self.views], float)

    @property
    def T_tcp_con(self) -> Array:
        """(4, 4) con -> tcp, mm."""
        return self.T_tcp_flange @ self.T_flange_con

    @property
    def manufacturing_std_mm(self) -> Array:
        """(N, 3) standard deviation of each fiducial coordinate."""
        law = self.manufacturing_law
        per = 1 / self.manufacturing_coverage_factor if law is Law.NORMAL else STD_PER_HALF_WIDTH[law]
        return self.manufacturing_half_width_mm * per
