"""tailstack: tolerance stack-up of X-ray reference structures, judged by its tail.

Three lines::

    from tailstack import load_design, score, verify
    design = load_design("examples/demo.yaml")
    print(score(design).targets[0].p95_mm, verify(design, precision=0.01).targets[0].p95_interval_mm)

``optimise(design)`` moves fiducials and sets rotational tolerances under the design's own limit, ``sweep(design,
{path: values})`` varies numbers of it, ``score_batch(design, {path: column})`` scores it once for each row of a table,
``design.with_value(path, value)`` is the design with one of them changed, and ``DesignFunction(design, paths)`` makes
a function of them for another program, with the derivative of P95.
Results are the frozen records of :mod:`tailstack.results`; refusals are the exceptions of :mod:`tailstack.errors`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from .extras import load_on_first_use
from .version import __version__

if TYPE_CHECKING:
    from .batch import score_batch
    from .design import Design, compile_design, load_design
    from .design_function import DesignFunction
    from .errors import (
        DesignError,
        IllPosedError,
        InfeasibleError,
        LimitError,
        MissingExtraError,
        NotConvergedError,
        OutOfRangeError,
        Problem,
        TailstackError,
    )
    from .optimisation import optimise
    from .scoring import score
    from .sweeping import sweep
    from .verification import verify

# Loaded on first use: numba and casadi take a second that `tailstack --help` should not.
_HOME = {
    "Design": "design",
    "load_design": "design",
    "compile_design": "design",
    "score": "scoring",
    "score_batch": "batch",
    "verify": "verification",
    "optimise": "optimisation",
    "sweep": "sweeping",
    "DesignFunction": "design_function",
    **dict.fromkeys(
        (
            "DesignError", "IllPosedError", "InfeasibleError", "LimitError", "MissingExtraError", "NotConvergedError",
            "OutOfRangeError", "Problem", "TailstackError",
        ),
        "errors",
    ),
}  # fmt: skip

__all__ = [
    "Design",
    "DesignError",
    "DesignFunction",
    "IllPosedError",
    "InfeasibleError",
    "LimitError",
    "MissingExtraError",
    "NotConvergedError",
    "OutOfRangeError",
    "Problem",
    "TailstackError",
    "__version__",
    "compile_design",
    "load_design",
    "optimise",
    "score",
    "score_batch",
    "sweep",
    "verify",
]

__getattr__ = load_on_first_use(__name__, _HOME)


def __dir__() -> list[str]:
    return __all__
