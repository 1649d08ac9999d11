"""What can be said of the printed tables, and what ours add to S4."""

from __future__ import annotations

from collections.abc import Sequence
from math import radians, sin

from .paper_cells import printed_at
from .paper_records import Geometry, Statement
from .published import LEVELS, MM_PER_PRINTED_UNIT, S1_NOISE_PX, S4_MM_PER_PX, Quantity, Table


def _printed(table: Table, row: str, quantity: Quantity) -> float:
    found = printed_at(table, row, quantity)
    assert found is not None
    return found.printed


def statements(geometries: Sequence[Geometry]) -> tuple[Statement, ...]:
    """Facts about the printed tables that need no geometry, and what ours add to S4."""
    moved = 5.0
    there = _printed("S1", f"translation {moved:g} mm", "mean")
    turned = _printed("S1", "rotation 2 deg", "mean")
    still, both = _printed("S2", "L0, 2 px", "p95"), _printed("S2", "L2, 2 px", "p95")
    zero, again = _printed("S1", "rotation 0 deg", "mean"), _printed("S1", "translation 0 mm", "mean")
    bias = _printed("S2", "L2, 0 px", "p95")
    degrees, _ = LEVELS["L2"]
    lever = bias * MM_PER_PRINTED_UNIT / (2 * sin(radians(degrees) / 2))
    low, high = _printed("S2", "L2, 5 px", "p95"), _printed("S2", "L0, 5 px", "p95")
    found = [
        Statement(
            "units",
            f"A translation of {moved:g} mm moves the target by {moved:g} mm in every geometry, so the mean error is "
            f"at least {moved:g} mm, whatever the noise; the table prints {there:g} under 'mm'. Read as metres it is "
            f"{there * MM_PER_PRINTED_UNIT:g} mm, the text's 18 to 75 mm are S1's {zero:g} to {turned:g} over "
            f"rotation, and its 90 to 108 mm are S2's {still:g} to {both:g} at 2 px, L0 to L2: the tables are in "
            "metres.",
            (moved, there, there * MM_PER_PRINTED_UNIT),
        ),
        Statement(
            "lever",
            f"{bias * MM_PER_PRINTED_UNIT:g} mm at {degrees:g} deg without noise takes a lever arm of {lever:.0f} mm "
            "if one axis turns. That translations of 0 to 5 mm hardly show is this lever and the noise: a translation "
            "arrives one to one, and vanishes in quadrature beside 18 mm.",
            (bias * MM_PER_PRINTED_UNIT, degrees, lever),
        ),
        Statement(
            "repeat",
            f"The same experiment, no installation error at {S1_NOISE_PX:g} px, is printed twice, {zero:g} and "
            f"{again:g}: a difference of one last digit, which two samples of 2,000 trials, or one value near 0.0185, "
            "explain.",
            (zero, again),
        ),
        Statement(
            "falling",
            f"S2 falls from {high:.3f} at L0 to {low:.3f} at L2 where the noise is 5 px. In the Eq 18 reading no "
            "geometry does that to first order: the noise keeps its law, and a known displacement can only raise a "
            "quantile of the norm of a centred Gaussian vector (Anderson 1955). In the physical reading the noise gain "
            "changes with the bias, and it can happen.",
            (high, low),
        ),
    ]
    ratios = [
        (one.name, [level.mm_per_px for level in one.levels if level.mm_per_px is not None]) for one in geometries
    ]
    listed = "; ".join(f"{name}: {' and '.join(f'{value:.3g}' for value in values)}" for name, values in ratios)
    found.append(
        Statement(
            "S4",
            f"S4's error over its reprojection error is {S4_MM_PER_PX:g} mm/px in both rows, and its L0 has no spread: "
            "both columns are measured against L0 and carry one number a level between them, one degree of freedom. "
            "With matrices estimated at each level the reprojection error does not depend on the level at all (DLT "
            "absorbs a rigid displacement), so a column that follows the error was taken with matrices that were "
            "kept, say those of L0; both then grow with the displacement, and to first order their ratio is one number "
            "of the bench's geometry for every level that is a multiple of the others. Here, at L1 and L2 (which are "
            f"not quite), in mm/px: {listed}. What can be predicted is that both columns grow in proportion, and by "
            "how much from level to level where the levels are known. What cannot be had from them: the bench's noise, "
            "its bias, a test of the model's spread or tail.",
            tuple(value for _, values in ratios for value in values),
        )
    )
    return tuple(found)
