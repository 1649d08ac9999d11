"""Results that an older version wrote, in the words of today."""

from __future__ import annotations

import re
from typing import Any

NUMBERED = {"interface_1": "structure_connector", "interface_2": "connector_flange"}


def in_words_of_today(data: Any) -> Any:
    """Plain data of a result, its sources of error named as in the design document; the data itself stays as it is.

    Until version 0.1 results called the interfaces ``interface_1`` and ``interface_2``, and stated neither labels nor
    shares of the localisation error, nor what the budget is of where fiducials are missed.
    """
    if isinstance(data, list):
        return [in_words_of_today(entry) for entry in data]
    if not isinstance(data, dict):
        return data
    read = {key: in_words_of_today(value) for key, value in data.items()}
    key = "name" if "variance_share" in read else "contributor"  # a line of a budget is named by its source
    if isinstance(name := read.get(key), str):
        read[key] = NUMBERED.get(name, name)
        read.setdefault("label", read[key].replace("_", " ").replace(":", ", ") if name not in NUMBERED else read[key])
    if isinstance(ends := read.get("worst_vertex"), list):
        read["worst_vertex"] = [_rename(end) for end in ends]
    if "distributions" in read:
        read.pop("convergence", None)  # of a report, which had P95 of its first trials
    if isinstance(lines := read.get("contributors"), list) and isinstance(read.get("localisation"), dict):
        _share_localisation(read, lines)
        read.setdefault("budget_p95_mm", read.get("p95_mm"))
    return read


def _share_localisation(target: dict[str, Any], lines: list[Any]) -> None:
    """Fill in the shares of the localisation error: only rigid motions lie behind it, which keep the trace of a
    covariance.  (Temperature also acts behind it, which such a result does not say.)
    """
    try:
        tool, located = (sum(std**2 for std in of["std_mm"]) for of in (target, target["localisation"]))
        for line in lines:
            behind = line["name"] in ("connector_flange", "hand_eye", "execution")
            line.setdefault("localisation_share", 0.0 if behind else line["variance_share"] * tool / (located or 1.0))
    except (KeyError, TypeError):  # no result: what reads it says so
        return


def _rename(end: Any) -> Any:
    """``interface_1.rz=+0.1 deg`` by the interface's name."""
    if not isinstance(end, str):
        return end
    return re.sub(r"^interface_[12](?=\.)", lambda match: NUMBERED[match[0]], end)
