"""Rules of the ``optimise`` section that look at the rest of the document."""

from __future__ import annotations

from ..errors import Problem
from .document import DesignDocument
from .fiducial_files import FiducialList
from .mount_document import Interface
from .naming_rules import known, unique

INTERFACES = ("structure_connector", "connector_flange")
ROTATIONS, TRANSLATIONS = ("rx", "ry", "rz"), ("tx", "ty", "tz")


def declared(document: DesignDocument, components: tuple[str, ...]) -> list[tuple[str, str]]:
    """(interface, component) of every tolerance of these components that the two interfaces declare."""
    found = []
    for name in INTERFACES:
        interface: Interface | None = getattr(document.interfaces, name)
        if interface is not None and interface.tolerances is not None:
            tolerances = interface.tolerances
            found += [(name, axis) for axis in components if getattr(tolerances, axis) is not None]
    return found


def check_optimise(document: DesignDocument, most_fiducials: int) -> list[Problem]:
    """Requirements, tolerances, pivots and locators that the section names exist."""
    wanted = document.optimise
    if wanted is None:
        return []
    problems: list[Problem] = []
    names = [requirement.name for requirement in document.requirements]
    if not names:
        problems.append(
            Problem("/optimise", "missing-field", "the design has no requirements: no limit to hold", "add one")
        )
    elif isinstance(wanted.requirement, str):
        problems += known("/optimise/requirement", "requirement", wanted.requirement, names)
    elif wanted.requirement is not None:
        problems += unique(wanted.requirement, "/optimise/requirement/{}".format, "entries")
        for index, name in enumerate(wanted.requirement):
            problems += known(f"/optimise/requirement/{index}", "requirement", name, names)
    if wanted.count is not None and wanted.count.max > most_fiducials:
        detail = f"{wanted.count.max} fiducials; at most {most_fiducials} are accepted"
        problems.append(Problem("/optimise/count/max", "too-many", detail, f"max: {most_fiducials}"))
    return problems + _tolerances(document) + _mounts(document)


def _tolerances(document: DesignDocument) -> list[Problem]:
    assert document.optimise is not None
    problems = []
    for index, free in enumerate(document.optimise.tolerances):
        interface: Interface | None = getattr(document.interfaces, free.interface)
        pointer = f"/optimise/tolerances/{index}"
        if interface is not None and interface.locators is not None:
            names = [locator.name for locator in interface.locators]
            problems += known(f"{pointer}/component", "locator", free.component, names)
            continue
        if free.component not in (*ROTATIONS, *TRANSLATIONS):
            problems += known(f"{pointer}/component", "component", free.component, (*ROTATIONS, *TRANSLATIONS))
            continue
        if interface is None or interface.tolerances is None or getattr(interface.tolerances, free.component) is None:
            problems.append(
                Problem(
                    pointer,
                    "unknown-name",
                    f"{free.interface} declares no tolerance for {free.component}: its law is not known",
                    f"add interfaces/{free.interface}/tolerances/{free.component}",
                )
            )
    for field, components in (("rotation_bounds", ROTATIONS), ("translation_bounds", TRANSLATIONS)):
        if getattr(document.optimise, field) is not None and not declared(document, components):
            problems.append(
                Problem(
                    f"/optimise/{field}",
                    "nothing-free",
                    f"neither interface declares a {field.partition('_')[0]}al tolerance",
                    f"declare {', '.join(components[:-1])} or {components[-1]} under interfaces/.../tolerances",
                )
            )
    return problems


def _mounts(document: DesignDocument) -> list[Problem]:
    """Pivots of seats with tolerances may move, locators of seats with locators may be spread."""
    assert document.optimise is not None
    problems = []
    for index, pivot in enumerate(document.optimise.pivots):
        interface: Interface | None = getattr(document.interfaces, pivot.interface)
        if interface is None or interface.locators is not None:
            why = "is not in the design" if interface is None else "is held by locators: its pivot only reduces them"
            problems.append(
                Problem(
                    f"/optimise/pivots/{index}/interface",
                    "no-pivot",
                    f"{pivot.interface} {why}",
                    "free locator_spacing instead" if interface is not None else f"add interfaces/{pivot.interface}",
                )
            )
    for index, spacing in enumerate(document.optimise.locator_spacing):
        interface = getattr(document.interfaces, spacing.interface)
        if interface is None or interface.locators is None:
            problems.append(
                Problem(
                    f"/optimise/locator_spacing/{index}/interface",
                    "no-locators",
                    f"{spacing.interface} has no locators",
                    f"describe it by interfaces/{spacing.interface}/locators",
                )
            )
    return problems


def check_optimise_labels(document: DesignDocument, fiducials: FiducialList) -> list[Problem]:
    """Fiducials that the section names exist, in one place each; symmetry and count go with how many there are."""
    wanted = document.optimise
    if wanted is None:
        return []
    labels = fiducials.labels
    problems: list[Problem] = []
    for index, label in enumerate(wanted.fixed):
        problems += known(f"/optimise/fixed/{index}", "fiducial", label, labels)
    named = [
        (f"/optimise/regions/{r}/fiducials/{i}", label)
        for r, region in enumerate(wanted.regions or ())
        for i, label in enumerate(region.fiducials)
    ]
    problems += unique(wanted.fixed, "/optimise/fixed/{}".format, "entries")
    problems += unique([label for _, label in named], lambda index: named[index][0], "entries")
    for pointer, label in named:
        if label in wanted.fixed:
            hint = "take it out of fixed, or out of the region"
            problems.append(Problem(pointer, "fixed-and-free", f"{label!r} is also listed as fixed", hint))
        problems += known(pointer, "fiducial", label, labels)
    if problems:
        return problems
    return _groups(document, labels) + _counts(document, len(labels))


def _groups(document: DesignDocument, labels: tuple[str, ...]) -> list[Problem]:
    """Under a symmetry the free fiducials of each region must make whole groups."""
    wanted = document.optimise
    assert wanted is not None
    if wanted.symmetry is None:
        return []
    size = 2 if wanted.symmetry.mirror is not None else wanted.symmetry.rotation.order  # type: ignore[union-attr]
    free = [label for label in labels if label not in wanted.fixed]
    groups = [("/optimise/symmetry", len(free))]
    if wanted.regions is not None:
        groups = [(f"/optimise/regions/{r}/fiducials", len(item.fiducials)) for r, item in enumerate(wanted.regions)]
    return [
        Problem(
            pointer,
            "incomplete-group",
            f"{count} free fiducials do not make whole groups of {size} under the symmetry",
            "fix some, or add some",
        )
        for pointer, count in groups
        if count % size
    ]


def _counts(document: DesignDocument, present: int) -> list[Problem]:
    wanted = document.optimise
    assert wanted is not None
    if wanted.count is None:
        return []
    fixed = len(wanted.fixed)
    if wanted.count.max < fixed:
        detail = f"{fixed} fiducials are fixed; count allows {wanted.count.max}"
        return [Problem("/optimise/count/max", "out-of-range", detail, "raise max, or free some")]
    if present == fixed:
        return [Problem("/optimise/count", "nothing-free", "every fiducial is fixed: none can be added or left out")]
    return []
