"""Trials of the full nonlinear chain: against what the processor could do, against peers, and against themselves.

The peers are what a user would write first, and what others' tools make of it.  Each draws ``trials`` samples of the
performance scene (12 fiducials, AP and LAT, 0.5 px, two mounts of three rotations and three translations: 64 normal
deviates a trial) and returns the norms of the TCP error.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from statistics import median

import numpy as np
from scipy.linalg import rq

import operations
from bench import ROOT, Figure, Findings, interleave, watch_load
from plain_trials import simulate
from scenes import cios_system, read_only
from tailstack.contributors import declared_law
from tailstack.estimation.resection import homogeneous
from tailstack.geometry.arrays import Array
from tailstack.montecarlo.chain import draw, run_indices
from tailstack.montecarlo.estimators import quantile_estimate
from tailstack.montecarlo.lanes import WIDTH
from tailstack.montecarlo.plan import ChainPlan, compile_plan
from tailstack.montecarlo.radial import LinearChain, gains_in_plan_order, radial
from tailstack.propagation.linear import linearise
from tailstack.system import Estimator, System, View
from tailstack.tail.declared import law_exceedance, law_quantile

DEVIATES = 64
LEAST_SQUARES = {Estimator.POSE: 60, Estimator.POSE_WITH_PRIOR: 45, Estimator.REPROJECTION: 45}  # their musts


def scaled_deviates(system: System, rng: np.random.Generator, trials: int) -> Array:
    """(trials, 64): fiducial noise of both views, target noise of both views, torsors 1 and 2, in px, rad and mm."""
    mounts = (system.structure_connector, system.connector_flange)
    noise = [np.full(2 * len(system.fiducials_mm), v.fiducial_noise_px) for v in system.views]
    noise += [np.full(2, v.target_noise_px) for v in system.views]
    scale = np.concatenate([*noise, *[m.sources.std for m in mounts]])
    return rng.standard_normal((trials, len(scale))) * scale


def rotations(angles: Array) -> Array:
    """Rx Ry Rz for (..., 3) angles, rad."""
    (cx, cy, cz), (sx, sy, sz) = np.moveaxis(np.cos(angles), -1, 0), np.moveaxis(np.sin(angles), -1, 0)
    rows = [
        [cy * cz, -cy * sz, sy],
        [cx * sz + sx * sy * cz, cx * cz - sx * sy * sz, -sx * cy],
        [sx * sz - cx * sy * cz, sx * cz + cx * sy * sz, cx * cy],
    ]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def moved(points: Array, torsor: Array, pivot: Array) -> Array:
    """(..., N, 3) points displaced by (..., 6) torsors about a pivot."""
    turned = (points - pivot) @ np.swapaxes(rotations(torsor[..., :3]), -1, -2)
    return np.asarray(turned + pivot + torsor[..., None, 3:])


def images(projection: Array, points: Array) -> Array:
    seen = points @ projection[:, :3].T + projection[:, 3]
    return np.asarray(seen[..., :2] / seen[..., 2:])


def similarity(points: Array) -> tuple[Array, Array]:
    """Hartley's centre (..., d) and scale (...)."""
    centre = points.mean(axis=-2)
    spread = np.sqrt(((points - centre[..., None, :]) ** 2).sum(-1).mean(-1))
    return centre, np.sqrt(points.shape[-1]) / spread


def equations(points: Array, seen: Array) -> Array:
    """(..., 2N, 12) rows of the resection from (N, 3) and (..., N, 2), both normalised."""
    x = np.broadcast_to(np.append(points, np.ones((len(points), 1)), axis=1), (*seen.shape[:-1], 4))
    zero = np.zeros_like(x)
    u_rows = np.concatenate([x, zero, -seen[..., :1] * x], axis=-1)
    v_rows = np.concatenate([zero, x, -seen[..., 1:] * x], axis=-1)
    return np.concatenate([u_rows, v_rows], axis=-2)


def split(system: System, z: Array) -> tuple[list[Array], list[Array], Array, Array]:
    count = len(system.fiducials_mm)
    fiducial = [z[..., 2 * count * v : 2 * count * (v + 1)].reshape(*z.shape[:-1], count, 2) for v in range(2)]
    rest = z[..., 4 * count :]
    return fiducial, [rest[..., 0:2], rest[..., 2:4]], rest[..., 4:10], rest[..., 10:16]


def observe(system: System, z: Array) -> tuple[list[Array], list[Array], Array]:
    """Images of fiducials and target in both views for a batch of deviates, and the second torsor."""
    fiducial, aim, first, second = split(system, z)
    true = moved(system.fiducials_mm, first, system.structure_connector.pivot_mm)
    target = system.targets[0].position_mm
    seen = [images(v.projection, true) + n for v, n in zip(system.views, fiducial, strict=True)]
    aimed = [images(v.projection, target[None])[0] + n for v, n in zip(system.views, aim, strict=True)]
    return seen, aimed, second


def finish(system: System, found: Array, second: Array) -> Array:
    end = moved(found[..., None, :], second, system.connector_flange.pivot_mm)[..., 0, :]
    return np.linalg.norm(end - system.targets[0].position_mm, axis=-1)


def batched_svd(system: System, rng: np.random.Generator, trials: int) -> Array:
    """Vectorised NumPy: `numpy.linalg.svd` over a batch."""
    return batched_chain(system, scaled_deviates(system, rng, trials))


def batched_chain(system: System, z: Array) -> Array:
    seen, aimed, second = observe(system, z)
    centre, scale = similarity(system.fiducials_mm)
    points = (system.fiducials_mm - centre) * scale
    rows = []
    for x, t in zip(seen, aimed, strict=True):
        middle, zoom = similarity(x)
        matrix = equations(points, (x - middle[..., None, :]) * zoom[..., None, None])
        p = np.linalg.svd(matrix, full_matrices=False)[2][..., -1, :].reshape(-1, 3, 4)
        p = p / np.linalg.norm(p[:, 2, :3], axis=-1)[:, None, None]
        local = (t - middle) * zoom[..., None]
        # Undo the image scale so that both views' rows are in pixels times depth.
        rows.append((local[..., None] * p[:, 2:3] - p[:, :2]) / zoom[..., None, None])
    solution = np.linalg.svd(np.concatenate(rows, axis=-2), full_matrices=False)[2][..., -1, :]
    return finish(system, solution[:, :3] / solution[:, 3:] / scale + centre, second)


def loop_svd(system: System, rng: np.random.Generator, trials: int) -> Array:
    """A loop over trials with `numpy.linalg.svd`: what a user writes first."""
    return np.array([batched_chain(system, z[None])[0] for z in scaled_deviates(system, rng, trials)])


def opencv(system: System, rng: np.random.Generator, trials: int) -> Array:
    """OpenCV: `SVDecomp` for the resection, `triangulatePoints` for the target, one trial at a time."""
    import cv2

    centre, scale = similarity(system.fiducials_mm)
    points = (system.fiducials_mm - centre) * scale
    norms = np.empty(trials)
    for k, z in enumerate(scaled_deviates(system, rng, trials)):
        seen, aimed, second = observe(system, z)
        found, local = [], []
        for x, t in zip(seen, aimed, strict=True):
            middle, zoom = similarity(x)
            null = cv2.SVDecomp(equations(points, (x - middle) * zoom))[2][-1].reshape(3, 4)
            found.append(null / np.linalg.norm(null[2, :3]))
            local.append((t - middle) * zoom)
        solution = cv2.triangulatePoints(found[0], found[1], local[0][:, None], local[1][:, None])[:, 0]
        norms[k] = finish(system, solution[:3] / solution[3] / scale + centre, second)
    return norms


def openturns(system: System, rng: np.random.Generator, trials: int) -> Array:
    """OpenTURNS: a Monte Carlo experiment through a vectorised Python function."""
    import openturns as ot

    ot.RandomGenerator.SetSeed(int(rng.integers(2**31)))
    deviates = ot.MonteCarloExperiment(ot.Normal(DEVIATES), trials).generate()
    unit = [v.fiducial_noise_px for v in system.views for _ in range(2 * len(system.fiducials_mm))]
    unit += [v.target_noise_px for v in system.views for _ in range(2)]
    scale = np.concatenate([unit, system.structure_connector.sources.std, system.connector_flange.sources.std])
    chain = ot.PythonFunction(DEVIATES, 1, func_sample=lambda z: batched_chain(system, np.asarray(z) * scale)[:, None])
    return np.asarray(chain(deviates))[:, 0]


PEERS: dict[str, tuple[Callable[..., object], int]] = {
    "a loop with numpy.linalg.svd": (loop_svd, 400),
    "OpenCV SVDecomp + triangulatePoints": (opencv, 400),
    "OpenTURNS, vectorised driver": (openturns, 4000),
    "batched numpy.linalg.svd": (batched_svd, 4000),
}


def peer_job(name: str, system: System) -> Callable[[], int]:
    """Trials by other means."""
    function, count = PEERS[name]
    rng = np.random.default_rng(1)

    def run() -> int:
        function(system, rng, count)
        return count

    return run


def trials_job(system: System, count: int) -> Callable[[], int]:
    """Trials by the kernel, in one thread, compiled before."""
    plan = compile_plan(system)
    simulate(plan, trials=20_000, seed=0, threads=1)

    def run() -> int:
        simulate(plan, trials=count, seed=3, threads=1)
        return count

    return run


def trials() -> Findings:
    """Trials and their peers in turn with multiply-adds, divisions and square roots, which give the bound."""
    system = cios_system()
    counts = operations.count_operations(system)
    jobs = {name: peer_job(name, system) for name in PEERS} | {"tailstack": trials_job(system, 400_000)}
    processor = operations.processor_jobs()
    rounds = interleave(jobs | processor)
    shares, doubles = [], []
    for k, of_trial in enumerate(rounds.cpu["tailstack"]):
        seconds = {name: rounds.cpu[name][k] for name in processor}
        of_eight = WIDTH * of_trial
        shares.append(100 * operations.least_seconds(counts, seconds) / of_eight)
        alone = counts["doubles"] + counts["divisions"] + counts["roots"]
        doubles.append(100 * alone * min(seconds["five chains"], seconds["ten chains"]) / of_eight)
    peak = 1e-9 / min(median(rounds.cpu["five chains"]), median(rounds.cpu["ten chains"]))
    bits = operations.vector_bits()
    figures = [Figure(f"fused multiply-adds of {WIDTH} doubles, registers of {bits} bits", peak, "G/s")]
    figures += [Figure(f"operations of {WIDTH} trials: {kind}", number) for kind, number in counts.items()]
    figures.append(Figure("share of the peak, arithmetic of doubles alone, each one operation", median(doubles), "%"))
    for name in jobs:
        figures.append(Figure(f"trials a second and core: {name}", 1e-3 / median(rounds.cpu[name]), "k/s"))
    figures += [Figure(f"against batched SVD: {name}", rounds.ratio("batched numpy.linalg.svd", name), "×")
                for name in PEERS if name != "batched numpy.linalg.svd"]  # fmt: skip
    return Findings([median(shares), rounds.ratio("batched numpy.linalg.svd", "tailstack")], rounds.foreign, figures)


def batched_least_squares(system: System, z: Array) -> Array:
    """Vectorised NumPy: Gauss-Newton steps for each view, from the nominal one until no image moves.

    ``z`` in px, rad and mm, as :func:`scaled_deviates` draws them; the normal equations of a batch by one call of
    `numpy.linalg.solve` a step, which is faster than QR and exact enough in these units.
    """
    seen, aimed, second = observe(system, z)
    centre, scale = similarity(system.fiducials_mm)
    points = (system.fiducials_mm - centre) * scale
    rows = []
    for view, x, t in zip(system.views, seen, aimed, strict=True):
        p = (fit_projection if system.estimator is Estimator.REPROJECTION else fit_pose)(view, points, centre, scale, x)
        p = p / np.linalg.norm(p[:, 2:3, :3], axis=-1, keepdims=True)
        rows.append(t[..., None] * p[:, 2:3] - p[:, :2])
    solution = np.linalg.svd(np.concatenate(rows, axis=-2), full_matrices=False)[2][..., -1, :]
    return finish(system, solution[:, :3] / solution[:, 3:] / scale + centre, second)


def step_of(slopes: Array, left: Array, prior: Array, due: Array) -> tuple[Array, bool]:
    """Gauss-Newton step, and whether it moves no image any more.

    The slopes have shape (n, N, 2, k), what is left (n, N, 2); ``prior`` (k,) are precisions, ``due`` (n, k) what the
    unknowns are from the values that the prior has for likeliest.
    """
    slopes = slopes.reshape(len(slopes), -1, slopes.shape[-1])
    across = np.swapaxes(slopes, -1, -2)
    right = across @ left.reshape(len(left), -1, 1) + (prior * due)[..., None]
    step = np.linalg.solve(across @ slopes + np.diag(prior), right)
    # px; the next step would move them by a thousandth of that
    return step[..., 0], bool(np.abs(slopes @ step).max() < 1e-7)


def fit_pose(view: View, points: Array, centre: Array, scale: float, x: Array) -> Array:
    """(n, 3, 4) projections of scaled points, by the pose and, with a prior, by the intrinsics too."""
    camera, turn = rq(view.projection[:, :3])
    signs = np.sign(np.diag(camera))
    camera, turn = camera * signs, turn * signs[:, None]
    place = np.broadcast_to(np.linalg.solve(camera, view.projection @ [*centre, 1.0]) * scale, (len(x), 3))
    turn = np.broadcast_to(turn, (len(x), 3, 3))
    prior, state = np.zeros(6), np.zeros((len(x), 6))
    if view.intrinsics_prior is not None:
        focal, middle = view.intrinsics_prior
        prior = np.append(prior, (view.fiducial_noise_px / np.array([focal, middle, middle])) ** 2)
        state = np.zeros((len(x), 9))
    k = camera[None]
    for _ in range(20):
        turned = points @ np.swapaxes(turn, -1, -2)
        rays = (turned + place[:, None]) @ np.swapaxes(k, -1, -2)
        found = rays[..., :2] / rays[..., 2:]
        by_place = (k[:, None, :2, :] - found[..., None] * k[:, None, 2:, :]) / rays[..., 2, None, None]
        slopes = [by_place, np.cross(turned[..., None, :], by_place)]
        if prior.size == 9:
            grown = (found - k[:, None, :2, 2]) / (1 + state[:, None, 6:7])
            slopes += [grown[..., None], np.broadcast_to(np.eye(2), (*found.shape, 2))]
        step, rests = step_of(np.concatenate(slopes, axis=-1), x - found, prior, -state)
        turn, place = rotations(step[:, 3:6]) @ turn, place + step[:, :3]
        if prior.size == 9:
            state = state + np.hstack([np.zeros((len(x), 6)), step[:, 6:]])
            k = np.repeat(camera[None], len(x), axis=0)
            k[:, :2, :2] *= 1 + state[:, 6, None, None]
            k[:, :2, 2] += state[:, 7:]
        if rests:
            break
    return k @ np.concatenate([turn, place[..., None]], axis=-1)


def fit_projection(view: View, points: Array, centre: Array, scale: float, x: Array) -> Array:
    """(n, 3, 4) projections of scaled points by their eleven ratios, images about their mean."""
    p = view.projection @ np.block([[np.eye(3) / scale, centre[:, None]], [np.zeros((1, 3)), np.ones((1, 1))]])
    middle, size = x.mean(axis=(0, 1)), x.std()
    p = np.array([[1, 0, -middle[0]], [0, 1, -middle[1]], [0, 0, size]]) @ p / size
    p = np.broadcast_to(p / p[2, 3], (len(x), 3, 4))
    y = homogeneous(points)
    for _ in range(20):
        rays = y @ np.swapaxes(p, -1, -2)
        found = rays[..., :2] / rays[..., 2:]
        slopes = np.zeros((*found.shape, 11))
        slopes[..., 0, 0:4] = slopes[..., 1, 4:8] = y / rays[..., 2:]
        slopes[..., 8:] = -found[..., None] * (points / rays[..., 2:])[..., None, :]
        left = (x - middle) / size - found
        step, rests = step_of(size * slopes, size * left, np.zeros(11), np.zeros((len(x), 11)))
        p = p + np.append(step, np.zeros((len(x), 1)), axis=-1).reshape(-1, 3, 4)
        if rests:
            break
    return np.array([[size, 0, middle[0]], [0, size, middle[1]], [0, 0, 1]]) @ p


def least_squares(estimator: Estimator) -> Findings:
    """Trials of an estimator by least squares, and of its peer, whose answers to the same deviates are the same."""
    views = cios_system().views
    if estimator is Estimator.POSE_WITH_PRIOR:
        views = tuple(replace(view, intrinsics_prior=(0.01, 10.0)) for view in views)
    system = cios_system(estimator=estimator, views=views)
    rng, plan = np.random.default_rng(1), compile_plan(system)

    def by_numpy() -> int:
        batched_least_squares(system, scaled_deviates(system, rng, 4000))
        return 4000

    rounds = interleave({"NumPy": by_numpy, "tailstack": trials_job(system, 400_000)})
    indices = np.arange(4000)
    ours = np.linalg.norm(run_indices(plan, 11, 0, len(indices)).errors[0, 0], axis=0)
    reference = batched_least_squares(system, native_deviates(system, draw(plan, 11, indices), plan))
    figures = [Figure(f"trials a second and core: {name}", 1e-3 / median(each), "k/s")
               for name, each in rounds.cpu.items()]  # fmt: skip
    difference = float(np.max(np.abs(ours / reference - 1)))
    return Findings([rounds.ratio("NumPy", "tailstack"), difference], rounds.foreign, figures)


def native_deviates(system: System, z: Array, plan: ChainPlan) -> Array:
    """The plan's deviates in the order and the units of :func:`scaled_deviates`."""
    width = 2 * len(system.fiducials_mm)
    places = {block.name: block.start for block in plan.blocks}
    names = [view.name for view in system.views]
    order = [slice(places[f"fiducial_noise:{n}"], places[f"fiducial_noise:{n}"] + width) for n in names]
    order += [slice(places[f"target_noise:{n}"], places[f"target_noise:{n}"] + 2) for n in names]
    order += [slice(places[n], places[n] + 6) for n in ("structure_connector", "connector_flange")]
    scale = [np.full(width, v.fiducial_noise_px) for v in system.views]
    scale += [np.full(2, v.target_noise_px) for v in system.views]
    scale += [system.structure_connector.sources.std, system.connector_flange.sources.std]
    return np.hstack([z[:, s] for s in order]) * np.concatenate(scale)


def agreement() -> Findings:
    """20,000 trials against an independent SVD chain on the same deviates."""
    system = cios_system()
    plan = compile_plan(system)
    with watch_load() as load:
        indices = np.arange(20_000)
        ours = np.linalg.norm(run_indices(plan, 11, 0, len(indices)).errors[0, 0], axis=0)
        z = draw(plan, 11, indices)
        native = native_deviates(system, z, plan)
        reference = np.concatenate([batched_chain(system, part) for part in np.array_split(native, 10)])
    return Findings([float(np.max(np.abs(ours / reference - 1)))], load.foreign)


def threads() -> Findings:
    """Wall time of two threads and of one."""
    plan = compile_plan(cios_system())

    def job(count: int) -> Callable[[], int]:
        def run() -> int:
            simulate(plan, trials=2_000_000, seed=3, threads=count)
            return 2_000_000

        return run

    rounds = interleave({"one": job(1), "two": job(2)})
    return Findings([rounds.ratio("one", "two", wall=True)], rounds.foreign,
                    [Figure("trials a second, two threads", 1e-6 / median(rounds.wall["two"]), "M/s")])  # fmt: skip


def precision() -> Findings:
    """Time to P95 with an interval, both to the half-width that the radial estimate reaches, which is below 1 %.

    The half-width of plain sampling falls with the root of the trials: its time is scaled by the square of the
    quotient of half-widths.
    """
    system = cios_system()
    plan = compile_plan(system)
    model = linearise(system, system.targets[0])
    law = declared_law(model, "tcp", model.bias_mm("tcp"))
    first = law_quantile(law, 0.95)
    linear = LinearChain(
        model.bias_mm("tcp"), gains_in_plan_order(plan, model.blocks, (0,), "tcp"), lambda r: law_exceedance(law, r),
        first.quantile_mm, first.density,
    )  # fmt: skip
    halves: dict[str, list[float]] = {"radial": [], "plain": []}

    def note(name: str, value: float, interval: tuple[float, float]) -> int:
        halves[name].append((interval[1] - interval[0]) / (2 * value))
        return 1

    def by_rays() -> int:
        estimate = radial(plan, linear, seed=5 + len(halves["radial"]))
        return note("radial", estimate.value_mm, estimate.interval_mm)

    def by_trials() -> int:
        samples = simulate(plan, trials=2**15, seed=5 + len(halves["plain"]), threads=1)
        estimate = quantile_estimate(samples, 0, "tcp", 0.95)
        return note("plain", estimate.value_mm, estimate.interval_mm)

    by_rays()
    by_trials()
    rounds = interleave({"radial": by_rays, "plain": by_trials}, 21)
    reached = {name: median(values) for name, values in halves.items()}
    ratio = rounds.ratio("plain", "radial") * (reached["plain"] / reached["radial"]) ** 2
    to_one_percent = rounds.ratio("plain", "radial") * (reached["plain"] / 0.01) ** 2
    figures = [Figure("plain Monte Carlo to ± 1 % against that radial estimate", to_one_percent, "×")]
    figures += [Figure(f"CPU time, {name}", 1e3 * median(rounds.cpu[name]), "ms") for name in halves]
    figures += [Figure(f"half-width of the interval, {name}", 100 * half, "%") for name, half in reached.items()]
    return Findings([ratio], rounds.foreign, figures)


MEMORY = """
from plain_trials import simulate
from scenes import cios_system
simulate(cios_system(), trials=10_000_000, seed=1)
# VmHWM starts anew at exec; ru_maxrss would remember the process that started this one.
print(next(line.split()[1] for line in open("/proc/self/status") if line.startswith("VmHWM")))
"""


def memory() -> Findings:
    """Peak resident set of a process that runs 10^7 trials, interpreter and compiler included."""
    code = f"import sys; sys.path[:0] = {[str(ROOT / 'tests')]!r}\n{MEMORY}"
    with watch_load() as load:
        printed = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    return Findings([int(printed) / 1024], load.foreign)


def fiducials() -> Findings:
    """Cost of a trial with 100 fiducials and with 12."""
    rng = np.random.default_rng(4)
    few = cios_system()
    many = replace(
        few,
        fiducial_labels=tuple(f"F{i}" for i in range(100)),
        fiducials_mm=read_only(rng.uniform(-50, 50, (100, 3)) + np.array([0, 0, -40.0])),
        manufacturing_half_width_mm=read_only(np.zeros((100, 3))),
    )
    rounds = interleave({"few": trials_job(few, 100_000), "many": trials_job(many, 100_000)})
    return Findings([rounds.ratio("many", "few")], rounds.foreign)
