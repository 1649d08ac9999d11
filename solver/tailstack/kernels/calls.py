"""Kernels compiled before the first call asks for them: which those are, by what is computed, and how to compile one.

A kernel is compiled for the types of its arguments.  Python calls some thirty kernels, each with one combination
of types (one with two); those that only other kernels call are compiled into these.  The table names them, so that they
can be compiled in several processes at once, counted before the first is done, and put into the distribution of
kernels.  What is missing in it is compiled when it is called; a test holds the table against what is really called.

``python -m tailstack.kernels.calls`` compiles the calls whose numbers it reads, one a line, and answers each
with the line.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import Any

from numba import types

from . import store

# Seconds of one processor (an AMD EPYC of 2024) with what the kernel calls, the kernel, and its arguments: f float64,
# i int64, u uint64, b bool; with a number, a C-contiguous array of so many dimensions, with r a read-only one;
# NAME(...) a named tuple of the kernel's module, or of the one that stands before a dot, (...) one without a name.
_FRAME = "PrincipalLaw(f1 f1 f2 f2 f1 f2 i f)"
_TABLES = (
    "montecarlo.tables.Tables(i2r i1r i1r f2r f3r f2r f2r f2r f1r f1r f1r f2r f2r f2r f3r "
    "f3r f3r f1r i2r f2r f3r f2r f1r f2r f2r f2r f2r f1r f1r f2r f1r)"
)
_IMAGING = "Imaging(f3 f2 propagation.noise.Estimation(i i f2 f2 f4) f2 b f2 i1 f2)"
_EXCHANGE = f"ExchangeModel({_IMAGING} f2 f1 f2 f3 i1 f1)"
_CLOSED = "ClosedLimits(f2 f3 f1 f1 b1 f1 f1 f2)"
_CURVES = "PriceCurves(b1 f1 f1 f1)"
_WIDTHS = f"Widths({_CURVES} f1 f1)"
_ROWS = "CompiledRows(f4 f3 f3 f3 f2 i i f3 f3 f4 f2 i1 f2 f3 f4 f3 f3 f5 f5 f4 i f2 i1 i1 b1 f5 b)"
_VALIDITY_BOUNDS = "ValidityBounds(f3 f2 f3 f1 f b)"
_TABLE = {
    "score": f"""
        9.9 tail.declared.solve_on_axes         f {_FRAME} Accuracy(f f f)
        6.0 tail.declared.solve_on_lattice      f {_FRAME} Accuracy(f f f) f Lattice(f1 f1 f2 f f)
        6.9 tail.declared.outer_lattice         {_FRAME} Accuracy(f f f)
        9.0 tail.declared.solve_about           f f2 {_FRAME} Accuracy(f f f)
        6.5 tail.lattice.build                  f {_FRAME} Accuracy(f f f) b
        2.2 tail.gaussian.norm_gradient_jit     f1 f2 f
        2.0 tail.gaussian.norm_quantile_jit     f1 f2 f
        2.0 tail.gaussian.norm_quantiles        f f2 f2
        4.7 propagation.noise.assemble          {_IMAGING} f2 f1 f3 f2 f3
        1.6 tail.lattice.on_principal_axes      f1 f2 f2
        5.0 propagation.noise.lose              {_IMAGING} f2 f4 b1 f4 f1 f3 (f4 f4)
        1.0 tail.approximation.rank_losses      f4 f4 Rest(f3 f3 f1 f2 f3 f1 f1 f3) f Ranking(f2 f3 f4)
        0.3 tail.per_unit.position_of           f1 i f
        0.2 tail.per_unit.average_at            f1 i f
        1.3 propagation.nonlinearity.matrix_gains  f2 f2 f1
        1.0 tail.declared.excess_integral       f f {_FRAME} f1 f1
        0.3 kernels.numerics.eigen_symmetric    f2
        0.7 tail.lattice.ball_sums              f i f1 f1
        0.8 tail.declared.probabilities_within  f1 i f1 f1
        0.5 tail.gaussian.tail_nodes            f b f1 f1
        0.5 tail.lattice.assemble_law           f2 f1 f1 i1
        0.4 tail.gaussian.law_on_axes           f1 f1 f
        0.3 tail.declared.split_columns         f2 i1
        0.3 tail.lattice.reach_of               {_FRAME} f
        0.3 kernels.numerics.principal_axes     f1 f2
        0.2 tail.gaussian.brought_near          f1 f1
        0.2 tail.declared.column_slopes         f1 f2 f2
        0.1 tail.gaussian.norm_mean_jit         f1 f2
        0.1 tail.lattice.balls                  f f1
        0.1 tail.lattice.flat_balls             f i f1
        0.1 tail.pairs.chi_below                f1 i
        0.1 tail.pairs.between                  f1 f f1 f3 f3
    """,
    "batch": f"""
        24.0 rows.score_rows                     {_ROWS} Asked(i1 f1 b1 f2) {_VALIDITY_BOUNDS} b1 f3 f2
        1.8 propagation.validity_bounds.is_layout_certainly_valid f2 f2 f3 {_VALIDITY_BOUNDS}
    """,
    "verify": f"""
        11.2 montecarlo.kernel.run_trials        {_TABLES} Draws(u1 i1 i1 f2) Results(f1 f1 f1) f1
        0.5 montecarlo.kernel.reduce_block      f1 i f1 f2 f3 f1 f1
        0.4 montecarlo.streams.draw_columns     i2 u1 i1 i1 f1 f2
        0.2 montecarlo.streams.draw_columns     i2r u1 i1 i1 f1 f2
    """,
    "optimise": f"""
        6.0 optimisation.exchanging.exchange    i2 Candidates(f3 i1 i1) Spacing(f f) {_EXCHANGE} i
        2.0 optimisation.enclosure.enclose      Forms(f4 f4 f2 f3 f3 i1) ViewTurns(f3 f3 i1 f1 f2) f2 f2 i1 f1 f1 f2
        3.0 optimisation.least_cost.find_cheapest  {_CLOSED} {_WIDTHS} f1 f
        1.0 optimisation.least_cost.log_squares  {_CLOSED} f1
        2.0 optimisation.least_cost.solve_programme  Programme({_WIDTHS} f1 f2) f1
        0.3 optimisation.least_cost.cheapest_widths  {_CURVES} f1 f1 f1
        0.3 optimisation.least_cost.log_costs   {_CURVES} f1
        0.3 optimisation.least_cost.total_cost  {_CURVES} f1
        1.5 optimisation.mixture.mix            MixedParts(f3 i1 i1 i1 f2 f2) f3 b i i i
        0.4 optimisation.mixture.told_by_rows       f3 f2
        0.4 optimisation.mixture.information_by_rows  f3 f1
        0.4 optimisation.mixture.whiten_rows        f3 f3
        0.9 optimisation.cost_bound.raise_prices  f3 f3 f1 f1 f1
        0.4 optimisation.cost_bound.fill_charges  f2 f2 i1 i1 b1
        0.6 optimisation.chance_bound.sum_waves  f2 f1 f2r f2 f1
        1.1 optimisation.curvature.fill_jacobian   Tape(i1 i1 i1 i1 i1 f1) f1 f1 f2 f2
        0.4 optimisation.exchanging.apart_from_copies  f3 f3 Spacing(f f)
        0.3 optimisation.exchanging.keeps_distance  f2 i1 f2 f3 Spacing(f f)
    """,
}
COMPUTATIONS = tuple(_TABLE)
_SCALARS = {"f": types.float64, "i": types.int64, "u": types.uint64, "b": types.boolean}


@dataclass(frozen=True)
class KernelCall:
    """One kernel with one combination of types."""

    kernel: str
    arguments: str
    seconds: float  # of one processor, roughly

    @cached_property
    def dispatcher(self) -> Any:
        """The kernel itself; its module is imported for it."""
        import_module(self._module)
        return store.KERNELS[self.kernel]

    @cached_property
    def signature(self) -> tuple[types.Type, ...]:
        """The types, as numba has them."""
        words = iter(re.findall(r"[\w.]*\(|[\w.]+|\)", self.arguments))
        return tuple(self._types(words))

    @property
    def _module(self) -> str:
        return f"tailstack.{self.kernel.rpartition('.')[0]}"

    def _types(self, words: Iterator[str]) -> Iterator[types.Type]:
        """What the words mean, up to the bracket that closes."""
        for word in words:
            if word == ")":
                return
            if word.endswith("("):
                named, inner = self._tuple_class(word[:-1]) if word[:-1] else None, tuple(self._types(words))
                if named is not None and len(named._fields) != len(inner):
                    raise ValueError(f"{self.kernel}: {word[:-1]} has {len(named._fields)} fields, here {len(inner)}")
                yield types.BaseTuple.from_types(inner, named)
            elif len(word) == 1:
                yield _SCALARS[word]
            else:
                yield types.Array(_SCALARS[word[0]], int(word[1]), "C", readonly=word.endswith("r"))

    def _tuple_class(self, name: str) -> Any:
        module, _, name = name.rpartition(".")
        return getattr(import_module(f"tailstack.{module}" if module else self._module), name)

    def file(self) -> Path | None:
        """Where its machine code is, with which its first call compiles nothing."""
        return store.stored_file(self.dispatcher, self.signature)

    def compile(self) -> None:
        """Load it, or compile it and keep it."""
        self.dispatcher.compile(self.signature)


def _read_table() -> dict[str, tuple[KernelCall, ...]]:
    lines = {name: [line.split(maxsplit=2) for line in text.strip().splitlines()] for name, text in _TABLE.items()}
    return {name: tuple(KernelCall(k, types, float(s)) for s, k, types in parts) for name, parts in lines.items()}


CALLS = _read_table()
EVERY = tuple(call for calls in CALLS.values() for call in calls)


def calls_for(computations: Iterable[str]) -> tuple[KernelCall, ...]:
    """What these computations call, the slowest first."""
    chosen = set(computations)
    return tuple(sorted((c for n, calls in CALLS.items() if n in chosen for c in calls), key=lambda c: -c.seconds))


def main() -> None:
    """Compile what stdin names until it ends."""
    for line in sys.stdin:
        EVERY[int(line)].compile()
        sys.stdout.write(line)
        sys.stdout.flush()


if __name__ == "__main__":
    main()
