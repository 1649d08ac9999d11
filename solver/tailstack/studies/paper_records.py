"""The record of ``study paper``: printed cells, ours beside them, and what explains the rest."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from ..results import Interval, Vector3


@dataclass(frozen=True, slots=True)
class PrintedCell:
    """A cell as it stands in its table, beside ours, or with the reason why nothing can stand beside it."""

    table: Literal["S1", "S2", "S3", "S4"]
    """Table of the paper."""
    row: str
    """Row of the table."""
    column: str
    """Column of the table."""
    printed: str
    """The cell as it is printed."""
    value: float
    """What it says, in `unit`: S1 to S3 are read as metres; S4 as printed."""
    unit: Literal["mm", "px"]
    """Unit of `value` and `ours`: mm or px."""
    ours: tuple[float | None, ...]
    """What the chain gives in each geometry, in `unit`; null where nothing can stand beside it."""
    remark: str
    """Why nothing stands beside it, or why it is not compared; empty for a cell that is compared."""


@dataclass(frozen=True, slots=True)
class PaperCell:
    """One statistic under one condition: what is printed, what the full chain gives, and how far apart they may be."""

    table: Literal["S1", "S2", "S3"]
    """Table of the paper."""
    row: str
    """Row of the table."""
    quantity: Literal["mean", "p95", "std_x", "std_y", "std_z"]
    """Statistic of the localisation error: mean or P95 of its norm, or a standard deviation along an axis of con."""
    rotation_deg: float
    """Installation error of the structure, about each axis, deg."""
    translation_mm: float
    """Installation error of the structure, along (1, 1, 1), mm."""
    noise_px: float
    """Standard deviation of each image coordinate, px."""
    value_mm: float
    """Monte Carlo on the full chain, mm."""
    standard_error_mm: float
    """Standard error of `value_mm`, mm."""
    tcp_mm: float
    """The same statistic of the error at the tool, sampled at the same trials, mm."""
    first_order_mm: float
    """The same statistic to first order, mm."""
    other_reading_mm: float
    """First order in the other reading of the installation error, mm."""
    printed_mm: float | None
    """What is printed, mm: of the localisation error, of the tool's where the table has no other. Null: not printed,
    trivial, or this geometry is not meant to be the paper's.
    """
    rounding_mm: float | None
    """Half of the last printed decimal, mm; null where nothing is printed."""
    published_error_mm: float
    """Standard deviation of this statistic over experiments of the paper's size, mm."""
    band_mm: Interval
    """Where 99 % of such experiments would print it, mm."""
    z: float | None
    """Printed less ours, in standard deviations of such experiments, our sampling and the rounding; null where
    nothing is printed.
    """
    outside: bool | None
    """Whether the printed cell is outside the band; null where nothing is printed."""


@dataclass(frozen=True, slots=True)
class Additivity:
    """A cell of S2 against its parts: installation error alone and noise alone."""

    row: str
    """Row of S2."""
    joint_mm: float
    """P95 of installation error and noise together, mm."""
    first_order_mm: float
    """The same to first order, mm."""
    bias_mm: float
    """Of the installation error alone, mm."""
    noise_mm: float
    """Of the noise alone, mm."""
    quadrature_mm: float
    """Root of the sum of squares of the two, mm."""
    sum_mm: float
    """Sum of the two, mm."""
    printed_joint_mm: float | None
    """What is printed for both together, mm; null where nothing is."""
    printed_quadrature_mm: float | None
    """Root of the sum of squares of the printed parts, mm; null where nothing is printed."""


@dataclass(frozen=True, slots=True)
class Propagation:
    """Standard deviations at S3's noise, propagated one way."""

    name: str
    """Name of this way of propagating."""
    sentence: str
    """What it leaves out, in a sentence."""
    std_mm: Vector3
    """Standard deviations along x, y, z of con, mm."""
    over_monte_carlo: Vector3
    """Their ratio to Monte Carlo's, along x, y, z."""
    printed_difference_mm: Vector3 | None
    """Their difference from the printed analytic column, mm; null where nothing is printed."""
    reproduces_printed: bool | None
    """Whether that is within the rounding on all three axes; null where nothing is printed."""


@dataclass(frozen=True, slots=True)
class Factor:
    """S3: the analytic column against Monte Carlo, and which simplification makes it."""

    noise_px: float
    """Standard deviation of each image coordinate, px."""
    monte_carlo_mm: Vector3
    """Standard deviations by Monte Carlo along x, y, z of con, mm."""
    standard_error_mm: Vector3
    """Standard errors of them, mm."""
    printed_monte_carlo_mm: Vector3 | None
    """The printed Monte Carlo column, mm; null where it is not compared."""
    printed_analytic_mm: Vector3 | None
    """The printed analytic column, mm; null where it is not compared."""
    mean_error_mm: Vector3
    """Mean of Monte Carlo less the point that first order has for it, along x, y, z of con, mm."""
    mean_standard_error_mm: Vector3
    """Standard errors of it, mm."""
    printed_mean_difference_mm: Vector3 | None
    """Printed mean by Monte Carlo less the analytic one, mm; null where it is not compared."""
    propagations: tuple[Propagation, ...]
    """The simplifications that were tried."""
    sentence: str
    """Which of them makes the printed column, in a sentence."""


@dataclass(frozen=True, slots=True)
class LevelRatio:
    """S4: what an installation level does to error and reprojection error where there is no noise."""

    level: str
    """Installation level of S4."""
    rotation_deg: float
    """About each axis, deg."""
    translation_mm: float
    """Along (1, 1, 1), mm."""
    error_mm: float
    """Norm of the localisation error without noise, mm."""
    reprojection_estimated_px: float
    """Reprojection error with the matrices estimated at this level, as the chain does, px."""
    reprojection_noisy_px: float
    """The same with 2 px of noise: mean over trials, px."""
    reprojection_kept_px: float
    """Reprojection error with the matrices of L0 kept: RMS over fiducials and views, px."""
    mm_per_px: float | None
    """Error over the latter, mm per px; null at L0."""


@dataclass(frozen=True, slots=True)
class LevelShape:
    """Where the P95 of the error stands at a level with 2 px of noise: S4 beside this says what its tail is."""

    level: str
    """Installation level of S4."""
    p95_over_mean: float
    """P95 of the error's norm over its mean."""
    standard_deviations: float
    """P95 less the mean, over the standard deviation; a normal law has 1.645."""


@dataclass(frozen=True, slots=True)
class Geometry:
    """The tables in one geometry."""

    name: str
    """Name of the geometry."""
    design_sha256: str | None
    """SHA-256 of its design's canonical content; null where there is no design."""
    compared: bool
    """Whether it was fitted to the tables, and is set beside them."""
    reading: str
    """Reading of the installation error: physical or eq18."""
    target: str
    """Name of the target."""
    lever_mm: float
    """Distance from the pivot to the target, mm."""
    nu: float
    """Validity number at the largest noise of the tables."""
    cells: tuple[PaperCell, ...]
    """The cells of S1 to S3 in this geometry."""
    compared_cells: int
    """How many of them stand beside a printed one."""
    outside_cells: int
    """How many printed ones are outside their band."""
    chi_square: float | None
    """Sum of the squares of their z; null where nothing is compared."""
    additivity: tuple[Additivity, ...]
    """S2 against its parts."""
    factor: Factor
    """S3's analytic column."""
    levels: tuple[LevelRatio, ...]
    """S4's ratio of error to reprojection error."""
    shapes: tuple[LevelShape, ...]
    """S4's tail."""


@dataclass(frozen=True, slots=True)
class Statement:
    """Something that can be said of the tables, with the numbers it rests on."""

    about: Literal["units", "repeat", "falling", "lever", "means", "S4", "tail", "zero"]
    """What of the tables it is about."""
    sentence: str
    """The statement."""
    values: tuple[float, ...]
    """The numbers that it rests on, in its order."""


@dataclass(frozen=True, slots=True)
class StudyPaper:
    """Tables S1 to S4, printed and reproduced."""

    schema: Literal["tailstack/study-paper/1"]
    """Name and version of this record's schema."""
    source: str
    """The publication."""
    seed: int
    """Seed of the trials."""
    trials: int
    """Trials of each of our cells."""
    published_trials: int
    """Trials of each published cell."""
    band: float
    """Share of experiments of the paper's size that would print a cell within its band."""
    geometries: tuple[Geometry, ...]
    """The tables in each geometry."""
    printed: tuple[PrintedCell, ...]
    """Every cell of S1 to S4."""
    statements: tuple[Statement, ...]
    """What can be said of the tables."""
    tailstack_version: str
    """Version of the solver."""
