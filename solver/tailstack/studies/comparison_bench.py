"""The bench as the design predicts it: simulated through the full chain, structured as it was run.

One structure and one robot: manufacturing and hand-eye error are drawn once for a simulated bench.  Both interfaces are
drawn at each installation; noise, repeatability and load at each trial.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from math import ceil

import numpy as np
from numpy.typing import NDArray

from ..cores import usable_cores
from ..errors import LimitError, OutOfRangeError, Problem
from ..montecarlo import ChainPlan, compile_plan, draw, evaluate
from ..montecarlo.chain import standard_normals
from ..montecarlo.plan import INSTALLATION
from ..montecarlo.simulate import ERRORS
from ..propagation.linear import Block, LinearModel
from ..system import Array, System
from .comparison_statistics import Expected

ONCE = ("fiducial_manufacturing", "hand_eye")  # drawn once for a bench; the other per-unit sources at each installation
ROWS = 2_000_000  # simulated trials of a file that there is room for
MOST_ROWS = 4_000_000  # and that the tests of a file may need: half a minute
LEAST_REPLICATES, MOST_REPLICATES = 499, 4_999
ROWS_AT_A_TIME = 8192
INSTRUMENT_STREAM = 64  # of the generator; 0 and 1 are the chain's own

Progress = Callable[[float], None]


def at_level(system: System, deliberate: Array | None) -> System:
    """The system with a level's installation error (6,) rad, mm on top of the known bias of the structure's mount."""
    if deliberate is None or not deliberate.any():
        return system
    mount = system.interface_1
    return replace(system, interface_1=replace(mount, bias=mount.bias + deliberate))


def benches_for(trials: Sequence[int], tests: int, alpha: float) -> int:
    """How many benches are simulated of each group of a file: as many as its tests need, more where there is room.

    trials: of each group.  Raises LimitError where the tests together need more than can be simulated.
    """
    least, every = least_benches(tests, alpha), sum(trials)
    if least * every > MOST_ROWS:
        needed = f"{every:,} trials and {tests} tests need {least * every:,} simulated trials"
        detail = f"{needed}; at most {MOST_ROWS:,} are made"
        hint = "put fewer levels, targets or trials into a file; several files are compared one by one"
        raise LimitError(Problem("", "too-many", detail, hint))
    return max(min(ROWS // every, MOST_REPLICATES), least)


def least_benches(tests: int, alpha: float, fewest: int = LEAST_REPLICATES) -> int:
    """So many that a two-sided p-value can fall below alpha shared among the tests, with room to spare."""
    return max(fewest, ceil(3 * tests / alpha))


def simulated(
    system: System,
    target: int,
    error: str,
    sizes: Sequence[int],
    *,
    seed: int,
    first: int,
    count: int = MOST_REPLICATES,
    instrument_sd_mm: float = 0.0,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Array:
    """Errors (R, n, 3) mm of R = ``count`` simulated benches; bounded components stand at their centres.

    ``first``: index of the first trial, so that benches of one seed do not share deviates unless they should.
    """
    plan = compile_plan(system)
    trials = sum(sizes)
    at_once = max(1, ROWS_AT_A_TIME // trials)
    starts = range(0, count, at_once)
    out = np.empty((count, trials, 3))

    def part(start: int) -> None:
        stop = min(start + at_once, count)
        z = draw(plan, seed, np.arange(first + start * trials, first + stop * trials, dtype=np.int64))
        z = shared(plan, z, sizes)
        out[start:stop] = evaluate(plan, z)[:, target, ERRORS.index(error)].reshape(stop - start, trials, 3)

    with ThreadPoolExecutor(usable_cores() if threads is None else threads) as pool:
        for done, _ in enumerate(pool.map(part, starts), 1):
            if progress is not None:
                progress(done / len(starts))
    if instrument_sd_mm > 0:
        out += instrument_sd_mm * standard_normals(seed, INSTRUMENT_STREAM, count * trials, 3).reshape(out.shape)
    return out


def shared(plan: ChainPlan, z: Array, sizes: Sequence[int]) -> Array:
    """Deviates (R n, d) in which a bench's trials share what is drawn once, and an installation's its mounting."""
    trials = sum(sizes)
    starts = np.concatenate([[0], np.cumsum(sizes)[:-1]])
    bench: NDArray[np.int64] = np.arange(len(z)) // trials * trials
    installation = bench + np.tile(np.repeat(starts, sizes), len(z) // trials)
    for block in plan.blocks:
        if block.stream == INSTALLATION:
            owner = bench if block.name in ONCE else installation
            z[:, block.start : block.stop] = z[owner, block.start : block.stop]
    return z


def expected(model: LinearModel, error: str, instrument_sd_mm: float) -> Expected:
    """Mean and covariances to first order.  Raises OutOfRangeError where nothing varies from shot to shot."""
    parts = {"unit": np.zeros((3, 3)), "installation": np.zeros((3, 3)), "shot": instrument_sd_mm**2 * np.eye(3)}
    for block in model.blocks:
        scaled = model.gain(block, error) * block.std
        parts[when(block)] += scaled @ scaled.T
    if not np.linalg.eigvalsh(parts["shot"])[0] > 1e-12:
        detail = f"the design predicts no spread of the {error} error from trial to trial in some direction"
        raise OutOfRangeError(Problem("/views", "no-noise", detail, "state the noise of the views, or --instrument-sd"))
    return Expected(model.bias_mm(error), parts["unit"], parts["installation"], parts["shot"])


def when(block: Block) -> str:
    """What a contributor is drawn with: the bench as a whole ("unit"), an "installation", a "shot"."""
    if not block.per_unit:
        return "shot"
    return "unit" if block.contributor in ONCE else "installation"
