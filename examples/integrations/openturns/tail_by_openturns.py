"""The whole chain of a design as an OpenTURNS function of random inputs, and P95 by its Monte Carlo.

``python tail_by_openturns.py DESIGN`` needs tailstack and openturns.
"""

from __future__ import annotations

import sys

import openturns as ot

from tailstack import Design, compile_design, load_design, verify
from tailstack.montecarlo.chain import evaluate
from tailstack.montecarlo.plan import compile_plan

LAWS = {"normal": ot.Normal(), "uniform": ot.Uniform(-1, 1), "triangular": ot.Triangular(-1, 0, 1)}


def chain_of(design: Design, target: int = 0) -> tuple[ot.Function, ot.Distribution]:
    """(function, its inputs): from the standardised random inputs of a shot to the error at the tool, x, y, z in mm.

    The inputs are independent, each with the law that the design declares, on the scale on which its half-width is 1
    (normal: its standard deviation).  Components that are only bounded are no random inputs: they stand at their
    middle, or where ``compile_plan(..., vertex={"connector_flange.rx": 1.0})`` puts them.
    """
    plan = compile_plan(compile_design(design))

    def errors(sample: list[list[float]]) -> object:
        return evaluate(plan, sample)[:, target, 0]

    chain = ot.PythonFunction(plan.dimension, 3, func_sample=errors)
    names = [f"{block.name}[{k}]" for block in plan.blocks for k in range(block.stop - block.start)]
    chain.setDescription([*names, "x_mm", "y_mm", "z_mm"])
    return chain, ot.JointDistribution([LAWS[law] for law in plan.laws])


def quantile_interval(
    chain: ot.Function, inputs: ot.Distribution, trials: int, p: float = 0.95, error_rate: float = 0.01
) -> tuple[float, float, float]:
    """(quantile of the error's norm, and the order statistics about it that miss the true one at this rate)."""
    norms = ot.SymbolicFunction(["x", "y", "z"], ["sqrt(x^2 + y^2 + z^2)"])(chain(inputs.getSample(trials)))
    ordered = norms.sortAccordingToAComponent(0).asPoint()
    below = ot.Binomial(trials, p)  # how many of the trials are below the true quantile
    low, high = (int(below.computeQuantile(q)[0]) for q in (error_rate / 2, 1 - error_rate / 2))
    return norms.computeQuantile(p)[0], ordered[max(low - 1, 0)], ordered[min(high, trials - 1)]


def main(path: str) -> None:
    design = load_design(path)
    ot.RandomGenerator.SetSeed(1)
    p95, low, high = quantile_interval(*chain_of(design), trials=100_000)
    print(f"OpenTURNS: P95 {p95:.3f} mm, between {low:.3f} and {high:.3f}")
    target = verify(design, trials=100_000, seed=1).targets[0]
    low, high = target.p95_interval_mm
    print(f"tailstack: P95 {target.p95_mm:.3f} mm, between {low:.3f} and {high:.3f}")


if __name__ == "__main__":
    main(*sys.argv[1:])
