"""A hand-made answer of the optimiser: every optional part filled, every number chosen."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from tailstack.results import (
    Certificate,
    ChangedTolerance,
    Check,
    CountTried,
    Finding,
    FrontPoint,
    GlobalBound,
    LocalOptimum,
    MetricEstimate,
    MovedFiducial,
    MovedPivot,
    MovesValue,
    MoveValue,
    Optimisation,
    Provenance,
    Relaxation,
    Reprojection,
    ShadowPrice,
    TargetEstimate,
    Verdict,
    Verification,
)

PROVENANCE = Provenance(
    "drill guide", "0123456789abcdef" * 4, "0.1.0", "physical", "full", "normalised", ("a note",), ("distortion",)
)
SEAT = "carrier on connector, two dowel pins"


def verification(status: Any = "pass", p95_mm: float = 0.9985) -> Verification:
    """A check of one target, "tip", with the limit 1 mm."""
    low, high = p95_mm - 0.0012, p95_mm + 0.0012
    metric = MetricEstimate((0.1, 0.0, 0.0), (0.3, 0.3, 0.1), 0.5, p95_mm, (low, high), 1.2, 2.5, None, 0.999)
    told = {"confidence": 0.95, "flagged_trials": 0, "first_order_p95_mm": p95_mm, "localisation": metric}
    target = TargetEstimate(**{"name": "tip", "frame": "tcp", **asdict(metric), **told})
    check = Check("tip-accuracy", "tip", "tcp", "pooled", 0.95, p95_mm, (low, high), 1.0, None, None, status)
    verdict = Verdict(status, "Monte Carlo", (check,), (Finding("far-target", "warning", "the target is far away"),))
    return Verification(
        "tailstack/verification/1", 77, 1_048_576, "plain", "numba", None, None, 0.0012, "done", (target,),
        Reprojection(1000, 0.4, 0.6), 0.999, verdict, PROVENANCE,
    )  # fmt: skip


def tolerance(component: str, cost_after: float, **changes: Any) -> ChangedTolerance:
    fields: dict[str, Any] = {
        "contributor": "structure_connector", "component": component, "label": f"{SEAT} {component}", "unit": "deg",
        "before_half_width": 0.1, "after_half_width": 0.1234, "at_target_before_mm": 0.288, "at_target_mm": 0.355,
        "cost_before": 573.0, "cost_after": cost_after, "grade": None,
    }  # fmt: skip
    return ChangedTolerance(**{**fields, **changes})


def full_result(**changes: Any) -> Optimisation:
    """Costs: 400 + 350 of the carrier's seat, 250 of the flange, 2 x 60 for fiducials, 1120 in all."""
    certificate = Certificate(
        kkt_residual=3.2e-9,
        starts=8,
        converged_starts=7,
        best_costs=(1101.5, 1130.0),
        optima=(LocalOptimum(1101.5, 5, 0, 0.0), LocalOptimum(1130.0, 2, 3, 12.25)),
        relaxation=Relaxation("convex allocation", 1080.0, 1075.0, 4.1, "no allocation at this layout is below 1075"),
        seed=1,
        tightening_rounds=0,
        stopped="all 8 starts were solved",
        verification=verification(),
        global_bound=GlobalBound("tip-accuracy", "tip", 1.0, 0.9983, 0.99412, 0.46, 0.42, (), "No layout is below."),
        cheapest=Relaxation("any layout", 1120.0, 1103.4, 1.5, "No layout is cheaper."),
    )
    fields: dict[str, Any] = {
        "schema": "tailstack/optimisation/1",
        "status": "verified",
        "objective": "least cost with P95 of the tcp error within 1 mm",
        "cost_before": 2000.0,
        "cost_after": 1120.0,
        "cost_closed_form": 1101.5,
        "cost_exact_law": 1227.25,
        "p95_before_mm": 1.144,
        "p95_after_mm": 0.9983,
        "moved": (
            MovedFiducial("F1", (0.0, 0.0, 0.0), (3.0, 4.0, 0.0)),
            MovedFiducial("F2", (1.0, 1.0, 1.0), (1.0, 1.0, 1.0)),
            MovedFiducial("F3", None, (9.0, 8.0, 7.0)),
            MovedFiducial("F4", (5.0, 5.0, 5.0), None),
        ),
        "tolerances": (
            tolerance("rx", 400.0, grade="ground, IT5"),
            tolerance("ry", 350.0, cost_before=None, grade="milled, IT7"),
            tolerance("tz", 250.0, contributor="connector_flange", label="connector on flange tz", unit="mm"),
        ),
        "pivots": (MovedPivot("structure_connector", SEAT, (0.0, 0.0, -95.0), (0.0, 0.0, -80.0)),),
        "scaling": 1.375,
        "certificate": certificate,
        "shadow_prices": (ShadowPrice("limit", "mm", -1800.0, "0.1 mm of limit is worth about 180"),),
        "binding": ("P95 at target 'tip'", "carrier rx at its largest"),
        "influence": (Finding("floor", "note", "moving fiducials cannot bring P95 at 'tip' below 0.98 mm"),),
        "moves": MovesValue(
            1300.0,
            1101.5,
            (MoveValue("F1", 1125.0), MoveValue("F3", None)),
            ("F1",),
            0.88,
            5,
            "moving F1 alone keeps 88 % of what moving buys",
        ),
        "counts": (CountTried(8, None, 1.0625, "cannot meet the limit"), CountTried(10, 1120.0, 1.0, "chosen")),
        "front": (
            FrontPoint(
                0.75,
                0.75,
                "verified",
                "",
                2500.0,
                0.7481,
                0.7496,
                (0.1, 0.1, 0.02),
                ((0.0, 0.0, -95.0),),
                ((0.0, 0.0, 0.0),),
            ),
            FrontPoint(0.5, 0.5, "out of reach", "the smallest P95 found is 0.61 mm", None, None, None, (), (), ()),
        ),
        "design_before": {},
        "design": {},
        "provenance": PROVENANCE,
    }
    return Optimisation(**{**fields, **changes})


def bare_result() -> Optimisation:
    """No tolerance free, nothing asked for beyond the layout, and the layout stays."""
    return full_result(
        objective="least P95 of the tcp error", cost_before=None, cost_after=0.0, cost_closed_form=None,
        cost_exact_law=None,
        p95_before_mm=None, moved=(MovedFiducial("F2", (1.0, 1.0, 1.0), (1.0, 1.0, 1.0)),), tolerances=(), pivots=(),
        scaling=None, shadow_prices=(), binding=(), influence=(), moves=None, counts=(),
        front=(),
    )  # fmt: skip
