"""Rules about the baseline: is the design worse than it was?"""

from __future__ import annotations

from .case import Case, Remark
from .records import GatedDesign, GateTarget
from .requirement_rules import target_pointer


def regressions(case: Case) -> list[Remark]:
    """regression"""
    base = case.baseline
    if base is None:
        return []
    before = {target.name: target for target in base.targets}
    remarks = []
    for index, score in enumerate(case.score.targets):
        was = before.get(score.name)
        pointer = target_pointer(case, index)
        if was is None:
            message = f"target {score.name}: the baseline has no number for it, nothing was compared"
            remarks.append(Remark(pointer, message, note=True))
            continue
        head, then, basis = _compared(case, index, was, base)
        percent = 100 * (head / then - 1) if then > 0 else 0.0
        if percent > case.max_regression_percent:
            message = (
                f"target {score.name}: P95 ({basis}) rose from {then:.4g} to {head:.4g} mm, by {percent:.3g} %; "
                f"{case.max_regression_percent:g} % are allowed"
            )
            remarks.append(Remark(pointer, message, percent, case.max_regression_percent, score.name))
    return remarks


def _compared(case: Case, index: int, was: GateTarget, base: GatedDesign) -> tuple[float, float, str]:
    """P95 now and then.

    Monte Carlo is compared only with as many trials of the same seed: then chance is common to both.  Otherwise
    first order, which has no noise, is.
    """
    now = case.verification
    if now is not None and was.p95_mm is not None and base.trials == now.trials:
        return now.targets[index].p95_mm, was.p95_mm, "Monte Carlo"
    return case.score.targets[index].p95_mm, was.first_order_p95_mm, "first order"
