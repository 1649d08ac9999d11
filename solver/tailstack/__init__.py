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

from .extras import load_on_first_use
from .version import __version__ as __version__

# numba and casadi take a second that `tailstack --help` should not.
__getattr__, __dir__, __all__ = load_on_first_use(__name__, __file__)
