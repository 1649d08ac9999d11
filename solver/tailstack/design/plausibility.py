"""Remarks on values that are allowed and hardly ever meant: a slip of unit, a seat nobody can make, no noise at all.

A design document accepts a wide range, so that no honest design is refused.  The rules here are narrower and refuse
nothing: each says what it met, why it doubts that, and what to do.  Their numbers are published ones where there are
any, and each rule states where its numbers come from.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import dist, hypot, pi

import numpy as np

from tailstack.fields import INTERFACES

from ..arrays import Array
from ..effects import EFFECTS
from ..effects.kind import Doubt, PlausibilityTest, Subject, guess_unit
from ..errors import Problem
from ..geometry.camera import camera_centre
from ..results import Finding
from ..system import System
from ..tolerances import Bias, Tolerances
from .document import (
    DesignDocument,
    DistanceView,
    Interface,
    MatrixView,
    PinholeView,
    Pose,
    PresetView,
    Region,
    TargetDocument,
)
from .loading import Design
from .meanings import SHORTEST_MM, UNITS, WrittenPoints, find_units_of_points, say_meanings
from .presets import PRESETS

BEAD_MM = 3.0  # diameter of the beads that localisation noise is quoted for
FINEST_DEG, FINEST_MM = 0.002, 1e-4
WIDEST_DEG, WIDEST_MM = 1.0, 1.0
BEST_NOISE_PX, WORST_NOISE_PX = 0.015, 5.0
WIDEST_REPEATABILITY_MM = 1.0
WIDEST_LIMIT_MM = 20.0
SMALLEST_STRUCTURE_MM, LARGEST_STRUCTURE_MM = 5 * BEAD_MM, 750.0
SHORTEST_DETECTOR_MM, SHORTEST_ISOCENTRE_MM = SHORTEST_MM["source_detector_mm"], SHORTEST_MM["source_isocentre_mm"]
SAME_WIDTH = 0.01  # relative, of two detectors
LARGEST_SHARE = 0.2
# A multiple of 30 or 45 degrees, in radians, written with three digits or more: 1.57, 0.785, 3.1416.
TURNS = sorted({k * pi / n for n in (4, 6) for k in range(1, 2 * n + 1)})
SAME_TURN = 6e-4  # relative: 1.57 is nearer to a quarter turn

_ROTATIONS = ("rx", "ry", "rz")
_COMPONENTS = (*_ROTATIONS, "tx", "ty", "tz")


def find_implausible(design: Design, system: System) -> tuple[Finding, ...]:
    """A warning for each value that a rule doubts, in the order of :data:`PLAUSIBILITY`."""
    subject = Subject(design.document, system.fiducials_mm, system, system.fiducial_labels)
    return tuple(
        Finding(rule.id, "warning", met.message, met.pointer, met.value, met.limit)
        for rule in PLAUSIBILITY.values()
        for met in rule.find(subject)
    )


def explain_refusal(design: Design, system: System | None = None) -> list[Problem]:
    """Slips of unit, as further problems of a geometry that is refused: they may be why."""
    subject = Subject(design.document, np.array(design.fiducials.positions_mm), system, tuple(design.fiducials.labels))
    return [
        Problem(met.pointer, rule.id, met.message)
        for rule in PLAUSIBILITY.values()
        if rule.slip
        for met in rule.find(subject)
    ]


_SECTIONS = ("interfaces", "transforms", "execution", "rotation_deg")


def _name(pointer: str) -> str:
    """What an angle belongs to, as a person calls it: structure_connector bias rz_deg, T_flange_con 2."""
    return " ".join(step for step in pointer.split("/") if step and step not in _SECTIONS)


# --- lengths of the whole ------------------------------------------------------------------------------


def _doubt_structure_size(subject: Subject) -> Iterator[Doubt]:
    points = subject.fiducials_mm - subject.fiducials_mm.mean(axis=0)
    square = (points**2).sum(axis=1)
    width = float(np.sqrt(max(0.0, (square[:, None] + square - 2 * points @ points.T).max())))
    limit = SMALLEST_STRUCTURE_MM if width < SMALLEST_STRUCTURE_MM else LARGEST_STRUCTURE_MM
    if SMALLEST_STRUCTURE_MM <= width <= LARGEST_STRUCTURE_MM:
        return
    why = (
        f"six beads of {BEAD_MM:g} mm need {limit:g} mm"
        if width < limit
        else f"no detector of a C-arm images more than {limit:g} mm at once"
    )
    message = f"the two fiducials farthest apart are {width:.4g} mm apart; {why}. {_say_units(subject, width)}"
    if subject.document.fiducials.points is None:
        yield Doubt("/fiducials/file", f"{message}, which the file states (x_mm, coordinateUnits)", width, limit)
    else:
        yield Doubt("/fiducials/points", message, width, limit)


def _say_units(subject: Subject, width: float) -> str:
    """In which unit the fiducials and targets would lie in the images of all views."""
    units = find_units_of_points(subject.document, _scene_of(subject), width)
    wide = [f"{unit} ({UNITS[unit] * width:.4g} mm)" for unit in units]
    if len(units) == 1:
        return f"In {wide[0]} they lie in all images: multiply by {UNITS[units[0]]:g}, or correct the unit"
    if units:
        return f"In {' and in '.join(wide)} they lie in all images: look up which it is, and correct the unit"
    return f"In none of {', '.join(UNITS)} would they lie in all images: check the unit of the positions"


def _scene_of(subject: Subject) -> WrittenPoints:
    return WrittenPoints.of(subject.document, subject.labels, subject.fiducials_mm)


def _doubt_source_distances(subject: Subject) -> Iterator[Doubt]:
    middle = subject.fiducials_mm.mean(axis=0)
    for index, view in enumerate(subject.document.views):
        at = f"/views/{index}"
        if isinstance(view, PresetView | DistanceView):
            for field, least in (
                ("source_detector_mm", SHORTEST_DETECTOR_MM),
                ("source_isocentre_mm", SHORTEST_ISOCENTRE_MM),
            ):
                length = getattr(view, field)
                if length is not None and length < least:
                    message = _describe_distance(subject, view, field, length, least)
                    yield Doubt(f"{at}/{field}", message, length, least)
        elif subject.system is not None:
            field = "pose" if isinstance(view, PinholeView) else "projection"
            length = float(np.linalg.norm(camera_centre(subject.system.views[index].projection) - middle))
            if length < SHORTEST_ISOCENTRE_MM:
                what = "the distance of the source from the middle of the fiducials"
                message = _describe_distance(subject, view, what, length, SHORTEST_ISOCENTRE_MM)
                yield Doubt(f"{at}/{field}", message, length, SHORTEST_ISOCENTRE_MM)


def _describe_distance(
    subject: Subject, view: PresetView | DistanceView | PinholeView | MatrixView, what: str, length: float, least: float
) -> str:
    meant = say_meanings(view, _scene_of(subject)) or f"check its unit, which is mm: none of {', '.join(UNITS)} fits"
    short = f"view {view.name}: {what} is {length:.4g} mm, less than {least:g} mm: no C-arm is that short"
    return f"{short}. {meant[0].upper()}{meant[1:]}."


def _doubt_detector_widths(subject: Subject) -> Iterator[Doubt]:
    for index, view in enumerate(subject.document.views):
        if not isinstance(view, PresetView):
            continue
        preset = PRESETS[view.preset]
        if preset.pixel_mm is None or preset.image_size_px is None:
            continue
        pixel, size = view.pixel_mm or preset.pixel_mm, view.image_size_px or preset.image_size_px
        ratios = [
            pixel * own / (preset.pixel_mm * known) for own, known in zip(size, preset.image_size_px, strict=True)
        ]
        side = max((0, 1), key=lambda each: abs(ratios[each] - 1))
        if abs(ratios[side] - 1) <= SAME_WIDTH:
            continue
        own, known, way = size[side], preset.image_size_px[side], ("wide", "high")[side]
        width, published = pixel * own, preset.pixel_mm * known
        if view.image_size_px is None:
            field, whole = (
                "pixel_mm",
                f"image_size_px: [{', '.join(f'{s * preset.pixel_mm / pixel:.0f}' for s in size)}]",
            )
        else:
            field, whole = "image_size_px", f"pixel_mm: {published / own:.6g}"
        binned = (
            f"binned {known // own} x {known // own}" if own < known and known % own == 0 else "binned or resampled"
        )
        sentences = []
        if abs(ratios[0] / ratios[1] - 1) <= SAME_WIDTH:  # else no pixel makes both sides those of the preset
            sentences.append(f"An image of the whole detector, {binned}, has {whole}.")
        if max(ratios) <= 1 + SAME_WIDTH:
            sentences.append("Of a crop the numbers are right as they are.")
        message = (
            f"view {view.name}: its detector is {width:.4g} mm {way} ({own} px of {pixel:.4g} mm), that of "
            f"{preset.name} {published:.4g} mm ({known} px of {preset.pixel_mm:.4g} mm). "
            f"{' '.join(sentences) or 'Check image_size_px and pixel_mm.'}"
        )
        yield Doubt(f"/views/{index}/{field}", message, width, published)


# --- angles ---------------------------------------------------------------------------------------------


def _doubt_angles(subject: Subject) -> Iterator[Doubt]:
    for pointer, angle in _list_angles(subject.document):
        turn = angle and next((each for each in TURNS if abs(abs(angle) - each) <= SAME_TURN * each), None)
        if turn:
            degrees = round(turn * 180 / pi) * (1 if angle > 0 else -1)
            meant = f"{degrees} degrees in radians. Write {degrees} if that is meant."
            message = f"{_name(pointer)}: {angle:g} in a field of degrees is {meant}"
            yield Doubt(pointer, message, angle, degrees)


def _list_angles(document: DesignDocument) -> Iterator[tuple[str, float]]:
    """(pointer, degrees) of every rotation that is written as angles."""
    poses = [(f"/views/{k}/pose", view.pose) for k, view in enumerate(document.views) if isinstance(view, PinholeView)]
    transforms = document.transforms
    poses += [(f"/transforms/{name}", getattr(transforms, name)) for name in ("T_flange_con", "T_tcp_flange")]
    for at, pose in poses:
        if isinstance(pose, Pose) and pose.rotation_deg is not None:
            yield from ((f"{at}/rotation_deg/{axis}", angle) for axis, angle in enumerate(pose.rotation_deg))
    for at, bias in _list_biases(document):
        yield from ((f"{at}/{axis}_deg", getattr(bias, f"{axis}_deg")) for axis in _ROTATIONS)


def _list_biases(document: DesignDocument) -> Iterator[tuple[str, Bias]]:
    for name, interface in _list_interfaces(document):
        yield f"/interfaces/{name}/bias", interface.bias
    if document.execution.hand_eye is not None:
        yield "/execution/hand_eye/bias", document.execution.hand_eye.bias


def _list_interfaces(document: DesignDocument) -> Iterator[tuple[str, Interface]]:
    for name in INTERFACES:
        interface: Interface | None = getattr(document.interfaces, name)
        if interface is not None:
            yield name, interface


# --- half-widths ----------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class _HalfWidth:
    pointer: str
    name: str  # as budgets call it
    size: float
    unit: str  # deg or mm
    seat: bool  # of an interface: the ladder of seats applies at its wide end too


def _list_half_widths(document: DesignDocument) -> Iterator[_HalfWidth]:
    """Every half-width of a part that is made or seated; the scatter of a robot is none of them."""
    manufacturing = document.fiducials.manufacturing
    if manufacturing is not None:
        at, widths = "/fiducials/manufacturing/half_width_mm", manufacturing.half_width_mm
        if isinstance(widths, tuple):
            for number, (axis, width) in enumerate(zip("xyz", widths, strict=True)):
                yield _HalfWidth(f"{at}/{number}", f"fiducials {axis}", width, "mm", True)
        else:
            yield _HalfWidth(at, "fiducials", widths, "mm", True)
    for name, interface in _list_interfaces(document):
        if interface.tolerances is not None:
            yield from _list_components(interface.tolerances, f"/interfaces/{name}/tolerances", name, seat=True)
        for index, locator in enumerate(interface.locators or ()):
            at = f"/interfaces/{name}/locators/{index}/half_width_mm"
            yield _HalfWidth(at, f"{name} {locator.name}", locator.half_width_mm, "mm", True)
    if document.execution.hand_eye is not None:
        at = "/execution/hand_eye/tolerances"
        yield from _list_components(document.execution.hand_eye.tolerances, at, "hand_eye", seat=False)


def _list_components(tolerances: Tolerances, at: str, name: str, *, seat: bool) -> Iterator[_HalfWidth]:
    for component in _COMPONENTS:
        entry = getattr(tolerances, component)
        if entry is not None:
            unit = "deg" if component in _ROTATIONS else "mm"
            field = f"half_width_{unit}"
            yield _HalfWidth(f"{at}/{component}/{field}", f"{name} {component}", getattr(entry, field), unit, seat)


def _doubt_fine_half_widths(subject: Subject) -> Iterator[Doubt]:
    for width in _list_half_widths(subject.document):
        least = FINEST_DEG if width.unit == "deg" else FINEST_MM
        if 0 < width.size < least:  # 0 says on purpose that it does not vary
            unit, factor = ("radians", 180 / pi) if width.unit == "deg" else ("metres", 1000.0)
            meant = width.size * factor
            cure = f"If {unit} were meant, write {meant:.3g}. " if meant >= least else "Check its unit. "
            message = (
                f"{width.name}: a half-width of {width.size:g} {width.unit} is finer than a kinematic coupling repeats "
                f"({least:g} {width.unit}). {cure}If it does not vary at all, write 0."
            )
            yield Doubt(width.pointer, message, width.size, least)


def _doubt_wide_half_widths(subject: Subject) -> Iterator[Doubt]:
    for width in _list_half_widths(subject.document):
        most = WIDEST_DEG if width.unit == "deg" else WIDEST_MM
        if width.seat and width.size > most:
            why = f"wider than the play of a clip-on seat ({most:g} {width.unit})"
            if width.pointer.startswith("/fiducials"):
                why = f"ten times ({most:g} mm) what is asked of the beads of a calibration object, and more"
            message = (
                f"{width.name}: a half-width of {width.size:g} {width.unit} is {why}. Check the unit, and that it is "
                "half of the width and not a sum over parts."
            )
            yield Doubt(width.pointer, message, width.size, most)


def _doubt_repeatability(subject: Subject) -> Iterator[Doubt]:
    scatter = subject.document.execution.repeatability
    if scatter is None:
        return
    for field in ("std_mm", "half_width_mm"):
        stated = getattr(scatter, field)
        axes = enumerate(stated) if isinstance(stated, tuple) else [("", stated)]
        for axis, width in axes:
            if width is not None and width > WIDEST_REPEATABILITY_MM:
                at = f"/execution/repeatability/{field}" + (f"/{axis}" if isinstance(stated, tuple) else "")
                unit = guess_unit(width, 0.005, 0.5) or " Check its unit, which is mm."
                message = (
                    f"repeatability {field} is {width:g} mm; robots repeat a position to some 0.02 to 0.5 mm, and "
                    f"{WIDEST_REPEATABILITY_MM:g} mm is no robot's data sheet.{unit}"
                )
                yield Doubt(at, message, width, WIDEST_REPEATABILITY_MM)


def _doubt_limits(subject: Subject) -> Iterator[Doubt]:
    for index, requirement in enumerate(subject.document.requirements):
        if requirement.limit_mm > WIDEST_LIMIT_MM:
            unit = guess_unit(requirement.limit_mm, 0.1, 5.0) or " Check its unit, which is mm."
            message = (
                f"requirement {requirement.name}: a limit of {requirement.limit_mm:g} mm is wider than any anatomy a "
                f"robot is asked to keep clear of ({WIDEST_LIMIT_MM:g} mm).{unit}"
            )
            yield Doubt(f"/requirements/{index}/limit_mm", message, requirement.limit_mm, WIDEST_LIMIT_MM)


# --- noise and lever arms -------------------------------------------------------------------------------


def _list_noises(subject: Subject) -> Iterator[tuple[str, str, float]]:
    """Each noise of a view: its place, what it is called, and its size in px."""
    for index, view in enumerate(subject.document.views):
        for field in ("fiducial_noise_px", "target_noise_px"):
            yield f"/views/{index}/{field}", f"view {view.name}: {field}", getattr(view, field)


def _doubt_noise(subject: Subject) -> Iterator[Doubt]:
    for pointer, name, noise in _list_noises(subject):
        if noise < BEST_NOISE_PX:
            message = (
                f"{name} is {noise:g} px, less than the best that was measured ({BEST_NOISE_PX:g} px): the error comes "
                "out too small. Write 0.05 for the best, 0.3 for typical, 0.5 for clinical images."
            )
            yield Doubt(pointer, message, noise, BEST_NOISE_PX)


def _doubt_noise_above(subject: Subject) -> Iterator[Doubt]:
    for pointer, name, noise in _list_noises(subject):
        if noise > WORST_NOISE_PX:
            message = (
                f"{name} is {noise:g} px, more than that of a bead clicked by hand ({WORST_NOISE_PX:g} px at most). It "
                "is a standard deviation, in pixels: write 0.3 for typical images, 0.5 for clinical ones."
            )
            yield Doubt(pointer, message, noise, WORST_NOISE_PX)


# --- what is said in per cent ---------------------------------------------------------------------------


def _doubt_shares(subject: Subject) -> Iterator[Doubt]:
    for pointer, name, share in _list_shares(subject.document):
        if abs(share) > LARGEST_SHARE:
            message = (
                f"{name} is {share:g}, which is {100 * share:g} %. If {share:g} % is meant, write {share / 100:g}."
            )
            yield Doubt(pointer, message, share, LARGEST_SHARE)


def _list_shares(document: DesignDocument) -> Iterator[tuple[str, str, float]]:
    """(pointer, name, value) of every part of one that is usually said in per cent."""
    for kind in EFFECTS:
        yield from kind.shares(document)
    fiducials = document.fiducials
    every = [("/fiducials", "loss_probability", fiducials.loss_probability)]
    for index, point in enumerate(fiducials.points or ()):
        name = f"{point.label or f'F{index + 1}'}: loss_probability"
        every.append((f"/fiducials/points/{index}", name, point.loss_probability))
    yield from ((f"{at}/loss_probability", name, value) for at, name, value in every if value is not None)


def _doubt_lever_arms(subject: Subject) -> Iterator[Doubt]:
    turning = [
        (name, interface)
        for name, interface in _list_interfaces(subject.document)
        if interface.tolerances is not None
        and any((entry := getattr(interface.tolerances, axis)) and entry.half_width_deg > 0 for axis in _ROTATIONS)
    ]
    for target in subject.document.targets:
        for name, interface in turning:
            lever = _reach(target, interface.pivot_mm)
            if lever < BEAD_MM:
                message = (
                    f"target {target.name} lies within {lever:.2g} mm of the pivot of {name}, nearer than the diameter "
                    f"of a bead ({BEAD_MM:g} mm): rotations of that seat have no lever arm there. The pivot is the "
                    "place of the seat, not of the target: check both."
                )
                yield Doubt(f"/interfaces/{name}/pivot_mm", message, lever, BEAD_MM)


def _reach(target: TargetDocument, pivot: tuple[float, float, float]) -> float:
    """Distance of a target from a pivot, of a region's farthest point, mm."""
    if target.position_mm is not None:
        return dist(target.position_mm, pivot)
    region = target.region
    assert isinstance(region, Region)
    if region.sphere is not None:
        return dist(region.sphere.centre_mm, pivot) + region.sphere.radius_mm
    assert region.box is not None
    offsets = zip(region.box.centre_mm, region.box.size_mm, pivot, strict=True)
    return hypot(*(abs(centre - at) + size / 2 for centre, size, at in offsets))


def _doubt_pivots(subject: Subject) -> Iterator[Doubt]:
    targets = [target.position_mm for target in subject.document.targets if target.position_mm is not None]
    if not targets:
        return
    points, middle = np.vstack([subject.fiducials_mm, *targets]), subject.fiducials_mm.mean(axis=0)
    low, high, away = points.min(axis=0), points.max(axis=0), middle - np.mean(targets, axis=0)

    def among(place: Array) -> bool:
        return bool(((place > low) & (place < high)).all())

    def behind(place: Array) -> bool:
        return bool((place - middle) @ away > 0)

    for name, interface in _list_interfaces(subject.document):
        pivot = np.array(interface.pivot_mm)
        if pivot.any() and among(pivot) and behind(10 * pivot) and not among(10 * pivot):
            depth = float(np.minimum(pivot - low, high - pivot).min())
            written = ", ".join(f"{10 * value:g}" for value in interface.pivot_mm)
            message = (
                f"the pivot of {name} lies among the fiducials and targets, {depth:.3g} mm inside the box about them. "
                "It is the place of a seat, which lies behind the structure; tolerances turn about it. "
                f"If it is in centimetres, write [{written}]."
            )
            yield Doubt(f"/interfaces/{name}/pivot_mm", message, depth, 0.0)


def _doubt_targets_in_beads(subject: Subject) -> Iterator[Doubt]:
    diameter = subject.document.fiducials.diameter_mm
    radius = (BEAD_MM if diameter is None else diameter) / 2
    for index, target in enumerate(subject.document.targets):
        if target.position_mm is None:
            continue
        away = np.linalg.norm(subject.fiducials_mm - target.position_mm, axis=1)
        if away.min() < radius:
            size = "its radius" if diameter is not None else f"the radius of a bead of {BEAD_MM:g} mm"
            label = f"fiducial {subject.labels[int(away.argmin())]}"
            message = (
                f"target {target.name} lies {away.min():.3g} mm from the centre of {label}, nearer than {size} "
                f"({radius:g} mm): a tool cannot go there while the bead is in place. Check both positions."
            )
            yield Doubt(f"/targets/{index}/position_mm", message, float(away.min()), radius)


_RULES = (
    PlausibilityTest(
        "structure-size",
        "A structure that is too small for its beads or too large for a detector",
        "15 mm: five beads of 3 mm, a judgement. 750 mm: the space diagonal of a cube as wide as the widest detector "
        "among the presets, 1440 px of 0.3 mm.",
        _doubt_structure_size,
        slip=True,
    ),
    PlausibilityTest(
        "source-distance",
        "A source that is nearer than that of any C-arm",
        "Detector below 200 mm, isocentre (or, of a calibrated view, the middle of the fiducials) below 100 mm: a "
        "judgement. Published C-arms have 1020-1260 mm and 530-810 mm, which is 102-126 and 53-81 in cm.",
        _doubt_source_distances,
        slip=True,
    ),
    PlausibilityTest(
        "detector-width",
        "A detector of another width than that of its preset",
        "1 %, of the larger difference of width and height: the widths of presets are published to some 0.1 %. A crop "
        "is remarked too, because nothing tells it from an image that was binned.",
        _doubt_detector_widths,
        slip=True,
    ),
    PlausibilityTest(
        "angle-in-radians",
        "An angle in a degree field that is a round angle in radians",
        "Multiples of 30 and 45 degrees to 0.06 %, so that 1.57 counts: a judgement.",
        _doubt_angles,
        slip=True,
    ),
    PlausibilityTest(
        "half-width-too-fine",
        "A half-width finer than a kinematic coupling repeats",
        "0.0001 mm: kinematic couplings repeat to less than 0.1 um (Schouten 1997); 0.002 degrees: a judgement from "
        "it. 0 is not remarked: it says that nothing varies.",
        _doubt_fine_half_widths,
    ),
    PlausibilityTest(
        "half-width-too-wide",
        "A half-width wider than the play of a clip-on seat",
        "1 degree and 1 mm: the play of a clip-on plate, 0.5 mm at each of two pins 50 mm apart, gives 0.57 to 1.15 "
        "degrees; a judgement. Beads of calibration objects are placed within 0.1 mm (XMALab). Calibration of hand to "
        "eye is not held to it: its measured standard deviation is up to 0.65 mm (arXiv 2404.05884).",
        _doubt_wide_half_widths,
    ),
    PlausibilityTest(
        "noise-too-small",
        "Image noise of zero, or below the best that was measured",
        "0.015 px: the centroid of a bead at 0.26 mm pixels is located to 0.015-0.05 px (Zhang 2015).",
        _doubt_noise,
    ),
    PlausibilityTest(
        "noise-too-large",
        "Image noise beyond that of a bead clicked by hand",
        "5 px: a judgement, a third of the image of a small bead. Clicks by hand scatter by one to two pixels.",
        _doubt_noise_above,
    ),
    PlausibilityTest(
        "repeatability-too-wide",
        "A robot that does not repeat a position",
        "1 mm: a judgement; data sheets by ISO 9283 state 0.02 to 0.5 mm.",
        _doubt_repeatability,
    ),
    PlausibilityTest(
        "limit-too-wide",
        "A limit beyond any anatomy",
        "20 mm: a judgement; safe zones are 2 to 4 mm (pedicle screws) and at most some 10 mm. 600 is 0.6 in um.",
        _doubt_limits,
    ),
    PlausibilityTest(
        "share-in-percent",
        "A part of one that looks like per cent",
        "0.2: a judgement; errors of the focal length up to 0.14 were tried on five C-arms (arXiv 2603.14031).",
        _doubt_shares,
    ),
    PlausibilityTest(
        "no-lever-arm",
        "A target at the pivot of a seat that may turn",
        "3 mm: the diameter of a bead, a judgement.",
        _doubt_lever_arms,
    ),
    PlausibilityTest(
        "pivot-among-fiducials",
        "A seat among the fiducials and targets that is behind them in centimetres",
        "Inside the box about fiducials and targets, and ten times the pivot outside of it, on the far side from the "
        "targets: a judgement. A pivot of [0, 0, 0], as when it is left out, is not remarked.",
        _doubt_pivots,
    ),
    PlausibilityTest(
        "target-in-bead",
        "A target inside a fiducial",
        "The radius that the design gives, otherwise 1.5 mm: that of a bead of 3 mm.",
        _doubt_targets_in_beads,
    ),
)

PLAUSIBILITY: dict[str, PlausibilityTest] = {
    rule.id: rule for rule in (*_RULES, *(rule for kind in EFFECTS for rule in kind.doubts))
}
