"""What the intervals of a study of coupling say, in sentences that nothing but the intervals decides."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import floor, log10

from scipy.special import stdtrit

from .coupling_records import SECTIONS, CouplingCase, Ratio, Seen

ROUNDING = 1e-9  # relative: what double precision leaves of an identity


def side(ratio: Ratio) -> int:
    """1 above one, -1 below, 0 where the interval (or rounding) does not tell."""
    if abs(ratio.value - 1) <= ROUNDING:
        return 0
    return int(ratio.interval[0] > 1) - int(ratio.interval[1] < 1)


def seen(ratio: Ratio) -> Seen:
    return ("none seen", "more", "less")[side(ratio)]


def among(ratio: Ratio, count: int, confidence: float = 0.95) -> Ratio:
    """The same with an interval of which ``count`` hold together (Bonferroni); its own holds by itself."""
    alone, together = (float(stdtrit(SECTIONS - 1, 1 - (1 - confidence) / (2 * m))) for m in (1, count))
    low, high = ratio.interval
    half = (high - low) / 2 * together / alone
    return replace(ratio, interval=(ratio.value - half, ratio.value + half))


def decimals_of(ratio: Ratio) -> int:
    """So many that the half-width of the interval, in per cent, has two digits; one to six."""
    half = 50 * (ratio.interval[1] - ratio.interval[0])
    return min(max(1 - floor(log10(max(half, 1e-7))), 1), 6)


def per_cent(ratio: Ratio, decimals: int | None = None) -> str:
    """How far a ratio is from one: ``+3.02 %``."""
    decimals = decimals_of(ratio) if decimals is None else decimals
    return f"{round(100 * (ratio.value - 1), decimals) + 0.0:+.{decimals}f} %"


def _compared(ratio: Ratio, what: str, above: str = "above", below: str = "below") -> str:
    where = side(ratio)
    if where == 0:
        return f"cannot be told from {what} ({per_cent(ratio)})"
    return f"is {above if where > 0 else below} {what} ({per_cent(ratio)})"


def sentence(case: CouplingCase) -> str:
    gain = case.gain
    if case.p95_installation_mm <= ROUNDING * case.p95_together_mm:
        return (
            f"{case.installation}, {case.reading} reading, at {case.target}: there is no installation error, so that "
            f"nothing couples; P95 of the noise is {case.p95_together_mm:.4g} mm."
        )
    if gain is None:
        said = (
            f"no noise gain is given, for the noise shows no standard deviation (nu = {case.nu:.2g}, one trial makes "
            f"{100 * case.largest_share:.2g} % of a sum of squares)"
        )
    elif abs(gain.value - 1) <= ROUNDING and max(abs(end - 1) for end in gain.interval) <= ROUNDING:
        said = "the noise gain is the same as at the nominal geometry, trial by trial, to rounding"
    elif side(gain) == 0:
        said = f"no change of the noise gain is seen: {per_cent(gain)}"
    else:
        said = f"the noise gain is {'larger' if side(gain) > 0 else 'smaller'} than at the nominal geometry: " + (
            f"{per_cent(gain)}, first order says {100 * ((gain.first_order or 1.0) - 1):+.2f} %"
        )
    return (
        f"{case.installation}, {case.reading} reading, at {case.target}: {said}. P95 together, "
        f"{case.p95_together_mm:.4g} mm, {_compared(case.against_quadrature, 'the quadrature sum of the parts')}, "
        f"{_compared(case.against_sum, 'their plain sum')}, "
        f"{_compared(case.against_vector_sum, 'what the parts give when their vectors are added')}; "
        f"it {_compared(case.against_first_order, 'the first-order law of |bias + noise|')}."
    )


def conclusions(cases: Sequence[CouplingCase]) -> tuple[str, ...]:
    """What holds for all cases together, in sentences that only their intervals, widened to hold together, decide."""
    return (_whether_more(cases), _on_quadrature(cases), _on_first_order(cases))


def _whether_more(cases: Sequence[CouplingCase]) -> str:
    sides = [side(among(case.against_vector_sum, len(cases))) for case in cases]
    more, less = sides.count(1), sides.count(-1)
    over = sum(side(among(case.against_sum, len(cases))) > 0 for case in cases)
    furthest = max((abs(case.against_vector_sum.value - 1) for case in cases), default=0.0)
    if not more and not less:
        said = "No coupling is seen: in no case can P95 be told from that of the parts added as vectors"
    elif not more:
        said = f"The tail is not more than the parts: in {less} of {len(cases)} cases it is less than that of the "
        said += "parts added as vectors" + (", in the others no difference is seen" if less < len(cases) else "")
    else:
        said = f"In {more} of {len(cases)} cases the tail is more than that of the parts added as vectors"
        said += f", in {less} it is less" if less else ""
    said += f" (largest difference {100 * furthest:.2g} %; all intervals together 95 %)"
    exceeded = f"is exceeded in {over} of {len(cases)} cases" if over else "is exceeded nowhere"
    return f"{said}. The plain sum of both P95 {exceeded}."


def _on_quadrature(cases: Sequence[CouplingCase]) -> str:
    above = [case for case in cases if side(among(case.against_quadrature, len(cases))) > 0]
    if not above:
        return "P95 is nowhere seen above the quadrature sum of the parts."
    most = max(above, key=lambda case: case.against_quadrature.value)
    predicted = 100 * ((most.against_quadrature.first_order or 1.0) - 1)
    return (
        f"P95 is above the quadrature sum in {len(above)} of {len(cases)} cases, at most by "
        f"{per_cent(most.against_quadrature)} ({most.installation}, {most.reading}), where first order, in which the "
        f"two only add, says {predicted:+.2f} %: quadrature is not how a bias and noise combine."
    )


def _on_first_order(cases: Sequence[CouplingCase]) -> str:
    ends = [end for case in cases for end in among(case.against_first_order, len(cases)).interval]
    return (
        "P95 over first order's own prediction, all intervals together: "
        f"{100 * (min(ends) - 1):+.2f} .. {100 * (max(ends) - 1):+.2f} %."
    )
