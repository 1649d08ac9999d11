"""Tables S1 to S4 of the paper in any geometry, and beside the printed ones in the geometries fitted to them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from ..cores import usable_cores
from ..errors import Problem
from ..propagation.linear import linearise
from ..scoring import checked_system
from ..system import System
from ..version import __version__
from .paper_cells import AXIS, BAND, Sampled, cell, printed_at, sampled
from .paper_factor import factor
from .paper_levels import additivity, level_ratios, shape
from .paper_printed import printed_cells
from .paper_records import Geometry, LevelShape, PaperCell, StudyPaper
from .paper_statements import statements
from .published import (
    LEVELS,
    S1_NOISE_PX,
    S3_NOISE_PX,
    SOURCE,
    TRIALS,
    Quantity,
    Setting,
    Table,
)
from .refusals import StudyError
from .settings import nominal, with_noise

ROTATIONS_DEG = (0.0, 0.5, 1.0, 1.5, 2.0)
TRANSLATIONS_MM = (0.0, 1.0, 2.0, 3.0, 4.0, 5.0)
NORMS: tuple[Quantity, ...] = ("mean", "p95")
NOISES_PX = (0.0, 2.0, 5.0)
DEFAULT_TRIALS = 100_000
FEWEST_TRIALS = 20 * TRIALS  # so that our own error is a fifth of the paper's at most

Progress = Callable[[int, int], None]
Row = tuple[Table, str, Quantity, Setting]
Asked = tuple[int, Setting]  # of which geometry


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """A geometry that the tables are made in."""

    system: System
    compared: bool  # fitted to the tables
    target: int = 0


def rows() -> tuple[Row, ...]:
    """Every cell of S1, S2 and S3."""
    found: list[Row] = []
    for degrees in ROTATIONS_DEG:
        for quantity in NORMS:
            found.append(("S1", f"rotation {degrees:g} deg", quantity, Setting(degrees, 0.0, S1_NOISE_PX)))
    for millimetres in TRANSLATIONS_MM:
        for quantity in NORMS:
            found.append(("S1", f"translation {millimetres:g} mm", quantity, Setting(0.0, millimetres, S1_NOISE_PX)))
    for level, (degrees, millimetres) in LEVELS.items():
        for noise in NOISES_PX:
            found.append(("S2", f"{level}, {noise:g} px", "p95", Setting(degrees, millimetres, noise)))
    for spread in AXIS:
        found.append(("S3", f"Monte Carlo, {spread[-1]}", spread, Setting(0.0, 0.0, S3_NOISE_PX)))
    return tuple(found)


def paper_study(
    cases: Sequence[Case],
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
    table = rows()
    settings = list(dict.fromkeys(row[3] for row in table))
    asked = [(k, setting) for k in range(len(cases)) for setting in settings]

    def work(one: Asked) -> tuple[Sampled, dict[int, PaperCell]]:
        k, setting = one
        at = sampled(systems[k], cases[k].target, setting, trials, seed)
        made = {}
        for place, (name, row, quantity, there) in enumerate(table):
            if there == setting:
                printed = printed_at(name, row, quantity) if cases[k].compared else None
                made[place] = cell(at, name, row, quantity, printed)
        return at, made

    cells: list[dict[int, PaperCell]] = [{} for _ in cases]
    kept: list[dict[Setting, Sampled]] = [{} for _ in cases]
    needed = {Setting(0.0, 0.0, S3_NOISE_PX)}
    noisy: list[dict[str, float]] = [{} for _ in cases]
    shapes: list[dict[str, LevelShape]] = [{} for _ in cases]
    levels = {Setting(*torsor, S3_NOISE_PX): level for level, torsor in LEVELS.items()}
    for done, ((k, setting), (at, made)) in enumerate(_in_order(work, asked, threads)):
        cells[k].update(made)
        if setting in needed:
            kept[k][setting] = at
        if setting in levels:
            noisy[k][levels[setting]] = at.reprojection_px
            shapes[k][levels[setting]] = shape(levels[setting], at.localisation)
        if progress is not None:
            progress(done + 1, len(asked))
    geometries = tuple(
        _geometry(
            case,
            system,
            tuple(cells[k][place] for place in range(len(table))),
            kept[k],
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
        printed=printed_cells(geometries),
        statements=statements(geometries),
        tailstack_version=__version__,
    )


def _in_order(
    work: Callable[[Asked], tuple[Sampled, dict[int, PaperCell]]], asked: list[Asked], threads: int | None
) -> Iterator[tuple[Asked, tuple[Sampled, dict[int, PaperCell]]]]:
    with ThreadPoolExecutor(usable_cores() if threads is None else threads) as pool:
        yield from zip(asked, pool.map(work, asked), strict=True)


def _geometry(
    case: Case,
    system: System,
    cells: tuple[PaperCell, ...],
    kept: dict[Setting, Sampled],
    noisy: dict[str, float],
    shapes: tuple[LevelShape, ...],
) -> Geometry:
    compared = [one for one in cells if one.z is not None]
    target = system.targets[case.target]
    pivot = system.interface_1.pivot_mm
    second = {(one.row.partition(",")[0], one.noise_px): one for one in cells if one.table == "S2"}
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
        outside_cells=sum(bool(one.outside) for one in compared),
        chi_square=sum(one.z**2 for one in compared if one.z is not None) if compared else None,
        additivity=additivity(second, case.compared),
        factor=factor(system, case.target, kept[Setting(0.0, 0.0, S3_NOISE_PX)], case.compared),
        levels=level_ratios(system, case.target, noisy),
        shapes=shapes,
    )
