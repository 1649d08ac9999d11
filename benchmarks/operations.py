"""How many operations a trial takes, and how many of them this processor could do.

The kernel is numba's, but its source is Python: here it runs once on numbers that count what is done to them.  Counted
are the vector instructions that compute: arithmetic of doubles and of the integers of random numbers, comparisons,
choices.  Each is taken for one fused multiply-add; divisions and square roots for as many as they take on this machine.
Loads, stores and copies are not counted.
"""

from __future__ import annotations

import operator
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numba import njit

from tailstack.geometry.arrays import Array
from tailstack.montecarlo import kernel, lane_least_squares, lane_motion, lane_resection, lanes, streams
from tailstack.montecarlo.lanes import WIDTH, fma, load, square_root, store
from tailstack.montecarlo.plan import compile_plan
from tailstack.system import System

MODULES = (lanes, streams, lane_resection, lane_least_squares, lane_motion, kernel)
Counts = Counter[str]


class Vector:
    """Eight doubles, integers or truth values that count what is done to them."""

    __slots__ = ("counts", "values")

    def __init__(self, values: Any, counts: Counts) -> None:
        self.values, self.counts = values, counts

    def __neg__(self) -> Vector:
        return Vector(-self.values, self.counts)

    def __invert__(self) -> Vector:
        return Vector(~self.values, self.counts)


def _kind(name: str, values: Any) -> str:
    if values.dtype != np.float64:
        return "integers" if values.dtype == np.uint64 else "choices"
    return "divisions" if name == "truediv" else "choices" if name in ("lt", "le", "gt") else "doubles"


def _teach(name: str) -> None:
    function = getattr(operator, name)

    def method(self: Vector, other: Vector) -> Vector:
        self.counts[_kind(name, self.values)] += 1
        return Vector(function(self.values, other.values), self.counts)

    setattr(Vector, f"__{name.strip('_')}__", method)


for _name in ("add", "sub", "mul", "truediv", "lt", "le", "gt", "and_", "or_", "xor", "lshift", "rshift"):
    _teach(_name)


def _primitives(counts: Counts) -> dict[str, Callable[..., Any]]:
    """What ``lanes.py`` gives to numba, for Python."""

    def vector(values: Any, kind: str = "") -> Vector:
        if kind:
            counts[kind] += 1
        return Vector(values, counts)

    def read(array: Any, index: int) -> Vector:
        part = array[index : index + WIDTH]
        return vector(part.copy() if part.dtype == np.float64 else part.astype(np.uint64))

    def write(array: Any, index: int, values: Any) -> None:
        for k, value in enumerate(values if isinstance(values, tuple) else (values,)):
            array[index + WIDTH * k : index + WIDTH * (k + 1)] = value.values

    def each(function: Callable[..., Any]) -> Callable[..., Any]:
        """Of vectors, and element by element of tuples of them; what is no tuple stands for each element."""

        def of_parts(*arguments: Any) -> Any:
            sizes = {len(argument) for argument in arguments if isinstance(argument, tuple)}
            if not sizes:
                return function(*arguments)
            (size,) = sizes
            parts = [argument if isinstance(argument, tuple) else (argument,) * size for argument in arguments]
            return tuple(function(*values) for values in zip(*parts, strict=True))

        return of_parts

    def count_of(count: Any) -> range:
        return range(len(count) if isinstance(count, tuple) else count)

    def fuse(a: Vector, b: Vector, c: Vector) -> Vector:
        return vector(a.values * b.values + c.values, "doubles")

    def dot(a: tuple[Vector, ...], b: tuple[Vector, ...]) -> Vector:
        total = a[-1] * b[-1]
        for pair in zip(a[-2::-1], b[-2::-1], strict=True):
            total = fuse(*pair, total)
        return total

    def join(a: Any, b: Any) -> tuple[Vector, ...]:
        return (*(a if isinstance(a, tuple) else (a,)), *(b if isinstance(b, tuple) else (b,)))

    return {
        "splat": lambda value: vector(np.full(WIDTH, value)),
        "splat_bits": lambda value: vector(np.full(WIDTH, value, np.uint64)),
        "load": read,
        "store": write,
        "loads": lambda array, at, count: tuple(read(array, at + WIDTH * k) for k in count_of(count)),
        "splats": lambda row, count: tuple(vector(np.full(WIDTH, row[k])) for k in count_of(count)),
        "repeat": lambda value, count: tuple(value for _ in count_of(count)),
        "join": join,
        "dot": dot,
        "fma": each(fuse),
        "add": each(lambda a, b: a + b),
        "subtract": each(lambda a, b: a - b),
        "multiply": each(lambda a, b: a * b),
        "negative": each(lambda a: -a),
        "square_root": each(lambda a: vector(np.sqrt(a.values), "roots")),
        "absolute": each(lambda a: vector(np.abs(a.values), "doubles")),
        "select": each(lambda mask, yes, no: vector(np.where(mask.values, yes.values, no.values), "choices")),
        "any_lane": lambda mask: bool(mask.values.any()),
        "bits_set": lambda bits: vector(bits.values != 0, "choices"),
        "as_bits": lambda numbers: vector(numbers.values.view(np.uint64)),
        "as_lanes": lambda bits: vector(bits.values.view(np.float64)),
    }


@contextmanager
def _uncompiled(plain: dict[str, Callable[..., Any]]) -> Iterator[None]:
    """The kernel's modules with plain Python in place of what numba compiles."""
    before = [dict(vars(module)) for module in MODULES]
    try:
        for module, names in zip(MODULES, before, strict=True):
            for name, value in names.items():
                if name in plain or hasattr(value, "py_func"):
                    setattr(module, name, plain[name] if name in plain else value.py_func)  # noqa: SIM401
        yield
    finally:
        for module, names in zip(MODULES, before, strict=True):
            vars(module).update(names)


def count_operations(system: System) -> Counts:
    """Vector operations of eight trials of a system: doubles, divisions, roots, integers, choices."""
    plan = compile_plan(system)
    trials = np.arange(WIDTH, dtype=np.int64)
    keys = np.array([streams.stream_key(1, 0), streams.stream_key(1, 1)])
    draws = kernel.Draws(keys, trials, trials, np.empty((0, 0)))
    results = kernel.Results(np.empty(6 * len(system.targets) * WIDTH), np.empty(WIDTH), np.empty(0))
    counts: Counts = Counter()
    with _uncompiled(_primitives(counts)):
        scratch = np.empty(int(kernel.scratch_size(plan.tables.counts)))
        kernel.run_trials(plan.tables, draws, results, scratch)
    if results.flags.any():
        raise RuntimeError("the counted trials are to be redone by SVD: count others")
    return counts


@njit(_nrt=False)
def _five_chains(count, x):  # type: ignore[no-untyped-def]
    factor, term = load(x, 0), load(x, 8)
    a, b, c, d, e = load(x, 16), load(x, 24), load(x, 32), load(x, 40), load(x, 48)
    for _ in range(count):
        a, b, c = fma(a, factor, term), fma(b, factor, term), fma(c, factor, term)
        d, e = fma(d, factor, term), fma(e, factor, term)
    store(x, 96, a + b + c + d + e)


@njit(_nrt=False)
def _ten_chains(count, x):  # type: ignore[no-untyped-def]
    factor, term = load(x, 0), load(x, 8)
    a, b, c, d, e = load(x, 16), load(x, 24), load(x, 32), load(x, 40), load(x, 48)
    f, g, h, i, j = load(x, 56), load(x, 64), load(x, 72), load(x, 80), load(x, 88)
    for _ in range(count):
        a, b, c = fma(a, factor, term), fma(b, factor, term), fma(c, factor, term)
        d, e = fma(d, factor, term), fma(e, factor, term)
        f, g, h = fma(f, factor, term), fma(g, factor, term), fma(h, factor, term)
        i, j = fma(i, factor, term), fma(j, factor, term)
    store(x, 96, a + b + c + d + e + f + g + h + i + j)


@njit(_nrt=False)
def _divisions(count, x):  # type: ignore[no-untyped-def]
    one = load(x, 0)
    a, b, c, d, e = load(x, 16), load(x, 24), load(x, 32), load(x, 40), load(x, 48)
    for _ in range(count):
        a, b, c, d, e = one / a, one / b, one / c, one / d, one / e
    store(x, 96, a + b + c + d + e)


@njit(_nrt=False)
def _roots(count, x):  # type: ignore[no-untyped-def]
    a, b, c, d, e = load(x, 16), load(x, 24), load(x, 32), load(x, 40), load(x, 48)
    for _ in range(count):
        a, b, c, d, e = square_root(a), square_root(b), square_root(c), square_root(d), square_root(e)
    store(x, 96, a + b + c + d + e)


def _job(chains: Callable[[int, Array], None], width: int, count: int) -> Callable[[], int]:
    """Repeats of so many independent operations; two coefficients, ten starts that differ, and room for the result."""

    def run() -> int:
        chains(count, np.concatenate([np.full(8, 0.999), np.full(8, 1e-3), np.linspace(1, 2, 80), np.zeros(8)]))
        return width * count

    run()
    return run


def processor_jobs() -> dict[str, Callable[[], int]]:
    """What measures the processor: multiply-adds for 16 and for 32 registers, divisions, square roots; warm."""
    return {
        "five chains": _job(_five_chains, 5, 2_000_000),
        "ten chains": _job(_ten_chains, 10, 1_000_000),
        "divisions": _job(_divisions, 5, 200_000),
        "roots": _job(_roots, 5, 100_000),
    }


def vector_bits() -> int:
    """Width of the registers that the measured multiply-adds were compiled to."""
    text = "".join(_ten_chains.inspect_asm().values())
    return 512 if "zmm" in text else 256 if "ymm" in text else 128


def least_seconds(counts: Counts, seconds: dict[str, float]) -> float:
    """Of eight trials, were nothing but the counted operations to be done; ``seconds``: of one of each measured job."""
    single = counts["doubles"] + counts["integers"] + counts["choices"]
    multiply_add = min(seconds["five chains"], seconds["ten chains"])
    return single * multiply_add + counts["divisions"] * seconds["divisions"] + counts["roots"] * seconds["roots"]
