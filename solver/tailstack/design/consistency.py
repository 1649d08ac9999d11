"""Rules that span several fields: names that must be unique, references that must lead somewhere, sizes."""

from __future__ import annotations

from collections.abc import Sequence

from ..errors import Problem
from .document import Box, DesignDocument, TargetDocument
from .fiducial_files import FiducialList
from .naming_rules import known, unique
from .optimise_consistency import check_optimise, check_optimise_labels
from .presets import PRESETS
from .reading import Limits
from .view_document import PresetView


def sample_count(target: TargetDocument) -> int:
    """How many points a target stands for."""
    if target.region is None:
        return 1
    if target.region.box is None:
        return 15
    counts = axis_counts(target.region.box)
    return counts[0] * counts[1] * counts[2]


def axis_counts(box: Box) -> tuple[int, int, int]:
    """Grid points along x, y, z."""
    n = box.points_per_axis
    return (n, n, n) if isinstance(n, int) else n


def check_document(document: DesignDocument, limits: Limits) -> list[Problem]:
    """Everything that can be said before a fiducial file is opened."""
    problems: list[Problem] = []
    problems += _too_many("/views", "views", len(document.views), limits.views)
    problems += _too_many("/fiducials/points", "fiducials", len(document.fiducials.points or ()), limits.fiducials)
    left_out = () if document.fiducials.origin is None else document.fiducials.origin.left_out
    problems += _too_many("/fiducials/origin/left_out", "points that were left out", len(left_out), limits.fiducials)
    problems += _too_many("/targets", "targets", sum(map(sample_count, document.targets)), limits.targets)
    problems += _too_many("/requirements", "requirements", len(document.requirements), limits.targets)
    problems += unique([view.name for view in document.views], "/views/{}/name".format, "views")
    named = [target.name for target in document.targets]
    problems += unique(named, "/targets/{}/name".format, "targets")
    problems += _expanded_names(document.targets)
    problems += unique([item.name for item in document.requirements], "/requirements/{}/name".format, "requirements")
    for index, view in enumerate(document.views):
        if isinstance(view, PresetView):
            problems += _preset(view, f"/views/{index}")
    for index, requirement in enumerate(document.requirements):
        if requirement.targets == "all":
            continue
        for place, name in enumerate(requirement.targets):
            problems += known(f"/requirements/{index}/targets/{place}", "target", name, named)
        problems += unique(requirement.targets, f"/requirements/{index}/targets/{{}}".format, "entries")
    return problems + check_optimise(document, limits.fiducials)


def check_fiducials(document: DesignDocument, fiducials: FiducialList) -> list[Problem]:
    """Labels: unique, and known where the optimiser is told to keep them."""
    place = "/fiducials/file" if document.fiducials.points is None else "/fiducials/points/{}/label"
    problems = unique(fiducials.labels, place.format, "fiducials")
    return problems + check_optimise_labels(document, fiducials)


def _too_many(pointer: str, what: str, count: int, limit: int) -> list[Problem]:
    if count <= limit:
        return []
    return [Problem(pointer, "too-many", f"{count} {what}; at most {limit} are accepted")]


def _expanded_names(targets: Sequence[TargetDocument]) -> list[Problem]:
    """A point that is called like a sample of a region (zone[3]) would be counted twice."""
    samples = {f"{t.name}[{i}]" for t in targets if t.region for i in range(min(sample_count(t), 10_000))}
    return [
        Problem(f"/targets/{i}/name", "duplicate-name", f"{t.name!r} is also the name of a sample of a region")
        for i, t in enumerate(targets)
        if t.name in samples
    ]


def _preset(view: PresetView, pointer: str) -> list[Problem]:
    preset = PRESETS.get(view.preset)
    if preset is None:
        return known(f"{pointer}/preset", "preset", view.preset, list(PRESETS))
    problems = [
        Problem(
            pointer,
            "missing-field",
            f"the field {name!r} is required: preset {preset.name} does not state it",
            preset.remark or f"add {name}",
        )
        for name in preset.missing
        if getattr(view, name) is None
    ]
    isocentre = view.source_isocentre_mm or preset.source_isocentre_mm
    detector = view.source_detector_mm or preset.source_detector_mm
    if isocentre is not None and isocentre >= detector:
        problems.append(
            Problem(
                f"{pointer}/source_isocentre_mm",
                "distance-order",
                f"the isocentre lies between source and detector: {isocentre:g} mm is not below {detector:g} mm",
            )
        )
    return problems
