"""A design as models of UM-Bridge: ``python serve_design.py DESIGN [PORT]`` needs tailstack and umbridge.

``score``: numbers of the design in, P95 at each target out, with its exact derivative.  ``chain``: one shot of the
whole chain, from numbers that are uniform between 0 and 1 to the error at the tool, x, y, z in mm, target by target.
"""

from __future__ import annotations

import sys

import numpy as np
import umbridge
from scipy import stats

from tailstack import Design, DesignFunction, compile_design, load_design
from tailstack.montecarlo.chain import evaluate
from tailstack.montecarlo.plan import compile_plan

LAWS = {"normal": stats.norm(), "uniform": stats.uniform(-1, 2), "triangular": stats.triang(0.5, -1, 2)}


class ScoreModel(umbridge.Model):
    """P95 of a design by the numbers that ``config["inputs"]`` names, by default the half-widths of its seats."""

    def __init__(self, design: Design) -> None:
        super().__init__("score")
        self.design, self.functions = design, {}
        self.targets = [target.name for target in design.document.targets]
        self.half_widths = [
            f"/interfaces/{seat}/tolerances/{name}/{field}"
            for seat, entry in design.source.data["interfaces"].items()
            for name, tolerance in entry.get("tolerances", {}).items()
            for field in tolerance
            if field.startswith("half_width")
        ]

    def function(self, config: dict) -> DesignFunction:
        inputs = tuple(config.get("inputs", self.half_widths))
        return self.functions.setdefault(inputs, DesignFunction(self.design, inputs))

    def get_input_sizes(self, config: dict) -> list[int]:
        return [len(self.function(config).pointers)]

    def get_output_sizes(self, config: dict) -> list[int]:
        return [len(self.targets)]

    def __call__(self, parameters: list, config: dict) -> list:
        record = self.function(config).score(parameters[0], losses=False)
        return [[target.p95_mm for target in record.targets]]

    def gradient(self, out_wrt: int, in_wrt: int, parameters: list, sens: list, config: dict) -> list:
        return (np.array(sens) @ self.jacobian(parameters[0], config)).tolist()

    def apply_jacobian(self, out_wrt: int, in_wrt: int, parameters: list, vec: list, config: dict) -> list:
        return (self.jacobian(parameters[0], config) @ np.array(vec)).tolist()

    def jacobian(self, values: list, config: dict) -> np.ndarray:
        """(targets, inputs) derivative of P95, mm per unit of the document."""
        function = self.function(config)
        return np.array([function.p95_gradient(values, target)[1] for target in self.targets])

    def supports_evaluate(self) -> bool:
        return True

    def supports_gradient(self) -> bool:
        return True

    def supports_apply_jacobian(self) -> bool:
        return True


class ChainModel(umbridge.Model):
    """One trial of ``tailstack verify`` a call.  Components that are only bounded stand at their middle."""

    def __init__(self, design: Design) -> None:
        super().__init__("chain")
        self.plan = compile_plan(compile_design(design))
        self.outputs = 3 * len(design.document.targets)

    def get_input_sizes(self, config: dict) -> list[int]:
        return [self.plan.dimension]

    def get_output_sizes(self, config: dict) -> list[int]:
        return [self.outputs]

    def __call__(self, parameters: list, config: dict) -> list:
        deviates = [LAWS[law].ppf(value) for law, value in zip(self.plan.laws, parameters[0], strict=True)]
        if not np.isfinite(deviates).all():
            raise ValueError("numbers lie between 0 and 1: scramble a Sobol sequence, which begins with 0")
        return [evaluate(self.plan, [deviates])[0, :, 0].ravel().tolist()]

    def supports_evaluate(self) -> bool:
        return True


def main(path: str, port: str = "4242") -> None:
    design = load_design(path)
    umbridge.serve_models([ScoreModel(design), ChainModel(design)], int(port))


if __name__ == "__main__":
    main(*sys.argv[1:])
