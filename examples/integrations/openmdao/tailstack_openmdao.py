"""P95 of a design as an OpenMDAO component, with exact partial derivatives."""

from __future__ import annotations

from typing import Any

import openmdao.api as om

from tailstack import Design, DesignFunction


class TailComponent(om.ExplicitComponent):  # type: ignore[misc]
    """``values`` (n,), numbers of a design in the unit of the document, to ``p95_mm`` of the error at a target.

    Options: ``design``; ``inputs``, the numbers as pointers or paths (half-widths, noise, positions of fiducials);
    ``target``, by default the first; ``error``, ``tcp`` or ``localisation``.
    """

    def initialize(self) -> None:
        self.options.declare("design", types=Design)
        self.options.declare("inputs", types=(list, tuple))
        self.options.declare("target", default=None, allow_none=True)
        self.options.declare("error", default="tcp", values=["tcp", "localisation"])

    def setup(self) -> None:
        self.function = DesignFunction(self.options["design"], self.options["inputs"])
        self.add_input("values", val=self.function.present)
        self.add_output("p95_mm")
        self.declare_partials("p95_mm", "values")

    def compute(self, inputs: Any, outputs: Any) -> None:
        targets = self.function.score(inputs["values"], losses=False).targets
        wanted = self.options["target"]
        target = next(one for one in targets if wanted in (None, one.name))
        outputs["p95_mm"] = target.p95_mm if self.options["error"] == "tcp" else target.localisation.p95_mm

    def compute_partials(self, inputs: Any, partials: Any) -> None:
        _, by_input = self.function.p95_gradient(inputs["values"], self.options["target"], self.options["error"])
        partials["p95_mm", "values"] = by_input[None]
