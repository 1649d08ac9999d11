"""The record of ``study paper``: printed cells, ours beside them, and what explains the rest.

Every printed cell of S1-S4 beside ours, or the reason why nothing can stand beside it.

Tables S1 to S4 of the paper in any geometry, and beside the printed ones in the geometries fitted to them.

Each condition of the tables is sampled, with how its statistics scatter over experiments of the paper's size.  S3 is
one covariance propagated in several ways beside Monte Carlo, each simplification under its name; S2 is held against
its parts; of S4 it is said what its columns can carry.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from math import hypot, radians, sin, sqrt
from typing import Literal

import numpy as np
from scipy.special import betaincinv, ndtr, ndtri

from ...arrays import Array
from ...cores import usable_cores
from ...errors import OutOfRangeError, Problem, StudyError
from ...estimation.resection import project, resect
from ...estimation.triangulation import triangulate
from ...montecarlo import compile_plan, evaluate, run_indices
from ...propagation.linear import LinearModel, covariance, estimator_geometry, linearise
from ...propagation.second_order import refuse_outside_range, second_order_moments
from ...results import Interval, Vector3
from ...results.record import Published
from ...results.verdicts import P95
from ...scoring import checked_system, vector3
from ...system import Reading, System
from ...tail.gaussian import norm_mean, norm_quantile
from ...version import __version__
from .published import (
    AXES,
    CELLS,
    LEVELS,
    MM_PER_PRINTED_UNIT,
    S1_NOISE_PX,
    S2,
    S3,
    S3_ANALYTIC,
    S3_NOISE_PX,
    S4,
    SOURCE,
    TABLES,
    TRIALS,
    Printed,
    Quantity,
    Setting,
    Table,
    apply_setting,
    nominal,
    read_printed,
    with_noise,
)


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


@dataclass(frozen=True, slots=True, repr=False)
class StudyPaper(Published):
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


MEANS = (
    "where the point lies in the authors' frame, which is not printed; what can be predicted is by how much the two "
    "means differ"
)
ANALYTIC = "ours is first order in full; the printed column leaves a covariance out"
AT_REST = "zero in any geometry: shown, not counted"
BENCH = "a bench whose geometry, pivot, axes and trials are not stated, counted from L0: shown, not compared"
SPREAD = "the bench's noise, instrument and number of trials are not stated: no geometry gives it"


def list_printed(geometries: Sequence[Geometry]) -> tuple[PrintedCell, ...]:
    """In the order of the tables, row by row."""
    cells = []
    for table in ("S1", "S2", "S3", "S4"):
        for row, *texts in TABLES[table]["rows"]:
            for column, text in zip(TABLES[table]["columns"], texts, strict=True):
                if text is not None:
                    cells.append(_show_cell(table, row, column, text, geometries))
    return tuple(cells)


def _show_cell(table: str, row: str, column: str, text: str, geometries: Sequence[Geometry]) -> PrintedCell:
    lengths = table != "S4"
    return PrintedCell(
        table=table,  # type: ignore[arg-type]
        row=row,
        column=column,
        printed=text,
        value=round(float(text) * MM_PER_PRINTED_UNIT, 6) if lengths else float(text),
        unit="px" if column.endswith("_px") else "mm",
        ours=tuple(_OURS[table](geometry, row, column) for geometry in geometries),
        remark=_remark(table, row, column),
    )


def _remark(table: str, row: str, column: str) -> str:
    if table == "S2":
        return AT_REST if (row, column) == ("L0", "0 px") else ""
    if table == "S3":
        return MEANS if column.endswith("mean") else ANALYTIC if column == "analytic_std" else ""
    if table == "S4":
        return SPREAD if column in ("e_3d_std", "e_3d_p95") else BENCH
    return ""


def _of_s1(geometry: Geometry, row: str, column: str) -> float:
    quantity = "p95" if column.endswith("p95") else "mean"
    cell = next(cell for cell in geometry.cells if (cell.table, cell.row, cell.quantity) == ("S1", row, quantity))
    return cell.value_mm if column == "e_3d_mean" else cell.tcp_mm


def _of_s2(geometry: Geometry, row: str, column: str) -> float:
    return next(cell.tcp_mm for cell in geometry.cells if (cell.table, cell.row) == ("S2", f"{row}, {column}"))


def _of_s3(geometry: Geometry, row: str, column: str) -> float | None:
    axis = AXES.index(row)
    if column == "mc_std":
        return geometry.factor.monte_carlo_mm[axis]
    full = next(propagation for propagation in geometry.factor.propagations if propagation.name == "full")
    return full.std_mm[axis] if column == "analytic_std" else None


def _of_s4(geometry: Geometry, row: str, column: str) -> float | None:
    level = next(level for level in geometry.levels if level.level == row)
    return {"e_3d_mean": level.error_mm, "e_reprojection_mean_px": level.reprojection_kept_px}.get(column)


_OURS = {"S1": _of_s1, "S2": _of_s2, "S3": _of_s3, "S4": _of_s4}


ROTATIONS_DEG = (0.0, 0.5, 1.0, 1.5, 2.0)
TRANSLATIONS_MM = (0.0, 1.0, 2.0, 3.0, 4.0, 5.0)
NORMS: tuple[Quantity, ...] = ("mean", "p95")
NOISES_PX = (0.0, 2.0, 5.0)
DEFAULT_TRIALS = 100_000
FEWEST_TRIALS = 20 * TRIALS  # so that our own error is a fifth of the paper's at most

Progress = Callable[[int, int], None]
Row = tuple[Table, str, Quantity, Setting]
Condition = tuple[int, Setting]  # of which geometry


@dataclass(frozen=True, slots=True, eq=False)
class PaperGeometry:
    """A geometry that the tables are made in."""

    system: System
    compared: bool  # fitted to the tables
    target: int = 0


def list_rows() -> tuple[Row, ...]:
    """Every cell of S1, S2 and S3."""
    rows: list[Row] = []
    for degrees in ROTATIONS_DEG:
        for quantity in NORMS:
            rows.append(("S1", f"rotation {degrees:g} deg", quantity, Setting(degrees, 0.0, S1_NOISE_PX)))
    for millimetres in TRANSLATIONS_MM:
        for quantity in NORMS:
            rows.append(("S1", f"translation {millimetres:g} mm", quantity, Setting(0.0, millimetres, S1_NOISE_PX)))
    for level, (degrees, millimetres) in LEVELS.items():
        for noise in NOISES_PX:
            rows.append(("S2", f"{level}, {noise:g} px", "p95", Setting(degrees, millimetres, noise)))
    for spread in AXIS:
        rows.append(("S3", f"Monte Carlo, {spread[-1]}", spread, Setting(0.0, 0.0, S3_NOISE_PX)))
    return tuple(rows)


def study_paper(
    cases: Sequence[PaperGeometry],
    *,
    trials: int = DEFAULT_TRIALS,
    seed: int = 0,
    threads: int | None = None,
    progress: Progress | None = None,
) -> StudyPaper:
    """The tables in every geometry.

    Of a system are taken: views without their noise, fiducials, target, the pivot of the first interface, transforms
    and model; everything else is the tables' own.

    trials: of each of our cells, one seed for all of them.  Same seed, same digits, whatever ``threads``.  Raises
    IllPosedError for a geometry that does not determine the target, StudyError for too few trials.
    """
    if trials < FEWEST_TRIALS:
        detail = (
            f"at least {FEWEST_TRIALS} trials are needed, so that our error is small beside the paper's; got {trials}"
        )
        raise StudyError(Problem("", "trials", detail, f"--trials {DEFAULT_TRIALS}"))
    systems = [nominal(with_noise(case.system, S1_NOISE_PX)) for case in cases]
    for system in systems:
        checked_system(system)
    table = list_rows()
    settings = list(dict.fromkeys(row[3] for row in table))
    asked = [(k, setting) for k in range(len(cases)) for setting in settings]

    def work(condition: Condition) -> tuple[ConditionErrors, dict[int, PaperCell]]:
        k, setting = condition
        at = take_sample(systems[k], cases[k].target, setting, trials, seed)
        made = {}
        for place, (name, row, quantity, there) in enumerate(table):
            if there == setting:
                printed = find_printed(name, row, quantity) if cases[k].compared else None
                made[place] = compare_cell(at, name, row, quantity, printed)
        return at, made

    cells: list[dict[int, PaperCell]] = [{} for _ in cases]
    samples: list[dict[Setting, ConditionErrors]] = [{} for _ in cases]
    needed = {Setting(0.0, 0.0, S3_NOISE_PX)}
    noisy: list[dict[str, float]] = [{} for _ in cases]
    shapes: list[dict[str, LevelShape]] = [{} for _ in cases]
    levels = {Setting(*torsor, S3_NOISE_PX): level for level, torsor in LEVELS.items()}
    for done, ((k, setting), (at, made)) in enumerate(_compute_in_order(work, asked, threads)):
        cells[k].update(made)
        if setting in needed:
            samples[k][setting] = at
        if setting in levels:
            noisy[k][levels[setting]] = at.reprojection_px
            shapes[k][levels[setting]] = describe_tail(levels[setting], at.localisation)
        if progress is not None:
            progress(done + 1, len(asked))
    geometries = tuple(
        _assemble_geometry(
            case,
            system,
            tuple(cells[k][place] for place in range(len(table))),
            samples[k],
            noisy[k],
            tuple(shapes[k][level] for level in LEVELS),
        )
        for k, (case, system) in enumerate(zip(cases, systems, strict=True))
    )
    return StudyPaper(
        schema="tailstack/study-paper/1",
        source=SOURCE,
        seed=seed,
        trials=trials,
        published_trials=TRIALS,
        band=BAND,
        geometries=geometries,
        printed=list_printed(geometries),
        statements=write_statements(geometries),
        tailstack_version=__version__,
    )


def _compute_in_order(
    work: Callable[[Condition], tuple[ConditionErrors, dict[int, PaperCell]]],
    asked: list[Condition],
    threads: int | None,
) -> Iterator[tuple[Condition, tuple[ConditionErrors, dict[int, PaperCell]]]]:
    with ThreadPoolExecutor(usable_cores() if threads is None else threads) as pool:
        yield from zip(asked, pool.map(work, asked), strict=True)


def _assemble_geometry(
    case: PaperGeometry,
    system: System,
    cells: tuple[PaperCell, ...],
    samples: dict[Setting, ConditionErrors],
    noisy: dict[str, float],
    shapes: tuple[LevelShape, ...],
) -> Geometry:
    compared = [cell for cell in cells if cell.z is not None]
    target = system.targets[case.target]
    pivot = system.structure_connector.pivot_mm
    second = {(cell.row.partition(",")[0], cell.noise_px): cell for cell in cells if cell.table == "S2"}
    loud = with_noise(system, max(NOISES_PX))
    return Geometry(
        name=case.system.name,
        design_sha256=case.system.design_sha256,
        compared=case.compared,
        reading=str(system.reading),
        target=target.name,
        lever_mm=float(np.linalg.norm(target.position_mm - pivot)),
        nu=linearise(loud, target).nu,
        cells=cells,
        compared_cells=len(compared),
        outside_cells=sum(bool(cell.outside) for cell in compared),
        chi_square=sum(cell.z**2 for cell in compared if cell.z is not None) if compared else None,
        additivity=compare_parts(second, case.compared),
        factor=compare_factor(system, case.target, samples[Setting(0.0, 0.0, S3_NOISE_PX)], case.compared),
        levels=compute_level_ratios(system, case.target, noisy),
        shapes=shapes,
    )


BAND = 0.99
WIDTH = float(ndtri(0.5 + BAND / 2))
PART = 20_000  # trials sampled in one go
AXIS: dict[Quantity, int] = {"std_x": 0, "std_y": 1, "std_z": 2}
OTHER = {Reading.PHYSICAL: Reading.EQ18, Reading.EQ18: Reading.PHYSICAL}


@dataclass(frozen=True, slots=True, eq=False)
class ConditionErrors:
    """A condition: errors of the full chain, and the linear model in both readings."""

    setting: Setting
    localisation: Array  # (3, n) mm, con
    tcp: Array  # (3, n) mm, tcp
    model: LinearModel
    other: LinearModel
    reprojection_px: float  # mean over trials of the RMS


@dataclass(frozen=True, slots=True)
class Statistic:
    """A number of a sample with its scatter over samples of the paper's size, and its own."""

    value: float
    published_error: float
    standard_error: float


def take_sample(system: System, target: int, setting: Setting, trials: int, seed: int) -> ConditionErrors:
    """The chain under a condition.  Without noise one trial is all there is."""
    here = apply_setting(system, setting)
    plan = compile_plan(here)
    count = trials if setting.noise_px > 0 else 1
    parts = [
        run_indices(plan, seed, first, min(PART, count - first), reprojection=True) for first in range(0, count, PART)
    ]
    errors = np.concatenate([part.errors[target] for part in parts], axis=-1)
    rms = np.concatenate([part.reprojection for part in parts if part.reprojection is not None])
    other = replace(here, reading=OTHER[here.reading])
    return ConditionErrors(
        setting,
        errors[1],
        errors[0],
        linearise(here, here.targets[target]),
        linearise(other, other.targets[target]),
        float(rms.mean()),
    )


def estimate(errors: Array, quantity: Quantity) -> Statistic:
    """``quantity`` of errors (3, n), mm.

    Over experiments of 2,000 trials a mean scatters by s / sqrt(2000), a standard deviation by its fourth moment, and
    the 1,900th of 2,000 ordered norms as the quantile at a Beta(1900, 101) variate, whatever the law.
    """
    count = errors.shape[1]
    if quantity in AXIS:
        x = errors[AXIS[quantity]] - errors[AXIS[quantity]].mean()
        value = sqrt(float(x @ x) / max(count - 1, 1))
        fourth = float((x**4).mean())
        per_trial = sqrt(max(fourth - value**4, 0.0)) / (2 * value) if value > 0 else 0.0
        return Statistic(value, per_trial / sqrt(TRIALS), per_trial / sqrt(count))
    norms = np.linalg.norm(errors, axis=0)
    if quantity == "mean":
        per_trial = float(norms.std())
        return Statistic(float(norms.mean()), per_trial / sqrt(TRIALS), per_trial / sqrt(count))
    ordered = np.sort(norms)
    rank = round(P95 * TRIALS)
    ends = np.quantile(ordered, betaincinv(rank, TRIALS - rank + 1, ndtr([-1.0, 1.0])))
    scatter = float(ends[1] - ends[0]) / 2
    return Statistic(float(np.quantile(ordered, P95)), scatter, scatter * sqrt(TRIALS / count))


def predict(model: LinearModel, quantity: Quantity) -> float:
    """The same number of the linear model's exact law, mm."""
    mean, spread = model.localisation_bias_mm, covariance(model, "localisation")
    if quantity in AXIS:
        return sqrt(float(spread[AXIS[quantity], AXIS[quantity]]))
    return norm_mean(mean, spread) if quantity == "mean" else norm_quantile(P95, mean, spread)


def compare_cell(at: ConditionErrors, table: Table, row: str, quantity: Quantity, printed: Printed | None) -> PaperCell:
    """One cell; ``printed`` is what stands there, if it is held and compared with."""
    statistic = estimate(at.localisation, quantity)
    rounding = 0.0 if printed is None else printed.rounding_mm
    width = sqrt(statistic.published_error**2 + statistic.standard_error**2 + rounding**2 / 3)
    z = None if printed is None else (printed.value_mm - statistic.value) / width
    return PaperCell(
        table=table,
        row=row,
        quantity=quantity,
        rotation_deg=at.setting.rotation_deg,
        translation_mm=at.setting.translation_mm,
        noise_px=at.setting.noise_px,
        value_mm=statistic.value,
        standard_error_mm=statistic.standard_error,
        tcp_mm=estimate(at.tcp, quantity).value,
        first_order_mm=predict(at.model, quantity),
        other_reading_mm=predict(at.other, quantity),
        printed_mm=None if printed is None else printed.value_mm,
        rounding_mm=None if printed is None else rounding,
        published_error_mm=statistic.published_error,
        band_mm=(statistic.value - WIDTH * width, statistic.value + WIDTH * width),
        z=z,
        outside=None if z is None else abs(z) > WIDTH,
    )


def find_printed(table: Table, row: str, quantity: Quantity) -> Printed | None:
    """What is held of a cell."""
    held: Sequence[Printed] = [p for p in CELLS if (p.table, p.row, p.quantity) == (table, row, quantity)]
    return held[0] if held else None


ROUNDING_MM = 0.5e-3 * MM_PER_PRINTED_UNIT  # of the analytic column: three decimals
# Monte Carlo less analytic, both printed with three decimals
S3_MEAN_DIFFERENCE_MM = np.array(
    [round(MM_PER_PRINTED_UNIT * (float(row[1]) - float(row[2])), 6) for row in TABLES["S3"]["rows"]]
)


def _std(spread: Array) -> Array:
    return np.asarray(np.sqrt(np.maximum(np.diag(spread), 0.0)))


def list_propagations(system: System, target: int, at: ConditionErrors) -> list[tuple[str, str, Array]]:
    """Name, what it is, standard deviations (3,) mm of every propagation."""
    model = at.model
    full = covariance(model, "localisation")
    views = [view.name for view in system.views]
    blocks = {block.contributor: block for block in model.blocks}
    propagations = [
        ("full", "Eqs 15-16 with the covariance of every view's matrix and of the target's images", _std(full))
    ]
    propagations += propagate_second_order(apply_setting(system, at.setting), target, model)
    for place, view in enumerate(views):
        left_out = full - blocks[f"fiducial_noise:{view}"].covariance("localisation")
        words = f"the covariance of the matrix of view {place + 1} ({view}) left out of Eq 16"
        propagations.append((f"without matrix {place + 1}", words, _std(left_out)))
        nothing = left_out - blocks[f"target_noise:{view}"].covariance("localisation")
        words = f"everything that comes through view {place + 1} ({view}) left out, its target noise too"
        propagations.append((f"without view {place + 1}", words, _std(nothing)))
    targets = sum((blocks[f"target_noise:{view}"].covariance("localisation") for view in views), np.zeros((3, 3)))
    propagations.append(("target noise alone", "every matrix taken as exact", _std(targets)))
    propagations.append(("matrices alone", "the target's images taken as exact", _std(full - targets)))
    return propagations


def propagate_second_order(here: System, target: int, model: LinearModel) -> list[tuple[str, str, Array]]:
    """The second-order correction, or nothing where it is refused."""
    plan = compile_plan(here)
    try:
        refuse_outside_range(model.nonlinearity.divisor, plan.inputs)
    except OutOfRangeError:
        return []
    gains = np.hstack([block.scaled("localisation") for block in model.blocks])
    _, spread = second_order_moments(lambda z: evaluate(plan, z)[:, target, 1], plan.standard_std, gains)
    return [("second order", "full, with the Hessian of the estimator", _std(spread))]


def compare_factor(system: System, target: int, at: ConditionErrors, compared: bool) -> Factor:
    """S3 of one geometry."""
    statistics = [estimate(at.localisation, quantity) for quantity in AXIS]
    sampled = np.array([statistic.value for statistic in statistics])
    analytic = np.array(S3_ANALYTIC) * MM_PER_PRINTED_UNIT
    own = at.localisation
    propagations = []
    for name, words, std in list_propagations(system, target, at):
        difference = analytic - std
        propagations.append(
            Propagation(
                name=name,
                sentence=words,
                std_mm=vector3(std),
                over_monte_carlo=vector3(std / sampled),
                printed_difference_mm=vector3(difference) if compared else None,
                reproduces_printed=bool((np.abs(difference) <= ROUNDING_MM).all()) if compared else None,
            )
        )
    return Factor(
        noise_px=at.setting.noise_px,
        monte_carlo_mm=vector3(sampled),
        standard_error_mm=vector3(np.array([statistic.standard_error for statistic in statistics])),
        printed_monte_carlo_mm=_printed_monte_carlo() if compared else None,
        printed_analytic_mm=vector3(analytic) if compared else None,
        mean_error_mm=vector3(own.mean(axis=1)),
        mean_standard_error_mm=vector3(own.std(axis=1) / np.sqrt(own.shape[1])),
        printed_mean_difference_mm=vector3(S3_MEAN_DIFFERENCE_MM) if compared else None,
        propagations=tuple(propagations),
        sentence=_sentence(propagations, statistics, compared),
    )


def _printed_monte_carlo() -> Vector3:
    return vector3(np.array([cell.value_mm for cell in S3]))


def _sentence(propagations: list[Propagation], statistics: list[Statistic], compared: bool) -> str:
    sampled = np.array([statistic.value for statistic in statistics])
    own = max(statistic.standard_error / statistic.value for statistic in statistics)
    worst = max(abs(ratio - 1) for ratio in propagations[0].over_monte_carlo)
    words = (
        f"Propagated in full, first order is within {100 * worst:.2g} % of Monte Carlo on every axis (whose own "
        f"standard error is {100 * own:.2g} %)"
    )
    if not compared:
        return words + "."
    same = [propagation for propagation in propagations if propagation.reproduces_printed]
    if not same:
        return words + "; none of these simplifications gives the printed analytic column."
    listed = " / ".join(f"{value:.1f}" for value in same[0].std_mm)
    also = f" ('{same[1].name}' too)" if len(same) > 1 else ""
    printed = " / ".join(f"{MM_PER_PRINTED_UNIT * value:g}" for value in S3_ANALYTIC)
    axis = int(np.argmin(np.array(same[0].std_mm) / sampled))
    times = sampled[axis] / same[0].std_mm[axis]
    return (
        f"{words}; the printed analytic column, {printed} mm, is what '{same[0].name}' gives{also}: {listed} mm, "
        f"within rounding on all axes, {times:.1f} times too small in {AXES[axis]}. That column was part of the fit; "
        "that full propagation agrees with Monte Carlo there was not: the underestimate is an omission, not a limit of "
        "linearisation."
    )


def compare_parts(cells: Mapping[tuple[str, float], PaperCell], compared: bool) -> tuple[Additivity, ...]:
    """Cells of S2, by level and noise, that have both parts."""
    printed = {(cell.row.partition(",")[0], cell.setting.noise_px): cell.value_mm for cell in S2}
    rows = []
    for (level, noise), joint in cells.items():
        if level == "L0" or noise == 0:
            continue
        bias, alone = cells[level, 0.0].value_mm, cells["L0", noise].value_mm
        rows.append(
            Additivity(
                row=joint.row,
                joint_mm=joint.value_mm,
                first_order_mm=joint.first_order_mm,
                bias_mm=bias,
                noise_mm=alone,
                quadrature_mm=hypot(bias, alone),
                sum_mm=bias + alone,
                printed_joint_mm=printed[level, noise] if compared else None,
                printed_quadrature_mm=hypot(printed[level, 0.0], printed["L0", noise]) if compared else None,
            )
        )
    return tuple(rows)


def compute_level_ratios(system: System, target: int, noisy_px: Mapping[str, float]) -> tuple[LevelRatio, ...]:
    """Every level without noise, by the plain estimator: matrices estimated there, and matrices of L0 kept.

    noisy_px: mean RMS reprojection error of the chain with noise, by level, passed on."""
    fiducials = system.fiducials_mm
    seen_at_rest = [project(view.projection, fiducials) for view in system.views]
    matrices_at_rest = np.array([resect(fiducials, seen) for seen in seen_at_rest])
    position = system.targets[target].position_mm
    rows = []
    for level, (degrees, millimetres) in LEVELS.items():
        here = apply_setting(system, Setting(degrees, millimetres, 0.0))
        seen_by, assumed, _ = estimator_geometry(here)
        # What is imaged, in the estimator's own coordinates: effective projections of the fiducials that it assumes.
        images = [project(matrix, assumed) for matrix in seen_by]
        estimated = np.array([resect(assumed, image) for image in images])
        aims = np.array([project(view.projection, position[None])[0] for view in system.views])
        point = triangulate(estimated, aims, assumed, system.triangulation)
        error = float(np.linalg.norm(point - position))
        # With the matrices of L0: a moved structure is seen elsewhere (physical), or looked for elsewhere (Eq 18).
        looked_for = assumed if system.reading is Reading.EQ18 else fiducials
        kept_px = _rms([project(m, looked_for) - image for m, image in zip(matrices_at_rest, images, strict=True)])
        rows.append(
            LevelRatio(
                level=level,
                rotation_deg=degrees,
                translation_mm=millimetres,
                error_mm=error,
                reprojection_estimated_px=_rms(
                    [project(m, assumed) - image for m, image in zip(estimated, images, strict=True)]
                ),
                reprojection_noisy_px=noisy_px[level],
                reprojection_kept_px=kept_px,
                mm_per_px=error / kept_px if level != "L0" else None,
            )
        )
    return tuple(rows)


def describe_tail(level: str, errors: Array) -> LevelShape:
    """Where the P95 of the norm of errors (3, n), mm, stands."""
    norms = np.linalg.norm(errors, axis=0)
    mean, p95 = float(norms.mean()), float(np.quantile(norms, 0.95))
    return LevelShape(level, p95 / mean, (p95 - mean) / float(norms.std()))


def _rms(differences: list[Array]) -> float:
    """RMS over fiducials and views of the length of (N, 2) differences, px."""
    squared = np.concatenate([(difference**2).sum(axis=1) for difference in differences])
    return sqrt(float(squared.mean()))


NORMAL, UNIFORM = 1.645, 1.559  # standard deviations from the mean to the P95
S4_HALVES = {"mean": 0.0005, "std": 0.00005, "p95": 0.0005}  # half of the last decimal of each column


def _read_printed(table: str, row: str, column: str) -> float:
    value = read_printed(table, row, column)
    assert value is not None
    return float(value)


def write_statements(geometries: Sequence[Geometry]) -> tuple[Statement, ...]:
    """Facts about the printed tables that need no geometry, and what ours add to S4."""
    return (_units(), _lever(), _repeat(), _falling(), _means(geometries), *_bench(geometries))


def _units() -> Statement:
    moved = 5.0
    there = _read_printed("S1", f"translation {moved:g} mm", "e_3d_mean")
    zero, turned = (_read_printed("S1", f"rotation {degrees} deg", "e_3d_mean") for degrees in (0, 2))
    still, both = (read_printed("S2", level, "2 px") for level in ("L0", "L2"))
    at_rest, displaced = TABLES["text"]["S2, 2 px, L0 and L2, mm"]
    low, high = TABLES["text"]["S1, mean over rotation, mm"]
    return Statement(
        "units",
        f"The text's {at_rest} and {displaced} mm settle the unit: they are S2's {still} and {both} under 'mm' (2 px, "
        f"L0 and L2), and its {low} to {high} mm are S1's {zero:g} to {turned:g} over rotation. S1-S3 are in metres "
        f"({displaced} is printed as {both}, cut and not rounded). It could not be otherwise: a translation of "
        f"{moved:g} mm moves the target by {moved:g} mm in every geometry, so the mean error is at least {moved:g} mm, "
        f"whatever the noise; the table prints {there:g}, which is {there * MM_PER_PRINTED_UNIT:g} mm in metres.",
        (float(at_rest), float(displaced), moved, there),
    )


def _lever() -> Statement:
    bias, (degrees, _) = _read_printed("S2", "L2", "0 px"), LEVELS["L2"]
    lever = bias * MM_PER_PRINTED_UNIT / (2 * sin(radians(degrees) / 2))
    return Statement(
        "lever",
        f"{bias * MM_PER_PRINTED_UNIT:g} mm at {degrees:g} deg without noise takes a lever arm of {lever:.0f} mm "
        "if one axis turns. That translations of 0 to 5 mm hardly show is this lever and the noise: a translation "
        "arrives one to one, and vanishes in quadrature beside 18 mm.",
        (bias * MM_PER_PRINTED_UNIT, degrees, lever),
    )


def _repeat() -> Statement:
    zero, again = (_read_printed("S1", row, "e_3d_mean") for row in ("rotation 0 deg", "translation 0 mm"))
    return Statement(
        "repeat",
        f"The same experiment, no installation error at {S1_NOISE_PX:g} px, is printed twice, {zero:g} and "
        f"{again:g}: a difference of one last digit, which two samples of 2,000 trials, or one value near 0.0185, "
        "explain.",
        (zero, again),
    )


def _falling() -> Statement:
    high, low = (_read_printed("S2", level, "5 px") for level in ("L0", "L2"))
    return Statement(
        "falling",
        f"S2 falls from {high:.3f} at L0 to {low:.3f} at L2 where the noise is 5 px. In the Eq 18 reading no "
        "geometry does that to first order: the noise keeps its law, and a known displacement can only raise a "
        "quantile of the norm of a centred Gaussian vector (Anderson 1955). In the physical reading the noise gain "
        "changes with the bias, and it can happen.",
        (high, low),
    )


def _means(geometries: Sequence[Geometry]) -> Statement:
    pairs = [(row[1], row[2]) for row in TABLES["S3"]["rows"]]
    listed = ", ".join(f"{sampled} and {analytic}" for sampled, analytic in pairs)
    largest = max(max(map(abs, geometry.factor.mean_error_mm)) for geometry in geometries)
    spread = max(MM_PER_PRINTED_UNIT * float(row[3]) for row in TABLES["S3"]["rows"])
    scatter = spread / sqrt(TRIALS)
    return Statement(
        "means",
        f"S3's means agree, Monte Carlo and analytic: {listed} (x, y, z), one last digit, 1 mm, apart in z alone, "
        f"where the mean of {TRIALS:,} trials scatters by {spread:g} / sqrt({TRIALS}) = {scatter:.2f} mm. "
        "Where the point lies is not ours to predict, by how much noise shifts the mean is: in these geometries by "
        f"at most {largest:.1f} mm on an axis. So the means bear out first order, at the very noise at which its "
        "standard deviations are said to be wrong by a factor of two.",
        (scatter, largest),
    )


def _bench(geometries: Sequence[Geometry]) -> tuple[Statement, ...]:
    at_rest, *measured = S4
    ratios = [
        (geometry.name, [level.mm_per_px for level in geometry.levels if level.mm_per_px is not None])
        for geometry in geometries
    ]
    listed = "; ".join(f"{name}: {' and '.join(f'{value:.3g}' for value in values)}" for name, values in ratios)
    per_px = " and ".join(f"{row.mean:g} / {row.reprojection_px:g} = {row.per_px:.4f}" for row in measured)
    shapes = " and ".join(
        f"({row.p95:.3f} - {row.mean:.3f}) / {row.std:.4f} = {row.standard_deviations:.2f}" for row in measured
    )
    highest = max(
        (row.p95 - row.mean + S4_HALVES["p95"] + S4_HALVES["mean"]) / (row.std - S4_HALVES["std"]) for row in measured
    )
    over = " and ".join(f"{row.p95 / row.mean:.3f}" for row in measured)
    ours = [shape.standard_deviations for geometry in geometries for shape in geometry.shapes]
    return (
        Statement(
            "S4",
            f"S4's error over its reprojection error is one constant: {per_px} mm/px, and its L0 has no spread: "
            "both columns are counted from L0 and carry one number a level between them, one degree of freedom; 2.0 "
            "and 5.0 px are the noise levels of S2. With matrices estimated at each level the reprojection error does "
            "not depend on the level at all (DLT absorbs a rigid displacement), so a column that follows the error was "
            "taken with matrices that were kept, say those of L0; both then grow with the displacement, and to first "
            "order their ratio is one number of the bench's geometry for every level that is a multiple of the "
            f"others. Here, at L1 and L2 (which are not quite), in mm/px: {listed}. What can be predicted is that both "
            "columns grow in proportion, and by how much from level to level where the levels are known. What cannot "
            "be had from them: the bench's noise, its bias, a test of the model's spread or tail. Its lengths are mm "
            "by the text, and nothing confirms it: both means are below the translation of their own level, 2 and 5 "
            "mm, which arrives one to one unless a rotation takes it back.",
            tuple(value for _, values in ratios for value in values),
        ),
        Statement(
            "tail",
            f"S4 has no heavy tail at its P95, which stands {shapes} standard deviations above the mean, at most "
            f"{highest:.2f} with the rounding of what is printed; a normal law has {NORMAL}, a uniform one {UNIFORM}, "
            f"the error in these geometries with 2 px of noise {min(ours):.2f} to {max(ours):.2f}. The text says "
            f"that P95 grows substantially more than the mean; P95 over mean is {over}: it does not grow. What lies "
            "beyond P95 no column says.",
            tuple(row.standard_deviations for row in measured),
        ),
        Statement(
            "zero",
            f"S4's {at_rest.level} is zero in all four columns, reprojection error included, to the last decimal: no "
            "bench measures that. It is what the others are counted from, and no measurement.",
            (at_rest.mean, at_rest.std, at_rest.p95, at_rest.reprojection_px),
        ),
    )
