"""What the printed tables say by themselves, and what ours add to S4."""

from __future__ import annotations

from collections.abc import Sequence
from math import radians, sin, sqrt

from .paper_records import Geometry, Statement
from .published import LEVELS, MM_PER_PRINTED_UNIT, S1_NOISE_PX, S4, TABLES, TRIALS, printed_text

NORMAL, UNIFORM = 1.645, 1.559  # standard deviations from the mean to the P95
S4_HALVES = {"mean": 0.0005, "std": 0.00005, "p95": 0.0005}  # half of the last decimal of each column


def _printed(table: str, row: str, column: str) -> float:
    found = printed_text(table, row, column)
    assert found is not None
    return float(found)


def statements(geometries: Sequence[Geometry]) -> tuple[Statement, ...]:
    """Facts about the printed tables that need no geometry, and what ours add to S4."""
    return (_units(), _lever(), _repeat(), _falling(), _means(geometries), *_bench(geometries))


def _units() -> Statement:
    moved = 5.0
    there = _printed("S1", f"translation {moved:g} mm", "e_3d_mean")
    zero, turned = (_printed("S1", f"rotation {degrees} deg", "e_3d_mean") for degrees in (0, 2))
    still, both = (printed_text("S2", level, "2 px") for level in ("L0", "L2"))
    at_rest, displaced = TABLES["text"]["S2, 2 px, L0 and L2, mm"]
    low, high = TABLES["text"]["S1, mean over rotation, mm"]
    return Statement(
        "units",
        f"The text's {at_rest} and {displaced} mm settle the unit: they are S2's {still} and {both} under 'mm' (2 px, "
        f"L0 and L2), and its {low} to {high} mm are S1's {zero:g} to {turned:g} over rotation. S1-S3 are in metres "
        f"({displaced} is printed as {both}, cut and not rounded). It could not be otherwise: a translation of "
        f"{moved:g} mm moves the target by {moved:g} mm in every geometry, so the mean error is at least {moved:g} mm, "
        f"whatever the noise; the table prints {there:g}, which is {there * MM_PER_PRINTED_UNIT:g} mm in metres.",
        (float(at_rest), float(displaced), moved, there),
    )


def _lever() -> Statement:
    bias, (degrees, _) = _printed("S2", "L2", "0 px"), LEVELS["L2"]
    lever = bias * MM_PER_PRINTED_UNIT / (2 * sin(radians(degrees) / 2))
    return Statement(
        "lever",
        f"{bias * MM_PER_PRINTED_UNIT:g} mm at {degrees:g} deg without noise takes a lever arm of {lever:.0f} mm "
        "if one axis turns. That translations of 0 to 5 mm hardly show is this lever and the noise: a translation "
        "arrives one to one, and vanishes in quadrature beside 18 mm.",
        (bias * MM_PER_PRINTED_UNIT, degrees, lever),
    )


def _repeat() -> Statement:
    zero, again = (_printed("S1", row, "e_3d_mean") for row in ("rotation 0 deg", "translation 0 mm"))
    return Statement(
        "repeat",
        f"The same experiment, no installation error at {S1_NOISE_PX:g} px, is printed twice, {zero:g} and "
        f"{again:g}: a difference of one last digit, which two samples of 2,000 trials, or one value near 0.0185, "
        "explain.",
        (zero, again),
    )


def _falling() -> Statement:
    high, low = (_printed("S2", level, "5 px") for level in ("L0", "L2"))
    return Statement(
        "falling",
        f"S2 falls from {high:.3f} at L0 to {low:.3f} at L2 where the noise is 5 px. In the Eq 18 reading no "
        "geometry does that to first order: the noise keeps its law, and a known displacement can only raise a "
        "quantile of the norm of a centred Gaussian vector (Anderson 1955). In the physical reading the noise gain "
        "changes with the bias, and it can happen.",
        (high, low),
    )


def _means(geometries: Sequence[Geometry]) -> Statement:
    pairs = [(row[1], row[2]) for row in TABLES["S3"]["rows"]]
    listed = ", ".join(f"{sampled} and {analytic}" for sampled, analytic in pairs)
    largest = max(max(map(abs, one.factor.mean_error_mm)) for one in geometries)
    spread = max(MM_PER_PRINTED_UNIT * float(row[3]) for row in TABLES["S3"]["rows"])
    scatter = spread / sqrt(TRIALS)
    return Statement(
        "means",
        f"S3's means agree, Monte Carlo and analytic: {listed} (x, y, z), one last digit, 1 mm, apart in z alone, "
        f"where the mean of {TRIALS:,} trials scatters by {spread:g} / sqrt({TRIALS}) = {scatter:.2f} mm. "
        "Where the point lies is not ours to predict, by how much noise shifts the mean is: in these geometries by "
        f"at most {largest:.1f} mm on an axis. So the means bear out first order, at the very noise at which its "
        "standard deviations are said to be wrong by a factor of two.",
        (scatter, largest),
    )


def _bench(geometries: Sequence[Geometry]) -> tuple[Statement, ...]:
    at_rest, *measured = S4
    ratios = [
        (one.name, [level.mm_per_px for level in one.levels if level.mm_per_px is not None]) for one in geometries
    ]
    listed = "; ".join(f"{name}: {' and '.join(f'{value:.3g}' for value in values)}" for name, values in ratios)
    per_px = " and ".join(f"{row.mean:g} / {row.reprojection_px:g} = {row.per_px:.4f}" for row in measured)
    shapes = " and ".join(
        f"({row.p95:.3f} - {row.mean:.3f}) / {row.std:.4f} = {row.standard_deviations:.2f}" for row in measured
    )
    highest = max(
        (row.p95 - row.mean + S4_HALVES["p95"] + S4_HALVES["mean"]) / (row.std - S4_HALVES["std"]) for row in measured
    )
    over = " and ".join(f"{row.p95 / row.mean:.3f}" for row in measured)
    ours = [shape.standard_deviations for one in geometries for shape in one.shapes]
    return (
        Statement(
            "S4",
            f"S4's error over its reprojection error is one constant: {per_px} mm/px, and its L0 has no spread: "
            "both columns are counted from L0 and carry one number a level between them, one degree of freedom; 2.0 "
            "and 5.0 px are the noise levels of S2. With matrices estimated at each level the reprojection error does "
            "not depend on the level at all (DLT absorbs a rigid displacement), so a column that follows the error was "
            "taken with matrices that were kept, say those of L0; both then grow with the displacement, and to first "
            "order their ratio is one number of the bench's geometry for every level that is a multiple of the "
            f"others. Here, at L1 and L2 (which are not quite), in mm/px: {listed}. What can be predicted is that both "
            "columns grow in proportion, and by how much from level to level where the levels are known. What cannot "
            "be had from them: the bench's noise, its bias, a test of the model's spread or tail. Its lengths are mm "
            "by the text, and nothing confirms it: both means are below the translation of their own level, 2 and 5 "
            "mm, which arrives one to one unless a rotation takes it back.",
            tuple(value for _, values in ratios for value in values),
        ),
        Statement(
            "tail",
            f"S4 has no heavy tail at its P95, which stands {shapes} standard deviations above the mean, at most "
            f"{highest:.2f} with the rounding of what is printed; a normal law has {NORMAL}, a uniform one {UNIFORM}, "
            f"the error in these geometries with 2 px of noise {min(ours):.2f} to {max(ours):.2f}. The text says "
            f"that P95 grows substantially more than the mean; P95 over mean is {over}: it does not grow. What lies "
            "beyond P95 no column says.",
            tuple(row.standard_deviations for row in measured),
        ),
        Statement(
            "zero",
            f"S4's {at_rest.level} is zero in all four columns, reprojection error included, to the last decimal: no "
            "bench measures that. It is what the others are counted from, and no measurement.",
            (at_rest.mean, at_rest.std, at_rest.p95, at_rest.reprojection_px),
        ),
    )
