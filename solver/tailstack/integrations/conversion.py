"""Convert designs, fiducial files, calibration cages and STEP files into one another, by the endings of their names."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..design.document import WAYS_OF_HOLDING
from ..design.fiducial_files import ENDINGS, FORMATS, FiducialList, read_fiducials, write_fiducials
from ..design.loading import ASSUMED, Design, follow_changes, holds_points, load_design
from ..design.reading import DEFAULT_LIMITS, DOCUMENTS, MOST_STEP_BYTES, STEP_FILES, Format, Limits, read_bytes
from ..design.write import data_to_yaml, design_to_data, forget_missing_labels, to_json
from ..errors import DesignError, LimitError, Problem, StepError
from .calibration_cages import CageForm, read_cage, write_cage
from .step import StepBody, StepContact, StepSelection, StepTolerance, read_step
from .step.seat import StepSeat, find_seat

Base = Design | Callable[[FiducialList], Design]
IMAGES = (".dcm", ".dicom")  # become views: dicom.py
HEADER_BYTES = 4_000_000  # that are read of a DICOM file: headers are some kB, and pixels come last
SEAT_HALF_WIDTH_MM = 0.02  # of a contact that a STEP file brings, which states no tolerance: a start


@dataclass(frozen=True, slots=True)
class ConvertedFile:
    """The converted text, the fiducials in it, and what was done to the numbers on the way."""

    text: str  # of the new file
    notes: tuple[str, ...]  # sentences: what was converted, left out or renamed
    fiducials: FiducialList  # as they stand in it
    bodies: tuple[StepBody, ...] = ()  # of a STEP file: those that became fiducials, and those that were left
    tolerances: tuple[StepTolerance, ...] = ()  # of a STEP file: tolerances and dimensions that it states as such


def convert(
    content: bytes,
    source_name: str,
    target_name: str,
    *,
    directory: Path | None = None,
    allow_files: bool = True,
    files: Mapping[str, bytes] | None = None,
    limits: Limits = DEFAULT_LIMITS,
    selection: StepSelection | None = None,
    base: Base | None = None,
    cage: CageForm | None = None,
) -> ConvertedFile:
    """Convert by the endings of two file names: .csv, .fcsv, .mrk.json (fiducials); .yaml, .yml, .json (designs).

    Fiducials are also read from .tsv, and from .json that holds points of 3D Slicer.
    A design converts to a design that stands alone (files it refers to are read in; ``files`` as for ``load_design``),
    or to its fiducials.  Fiducials convert to another fiducial file, or to the ``fiducials`` section of a design.
    A STEP file (.step, .stp, .p21) is read for its balls, which are fiducials; ``selection`` says for which.  Images
    (.dcm) are for ``dicom.convert_shots``.
    With ``base``, a design or what makes one for the fiducials, they replace those of that design, as its seat is
    replaced where ``selection`` names seats and pins.  With ``cage``, a .csv that is read is a frame specification of
    XMALab, or else the one that is written.  Raises DesignError, LimitError.
    """
    known = (*FORMATS, *DOCUMENTS)
    for name, endings, more in ((source_name, (*known, ".tsv", *STEP_FILES), IMAGES), (target_name, known, ())):
        if not name.lower().endswith(endings):
            cure = f"known: {', '.join((*endings, *more))}"
            raise DesignError(Problem("", "unknown-format", f"{name[:80]!r} has no known ending", cure))
    reads_table = source_name.lower().endswith(".csv")
    written = None if reads_table else cage
    if source_name.lower().endswith(STEP_FILES):
        reading = read_step(content, source_name, selection, limits)
        fiducials, seat = reading.fiducials, None
        if selection is not None and selection.pin_class is not None:
            if reading.contacts:
                detail = "the seat is read from tolerances (pin_class), or from seats and pins; both arrived"
                raise StepError(Problem("", "one-of", detail, "leave one of them out", source_name))
            seat = find_seat(reading.tolerances, selection.pin_class, source_name)
        if not fiducials.labels:
            fiducials = _keep_fiducials(base, source_name)
        data, notes = _place_fiducials(base, fiducials, reading.contacts, seat)
        text = write_data(data, fiducials, target_name, written)
        return ConvertedFile(text, (*reading.notes, *notes), fiducials, reading.bodies, reading.tolerances)
    if len(content) > limits.document_bytes:
        raise LimitError(Problem("", "too-large", f"{source_name} is longer than {limits.document_bytes} bytes"))
    if source_name.lower().endswith(ENDINGS) and not _is_design(content, source_name):
        if cage is not None and reads_table:
            fiducials = read_cage(content, source_name, cage, limits)
        else:
            fiducials = read_fiducials(content, source_name, limits)
        data, _ = _place_fiducials(base, fiducials)
        return ConvertedFile(write_data(data, fiducials, target_name, written), fiducials.notes, fiducials)
    form: Format = "json" if source_name.lower().endswith(".json") else "yaml"
    design = load_design(
        content, form=form, base_directory=directory, allow_files=allow_files, files=files, limits=limits
    )
    text = write_data(design_to_data(design), design.fiducials, target_name, written)
    return ConvertedFile(text, design.fiducials.notes, design.fiducials)


def _keep_fiducials(base: Base | None, name: str) -> FiducialList:
    """Those of the design that a file without balls goes into.  Raises StepError."""
    if isinstance(base, Design):
        return base.fiducials
    cure = "name the design that the seat goes into: --base (base)"
    raise StepError(Problem("", "no-ball", f"{name} holds a seat and no ball", cure, name))


def _is_design(content: bytes, name: str) -> bool:
    """Whether a .json is a design; one that holds points of 3D Slicer is none, whatever its name."""
    if not name.lower().endswith(".json") or name.lower().endswith(FORMATS):
        return False
    try:
        data = json.loads(content) if b'"markups"' in content else None
    except (ValueError, RecursionError):
        return True
    return not (isinstance(data, dict) and "markups" in data and holds_points(data))


def read_source_file(source: Path) -> bytes:
    """The bytes of a file to convert, within the limit of its kind; of an image only its beginning, with its header.

    Raises DesignError, LimitError.
    """
    name = source.name.lower()
    if not name.endswith((*FORMATS, *DOCUMENTS, ".tsv", *STEP_FILES)):
        return read_bytes(source, HEADER_BYTES, str(source), whole=False)
    most_bytes = MOST_STEP_BYTES if name.endswith(STEP_FILES) else DEFAULT_LIMITS.document_bytes
    return read_bytes(source, most_bytes, str(source))


def _place_fiducials(
    base: Base | None, fiducials: FiducialList, contacts: Sequence[StepContact] = (), seat: StepSeat | None = None
) -> tuple[dict[str, Any], tuple[str, ...]]:
    """The design with other fiducials and perhaps a seat; without one, these sections of it.  And what to mind."""
    base = base(fiducials) if callable(base) else base
    old = {} if base is None else design_to_data(base)
    data = deepcopy(old)
    before = data.get("fiducials", {})
    own = {point.get("label"): point for point in before.pop("points", [])}
    before.pop("origin", None)
    points = [
        {**own.get(label, {}), "label": label, "position_mm": list(position)}
        for label, position in zip(fiducials.labels, fiducials.positions_mm, strict=True)
    ]
    file = fiducials.origin
    origin: dict[str, Any] = {} if file is None else {"origin": file.model_dump(mode="json", exclude_unset=True)}
    data["fiducials"] = {"points": points, **origin, **before}
    forget_missing_labels(data, set(fiducials.labels))
    notes, guessed = _place_contacts(data, contacts) if contacts else ((), [])
    if seat is not None:
        _hold(data, seat.pivot_mm, features=seat.features)
        notes = (*notes, *seat.remarks)
    data = follow_changes(old, data)
    if guessed:
        data[ASSUMED] = [*data.get(ASSUMED, ()), *guessed]
    return data if base is None else design_to_data(load_design(data)), notes


def _place_contacts(data: dict[str, Any], contacts: Sequence[StepContact]) -> tuple[tuple[str, ...], list[str]]:
    """Contacts as the locators of the structure on its connector; half-widths of those that had them before stay.

    What to mind, and the pointers of half-widths that are a start."""
    interface = data.get("interfaces", {}).get("structure_connector", {})
    before = {locator["name"]: locator for locator in interface.get("locators") or ()}
    start = {"half_width_mm": SEAT_HALF_WIDTH_MM, "distribution": "uniform"}
    places = [{"name": each.name, "position_mm": [*each.position_mm], "normal": [*each.normal]} for each in contacts]
    locators = [before.get(each.name, start) | place for each, place in zip(contacts, places, strict=True)]
    _hold(data, np.mean([each.position_mm for each in contacts], axis=0).tolist(), locators=locators)
    new = [each.name for each in contacts if each.name not in before]
    if not new:
        return (), []
    width = f"half-width {SEAT_HALF_WIDTH_MM} mm, uniform, of {', '.join(new)}"
    words = f"{width}: a start, as STEP states none; correct it"
    at = "/interfaces/structure_connector/locators"
    return (words,), [f"{at}/{k}/half_width_mm" for k, each in enumerate(contacts) if each.name in new]


def _hold(data: dict[str, Any], pivot_mm: Sequence[float], **way: Any) -> None:
    """Another way of holding the structure on its connector, in place of what is there."""
    interface = data.setdefault("interfaces", {}).get("structure_connector", {})
    kept = {field: value for field, value in interface.items() if field not in (*WAYS_OF_HOLDING, "origin")}
    data["interfaces"]["structure_connector"] = {**kept, "pivot_mm": [*pivot_mm], **way}


def write_data(data: Mapping[str, Any], fiducials: FiducialList, target: str, cage: CageForm | None = None) -> str:
    """A design or sections of one as the target's ending asks for, or only the fiducials."""
    if cage is not None and target.lower().endswith(".csv"):
        return write_cage(fiducials, cage.unit)
    if target.lower().endswith(FORMATS):
        return write_fiducials(fiducials, target)
    return to_json(data) if target.lower().endswith(".json") else data_to_yaml(data)
