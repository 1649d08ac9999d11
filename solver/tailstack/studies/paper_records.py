"""The record of ``study paper``: printed cells, ours beside them, and what explains the rest."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from ..results import Interval, Vector3


@dataclass(frozen=True, slots=True)
class PrintedCell:
    """A cell as it stands in its table, beside ours, or with the reason why nothing can stand beside it."""

    table: Literal["S1", "S2", "S3", "S4"]
    row: str
    column: str
    printed: str
    value: float  # S1-S3: mm, read as metres; S4: as printed, mm or px
    unit: Literal["mm", "px"]
    ours: tuple[float | None, ...]  # of every geometry, in the same unit
    remark: str  # why there is none, or why it is not compared; "" for a cell that is compared


@dataclass(frozen=True, slots=True)
class PaperCell:
    """One statistic under one condition: what is printed, what the full chain gives, and how far apart they may be."""

    table: Literal["S1", "S2", "S3"]
    row: str
    quantity: Literal["mean", "p95", "std_x", "std_y", "std_z"]  # of the localisation error
    rotation_deg: float  # about each axis
    translation_mm: float  # along (1, 1, 1)
    noise_px: float
    value_mm: float  # Monte Carlo on the full chain
    standard_error_mm: float  # of value_mm
    tcp_mm: float  # the same statistic of the error at the tool, sampled at the same trials
    first_order_mm: float
    other_reading_mm: float  # first order in the other reading of the installation error
    # of the 3-D error, of the tool's where the table has no other; None: not printed, trivial, or this geometry is not
    # meant to be the paper's
    printed_mm: float | None
    rounding_mm: float | None  # half of the last printed decimal
    published_error_mm: float  # standard deviation of this statistic over experiments of the paper's size
    band_mm: Interval  # where 99 % of such experiments would print it
    z: float | None
    outside: bool | None  # of the band


@dataclass(frozen=True, slots=True)
class Additivity:
    """A cell of S2 against its parts: installation error alone and noise alone."""

    row: str
    joint_mm: float
    first_order_mm: float
    bias_mm: float
    noise_mm: float
    quadrature_mm: float  # sqrt(bias^2 + noise^2)
    sum_mm: float
    printed_joint_mm: float | None
    printed_quadrature_mm: float | None  # from the printed parts


@dataclass(frozen=True, slots=True)
class Propagation:
    """Standard deviations at S3's noise, propagated one way."""

    name: str
    sentence: str
    std_mm: Vector3
    over_monte_carlo: Vector3
    printed_difference_mm: Vector3 | None  # from the printed analytic column
    reproduces_printed: bool | None  # within the rounding on all three axes


@dataclass(frozen=True, slots=True)
class Factor:
    """S3: the analytic column against Monte Carlo, and which simplification makes it."""

    noise_px: float
    monte_carlo_mm: Vector3
    standard_error_mm: Vector3
    printed_monte_carlo_mm: Vector3 | None
    printed_analytic_mm: Vector3 | None
    mean_error_mm: Vector3  # of Monte Carlo: how far its mean is from the point that first order has for its mean
    mean_standard_error_mm: Vector3
    printed_mean_difference_mm: Vector3 | None  # Monte Carlo less analytic
    propagations: tuple[Propagation, ...]
    sentence: str


@dataclass(frozen=True, slots=True)
class LevelRatio:
    """S4: what an installation level does to error and reprojection error where there is no noise."""

    level: str
    rotation_deg: float
    translation_mm: float
    error_mm: float
    reprojection_estimated_px: float  # matrices estimated at this level, as the chain does
    reprojection_noisy_px: float  # the same with 2 px of noise: mean over trials
    reprojection_kept_px: float  # matrices of L0 kept: RMS over fiducials and views
    mm_per_px: float | None  # error over the latter; None at L0


@dataclass(frozen=True, slots=True)
class LevelShape:
    """Where the P95 of the error stands at a level with 2 px of noise: S4 beside this says what its tail is."""

    level: str
    p95_over_mean: float
    standard_deviations: float  # (P95 - mean) / standard deviation; a normal law has 1.645


@dataclass(frozen=True, slots=True)
class Geometry:
    """The tables in one geometry."""

    name: str
    design_sha256: str | None
    compared: bool  # fitted to the tables, and set beside them
    reading: str
    target: str
    lever_mm: float  # pivot to target
    nu: float  # at the largest noise of the tables
    cells: tuple[PaperCell, ...]
    compared_cells: int
    outside_cells: int
    chi_square: float | None  # sum of z^2
    additivity: tuple[Additivity, ...]
    factor: Factor
    levels: tuple[LevelRatio, ...]
    shapes: tuple[LevelShape, ...]


@dataclass(frozen=True, slots=True)
class Statement:
    """Something that can be said of the tables, with the numbers it rests on."""

    about: Literal["units", "repeat", "falling", "lever", "means", "S4", "tail", "zero"]
    sentence: str
    values: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class StudyPaper:
    """Tables S1 to S4, printed and reproduced."""

    schema: Literal["tailstack/study-paper/1"]
    source: str
    seed: int
    trials: int  # of each of our cells
    published_trials: int
    band: float  # 0.99
    geometries: tuple[Geometry, ...]
    printed: tuple[PrintedCell, ...]  # every cell of S1-S4
    statements: tuple[Statement, ...]
    tailstack_version: str
