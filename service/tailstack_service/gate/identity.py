"""Which design of a baseline is the same design: by its file, or by what it consists of where the file was renamed."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Collection, Sequence
from typing import Any

from tailstack.design import Design
from tailstack.json_text import write_json

from .records import GatedDesign, GateSection

# A name is what its author writes; these are what is made.  Requirements are left out: they are what is compared.
SECTIONS = ("views", "interfaces", "targets", "transforms", "execution")
FEWEST_ALIKE = 3  # sections that have to be the same where the fiducials are not


def sections_of(design: Design) -> tuple[GateSection, ...]:
    """The sections that a design states, by the hash of their content, defaults filled in; of the fiducials where they
    are, whatever they are called and whatever file they stand in."""
    document = design.document
    data = document.model_dump(mode="json", by_alias=True, include=set(SECTIONS) & document.model_fields_set)
    content = {"fiducials": [list(position) for position in design.fiducials.positions_mm], **data}
    return tuple(GateSection(name, _digest(content[name])) for name in ("fiducials", *SECTIONS) if name in content)


def find_earlier(
    designs: Sequence[GatedDesign],
    file: str,
    name: str,
    sha256: str,
    sections: Collection[GateSection],
    present: Collection[str],
) -> GatedDesign | None:
    """The design of a baseline that this one was: of that file; or, of those whose file is not ``present`` any more,
    the only one of that content, of the most sections in common (fiducials, or three), or of that name."""
    same_file = [entry for entry in designs if entry.file == file and entry.targets]
    gone = [entry for entry in designs if entry.file not in present and entry.targets]
    found: tuple[Callable[[], list[GatedDesign]], ...] = (
        lambda: same_file,
        lambda: [entry for entry in gone if entry.sha256 == sha256],
        lambda: _most_alike(gone, sections),
        lambda: [entry for entry in gone if entry.name == name],
    )
    return next((entries[0] for find in found if len(entries := find()) == 1), None)


def _most_alike(designs: Sequence[GatedDesign], sections: Collection[GateSection]) -> list[GatedDesign]:
    alike = {entry.file: set(sections) & set(entry.sections) for entry in designs}
    near = [
        entry
        for entry in designs
        if len(alike[entry.file]) >= FEWEST_ALIKE or any(one.name == "fiducials" for one in alike[entry.file])
    ]
    most = max((len(alike[entry.file]) for entry in near), default=0)
    return [entry for entry in near if len(alike[entry.file]) == most]


def _digest(content: Any) -> str:
    return hashlib.sha256(write_json(content, sort_keys=True).encode()).hexdigest()
