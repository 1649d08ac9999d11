"""What each fiducial does to the value that decides a score: by moving, exactly, and by being lost."""

from __future__ import annotations

from dataclasses import replace

from .design import Design, compile_design, design_to_data, load_design
from .design_function import DesignFunction
from .errors import IllPosedError, OutOfRangeError
from .losses import without_fiducials
from .results import FiducialWorth, Score
from .results.verdicts import P95, Vector3, decisive_check
from .scoring import score, vector3

NO_SLOPE = "the derivative is known of a quantile of all shots together"


def weigh_fiducials(design: Design, record: Score) -> tuple[FiducialWorth, ...]:
    """The worth of each fiducial of a design for what decides its score ``record``, in its unit, by mm in con.

    What is not known is None, with the reason: a derivative of what is no quantile, an answer of too few fiducials.
    """
    system, check = compile_design(design), decisive_check(record.verdict.checks)
    item = next((each for each in system.requirements if check and each.name == check.requirement), None)
    target = record.worst_target.name if check is None else check.target
    slopes: list[Vector3 | None] = [None] * len(system.fiducial_labels)
    why = "" if item is None or (item.level is None and item.row.by_quantile) else NO_SLOPE
    if not why:
        places = [f"/fiducials/points/{i}/position_mm/{k}" for i in range(len(slopes)) for k in range(3)]
        function = DesignFunction(load_design(design_to_data(design)), places)  # which has those of a file, too
        error, quantile = (item.error, item.quantile) if item else ("tcp", P95)
        try:
            _, by_place = function.p95_gradient(function.present, target, error, quantile)
            slopes = [vector3(each) for each in by_place.reshape(-1, 3)]
        except OutOfRangeError as refusal:
            why = refusal.problems[0].detail
    needed = {target, *(each.entry for each in system.targets if each.name == target)}
    own = [each for each in system.targets if each.name in needed] or system.targets
    stated = () if item is None else (replace(item, targets=(target,)),)
    system, worth = replace(system, targets=tuple(own), requirements=stated), []
    for label, slope in zip(system.fiducial_labels, slopes, strict=True):
        without, reason = None, ""
        try:
            left = score(without_fiducials(system, (label,)), losses=False)
            worst = next((each for each in left.targets if each.name == target), left.worst_target)
            without = left.verdict.checks[0].value if stated else worst.p95_mm
        except IllPosedError as refusal:
            reason = refusal.problems[0].detail
        worth.append(FiducialWorth(label, slope, without, "; ".join(filter(None, (why, reason)))))
    return tuple(worth)
