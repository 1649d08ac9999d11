"""What is measured, group by group.  Scenes are those of the tests: ``cios_system`` is the performance scene."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Callable
from copy import deepcopy
from dataclasses import replace
from itertools import cycle, islice
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

import gate_rows
import peers
import report_rows
import service_rows
from bench import ROUNDS, Row, interleaved
from optimiser_rows import optimiser, placement
from scenes import cios_system, read_only
from tailstack import load_design, score
from tailstack.contributors import declared_law
from tailstack.design.reading import DEFAULT_LIMITS, decode, read_text
from tailstack.montecarlo import compile_plan, draw, run_indices
from tailstack.montecarlo.radial import LinearChain, gains_in_plan_order, radial
from tailstack.montecarlo.simulate import simulate
from tailstack.propagation.linear import linearise
from tailstack.propagation.noise import noise_gains_jit
from tailstack.tail.declared import law_exceedance, law_quantile
from tailstack.tail.gaussian import norm_quantile_jit
from tailstack_service.documents import to_json

DEMO = Path(__file__).resolve().parents[1] / "examples" / "demo.yaml"


def throughput() -> list[Row]:
    """Trials per CPU second, peers and ours in turn."""
    system = cios_system()
    plan = compile_plan(system)
    rng = np.random.default_rng(1)
    simulate(plan, trials=20_000, seed=0, threads=1)
    sizes: dict[str, tuple[Callable[..., object], int]] = {
        "loop with numpy.linalg.svd": (peers.loop_svd, 400),
        "OpenCV SVDecomp + triangulatePoints": (peers.opencv, 400),
        "OpenTURNS, vectorised driver": (peers.openturns, 4000),
        "batched numpy.linalg.svd": (peers.batched_svd, 4000),
    }

    def peer(function: Callable[..., object], count: int) -> Callable[[], int]:
        def job() -> int:
            function(system, rng, count)
            return count

        return job

    def ours() -> int:
        simulate(plan, trials=400_000, seed=3, threads=1)
        return 400_000

    jobs = {name: peer(*what) for name, what in sizes.items()} | {"tailstack": ours}
    seconds = interleaved(jobs)
    batched, loop = seconds["batched numpy.linalg.svd"], seconds["loop with numpy.linalg.svd"]
    rows = [Row(f"trials/s/core: {name}", 1e-3 / value, "k") for name, value in seconds.items()]
    rows += [Row(f"  × batched SVD: {name}", batched / value, "×") for name, value in seconds.items()]
    rows.append(
        Row("full nonlinear trials, one core, against batched SVD", batched / seconds["tailstack"], "×", 100, 300)
    )
    rows.append(Row("against the loop with numpy.linalg.svd", loop / seconds["tailstack"], "×", 500, 1500))
    return rows


def agreement() -> list[Row]:
    """Largest relative difference from an independent SVD chain on the same deviates."""
    system = cios_system()
    plan = compile_plan(system)
    indices = np.arange(20_000)
    ours = np.linalg.norm(run_indices(plan, 11, 0, len(indices)).errors[0, 0], axis=0)
    z = draw(plan, 11, indices)
    width = 2 * len(system.fiducials_mm)
    places = {block.name: block.start for block in plan.blocks}
    names = [view.name for view in system.views]
    order = [slice(places[f"fiducial_noise:{n}"], places[f"fiducial_noise:{n}"] + width) for n in names]
    order += [slice(places[f"target_noise:{n}"], places[f"target_noise:{n}"] + 2) for n in names]
    order += [slice(places[n], places[n] + 6) for n in ("structure_connector", "connector_flange")]
    scale = [np.full(width, v.fiducial_noise_px) for v in system.views]
    scale += [np.full(2, v.target_noise_px) for v in system.views]
    scale += [system.structure_connector.sources.std, system.connector_flange.sources.std]
    native = np.hstack([z[:, s] for s in order]) * np.concatenate(scale)
    reference = np.concatenate([peers.batched_chain(system, part) for part in np.array_split(native, 10)])
    return [Row("largest relative difference from SVD, 20,000 trials", float(np.max(np.abs(ours / reference - 1))), "",
                1e-9, 5e-12, "<")]  # fmt: skip


def threads() -> list[Row]:
    """Wall time of two threads against one: meaningful on an idle machine only."""
    plan = compile_plan(cios_system())
    spent: dict[int, list[float]] = {1: [], 2: []}
    for _ in range(ROUNDS):
        for count, values in spent.items():
            start = time.perf_counter()
            simulate(plan, trials=2_000_000, seed=3, threads=count)
            values.append(time.perf_counter() - start)
    return [Row("two threads against one (idle machine)", median(spent[1]) / median(spent[2]), "×", 1.7, 1.9)]


def precision() -> list[Row]:
    """Time to P95 within 1 % with a confidence interval, warm, in process."""
    system = cios_system()
    plan = compile_plan(system)
    model = linearise(system, system.targets[0])
    law, _ = declared_law(model, "tcp", model.tcp_bias_mm)
    first = law_quantile(law, 0.95)
    linear = LinearChain(
        model.tcp_bias_mm, gains_in_plan_order(plan, model.blocks, 0, "tcp"), lambda r: law_exceedance(law, r),
        first.quantile_mm, first.density,
    )  # fmt: skip
    reached: list[float] = []

    def ray() -> int:
        estimate = radial(plan, linear, seed=5)
        low, high = estimate.interval_mm
        reached.append((high - low) / (2 * estimate.value_mm))
        return 1

    def plain() -> int:
        simulate(plan, trials=2**15, seed=5, threads=1)
        return 1

    seconds = interleaved({"ray": ray, "plain": plain}, 3 * ROUNDS)
    return [
        Row("P95 ± 1 % with interval, radial conditional", 1e3 * seconds["ray"], "ms", 5, 0.5, "<"),
        Row("  precision it reached", 100 * max(reached), "%", 1, None, "<"),
        Row("P95 ± 1 % with interval, plain (32,768 trials)", 1e3 * seconds["plain"], "ms"),
    ]


def scoring() -> list[Row]:
    """First-order covariance and exact P95 of one target; and the whole score of the demo."""
    system = cios_system()
    projections = np.stack([view.projection for view in system.views])
    points, aim, mean = system.fiducials_mm, system.targets[0].position_mm, np.zeros(3)
    count = len(points)
    arrays = [np.zeros(s) for s in ((2, count, 3, 2), (2, 3, 2), (2, count, 3, 3), (2, count, 2))]
    model = linearise(system, system.targets[0])
    mounts = sum(((b.tcp * b.std) @ (b.tcp * b.std).T for b in model.blocks if not b.grouped), np.zeros((3, 3)))

    def kernel() -> int:
        for _ in range(500):
            noise_gains_jit(projections, points, aim, *arrays)
            fiducial, target = (
                arrays[0].transpose(2, 0, 1, 3).reshape(3, -1),
                arrays[1].transpose(1, 0, 2).reshape(3, -1),
            )
            covariance = 0.25 * (fiducial @ fiducial.T + target @ target.T) + mounts
            norm_quantile_jit(mean, covariance, 0.95)
        return 500

    design = load_design(DEMO)

    def whole() -> int:
        score(design)
        return 1

    bodies = cycle(_distinct_bodies(64))

    def request() -> int:
        for body in islice(bodies, 8):
            text = decode(body, None)
            data = read_text(text, DEFAULT_LIMITS, file=None, directory=None, form="json").data
            to_json(score(load_design(data["design"], allow_files=False)))
        return 8

    whole()
    kernel()
    request()
    seconds = interleaved({"kernel": kernel, "whole": whole, "request": request}, 3 * ROUNDS)
    return [
        Row("first-order score with exact P95, one target", 1e6 * seconds["kernel"], "µs", 100, 5, "<"),
        Row("score() of the demo: declared laws, bounds, 30 budget lines", 1e3 * seconds["whole"], "ms"),
        Row(
            "score of a JSON body (parse, load, score, write), distinct designs", 1e3 * seconds["request"], "ms", 5, 3,
            "<",
        ),
    ]  # fmt: skip


def _distinct_bodies(count: int) -> list[bytes]:
    """Bodies of requests for the demo, the noise of a view and every fiducial moved a little: seed 7."""
    rng = np.random.default_rng(7)
    bodies = []
    for _ in range(count):
        data: Any = deepcopy(_demo_data())
        for view in data["views"]:
            view["fiducial_noise_px"] *= 1 + 0.01 * rng.random()
        for point in data["fiducials"]["points"]:
            point["position_mm"] = (np.array(point["position_mm"]) + 0.01 * rng.random(3)).tolist()
        bodies.append(json.dumps({"design": data}).encode())
    return bodies


MEMORY = """
from scenes import cios_system
from tailstack.montecarlo.simulate import simulate
simulate(cios_system(), trials=10_000_000, seed=1)
# VmHWM starts anew at exec; ru_maxrss would remember the process that started this one.
print(next(line.split()[1] for line in open("/proc/self/status") if line.startswith("VmHWM")))
"""


def memory() -> list[Row]:
    """Peak resident set of a process that runs 10^7 trials, interpreter and compiler included."""
    paths = [str(Path(__file__).resolve().parents[1] / "tests")]
    code = f"import sys; sys.path[:0] = {paths!r}\n{MEMORY}"
    printed = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    return [Row("memory of a run of 10^7 trials", int(printed) / 1024, "MB", 300, 150, "<")]


def count() -> list[Row]:
    """Cost of a trial with 100 fiducials against 12."""
    rng = np.random.default_rng(4)
    few = cios_system()
    many = replace(
        few,
        fiducial_labels=tuple(f"F{i}" for i in range(100)),
        fiducials_mm=read_only(rng.uniform(-50, 50, (100, 3)) + np.array([0, 0, -40.0])),
        manufacturing_half_width_mm=read_only(np.zeros((100, 3))),
    )
    plans = {"few": compile_plan(few), "many": compile_plan(many)}

    def job(name: str) -> Callable[[], int]:
        def run() -> int:
            simulate(plans[name], trials=100_000, seed=2, threads=1)
            return 100_000

        return run

    seconds = interleaved({name: job(name) for name in plans})
    return [Row("N = 100 fiducials against N = 12, cost per trial", seconds["many"] / seconds["few"], "×", 6, 5, "<")]


def _demo_data() -> dict[str, object]:
    from tailstack.design import design_to_data

    return design_to_data(load_design(DEMO))


GROUPS: dict[str, Callable[[], list[Row]]] = {
    "throughput": throughput,
    "agreement": agreement,
    "threads": threads,
    "precision": precision,
    "scoring": scoring,
    "memory": memory,
    "count": count,
    "optimiser": optimiser,
    "placement": placement,
    "service": service_rows.scores,
    "start": service_rows.start,
    "jobs": service_rows.jobs,
    "gate": gate_rows.gate,
    "report": report_rows.report,
}
