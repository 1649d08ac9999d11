"""Rules about the layout and its tolerances: conditioning, spacing, what the views see, what a process can hold."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from fnmatch import fnmatchcase
from math import dist

from tailstack.design import Design
from tailstack.design.mount_document import Interface, Tolerances

from .case import Case, Remark

WEAKNESSES = ("flat-structure", "weak-resection", "small-parallax")
MOST_PAIRS = 10
_COMPONENTS = ("rx", "ry", "rz", "tx", "ty", "tz")


def weaknesses(case: Case) -> list[Remark]:
    """conditioning"""
    return [
        Remark(finding.pointer, finding.message, finding.value, finding.limit)
        for finding in case.score.verdict.findings
        if finding.rule in WEAKNESSES
    ]


def close_fiducials(case: Case) -> list[Remark]:
    """fiducial-spacing: the closest pairs, and how many more there are"""
    least = case.rules.fiducial_spacing.min_mm
    if least is None:
        return []
    fiducials = case.design.fiducials
    placed = list(zip(fiducials.labels, fiducials.positions_mm, strict=True))
    pairs = [
        (dist(here, there), first, second, k)
        for k, (second, there) in enumerate(placed)
        for first, here in placed[:k]
        if dist(here, there) < least
    ]
    told = [
        Remark(
            fiducial_pointer(case.design, index),
            f"{first} and {second} are {distance:.4g} mm apart, at least {least:g} mm are required",
            distance,
            least,
        )
        for distance, first, second, index in sorted(pairs)[:MOST_PAIRS]
    ]
    if (more := len(pairs) - len(told)) > 0:
        pointer = "/fiducials/points" if case.design.document.fiducials.points else "/fiducials/file"
        words = f"{more} more pair{'s are' if more > 1 else ' is'} closer than {least:g} mm"
        # no waiver has to cover it: what accepts the closest pairs accepts these
        told.append(Remark(pointer, f"{words}; told are the {MOST_PAIRS} closest", note=True))
    return told


def narrow_margins(case: Case) -> list[Remark]:
    """visibility"""
    least = case.rules.visibility.min_margin_px
    remarks = []
    for index, view in enumerate(case.score.views):
        if not view.checked:
            message = f"the image size of view {view.view} is not stated: the field of view was not checked"
            remarks.append(Remark(f"/views/{index}", message, unbounded=True))
        elif view.smallest_margin_px is not None and view.smallest_margin_px < least:
            message = (
                f"view {view.view}: a fiducial is imaged {view.smallest_margin_px:.1f} px from the border, at least "
                f"{least:g} px are required"
            )
            remarks.append(Remark(f"/views/{index}", message, view.smallest_margin_px, least))
    return remarks


def close_images(case: Case) -> list[Remark]:
    """overlap"""
    least = case.rules.overlap.min_px
    labels = case.design.fiducials.labels
    return [
        Remark(
            fiducial_pointer(case.design, labels.index(view.closest_pair[1])),
            f"view {view.view}: the images of {view.closest_pair[0]} and {view.closest_pair[1]} are "
            f"{view.closest_pair_px:.1f} px apart, at least {least:g} px are required to tell them apart",
            view.closest_pair_px,
            least,
        )
        for view in case.score.views
        if view.closest_pair_px < least and view.closest_pair[1] in labels
    ]


def tight_tolerances(case: Case) -> list[Remark]:
    """process-capability"""
    remarks = []
    for process in case.rules.process_capability.processes:
        for tolerance in tolerances_of(case.design):
            least = process.min_half_width_deg if tolerance.unit == "deg" else process.min_half_width_mm
            made = any(fnmatchcase(tolerance.name, pattern) for pattern in process.tolerances)
            if made and least is not None and tolerance.half_width < least:
                width = f"a half-width of {tolerance.half_width:g} {tolerance.unit}"
                what = width if tolerance.stated else "not stated, so it does not vary: that"
                message = (
                    f"{tolerance.name}: {what} is tighter than {process.name} can hold ({least:g} {tolerance.unit})"
                )
                remarks.append(Remark(tolerance.pointer, message, tolerance.half_width, least))
    return remarks


def fiducial_pointer(design: Design, index: int) -> str:
    return f"/fiducials/points/{index}/position_mm" if design.document.fiducials.points else "/fiducials/file"


@dataclass(frozen=True, slots=True)
class Tolerance:
    """One half-width of the document that a process has to hold."""

    name: str  # structure_connector.rx, fiducials.manufacturing, hand_eye.tx
    pointer: str
    half_width: float
    unit: str  # deg or mm
    stated: bool = True  # otherwise it does not vary: nothing is tighter


def tolerances_of(design: Design) -> list[Tolerance]:
    """Every half-width that somebody manufactures or adjusts, in the order of the document; one that is left out is 0,
    or a design would pass by leaving it out."""
    document = design.document
    found = []
    made = document.fiducials.manufacturing
    if made is None:
        found.append(Tolerance("fiducials.manufacturing", "/fiducials", 0.0, "mm", stated=False))
    else:
        widths = made.half_width_mm if isinstance(made.half_width_mm, tuple) else (made.half_width_mm,)
        pointer = "/fiducials/manufacturing/half_width_mm"
        found += [Tolerance("fiducials.manufacturing", pointer, min(widths), "mm")]
    for name in ("structure_connector", "connector_flange"):
        interface: Interface | None = getattr(document.interfaces, name)
        if interface is None:
            continue
        at = f"/interfaces/{name}"
        if interface.tolerances is not None:
            found += _components(interface.tolerances, name, f"{at}/tolerances")
        elif interface.locators is None:
            found += _components(Tolerances(), name, at)
        found += [
            Tolerance(f"{name}.{locator.name}", f"{at}/locators/{k}/half_width_mm", locator.half_width_mm, "mm")
            for k, locator in enumerate(interface.locators or ())
        ]
    if document.execution.hand_eye is not None:
        found += _components(document.execution.hand_eye.tolerances, "hand_eye", "/execution/hand_eye/tolerances")
    return found


def _components(tolerances: Tolerances, name: str, at: str) -> Iterator[Tolerance]:
    for component in _COMPONENTS:
        entry = getattr(tolerances, component)
        unit = "deg" if component.startswith("r") else "mm"
        field = f"half_width_{unit}"
        if entry is None:
            yield Tolerance(f"{name}.{component}", at, 0.0, unit, stated=False)
        else:
            yield Tolerance(f"{name}.{component}", f"{at}/{component}/{field}", getattr(entry, field), unit)
