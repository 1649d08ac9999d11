"""The score: one target to first order against one trial, and how its time grows with the design."""

from __future__ import annotations

import csv
import io
import subprocess
import sys
import time
import tracemalloc
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from bench import ROOT, Figure, Findings, Rounds, interleave
from engine import peer_job
from scenes import cios_system, read_only, target, with_noise
from tailstack import allocate, load_design, score, score_batch
from tailstack.batch import DEFAULT_COLUMNS
from tailstack.design import Design
from tailstack.design.pointers import find_places, replace_value, value_at
from tailstack.errors import DesignError
from tailstack.people_tables import read_people_table
from tailstack.propagation.linear import chain_of, linearise
from tailstack.propagation.noise import gains_of_images
from tailstack.results.json_text import write_json
from tailstack.studies.workspace import study_workspace
from tailstack.system import System
from tailstack.tail.gaussian import norm_quantile_jit

DEMO = ROOT / "examples" / "demo.yaml"
ROWS = 1_000_000  # of a table
TARGETS, FIDUCIALS, VIEWS = (1, 10, 50, 200), (8, 25, 50, 100), (2, 4, 8, 16)


def score_job(design: Design | System) -> Callable[[], int]:
    """Scores of one design, whose kernels are loaded."""
    score(design)

    def run() -> int:
        score(design)
        return 1

    return run


def first_order() -> Findings:
    """The kernels of the linear model and of P95, compiled, against one trial of batched SVD."""
    system = cios_system()
    imaging, count, mean = chain_of(system).imaging, 4 * len(system.fiducials_mm) + 4, np.zeros(3)
    aim, still = system.targets[0].position_mm, np.zeros((2, count // 2, 0))
    model = linearise(system, system.targets[0])
    mounts = sum((b.covariance("tcp") for b in model.blocks if not b.is_grouped), np.zeros((3, 3)))

    def kernels() -> int:
        for _ in range(500):
            columns, _ = gains_of_images(imaging, system.sees, aim, still)
            covariance = 0.25 * columns[:, :count] @ columns[:, :count].T + mounts
            norm_quantile_jit(mean, covariance, 0.95)
        return 500

    kernels()
    svd = "batched numpy.linalg.svd"
    rounds = interleave({"kernels": kernels, svd: peer_job(svd, system), "demo": score_job(load_design(DEMO))})
    return Findings(
        [rounds.ratio("kernels", svd), rounds.ratio("demo", svd)], rounds.foreign,
        [
            Figure("first-order covariance + exact P95, CPU", 1e6 * median(rounds.cpu["kernels"]), "µs"),
            Figure("score() of the demo: declared laws, bounds, 30 budget lines, CPU",
                   1e3 * median(rounds.cpu["demo"]), "ms"),
        ],
    )  # fmt: skip


ALLOCATED = (  # design, requirement, its limit
    ("demo", "tip-accuracy", 0.9), ("first_carrier", "tip-accuracy", 1.0), ("reworked_carrier", "tip-accuracy", 0.85),
    ("locators_321", "workspace-accuracy", 0.36), ("locators_321", "unit-yield", 0.4), ("mean_and_tail", "tail", 0.8),
)  # fmt: skip


def allocations() -> Findings:
    """The cheapest half-widths of six designs at the layout as it is, against a score of each without losses; CPU."""
    jobs: dict[str, Callable[[], int]] = {}
    for name, requirement, limit in ALLOCATED:
        design = load_design(ROOT / "examples" / f"{name}.yaml")

        def allocated(design: Design = design, requirement: str = requirement, limit: float = limit) -> int:
            allocate(design, requirement=requirement, limit=limit)
            return 1

        def scored(design: Design = design) -> int:
            score(design, losses=False)
            return 1

        jobs |= {f"{name}, {requirement}": allocated, f"{name}, {requirement}: a score": scored}
    for job in jobs.values():
        job()  # compiled
    rounds = interleave(jobs)
    ratios = [rounds.ratio(name, f"{name}: a score") for name in jobs if not name.endswith("a score")]
    figures = [Figure(name, 1000 * median(seconds), "ms") for name, seconds in rounds.cpu.items()]
    return Findings([max(ratios)], rounds.foreign, figures)


def losses() -> Findings:
    """A score with what losses do against one without: twelve fiducials, and 64, of which no pair is tried."""
    designs = {"12 fiducials": load_design(DEMO), "64 fiducials": of_fiducials(64)}

    def job(design: Design | System, wanted: bool) -> Callable[[], int]:
        score(design, losses=wanted)
        return lambda: len(score(design, losses=wanted).targets)

    pairs = [(f"{name}, {word}", design, word == "with losses") for name, design in designs.items()
             for word in ("with losses", "without")]  # fmt: skip
    rounds = interleave({name: job(design, wanted) for name, design, wanted in pairs})
    ratios = [median(rounds.cpu[f"{name}, with losses"]) / median(rounds.cpu[f"{name}, without"]) for name in designs]
    return Findings(list(ratios), rounds.foreign)


def of_normal_laws() -> dict[str, Any]:
    """The demo's document, every tolerance normal."""
    text = DEMO.read_text(encoding="utf-8")
    return dict(load_design(text.replace("uniform", "normal").replace("triangular", "normal")).source.data)


# What the loop over load_design and score took for a design before its first order was compiled, in trials of batched
# SVD: commit e3342c7, its kernels warm, both measured in one sitting.  Normal laws, and the demo's own.
LOOP_BEFORE, LOOP_BEFORE_DECLARED = 116.0, 155.0
NUMBERS = ("/fiducials/points/0/position_mm/0", "/interfaces/connector_flange/tolerances/rx/half_width_deg")


def designs() -> Findings:
    """Designs of a table on one core, positions of a fiducial and half-widths, against loading and scoring the document
    of each: as the loop was before (in trials of batched SVD), and as it is."""
    data = of_normal_laws()
    design, count = load_design(data), 4096
    rng = np.random.default_rng(1)
    base = [float(value_at(data, find_places(data, pointer)[0])) for pointer in NUMBERS]
    table = {pointer: at * (1 + 0.1 * rng.random(count)) for pointer, at in zip(NUMBERS, base, strict=True)}
    rows = list(zip(*(column.tolist() for column in table.values()), strict=True))
    plain = ("p95_mm", "bias_norm_mm", "within_limits")

    demo = load_design(DEMO)

    def batch(columns: tuple[str, ...]) -> Callable[[], int]:
        def run() -> int:
            assert score_batch(design, table, columns=columns, threads=1).ways["compiled"] == count
            return count

        run()
        return run

    def declared() -> int:
        found = score_batch(demo, {pointer: column[:200] for pointer, column in table.items()}, threads=1)
        assert found.ways["compiled"] == 200
        return 200

    def loop(base: dict[str, Any]) -> Callable[[], int]:
        def run() -> int:
            for row in rows[:20]:
                changed = base
                for pointer, value in zip(NUMBERS, row, strict=True):
                    changed = replace_value(changed, find_places(base, pointer)[0], value)
                score(load_design(changed), losses=False)
            return 20

        run()
        return run

    jobs = {"loop": loop(data), "default": batch(DEFAULT_COLUMNS), "p95": batch(plain)}
    svd = "batched numpy.linalg.svd"
    loops = {"declared loop": loop(dict(demo.source.data)), svd: peer_job(svd, cios_system())}
    rounds = interleave({**jobs, "declared": declared, **loops})
    return Findings(
        [LOOP_BEFORE * rounds.ratio(svd, "default"), LOOP_BEFORE_DECLARED * rounds.ratio(svd, "declared")],
        rounds.foreign,
        [
            Figure("normal laws: against the loop as it is", rounds.ratio("loop", "default"), "×"),
            Figure("the demo's own laws: against the loop as it is", rounds.ratio("declared loop", "declared"), "×"),
            Figure("a design with P95, mean, bias and limits, CPU", 1e6 * median(rounds.cpu["default"]), "µs"),
            Figure("without the mean: against the loop", rounds.ratio("loop", "p95"), "×"),
            Figure("the demo as it is, a design, CPU", 1e3 * median(rounds.cpu["declared"]), "ms"),
            Figure("the loop: load_design and score without losses, CPU", 1e3 * median(rounds.cpu["loop"]), "ms"),
        ],
    )  # fmt: skip


ARM = {
    "dh_convention": "standard",
    "dh": [{"d_mm": 162.5, "alpha_deg": 90}, {"a_mm": -425}, {"a_mm": -392.2}, {"d_mm": 133.3, "alpha_deg": 90},
           {"d_mm": 99.7, "alpha_deg": -90}, {"d_mm": 99.6}],
    "joints_imaging_deg": [0, -100, 110, -100, -90, 0], "joints_executing_deg": [15, -90, 105, -105, -90, 15],
    "joint_sd_deg": 0.01, "parameter_sd": {"length_mm": 0.05, "angle_deg": 0.01}, "repeatability_sd_deg": 0.002,
}  # fmt: skip


def workspace() -> Findings:
    """Poses of an arm in a study against rows of a table of the same design, one core; normal laws, and the demo's."""
    jobs: dict[str, Callable[[], int]] = {}
    for name, data, count in (
        ("normal", of_normal_laws(), 4096),
        ("declared", dict(load_design(DEMO).source.data), 256),
    ):
        design = load_design(replace_value(data, ("execution", "robot"), ARM))
        table = {NUMBERS[1]: np.linspace(0.1, 0.2, count)}

        def posed(design: Design = design, count: int = count) -> int:
            return study_workspace(design, poses=count).poses

        def scored(design: Design = design, table: dict[str, Any] = table, count: int = count) -> int:
            assert score_batch(design, table, threads=1).ways["compiled"] == count
            return count

        jobs |= {f"{name} poses": posed, f"{name} rows": scored}
    for job in jobs.values():
        job()  # compiled
    rounds = interleave(jobs)
    figures = [Figure(f"{name}, CPU", 1e6 * median(seconds), "µs") for name, seconds in rounds.cpu.items()]
    ratios = [rounds.ratio(f"{name} poses", f"{name} rows") for name in ("normal", "declared")]
    return Findings(ratios, rounds.foreign, figures)


PEAK = """
import sys
from tailstack_service.cli.main import main
assert main(["score", sys.argv[1], "--batch", sys.argv[2], "-o", sys.argv[3]]) == 0
print(next(line.split()[1] for line in open("/proc/self/status") if line.startswith("VmHWM")))
"""


def designs_memory() -> Findings:
    """Peak of ``tailstack score --batch`` over a million rows of CSV."""
    with TemporaryDirectory() as folder:
        design, table = Path(folder) / "design.json", Path(folder) / "table.csv"
        design.write_text(write_json(of_normal_laws()), encoding="utf-8")
        with table.open("w") as file:
            file.write(",".join(NUMBERS) + "\n")
            for k in range(1_000_000):
                file.write(f"{-30 - k % 1009 / 1000},{0.05 + k % 997 / 1e4}\n")
        command = [sys.executable, "-c", PEAK, str(design), str(table), str(Path(folder) / "scores.csv")]
        began = time.perf_counter()
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        rate = 1_000_000 / (time.perf_counter() - began)
    return Findings(
        [int(done.stdout) / 1024], 0.0, [Figure("rows a second, read, scored and written, all cores", rate, "")]
    )


def people_tables() -> Findings:
    """A million rows of four columns by the reader of people's tables and by csv.reader: as texts, and as numbers."""
    content = b"variant,x_mm,y_mm,z_mm\n" + b"A1,-24.5,-27.75,0.25\n" * ROWS

    def plain() -> int:
        return sum(1 for _ in csv.reader(io.TextIOWrapper(io.BytesIO(content), "utf-8", newline="")))

    def plain_numbers() -> int:
        rows = csv.reader(io.TextIOWrapper(io.BytesIO(content), "utf-8", newline=""))
        next(rows)
        return sum(1 for row in rows if [float(cell) for cell in row[1:]])

    def ours() -> int:
        return sum(1 for _ in read_people_table(content, None, DesignError).rows)

    def our_numbers() -> int:
        table = read_people_table(content, None, DesignError)
        return sum(1 for line, row in table.rows if [table.read_number(row[k], line, k) for k in (1, 2, 3)])

    rounds = interleave({"csv": plain, "csv, numbers": plain_numbers, "ours": ours, "ours, numbers": our_numbers})
    tracemalloc.start()
    ours()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return Findings(
        [rounds.ratio("ours", "csv"), rounds.ratio("ours, numbers", "csv, numbers"), peak / 2**20], rounds.foreign,
        [Figure(f"{each}: a row, CPU", 1e6 * median(rounds.cpu[each]), "µs") for each in rounds.cpu],
    )  # fmt: skip


def of_targets(count: int) -> System:
    """So many targets on a spiral around the first."""
    turns = np.linspace(0, 20, count)
    places = np.column_stack([turns * np.cos(turns), turns * np.sin(turns), 70 + 0 * turns])
    return replace(cios_system(), targets=tuple(target(place, f"target {k}") for k, place in enumerate(places)))


def of_fiducials(count: int) -> System:
    """So many fiducials in the box."""
    places = np.random.default_rng(4).uniform(-50, 50, (count, 3)) + np.array([0, 0, -40.0])
    return replace(
        cios_system(), fiducial_labels=tuple(f"F{i}" for i in range(count)), fiducials_mm=read_only(places),
        manufacturing_half_width_mm=read_only(np.zeros((count, 3))),
    )  # fmt: skip


def of_views(count: int) -> System:
    """So many views over half a turn."""
    return replace(cios_system(), views=with_noise(0.5, azimuths_rad=tuple(np.linspace(0, np.pi / 2, count))))


def exponent(rounds: Rounds, sizes: Iterable[int]) -> float:
    """Slope of the logarithm of the time over that of the size, by least squares."""
    points = [(size, median(rounds.cpu[str(size)])) for size in sizes]
    return float(np.polyfit(*np.log(np.array(points).T), 1)[0])


def growth() -> Findings:
    """Score time against targets, fiducials and views, the sizes of one kind in turn."""
    found = Findings([])
    for what, sizes, make in (
        ("targets", TARGETS, of_targets), ("fiducials", FIDUCIALS, of_fiducials), ("views", VIEWS, of_views),
    ):  # fmt: skip
        rounds = interleave({str(size): score_job(make(size)) for size in sizes}, 5)
        found.values.append(exponent(rounds, sizes))
        found.foreign = max(found.foreign, rounds.foreign)
        for size in sizes:
            found.figures.append(Figure(f"score of {size} {what}, CPU", 1e3 * median(rounds.cpu[str(size)]), "ms"))
    return found
