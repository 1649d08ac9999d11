"""Rules that span several fields: names that must be unique, references that must lead somewhere, sizes.

Among them are the rules of the ``optimise`` section that look at the rest of the document.  Sizes count the points that
a target stands for: itself, or samples of its region.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import chain, product
from math import comb, prod

import numpy as np

from ..cures import ask_label
from ..effects import EFFECTS
from ..effects.kind import Host
from ..errors import Problem
from ..fields import Record
from ..geometry.arrays import Array, frozen
from ..geometry.rotation import RotationForm
from ..measures.measure import Channel
from ..measures.rigid_fit import condition_number, spread_of
from ..results import Vector3
from ..system import ROTATIONS, TORSOR_COMPONENTS, TRANSLATIONS, Target
from .document import Box, DesignDocument, DistanceView, Interface, PresetView, Region, RigidBody, TargetDocument
from .drawn import check_freed
from .fiducial_files import FiducialList
from .optimise_document import AddedView, FreeView, Optimise
from .presets import PRESETS
from .reading import Limits


def check_document(document: DesignDocument, limits: Limits) -> Iterator[Problem]:
    """Everything that can be said before a fiducial file is opened."""
    yield from _too_many("/views", "views", len(document.views), limits.views)
    if document.optimise is not None and document.optimise.added_view is not None:
        with_one = len(document.views) + 1
        yield from _too_many("/optimise/views", "views with the one that may be added", with_one, limits.views)
    yield from _too_many("/fiducials/points", "fiducials", len(document.fiducials.points or ()), limits.fiducials)
    left_out = () if document.fiducials.origin is None else document.fiducials.origin.left_out
    yield from _too_many("/fiducials/origin/left_out", "points that were left out", len(left_out), limits.fiducials)
    yield from _too_many("/targets", "targets", sum(map(sample_count, document.targets)), limits.targets)
    yield from _too_many("/requirements", "requirements", len(document.requirements), limits.targets)
    yield from find_duplicates([view.name for view in document.views], "/views/{}/name".format, "views")
    named = [target.name for target in document.targets]
    yield from find_duplicates(named, "/targets/{}/name".format, "targets")
    yield from _expanded_names(document.targets)
    yield from _bodies(document)
    for index, target in enumerate(document.targets):
        if target.entry is not None:
            points = [t.name for t in document.targets if t.position_mm not in (None, target.position_mm)]
            yield from find_unknown(f"/targets/{index}/entry", "target elsewhere", target.entry, points)
            yield from _major_along(index, target, {t.name: t.position_mm for t in document.targets})
    promised = [item.name for item in document.requirements]
    yield from find_duplicates(promised, "/requirements/{}/name".format, "requirements")
    for index, view in enumerate(document.views):
        if isinstance(view, PresetView):
            yield from _preset(view, f"/views/{index}")
    for index, requirement in enumerate(document.requirements):
        yield from find_duplicates(requirement.ids, f"/requirements/{index}/ids/{{}}".format, "ids of a requirement")
        if requirement.targets != "all":
            known = [*named, *(body.name for body in document.bodies)]
            yield from check_entries(f"/requirements/{index}/targets", "target", requirement.targets, known)
        if requirement.error == "point_to_point":
            every = requirement.targets == "all"
            sizes = [sample_count(t) for t in document.targets if every or t.name in requirement.targets]
            distances = comb(sum(sizes), 2)
            yield from _too_many(f"/requirements/{index}/targets", "distances between them", distances, limits.targets)
    yield from _estimator(document)
    pivots, hosts = find_pivots(document), list_hosts(document)
    checks = [(kind.check, record) for kind in EFFECTS if kind.check for record in hosts[kind.host]]
    yield from (found for check, record in checks for found in check(record, pivots))
    yield from check_optimise(document, limits.fiducials)


def _major_along(index: int, target: TargetDocument, places: Mapping[str, Vector3 | None]) -> Iterator[Problem]:
    """A channel's major half-axis along the channel, which tells no direction across it."""
    entry, major = places.get(target.entry or ""), target.corridor_major_direction
    if major is None or entry is None or target.position_mm is None:
        return
    ahead = np.subtract(target.position_mm, entry)
    if np.linalg.norm(np.cross(ahead, major)) <= 1e-3 * np.linalg.norm(ahead) * np.linalg.norm(major):
        detail = f"{list(major)} is along the trajectory from {target.entry}: it tells no direction across it"
        hint = "give a direction across, such as that of the longer diameter of the pedicle"
        yield Problem(f"/targets/{index}/corridor_major_direction", "along-trajectory", detail, hint)


def find_pivots(document: DesignDocument) -> dict[str, Vector3]:
    """Pivots of the interfaces that are declared, con, mm."""
    return {name: interface.pivot_mm for name, interface in document.interfaces.by_name.items()}


def _estimator(document: DesignDocument) -> Iterator[Problem]:
    """What an estimator has to be told, and the rotations that it can follow."""
    model = document.model
    for index, view in enumerate(document.views):
        if model.estimator.traits.takes_prior and view.intrinsics_prior is None:
            detail = f"the estimator {model.estimator} weighs what it assumes of the intrinsics; view {view.name} does "
            cure = "intrinsics_prior: {focal_rel_sd: 0.01, principal_point_px_sd: 10}"
            yield Problem(f"/views/{index}", "missing-field", f"{detail}not say how well they are known", cure)
    if model.estimator.traits.seeks_pose and model.rotation is RotationForm.SMALL_ANGLE:
        detail = f"small_angle moves the structure by a map that is not rigid, which the estimator {model.estimator} "
        detail += "cannot follow: its intrinsics would be wrong by what the map stretches"
        yield Problem("/model/rotation", "not-rigid", detail, "rotation: full")


def check_fiducials(document: DesignDocument, fiducials: FiducialList) -> list[Problem]:
    """Labels: unique, and known where they are listed or the optimiser is told to keep them."""
    place = "/fiducials/file" if document.fiducials.points is None else "/fiducials/points/{}/label"
    problems = find_duplicates(fiducials.labels, place.format, "fiducials", document.fiducials.file, fiducials.lines)
    for pointer, _, labels in _list_fiducials(document):
        problems += check_entries(pointer, "fiducial", labels, fiducials.labels)
    return problems + check_optimise_labels(document, fiducials)


def _list_fiducials(document: DesignDocument) -> Iterator[tuple[str, str, Sequence[str]]]:
    """Pointer and labels of every list of fiducials beside the optimiser's own, and who lists what."""
    for index, view in enumerate(document.views):
        if view.sees is not None:
            yield f"/views/{index}/sees", f"view {view.name} lists the fiducials that it sees", view.sees
    for kind in EFFECTS:
        for record in list_hosts(document)[kind.host]:
            for pointer, labels in kind.list_fiducials(record) if kind.list_fiducials else ():
                yield pointer, f"{pointer} lists fiducials", labels


def list_hosts(document: DesignDocument) -> dict[Host, Sequence[Record]]:
    """The records that sections of effects stand in."""
    return {
        "design": [document],
        "execution": [document.execution],
        "fiducials": [document.fiducials],
        "view": document.views,
    }


def _too_many(pointer: str, what: str, count: int, limit: int) -> Iterator[Problem]:
    if count > limit:
        yield Problem(pointer, "too-many", f"{count} {what}; at most {limit} are accepted")


def _expanded_names(targets: Sequence[TargetDocument]) -> Iterator[Problem]:
    """A point that is called like a sample of a region (zone[3]) would be counted twice."""
    samples = {f"{t.name}[{i}]" for t in targets if t.region for i in range(min(sample_count(t), 10_000))}
    for i, t in enumerate(targets):
        if t.name in samples:
            detail = f"{t.name!r} is also the name of a sample of a region"
            yield Problem(f"/targets/{i}/name", "duplicate-name", detail)


def _bodies(document: DesignDocument) -> Iterator[Problem]:
    """Bodies have names of their own, and targets that are points, three of them not on one line."""
    points = {target.name: target.position_mm for target in document.targets if target.position_mm is not None}
    taken = list(dict.fromkeys(target.name for target in document.targets))
    names = [body.name for body in document.bodies]
    yield from find_duplicates([*taken, *names], lambda k: f"/bodies/{k - len(taken)}/name", "targets or bodies")
    for index, body in enumerate(document.bodies):
        pointer = f"/bodies/{index}"
        unknown = check_entries(f"{pointer}/targets", "target with position_mm", body.targets, list(points))
        yield from unknown
        if body.against is not None:
            others = [name for name in names if name != body.name]
            yield from find_unknown(f"{pointer}/against", "other body", body.against, others)
        if not unknown:
            spread = spread_of(places_of(document, body))
            if spread[1] <= 1e-3 * spread[0]:
                detail = f"the targets of {body.name} lie on a line: its rotation about it is not known"
                yield Problem(f"{pointer}/targets", "free-motion", detail, "add one beside it")


def places_of(document: DesignDocument, body: RigidBody) -> Array:
    """(K, 3) mm, con, of the targets of a body."""
    points = {target.name: target.position_mm for target in document.targets}
    return np.array([points[name] for name in body.targets])


def describe_condition(document: DesignDocument, body: RigidBody) -> str:
    """The condition number of its markers, 1/m."""
    number = condition_number(places_of(document, body))
    return f"body {body.name}: condition number of its targets {number:.0f} /m (in radiostereometry 150 or less)"


def _preset(view: PresetView, pointer: str) -> Iterator[Problem]:
    if (preset := PRESETS.get(view.preset)) is None:
        yield from find_unknown(f"{pointer}/preset", "preset", view.preset, list(PRESETS))
        return
    for name in preset.view_must_state:
        if getattr(view, name) is None:
            detail = f"the field {name!r} is required: preset {preset.name} does not state it"
            yield Problem(pointer, "missing-field", detail, preset.remark or f"add {name}")
    isocentre = view.source_isocentre_mm or preset.source_isocentre_mm
    detector = view.source_detector_mm or preset.source_detector_mm
    if isocentre is not None and isocentre >= detector:
        detail = f"the isocentre lies between source and detector: {isocentre:g} mm is not below {detector:g} mm"
        yield Problem(f"{pointer}/source_isocentre_mm", "distance-order", detail)


def list_declared(document: DesignDocument, components: tuple[str, ...]) -> list[tuple[str, str]]:
    """(interface, component) of every tolerance of these components that the two interfaces declare; of those that are
    correlated none, for their half-widths stay."""
    declared = []
    for name, interface in document.interfaces.by_name.items():
        if (tolerances := interface.tolerances) is not None:
            stated = [axis for axis in components if getattr(tolerances, axis) is not None]
            declared += [(name, axis) for axis in stated if not tolerances.is_correlated(axis)]
    return declared


def check_optimise(document: DesignDocument, most_fiducials: int) -> Iterator[Problem]:
    """Requirements, tolerances, pivots and locators that the section names exist."""
    if (wanted := document.optimise) is None:
        return
    names = [requirement.name for requirement in document.requirements]
    if not names:
        yield Problem("/optimise", "missing-field", "the design has no requirements: no limit to hold", "add one")
    elif isinstance(wanted.requirement, str):
        yield from find_unknown("/optimise/requirement", "requirement", wanted.requirement, names)
    elif wanted.requirement is not None:
        yield from check_entries("/optimise/requirement", "requirement", wanted.requirement, names)
    if wanted.count is not None and wanted.count.max > most_fiducials:
        detail = f"{wanted.count.max} fiducials; at most {most_fiducials} are accepted"
        yield Problem("/optimise/count/max", "too-many", detail, f"max: {most_fiducials}")
    yield from chain(_views(document, wanted), _tolerances(document, wanted), _mounts(document, wanted))


def _views(document: DesignDocument, wanted: Optimise) -> Iterator[Problem]:
    """Views that may be aimed otherwise are aimed, each is named once, and their sources stay before the detector; the
    view that may be added has a name of its own, and the same holds of the one that it is a copy of."""
    views, entries = {view.name: view for view in document.views}, wanted.views or []
    turned = {index: each.view for index, each in enumerate(entries) if isinstance(each, FreeView)}
    yield from find_duplicates([*turned.values()], lambda k: f"/optimise/views/{[*turned][k]}/view", "entries")
    for index, each in enumerate(entries):
        field, name = ("like", each.like) if isinstance(each, AddedView) else ("view", each.view)
        pointer, view = f"/optimise/views/{index}", views.get(name)
        if isinstance(each, AddedView) and each.add in views:
            detail, hint = f"the design has a view {each.add!r} already", "give the new one another name"
            yield Problem(f"{pointer}/add", "duplicate-name", detail, hint)
        yield from find_unknown(f"{pointer}/{field}", "view", name, list(views))
        if isinstance(view, PresetView | DistanceView):
            preset = PRESETS.get(view.preset) if isinstance(view, PresetView) else None
            detector_mm = view.source_detector_mm or (preset and preset.source_detector_mm)
            if each.source_isocentre_mm and detector_mm and each.source_isocentre_mm[1] >= detector_mm:
                detail = f"{each.source_isocentre_mm[1]:g} mm is not below the {detector_mm:g} mm to the detector"
                yield Problem(f"{pointer}/source_isocentre_mm/1", "distance-order", detail)
        elif view is not None:
            detail = f"{name} is given by a matrix or by intrinsics and a pose, which say nothing of how it is aimed"
            other = "name another" if field == "like" else "leave it as it is"
            yield Problem(f"{pointer}/{field}", "not-aimed", detail, f"give it by a preset or by distances, or {other}")


def _tolerances(document: DesignDocument, wanted: Optimise) -> Iterator[Problem]:
    for index, free in enumerate(wanted.tolerances):
        interface: Interface | None = getattr(document.interfaces, free.interface)
        tolerances = None if interface is None else interface.tolerances
        pointer = f"/optimise/tolerances/{index}"
        if interface is not None and interface.locators is not None:
            names = [locator.name for locator in interface.locators]
            yield from find_unknown(f"{pointer}/component", "locator", free.component, names)
        elif interface is not None and interface.features is not None:
            yield from check_freed(interface.features, free, pointer, wanted.grade_prices)
        elif free.also or any(grade.drawn_value is not None for grade in free.grades or ()):
            detail = f"{free.interface} has no features: values of a drawing say nothing of it"
            yield Problem(pointer, "unused-field", detail, "give half-widths, and leave out also")
        elif free.component not in TORSOR_COMPONENTS:
            yield from find_unknown(f"{pointer}/component", "component", free.component, TORSOR_COMPONENTS)
        elif tolerances is not None and tolerances.is_correlated(free.component):
            what = f"{free.interface} {free.component} is correlated with others"
            cure = "leave it out here: its half-width stays, and beads move under it"
            detail = f"{what}: what a part of them costs alone is not modelled"
            yield Problem(pointer, "correlated", detail, cure)
        elif tolerances is None or getattr(tolerances, free.component) is None:
            detail = f"{free.interface} declares no tolerance for {free.component}: its law is not known"
            cure = f"add interfaces/{free.interface}/tolerances/{free.component}"
            yield Problem(pointer, "unknown-name", detail, cure)
    for field, components in (("rotation_bounds", ROTATIONS), ("translation_bounds", TRANSLATIONS)):
        if getattr(wanted, field) is not None and not list_declared(document, components):
            detail = f"neither interface declares a {field.partition('_')[0]}al tolerance that is independent of others"
            cure = f"declare {', '.join(components[:-1])} or {components[-1]} under interfaces/.../tolerances"
            yield Problem(f"/optimise/{field}", "nothing-free", detail, cure)


def _mounts(document: DesignDocument, wanted: Optimise) -> Iterator[Problem]:
    """Pivots of seats with tolerances may move."""
    for index, pivot in enumerate(wanted.pivots):
        interface: Interface | None = getattr(document.interfaces, pivot.interface)
        if interface is None:
            why, cure = "is not in the design", f"add interfaces/{pivot.interface}"
        elif interface.is_held:
            why = "is held by its contacts: its pivot only reduces them"
            cure = "free what it states instead" if interface.locators is None else "free its locators instead"
        else:
            continue
        yield Problem(f"/optimise/pivots/{index}/interface", "no-pivot", f"{pivot.interface} {why}", cure)


def check_optimise_labels(document: DesignDocument, fiducials: FiducialList) -> list[Problem]:
    """Fiducials that the section names exist, in one place each; symmetry and count go with how many there are."""
    wanted = document.optimise
    if wanted is None:
        return []
    labels = fiducials.labels
    problems = check_entries("/optimise/fixed", "fiducial", wanted.fixed, labels)
    named = [
        (f"/optimise/regions/{r}/fiducials/{i}", label)
        for r, region in enumerate(wanted.regions or ())
        for i, label in enumerate(region.fiducials)
    ]
    problems += find_duplicates([label for _, label in named], lambda index: named[index][0], "entries")
    for pointer, label in named:
        if label in wanted.fixed:
            hint = "take it out of fixed, or out of the region"
            problems.append(Problem(pointer, "fixed-and-free", f"{label!r} is also listed as fixed", hint))
        problems += find_unknown(pointer, "fiducial", label, labels)
    return problems or _groups(wanted, labels) + _counts(document, wanted, len(labels))


def _groups(wanted: Optimise, labels: tuple[str, ...]) -> list[Problem]:
    """Under a symmetry the free fiducials of each region must make whole groups."""
    if wanted.symmetry is None:
        return []
    size = 2 if wanted.symmetry.mirror is not None else wanted.symmetry.rotation.order  # type: ignore[union-attr]
    free = [label for label in labels if label not in wanted.fixed]
    groups = [("/optimise/symmetry", len(free))]
    if wanted.regions is not None:
        groups = [(f"/optimise/regions/{r}/fiducials", len(item.fiducials)) for r, item in enumerate(wanted.regions)]
    what = f"free fiducials do not make whole groups of {size} under the symmetry"
    odd = [(pointer, count) for pointer, count in groups if count % size]
    return [Problem(pointer, "incomplete-group", f"{count} {what}", "fix some, or add some") for pointer, count in odd]


def _counts(document: DesignDocument, wanted: Optimise, present: int) -> list[Problem]:
    if wanted.survive is not None:
        seen = [len(view.sees) for view in document.views if view.sees is not None]
        least = min([present if wanted.count is None else wanted.count.min, *seen])
        left, needed = least - wanted.survive.lost, document.model.estimator.traits.fewest_fiducials
        if left < needed:
            detail = f"{left} fiducials would be left after a loss of {wanted.survive.lost}; an estimate needs {needed}"
            return [Problem("/optimise/survive/lost", "too-few-fiducials", detail, "add fiducials, or lose fewer")]
    if wanted.count is None:
        return []
    for pointer, who, _ in _list_fiducials(document):
        detail = f"{who}; their number may not change"
        return [Problem("/optimise/count", "count-and-sees", detail, f"leave out count, or {pointer}")]
    fixed = len(wanted.fixed)
    if wanted.count.max < fixed:
        detail = f"{fixed} fiducials are fixed; count allows {wanted.count.max}"
        return [Problem("/optimise/count/max", "out-of-range", detail, "raise max, or free some")]
    if present == fixed:
        return [Problem("/optimise/count", "nothing-free", "every fiducial is fixed: none can be added or left out")]
    return []


def check_entries(pointer: str, what: str, entries: Sequence[str], known: Sequence[str]) -> list[Problem]:
    """Entries of a list each name something, and no two the same."""
    unknown = [find_unknown(f"{pointer}/{index}", what, name, known) for index, name in enumerate(entries)]
    return [*find_duplicates(entries, lambda index: f"{pointer}/{index}", "entries"), *chain.from_iterable(unknown)]


def find_duplicates(
    names: Sequence[str],
    pointer: Callable[[int], str],
    what: str,
    file: str | None = None,
    lines: Sequence[int] = (),
) -> list[Problem]:
    """A problem for each name that was there before, at the ``pointer`` of its index; lines: each one's in the file."""
    if len(set(names)) == len(names):
        return []
    seen: set[str] = set()
    problems = []
    for index, name in enumerate(names):
        if name in seen:
            detail = f"two {what} are called {name!r}"
            place = (file, lines[index]) if lines else ()
            problems.append(Problem(pointer(index), "duplicate-name", detail, "names are unique", *place))
        seen.add(name)
    return problems


def find_unknown(pointer: str, what: str, name: str, names: Sequence[str]) -> list[Problem]:
    if name in names:
        return []
    listing = ", ".join(names[:12]) + (", ..." if len(names) > 12 else "")
    hint = ask_label(name, names, f"known: {listing}" if names else "")
    return [Problem(pointer, "unknown-name", f"no {what} is called {name!r}", hint)]


# --- the points that a target stands for ----------------------------------------------------------------


def sample_count(target: TargetDocument) -> int:
    """How many points a target stands for."""
    if target.region is None:
        return 1
    if target.region.box is None:
        return 15
    return prod(_axis_counts(target.region.box))


def _axis_counts(box: Box) -> tuple[int, int, int]:
    """Grid points along x, y, z."""
    n = box.points_per_axis
    return (n, n, n) if isinstance(n, int) else n


def expand_target(target: TargetDocument) -> tuple[Target, ...]:
    """The named points of a target; a region's are called name[0], name[1], ..."""
    if target.region is None:
        direction = None if target.direction is None else frozen(target.direction)
        place = frozen(target.position_mm)
        channel, two = _channel_of(target), target.ends == "two_shots"
        return (Target(target.name, place, None, direction, target.entry, channel, two),)
    points = _box_points(target.region.box) if target.region.box is not None else _sphere_points(target.region)
    assert len(points) == sample_count(target)
    return tuple([Target(f"{target.name}[{k}]", frozen(point), target.name) for k, point in enumerate(points)])


def _channel_of(target: TargetDocument) -> Channel | None:
    if target.corridor_mm is None:
        return None
    entry, end = target.corridor_entry_mm or target.corridor_mm, target.corridor_mm
    more = 0.0 if target.corridor_major_mm is None else target.corridor_major_mm - target.corridor_mm
    major = None if target.corridor_major_direction is None else frozen(target.corridor_major_direction)
    return Channel((entry + more, entry), (end + more, end), major)


def _box_points(box: Box) -> list[Array]:
    axes = [
        centre + (np.linspace(-0.5, 0.5, count) if count > 1 else np.zeros(1)) * size
        for centre, size, count in zip(box.centre_mm, box.size_mm, _axis_counts(box), strict=True)
    ]
    return [np.array(point) for point in product(*axes)]


def _sphere_points(region: Region) -> list[Array]:
    """Centre, 6 axis points, 8 diagonals: the 14 surface points are a spherical design of degree 5."""
    sphere = region.sphere
    assert sphere is not None
    centre = np.array(sphere.centre_mm)
    axial = [sign * axis for axis in np.eye(3) for sign in (-1.0, 1.0)]
    diagonal = [np.array(signs) / np.sqrt(3) for signs in product((-1.0, 1.0), repeat=3)]
    return [centre, *(centre + sphere.radius_mm * direction for direction in axial + diagonal)]
