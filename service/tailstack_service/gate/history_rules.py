"""Rules about the baseline: is the design worse than it was?"""

from __future__ import annotations

from .case import Case, Remark
from .records import GatedDesign, GateTarget
from .requirement_rules import target_pointer

# Two machines differ in the last digits of a first-order score; a rise of less is no rise.
ROUNDING_PERCENT = 1e-6


def regressions(case: Case) -> list[Remark]:
    """regression"""
    base = case.baseline
    if base is None:
        message = "the baseline has no design of this file, content or name: nothing was compared"
        return [Remark("", message, note=True)] if case.compared else []
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
        percent = 100 * (head / then - 1) if then > 0 else (0.0 if head == 0 else float("inf"))
        if percent > case.max_regression_percent + ROUNDING_PERCENT:
            message = (
                f"target {score.name}: P95 ({basis}) rose from {then:.4g} to {head:.4g} mm"
                + (f", by {percent:.3g} %" if then > 0 else "")
                + f"; {case.max_regression_percent:g} % are allowed"
            )
            value = percent if then > 0 else None
            remarks.append(Remark(pointer, message, value, case.max_regression_percent, score.name))
    return remarks


def _compared(case: Case, index: int, was: GateTarget, base: GatedDesign) -> tuple[float, float, str]:
    """P95 now and then.

    First order has no chance in it, so a difference is the design's.  Where it is not to be trusted Monte Carlo is
    compared, if both drew as many trials of the same seed.
    """
    now, trust = case.verification, case.score.validity.expected_error_percent
    trusted = trust is not None and trust <= case.rules.first_order_gap.max_percent
    if not trusted and now is not None and was.p95_mm is not None and base.trials == now.trials:
        return now.targets[index].p95_mm, was.p95_mm, "Monte Carlo"
    return case.score.targets[index].p95_mm, was.first_order_p95_mm, "first order"
