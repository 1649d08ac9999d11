"""Design -> System: degrees to radians, views to projections, locators to torsors, regions to points, once.

Presets of views are filled in, poses are read, and the rounding of written rotations is taken out.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import chain
from typing import Any

import numpy as np

from ..effects import EFFECTS
from ..effects.kind import Setting
from ..errors import DesignError, IllPosedError, Problem
from ..estimation.checks import direction_name, examine, point_name
from ..geometry.arrays import Array, frozen
from ..geometry.camera import depths
from ..laws import Drawn
from ..measures import MEASURE, Metric
from ..measures.measure import DRAWN_ANEW, TWO_SHOTS, MeasuredBody
from ..results import Finding, ViewCheck
from ..system import (
    DirectEffect,
    Effect,
    Law,
    Place,
    Requirement,
    Sources,
    System,
    Target,
    View,
    execution_of,
    mount,
    no_sources,
)
from ..tolerances import Source, coverage_of, gather_sources
from .consistency import describe_condition, expand_target, find_pivots, list_hosts
from .document import DesignDocument, Execution, FiducialOrigin, Fiducials, HandEye, Interface, RequirementDocument
from .features import MOTIONS, ROUND, Feature, FittedFeature, Part
from .frames import compile_transform, compile_view, find_detector, read_surface_of
from .loading import Design, list_assumed
from .meanings import WrittenPoints, explain_places
from .optimise_document import surfaces_in
from .plausibility import explain_refusal, find_implausible
from .refusals import place


def compile_design(design: Design) -> System:
    """Compile a design; mm, rad and px from here on.

    Raises DesignError (a transform that is not rigid) and IllPosedError (locators that leave a motion
    free, a projection without a source), with the place in the document.
    """
    try:
        return _compile(design)
    except (DesignError, IllPosedError) as error:
        raise _explain(design, error, None) from None


def _compile(design: Design) -> System:
    document = design.document
    fiducials = frozen(design.fiducials.positions_mm)
    notes = _list_notes(design.fiducials.origin, *(document.target_origins or ()))
    for surface in surfaces_in(document.optimise).values():
        notes += read_surface_of(surface).remarks
    views = tuple(compile_view(view, f"/views/{index}", fiducials, notes) for index, view in enumerate(document.views))
    made = document.fiducials.manufacturing
    transforms = document.transforms
    if transforms.T_flange_con is None and transforms.T_tcp_flange is None:
        notes.append("no transforms are given: the tcp frame is the connector frame")
    effects = tuple(_effects(document, views))
    unread = [str(view) for effect in effects for place, view in effect.places if place is Place.INTRINSICS]
    if unread and not document.model.estimator.believes_intrinsics:
        notes.append(
            f"what is said of the intrinsics of view {', '.join(unread)} has no effect: the estimator "
            f"{document.model.estimator} estimates them without assuming any"
        )
    samples = {target.name: expand_target(target) for target in document.targets}
    targets = tuple(chain.from_iterable(samples.values()))
    ended = ((each, TWO_SHOTS if each.two_shots else DRAWN_ANEW) for each in targets if each.entry is not None)
    notes += [f"trajectory {each.entry} to {each.name}: {ends}" for each, ends in ended]
    notes += [describe_condition(document, body) for body in document.bodies]
    refuse_behind_detector(design, views, fiducials, targets)
    flange_con = compile_transform(transforms.T_flange_con, "/transforms/T_flange_con", notes)
    tcp_flange = compile_transform(transforms.T_tcp_flange, "/transforms/T_tcp_flange", notes)
    half_width = np.broadcast_to(0.0 if made is None else made.half_width_mm, fiducials.shape)
    groups = {body.name: tuple(body.targets) for body in document.bodies}
    named = [named_samples(item, samples, groups) for item in document.requirements]
    asked = [(item.measure, tuple(names)) for item, names in zip(document.requirements, named, strict=True)]
    system = System(
        design_sha256=design.sha256,
        name=document.name,
        views=views,
        fiducial_labels=design.fiducials.labels,
        fiducials_mm=fiducials,
        manufacturing_law=Law.NORMAL if made is None else Law(made.distribution),
        manufacturing_half_width_mm=frozen(half_width),
        manufacturing_coverage_factor=1.0 if made is None else coverage_of(made.distribution, made.coverage_factor),
        manufacturing_drawn=Drawn.UNIT if made is None else made.drawn,
        structure_connector=_interface(document.interfaces.structure_connector, "structure_connector", notes),
        connector_flange=_interface(document.interfaces.connector_flange, "connector_flange", notes),
        T_flange_con=flange_con,
        T_tcp_flange=tcp_flange,
        hand_eye=_hand_eye(document.execution.hand_eye, notes),
        execution=_execution(document.execution),
        targets=targets,
        requirements=(),
        bodies=tuple(
            [MeasuredBody(body.name, groups[body.name], groups.get(body.against or "", ())) for body in document.bodies]
        ),
        demands={error: tuple(names for each, names in asked if each == error) for error, _ in asked},
        reading=document.model.installation_reading,
        rotation_form=document.model.rotation,
        estimator=document.model.estimator,
        triangulation=document.model.triangulation,
        effects=effects,
        fiducial_radius_mm=None if document.fiducials.diameter_mm is None else document.fiducials.diameter_mm / 2,
        loss_probability=loss_probabilities(document.fiducials, len(fiducials)),
        notes=tuple(notes),
        assumed=list_assumed(design.source.data),
        title_block=None if document.document is None else document.document.model_dump(),
    )
    _refuse_two_shots(system, [target.name for target in document.targets])
    metrics = system.metrics
    listed = enumerate(zip(document.requirements, named, strict=True))
    return replace(
        system,
        requirements=tuple([_requirement(item, f"/requirements/{k}", names, metrics) for k, (item, names) in listed]),
    )


def _refuse_two_shots(system: System, names: Sequence[str]) -> None:
    """Where what a shot draws cannot be drawn for each end; names: of the targets, as in the document."""
    two = next((each for each in system.targets if each.two_shots), None)
    if two is None:
        return
    drawn = (each for each in (*system.effects, *system.links) if each.drawn is Drawn.SHOT)
    bounded = [each.label for each in drawn if each.sources.are_bounded.any()]
    missed = ["which fiducials a shot misses"] if system.loss_probability else []
    if bounded + missed:
        detail = f"{', '.join(bounded + missed)}: not known of two shots"
        hint = "leave ends out, or state a law in place of bounded, and no loss_probability"
        raise DesignError(Problem(f"/targets/{names.index(two.name)}/ends", "two-shots", detail, hint))


def _effects(document: DesignDocument, views: tuple[View, ...]) -> Iterator[Effect]:
    """What is declared, one kind after the other, and each in the views as they stand."""
    pivots, hosts = find_pivots(document), list_hosts(document)
    for kind in EFFECTS:
        pointer = "" if kind.host == "design" else f"/{kind.host}"
        for index, record in enumerate(hosts[kind.host]):
            at, seen = (f"/views/{index}", views[index : index + 1]) if kind.host == "view" else (pointer, views)
            yield from kind.compile(record, Setting(at, seen, pivots))


# --- mounts -----------------------------------------------------------------------------------------


def _perfect(name: str) -> DirectEffect:
    return mount(name, frozen(np.zeros(3)), frozen(np.zeros(6)), no_sources(6))


def _interface(interface: Interface | None, name: str, notes: list[str]) -> DirectEffect:
    if interface is None:
        return _perfect(name)
    pivot, known = frozen(interface.pivot_mm), interface.bias.torsor
    sources = no_sources(6)
    if interface.tolerances is not None:
        sources = interface.tolerances.sources
    elif interface.locators is not None:
        held = interface.locators
        places, normals = (np.array([getattr(each, at) for each in held]) for at in ("position_mm", "normal"))
        direction = torsor_from_locators(places, normals, pivot, f"/interfaces/{name}/locators")
        stated = [
            Source(locator.name, locator.distribution, locator.half_width_mm, locator.coverage_factor, "mm", way)
            for locator, way in zip(held, direction.T, strict=True)
        ]
        sources = gather_sources(stated, 6)
    elif interface.features is not None:
        sources, middle = torsor_of_features(interface.features, pivot, f"/interfaces/{name}/features")
        known = frozen(known + middle)
        notes += _list_notes(interface.origin)
        notes += [f"{name} {each.name}, {each.words}" for each in interface.features]
        notes += [f"{name}: {ROUND}"] if any(isinstance(each, FittedFeature) for each in interface.features) else []
    return mount(name, pivot, known, sources, interface.label, interface.drawn)


def torsor_of_features(
    features: Sequence[Feature],
    pivot_mm: Array,
    pointer: str,
    instead: Mapping[tuple[str, str], Sequence[Part]] | None = None,
) -> tuple[Sources, Array]:
    """The scalars of every item of these features, each group of them one line of the budget, and the torsor (6,) of
    the middles of what they state, to first order.  ``instead``: other scalars of items, by feature and item."""
    contacts = [contact for feature in features for contact in feature.contacts]
    spare = contacts[:1] * (MOTIONS - len(contacts))  # said twice, a contact holds nothing more: the rest is named
    points, normals = (np.array(each) for each in zip(*contacts, *spare, strict=True))
    torsor = torsor_from_locators(points, normals, pivot_mm, pointer, "features")
    stated: list[Source] = []
    together, first, middle = [], 0, np.zeros(6)
    for feature in features:
        own = torsor[:, first : first + len(feature.contacts)]
        first += len(feature.contacts)
        middle += own @ feature.offset
        for item in feature.items():
            name, begin = f"{feature.name} {item.name}", len(stated)
            parts = (instead or {}).get((feature.name, item.name), item.parts)
            for k, part in enumerate(parts):
                called = f"{name}, {k + 1}" if k else name
                stated.append(Source(called, part.law, part.half_width, None, "mm", own @ part.weights))
            together += [tuple(range(begin, len(stated)))] if len(parts) > 1 else []
    return replace(gather_sources(stated, 6), together=tuple(together)), middle


def _list_notes(*origins: FiducialOrigin | None) -> list[str]:
    """What was done on the way to numbers that were read from files, in words."""
    return [note for origin in origins if origin is not None for note in origin.list_notes()]


def _hand_eye(hand_eye: HandEye | None, notes: list[str]) -> DirectEffect:
    if hand_eye is None:
        return _perfect("hand_eye")
    sources, label = hand_eye.tolerances.sources, "hand-eye calibration"
    notes += _list_notes(hand_eye.origin)
    return mount("hand_eye", frozen(hand_eye.pivot_mm), hand_eye.bias.torsor, sources, label, hand_eye.drawn)


def _execution(execution: Execution) -> DirectEffect:
    stated: list[Source] = []
    bias = np.zeros(3)
    if (scatter := execution.repeatability) is not None:
        if scatter.std_mm is not None:
            stated += _along_axes("repeatability", "mm", np.eye(3), scatter.std_mm, "normal", 1.0)
        else:
            law = scatter.distribution or "normal"
            stated += _along_axes("repeatability", "mm", np.eye(3), scatter.half_width_mm, law, scatter.coverage_factor)
    if (load := execution.compliance) is not None:
        matrix = np.array(load.matrix_mm_per_n)
        bias = matrix @ np.array(load.load_n)
        if (width := load.load_half_width_n) is not None:
            stated += _along_axes("load", "N", matrix, width, load.distribution or "normal", load.coverage_factor)
    return execution_of(gather_sources(stated, 3), frozen(bias), execution.drawn)


def _along_axes(
    name: str, unit: str, direction: Array, half_width: Any, law: str, coverage_factor: float | None
) -> list[Source]:
    widths = [half_width] * 3 if isinstance(half_width, float | int) else half_width
    return [
        Source(f"{name}.{axis}", law, width, coverage_factor, unit, way)
        for axis, width, way in zip("xyz", widths, direction.T, strict=True)
        if way.any()
    ]


def loss_probabilities(fiducials: Fiducials, count: int) -> tuple[float, ...]:
    """Of each of ``count`` fiducials in a shot; () where none is ever missed."""
    every = fiducials.loss_probability or 0.0
    own = [point.loss_probability for point in fiducials.points or ()] or [None] * count
    each = tuple(every if probability is None else probability for probability in own)
    return each if any(each) else ()


# --- targets ----------------------------------------------------------------------------------------


def named_samples(
    item: RequirementDocument, samples: dict[str, tuple[Target, ...]], bodies: dict[str, tuple[str, ...]]
) -> list[str]:
    """Names of the targets that a requirement names, samples of regions and targets of bodies by themselves."""
    each = {name: [target.name for target in targets] for name, targets in samples.items()}
    of_bodies = chain.from_iterable(bodies[name] for name in bodies if name in item.targets)
    wanted = {name for name in each if item.targets == "all" or name in item.targets} | set(of_bodies)
    return list(chain.from_iterable(names for name, names in each.items() if name in wanted))


def _requirement(item: RequirementDocument, pointer: str, names: list[str], metrics: tuple[Metric, ...]) -> Requirement:
    own = (metric.site for metric in metrics if metric.measure.name == item.measure)
    sites = tuple([site.name for site in own if site.name in item.targets or set(names).issuperset(site.weights)])
    if not sites:
        detail = f"{MEASURE[item.error].words} is read nowhere among the targets that are named"
        raise DesignError(Problem(f"{pointer}/targets", "no-site", detail, f"it takes {MEASURE[item.error].needs}"))
    asked: tuple[str, int | None, float | None] = item.statistic, item.n, item.limit_probability
    if item.risk != "pooled" and item.limit_probability is not None:
        asked = "quantile", None, None  # each unit keeps its share beyond the limit where it keeps its own quantile
    promised = item.name, item.measure, item.pooled_quantile, item.limit, item.confidence
    return Requirement(*promised, sites, item.risk, item.min_yield, *asked, tuple(item.ids))


def refuse_behind_detector(
    design: Design, views: tuple[View, ...], fiducials: Array, targets: tuple[Target, ...]
) -> None:
    """A distance to the detector is known for aimed views only; the System no longer holds it."""
    points = np.concatenate([fiducials, [target.position_mm for target in targets]])
    labels = design.fiducials.labels
    for index, (compiled, detector) in enumerate(zip(views, map(find_detector, design.document.views), strict=True)):
        depth = depths(compiled.projection, points)
        if compiled.sees is not None:
            depth[: len(labels)][[label not in compiled.sees for label in labels]] = -np.inf
        worst = depth.argmax()
        if depth[worst] > detector:
            count = len(fiducials)
            name = f"target {targets[worst - count].name}" if worst >= count else f"fiducial {labels[worst]}"
            detail = f"{name} lies {depth[worst]:.4g} mm from the source of view {compiled.name}, behind its detector "
            cure = "check the isocentre, the direction of the beam and the frame of the coordinates"
            raise IllPosedError(Problem(f"/views/{index}", "behind-detector", f"{detail}at {detector:g} mm", cure))


def check_design(design: Design) -> tuple[System, tuple[Finding, ...], tuple[ViewCheck, ...]]:
    """Compile and check: the system, remarks on its geometry and on implausible values, and what each view sees.

    Raises DesignError and IllPosedError with the file, line and column of the section they are about.
    """
    system = compile_design(design)
    try:
        findings, views = examine(system)
    except IllPosedError as error:
        raise _explain(design, error, system) from None
    return system, (*findings, *find_implausible(design, system)), views


def _explain(design: Design, error: DesignError | IllPosedError, system: System | None) -> DesignError | IllPosedError:
    """The refusal with its places in the document; that of a geometry with what the numbers may have been meant as."""
    source, problems = design.source.with_places(), list(error.problems)
    if isinstance(error, IllPosedError):
        scene = WrittenPoints.of(design.document, design.fiducials.labels, np.array(design.fiducials.positions_mm))
        problems = [*explain_places(design.document, scene, problems), *_name_left_out(design)]
        problems += explain_refusal(design, system)
    return type(error)([place(problem, source) for problem in problems])


def _name_left_out(design: Design) -> list[Problem]:
    """What a fiducial file holds and the design does not: it may be why too little is there."""
    if (origin := design.fiducials.origin) is None:
        return []
    pointer = "/fiducials" if design.document.fiducials.file is None else "/fiducials/file"
    others = [f"{origin.file}: {remark}" for remark in origin.remarks if "left out" in remark]
    sentences = [origin.describe_left_out(), *others]
    return [Problem(pointer, "left-out", each) for each in sentences if each]


SINGULAR = 1e-9  # smallest over largest singular value, rotations measured at the contacts' own radius
HOLDING = {  # how a part is held that is not
    "six locators": "move or turn a locator so that it resists that motion (3-2-1: three on one face, two on the next, "
    "one on the third)",
    "features": "add, move or turn a feature so that it resists that motion (a pad holds three, a pin in a hole two, "
    "in a slot one, a rest one)",
}


def torsor_from_locators(
    positions_mm: Array, normals: Array, pivot_mm: Array, pointer: str = "", held_by: str = "six locators"
) -> Array:
    """Torsor at the pivot per mm of deviation of each contact.

    positions_mm (6, 3), normals (6, 3), pivot_mm (3,), all in con; normals of any length.  Returns (6, 6):
    rows (rx, ry, rz, tx, ty, tz) in rad/mm and mm/mm, columns the contacts.  Raises IllPosedError that
    names the motion the contacts leave free.
    """
    unit = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    centre = positions_mm.mean(axis=0)
    # Solve at the contacts' centre, in units of their radius: conditioning then says something about the seat
    # and nothing about where the pivot was put.
    radius = max(float(np.sqrt(((positions_mm - centre) ** 2).sum(axis=1).mean())), 1e-6)
    rows = np.hstack([np.cross((positions_mm - centre) / radius, unit), unit])
    left, values, right = np.linalg.svd(rows)
    if values[-1] <= SINGULAR * values[0]:
        free = right[values <= SINGULAR * values[0]]
        motions = [describe_motion(vector[:3] / radius, vector[3:], centre, radius) for vector in _tidy(free)]
        count = f"{len(motions)} motion{'s' * (len(motions) > 1)}"
        detail = f"the {held_by} leave {count} of the part free: {'; '.join(motions)}"
        raise IllPosedError(Problem(pointer, "free-motion", detail, HOLDING[held_by]))
    inverse = (right.T / values) @ left.T
    turn, shift = inverse[:3] / radius, inverse[3:]
    return np.vstack([turn, shift + np.cross(turn, pivot_mm - centre, axis=0)])


def _tidy(free: Array) -> Array:
    """A basis of the free motions in which most entries are zero: the one a person would name (row echelon)."""
    rows = free.copy()
    done = 0
    for column in range(rows.shape[1]):
        if done == len(rows):
            break
        pick = done + int(np.argmax(np.abs(rows[done:, column])))
        if abs(rows[pick, column]) < 1e-6:
            continue
        rows[[done, pick]] = rows[[pick, done]]
        rows[done] /= rows[done, column]
        for other in range(len(rows)):
            if other != done:
                rows[other] -= rows[other, column] * rows[done]
        done += 1
    rows[np.abs(rows) < 1e-7] = 0.0
    return np.asarray(rows / np.linalg.norm(rows, axis=1, keepdims=True))


def describe_motion(turn: Array, shift_mm: Array, at_mm: Array, radius_mm: float) -> str:
    """A rigid motion in words: ``turn`` (3,) rad and ``shift_mm`` (3,) of the point ``at_mm``."""
    rate = float(np.linalg.norm(turn))
    if rate * radius_mm < 1e-6 * float(np.linalg.norm(shift_mm)):
        return f"translation along {direction_name(shift_mm)}"
    axis = turn / rate
    point = at_mm + np.cross(axis, shift_mm) / rate  # where the screw axis passes closest to at_mm
    through = f"rotation about {direction_name(axis)} through {point_name(point)}"
    along = float(axis @ shift_mm)
    if abs(along) > 1e-6 * rate * radius_mm:
        return f"{through}, together with {along / np.rad2deg(rate):.3g} mm per degree along it"
    return through
