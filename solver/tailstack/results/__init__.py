"""What the library answers with: frozen records of plain Python numbers, units in every name.

The command line prints them, the service serialises them as they stand, and their JSON Schemas are
published.  Names in them are a contract: scripts read them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..extras import load_on_first_use

if TYPE_CHECKING:
    from .optimisation import (
        AimedView,
        Certificate,
        ChangedSpacing,
        ChangedTolerance,
        CountTried,
        FrontPoint,
        LocalOptimum,
        MovedFiducial,
        MovedPivot,
        Optimisation,
        PlacementValue,
        Relaxation,
        ShadowPrice,
        SurvivedLoss,
        ViewOffer,
        ViewSearch,
    )
    from .score import (
        Bounds,
        Contributor,
        Loss,
        Losses,
        MetricScore,
        Mixture,
        PerUnit,
        Score,
        SecondOrder,
        SlipReliability,
        TargetScore,
        Validity,
    )
    from .sweep import Sweep, SweepAxis, SweepPoint, SweepTarget
    from .verdicts import (
        ERRORS,
        Check,
        Finding,
        Interval,
        Matrix3,
        Provenance,
        Severity,
        Vector3,
        Verdict,
        ViewCheck,
        headline_of,
    )
    from .verification import (
        DrawnLosses,
        Exceedance,
        MetricEstimate,
        Reprojection,
        TargetEstimate,
        Verification,
    )

# Loaded on first use: who validates a design does not wait for the records of the optimiser.
_HOME = {
    **dict.fromkeys(
        (
            "Certificate", "ChangedSpacing", "ChangedTolerance", "CountTried", "FrontPoint", "LocalOptimum",
            "MovedFiducial", "MovedPivot", "Optimisation", "PlacementValue", "Relaxation", "ShadowPrice",
            "SurvivedLoss", "AimedView", "ViewSearch", "ViewOffer",
        ),
        "optimisation",
    ),
    **dict.fromkeys(
        (
            "Bounds", "Contributor", "Loss", "Losses", "MetricScore", "Mixture", "PerUnit", "Score", "SecondOrder",
            "SlipReliability", "TargetScore",
            "Validity",
        ),
        "score",
    ),
    **dict.fromkeys(
        (
            "ERRORS", "Check", "Finding", "Interval", "Matrix3", "Provenance", "Severity", "TitleBlock", "Vector3",
            "Verdict", "ViewCheck", "headline_of",
        ),
        "verdicts",
    ),
    **dict.fromkeys(
        (
            "DrawnLosses", "Exceedance", "MetricEstimate", "Reprojection", "TargetEstimate", "Verification",
        ),
        "verification",
    ),
    **dict.fromkeys(("Sweep", "SweepAxis", "SweepPoint", "SweepTarget"), "sweep"),
}  # fmt: skip

__all__ = [
    "ERRORS",
    "AimedView",
    "Bounds",
    "Certificate",
    "ChangedSpacing",
    "ChangedTolerance",
    "Check",
    "Contributor",
    "CountTried",
    "DrawnLosses",
    "Exceedance",
    "Finding",
    "FrontPoint",
    "Interval",
    "LocalOptimum",
    "Loss",
    "Losses",
    "Matrix3",
    "MetricEstimate",
    "MetricScore",
    "Mixture",
    "MovedFiducial",
    "MovedPivot",
    "Optimisation",
    "PerUnit",
    "PlacementValue",
    "Provenance",
    "Relaxation",
    "Reprojection",
    "Score",
    "SecondOrder",
    "Severity",
    "ShadowPrice",
    "SlipReliability",
    "SurvivedLoss",
    "Sweep",
    "SweepAxis",
    "SweepPoint",
    "SweepTarget",
    "TargetEstimate",
    "TargetScore",
    "Validity",
    "Vector3",
    "Verdict",
    "Verification",
    "ViewCheck",
    "ViewOffer",
    "ViewSearch",
    "headline_of",
]

__getattr__ = load_on_first_use(__name__, _HOME)


def __dir__() -> list[str]:
    return __all__
