"""One class name, one class: whoever reads ``Table`` need not look which of five is meant."""

from __future__ import annotations

import re
from collections import defaultdict
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
CLASS = re.compile(r" *class (\w+)[(:\[]")  # by lines: to parse all sources takes seconds
# Both are published: the one in docs/python.md, the other as a schema of openapi.json.
BOTH_PUBLISHED = {"Conversion"}


def classes_by_name() -> dict[str, list[str]]:
    """Where each class name of the two packages is defined: ``file:line``."""
    places = defaultdict(list)
    for package in ("solver/tailstack", "service/tailstack_service"):
        for path in sorted((ROOT / package).rglob("*.py")):
            for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
                if found := CLASS.match(line):
                    places[found[1]].append(f"{path.relative_to(ROOT)}:{number}")
    return places


def test_no_class_name_is_defined_twice():
    places = classes_by_name()
    assert len(places) > 500  # the sources were found
    twice = {name: found for name, found in places.items() if len(found) > 1 and name not in BOTH_PUBLISHED}
    lines = "\n".join(f"  {name}: {', '.join(found)}" for name, found in sorted(twice.items()))
    assert not twice, (
        "A class name is defined twice.  Rename the less central class by what it is, with the field's noun; where "
        f"both are one thing, make them one:\n{lines}"
    )


@pytest.mark.long
def test_exceptions_are_still_needed():
    places = classes_by_name()
    assert [name for name in BOTH_PUBLISHED if len(places[name]) < 2] == []
