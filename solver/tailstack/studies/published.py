"""What the paper's supplementary tables print, cell by cell, as far as this project holds them.

Hu, Li and Cao, "System-Level Error Propagation and Tail-Risk Amplification in Reference-Based Robotic Navigation",
doi 10.21203/rs.3.rs-8811528, arXiv 2602.07846: tables S1-S3 and two facts about S4.  Numbers are kept as printed, with
the decimals that were printed; the column heads say mm, and :data:`MM_PER_PRINTED_UNIT` says why they are metres.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Table = Literal["S1", "S2", "S3"]
Quantity = Literal["mean", "p95", "std_x", "std_y", "std_z"]

SOURCE = (
    'Hu, Li and Cao, "System-Level Error Propagation and Tail-Risk Amplification in Reference-Based Robotic '
    'Navigation", tables S1-S4 (doi 10.21203/rs.3.rs-8811528, arXiv 2602.07846)'
)
TRIALS = 2000  # of each cell, says the paper
# The text speaks of 18 -> 75 mm and 90 -> 108 mm where the tables print 0.018 -> 0.075 (S1, rotation) and 0.09039 ->
# 0.10856 (S2 at 2 px, L0 to L2) under "mm"; and a translation of 5 mm, which moves the target by 5 mm whatever the
# geometry, is printed with a mean error of 0.019.
MM_PER_PRINTED_UNIT = 1000.0

S1_NOISE_PX = 1.0  # the text calls the noise of S1 negligible; it is this
S3_NOISE_PX = 2.0
LEVELS = {"L0": (0.0, 0.0), "L1": (1.0, 2.0), "L2": (2.0, 5.0)}  # deg about each axis, mm along (1, 1, 1)

S4_MM_PER_PX = 0.276  # error over reprojection error: the same number in every row that has one
AXES = ("x", "y", "z")


@dataclass(frozen=True, slots=True)
class Setting:
    """The condition that a cell was sampled under."""

    rotation_deg: float  # about each of the three axes
    translation_mm: float  # length of the translation along (1, 1, 1)
    noise_px: float


@dataclass(frozen=True, slots=True)
class Printed:
    """One cell, as printed."""

    table: Table
    row: str
    quantity: Quantity
    setting: Setting
    printed: float
    decimals: int

    @property
    def value_mm(self) -> float:
        return self.printed * MM_PER_PRINTED_UNIT

    @property
    def rounding_mm(self) -> float:
        """Half of the last decimal that was printed."""
        return 0.5 * 10.0**-self.decimals * MM_PER_PRINTED_UNIT


def _rotation(degrees: float, mean: float, p95: float) -> tuple[Printed, Printed]:
    row, setting = f"rotation {degrees:g} deg", Setting(degrees, 0.0, S1_NOISE_PX)
    return Printed("S1", row, "mean", setting, mean, 3), Printed("S1", row, "p95", setting, p95, 3)


def _translation(millimetres: float, mean: float) -> Printed:
    return Printed("S1", f"translation {millimetres:g} mm", "mean", Setting(0.0, millimetres, S1_NOISE_PX), mean, 3)


def _level(level: str, noise_px: float, p95: float, decimals: int = 3) -> Printed:
    return Printed("S2", f"{level}, {noise_px:g} px", "p95", Setting(*LEVELS[level], noise_px), p95, decimals)


S1 = (
    *_rotation(0.0, 0.018, 0.045),
    *_rotation(0.5, 0.027, 0.048),
    *_rotation(1.0, 0.042, 0.058),
    *_rotation(1.5, 0.058, 0.070),
    *_rotation(2.0, 0.075, 0.086),
    *(_translation(k, mean) for k, mean in enumerate((0.019, 0.018, 0.019, 0.018, 0.019, 0.019))),
)
S2 = (
    _level("L0", 2.0, 0.09039, 5), _level("L0", 5.0, 0.240), _level("L1", 0.0, 0.036), _level("L1", 2.0, 0.098),
    _level("L1", 5.0, 0.242), _level("L2", 0.0, 0.072), _level("L2", 2.0, 0.10856, 5), _level("L2", 5.0, 0.219),
)  # fmt: skip
S3 = (
    Printed("S3", "Monte Carlo, x", "std_x", Setting(0.0, 0.0, S3_NOISE_PX), 0.015, 3),
    Printed("S3", "Monte Carlo, y", "std_y", Setting(0.0, 0.0, S3_NOISE_PX), 0.010, 3),
    Printed("S3", "Monte Carlo, z", "std_z", Setting(0.0, 0.0, S3_NOISE_PX), 0.043, 3),
)
S3_ANALYTIC = (0.010, 0.008, 0.019)  # the column of Eqs 15-16, x, y, z; three decimals
CELLS = S1 + S2 + S3
