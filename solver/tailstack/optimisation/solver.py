"""IPOPT as CasADi finds it: a plugin, which an installation may be without, or unable to load."""

from __future__ import annotations

from functools import cache
from typing import Any

import casadi as ca

from ..errors import MissingExtraError, Problem

NAME = "ipopt"


def make_solver(name: str, programme: dict[str, Any], options: dict[str, Any]) -> Any:
    """A solver of a nonlinear programme by IPOPT.  Raises MissingExtraError where it cannot be loaded."""
    require_ipopt()
    return ca.nlpsol(name, NAME, programme, options)


@cache
def require_ipopt() -> None:
    """Raise MissingExtraError, with CasADi's reason, where IPOPT cannot be loaded."""
    try:
        ca.load_nlpsol(NAME)
    except RuntimeError as error:
        reason = " ".join(str(error).split())[:300]
        detail = f"the optimiser needs IPOPT, which CasADi {ca.CasadiMeta.version()} cannot load here: {reason}"
        hint = "install the wheel of PyPI, which brings it: pip install --force-reinstall --only-binary :all: casadi"
        raise MissingExtraError(Problem("", "missing-solver", detail, hint)) from None
