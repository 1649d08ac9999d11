"""Write a design as JSON or YAML, and change some of its numbers."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, field
from math import degrees
from typing import Any

import numpy as np
import yaml

from ..geometry.arrays import Array
from ..geometry.camera import turn_view
from ..results.json_text import write_json
from ..system import ROTATIONS
from .document import DistanceView, FiducialPoint, PresetView
from .drawn import find_drawn, redraw_data
from .features import Feature
from .frames import FRAME_FIELDS
from .loading import ASSUMED, Design, follow_changes, load_design
from .reading import DEFAULT_LIMITS, Limits, hide_nothing, is_unseen, scalar


def design_to_data(design: Design, *, inline: bool = True) -> dict[str, Any]:
    """The document as plain data, with what its author set and nothing else.

    ``inline`` replaces a fiducial file by its points (converted to con, mm) and their origin, and files of targets by
    these, so that the result stands alone and says what was done to them.
    """
    document = design.document if inline else design.as_written
    if inline and document.assumed:
        moved = [re.sub(r"/(target|locator)_files.*", r"/\1s", each) for each in document.assumed]
        document = document.model_copy(update={ASSUMED: list(dict.fromkeys(moved))})
    if inline and document.fiducials.file is not None:
        points = [
            FiducialPoint(label=label, position_mm=position)
            for label, position in zip(design.fiducials.labels, design.fiducials.positions_mm, strict=True)
        ]
        stated, dropped = document.fiducials, {"file", "points", "origin", *FRAME_FIELDS}
        remaining = {name: getattr(stated, name) for name in stated.model_fields_set - dropped}
        fiducials = type(stated).model_validate({"points": points, "origin": design.fiducials.origin, **remaining})
        assumed = ["/fiducials/points" if each == "/fiducials/file" else each for each in document.assumed]
        document = document.model_copy(update={"fiducials": fiducials} | ({ASSUMED: assumed} if assumed else {}))
    return document.model_dump(mode="json", by_alias=True, exclude_unset=True)


def turn_entry(
    entry: Mapping[str, Any], view: PresetView | DistanceView, right_deg: float, up_deg: float
) -> dict[str, Any]:
    """What a document says of a view, turned with its image to the right and up (``turn_view``)."""
    beam, up = turn_view(np.array(view.beam), np.array(view.up_direction), right_deg, up_deg)
    rest = {name: value for name, value in entry.items() if name != "orientation"}
    return rest | {"beam_direction": list(beam), "up_direction": list(up)}


def design_to_json(design: Design, *, inline: bool = True) -> str:
    """The document as JSON text."""
    return to_json(design_to_data(design, inline=inline))


def to_json(data: Any) -> str:
    """Plain data as indented JSON text."""
    return write_json(data, indent=2) + "\n"


def design_to_yaml(design: Design, *, inline: bool = True) -> str:
    """The document as YAML text, vectors on one line."""
    return data_to_yaml(design_to_data(design, inline=inline))


class _Dumper(yaml.SafeDumper):
    """Quotes every text that this package (or YAML 1.1) would read as something else; never writes aliases."""

    def ignore_aliases(self, data: Any) -> bool:
        return True


def _represent_text(dumper: yaml.SafeDumper, text: str) -> yaml.ScalarNode:
    style = '"' if is_unseen(text) else "'" if not isinstance(scalar(text), str) else "|" if "\n" in text else None
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style=style)


class _Lines(list[str]):
    """Pointers, each on a line of its own."""


def _represent_list(dumper: yaml.SafeDumper, items: list[Any]) -> yaml.SequenceNode:
    flat = type(items) is not _Lines and all(not isinstance(item, dict | list) for item in items)
    return dumper.represent_sequence("tag:yaml.org,2002:seq", items, flow_style=flat)


_Dumper.add_representer(str, _represent_text)
_Dumper.add_representer(list, _represent_list)
_Dumper.add_representer(_Lines, _represent_list)


def data_to_yaml(data: Any) -> str:
    """Plain data as YAML text that :func:`read_text` reads back unchanged."""
    if isinstance(data, dict) and isinstance(data.get(ASSUMED), list):
        data = {**data, ASSUMED: _Lines(data[ASSUMED])}
    text: str = yaml.dump(data, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=120)
    return hide_nothing(text)


def dump_flow(value: Any, *, spaced: bool = True) -> str:
    """Plain data as YAML on one line; ``spaced``: with spaces inside the braces of mappings."""
    space = " " if spaced else ""
    if value in ({}, []):
        return "{}" if isinstance(value, dict) else "[]"
    if isinstance(value, dict) and value:
        fields = ", ".join(f"{dump_flow(name)}: {dump_flow(item, spaced=spaced)}" for name, item in value.items())
        return f"{{{space}{fields}{space}}}"
    if isinstance(value, list) and value:
        return f"[{', '.join(dump_flow(item, spaced=spaced) for item in value)}]"
    # within brackets, where a comma or a colon in a text needs quotes
    text: str = yaml.dump([value], Dumper=_Dumper, default_flow_style=True, allow_unicode=True, width=1_000_000)
    return hide_nothing(text.strip()[1:-1])


WIDTH = 100  # of a line that holds a mapping


def dump_block(data: Mapping[str, Any], indent: int = 0) -> str:
    """Fields as YAML, a line for each field and for each item of a list, as far as they fit."""
    space, text = " " * indent, ""
    for name, value in data.items():
        flow = dump_flow(value)
        nested = isinstance(value, dict) and any(isinstance(item, dict | list) for item in value.values())
        text += f"{space}{dump_flow(name)}:"
        if isinstance(value, dict) and value and (nested or len(space + name + flow) + 2 > WIDTH):
            text += "\n" + dump_block(value, indent + 2)
        elif isinstance(value, list) and any(isinstance(item, dict) for item in value):
            text += "\n" + "".join(f"{space}  - {dump_flow(item)}\n" for item in value)
        else:
            text += f" {flow}\n"
    return text


@dataclass(frozen=True, slots=True, eq=False)
class Revision:
    """What to change: interfaces as the document calls them, half-widths in rad or mm."""

    labels: Sequence[str] | None = None  # of fiducials_mm; None: those of the design
    fiducials_mm: Array | None = None  # (N, 3) con; None: they stay
    half_width: Mapping[tuple[str, str], float] = field(default_factory=dict)  # (interface, component or locator)
    pivot_mm: Mapping[str, Array] = field(default_factory=dict)  # (3,) con
    drawn: Mapping[tuple[str, str], str | float] = field(default_factory=dict)  # (interface, feature and item)


def revise_design(design: Design, change: Revision, limits: Limits = DEFAULT_LIMITS) -> Design:
    """The design with a change made, loaded and checked anew.

    Fiducials from a file become points of the document, so the result stands alone.  Raises DesignError.
    """
    before = design_to_data(design, inline=True)
    data: dict[str, Any] = deepcopy(before)
    if change.fiducials_mm is not None:
        labels = design.fiducials.labels if change.labels is None else change.labels
        own = dict(zip(design.fiducials.labels, data["fiducials"].get("points") or (), strict=False))
        data["fiducials"]["points"] = [
            {**own.get(label, {}), "label": label, "position_mm": [float(value) for value in position]}
            for label, position in zip(labels, change.fiducials_mm, strict=True)
        ]
        same = tuple(labels) == design.fiducials.labels
        same = same and np.array_equal(change.fiducials_mm, design.fiducials.positions_mm)
        if design.fiducials.origin is not None and not same:
            data["fiducials"]["origin"]["changed"] = True
        forget_missing_labels(data, set(labels))
    for (contributor, component), value in change.half_width.items():
        _set_half_width(data["interfaces"][contributor], component, float(value))
    for (contributor, name), drawn in change.drawn.items():
        features = getattr(design.document.interfaces, contributor).features
        _redraw(data["interfaces"][contributor], features, name, drawn)
    for contributor, position in change.pivot_mm.items():
        data["interfaces"][contributor]["pivot_mm"] = [float(value) for value in position]
    return load_design(follow_changes(before, data), limits=limits)


def _redraw(interface: dict[str, Any], features: Sequence[Feature], name: str, value: str | float) -> None:
    """What a feature states, another value; then it is no longer as in the file that it was read from."""
    feature, item = find_drawn(features)[name]
    index = list(features).index(feature)
    old = interface["features"][index]
    new = redraw_data(old, item, value)
    if new != old:
        interface.pop("origin", None)
        interface["features"][index] = new


def _set_half_width(interface: dict[str, Any], component: str, value: float) -> None:
    if interface.get("locators"):
        for locator in interface["locators"]:
            if locator["name"] == component:
                locator["half_width_mm"] = value
        return
    # what was written in degrees comes back as it was, without the last digits of the two conversions
    unit, shown = ("deg", round(degrees(value), 12)) if component in ROTATIONS else ("mm", value)
    interface["tolerances"][component][f"half_width_{unit}"] = shown


def forget_missing_labels(data: dict[str, Any], labels: set[str]) -> None:
    """Fiducials that were left out are no longer named in the optimise section."""
    wanted = data.get("optimise")
    if wanted and wanted.get("fixed"):
        wanted["fixed"] = [label for label in wanted["fixed"] if label in labels]
