"""Examples with slips of every kind: the command and the service answer with a place and never with a defect."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from service_scenes import EXAMPLES

from plain_data import replaced
from tailstack_service.cli.main import main

pytestmark = pytest.mark.hostile

ALL = {path.stem: yaml.safe_load(path.read_text()) for path in sorted(EXAMPLES.glob("*.yaml"))}
SLOW = [HealthCheck.too_slow, HealthCheck.function_scoped_fixture]
SYNONYMS = ["gaussian", "Normal", "rectangular", "per unit", "ap", "lateral", "TCP", "optimize", "0,2", "90 %", "1e400"]


def places_of(node: Any, here: tuple[str | int, ...] = ()) -> Iterator[tuple[str | int, ...]]:
    yield here
    items = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ()
    for key, child in items:
        yield from places_of(child, (*here, key))


PLACES = [(stem, place) for stem, document in ALL.items() for place in places_of(document) if place]


def slip_of(value: Any, kind: int, word: str) -> Any:
    """A value as somebody might have written it instead."""
    if isinstance(value, bool) or value is None:
        return word
    if isinstance(value, int | float):
        numbers = (f"{value}".replace(".", ","), f"{100 * value:g} %", value * 1000, value / 1000, value * 0.0174532925)
        return (*numbers, 100 * value, -value, f"{value} mm")[kind % 8]
    if isinstance(value, str):
        return (value.upper(), value.replace("_", " "), value[1:], word, value + "s", 3)[kind % 6]
    if isinstance(value, list):
        return (value[:-1], [*value, *value[:1]], [value], {"points": value}, [row[:-1] for row in value if row]
                if all(isinstance(row, list) for row in value) else value[1:])[kind % 5]  # fmt: skip
    names = list(value)
    first = names[kind % len(names)] if names else "x"
    renamed = {(key[:-1] + "e" if key == first else key): child for key, child in value.items()}
    without = {key: child for key, child in value.items() if key != first}
    return (renamed, without, list(value.values()), {**value, first.title(): 1})[kind % 4]


slips = st.lists(
    st.tuples(st.sampled_from(PLACES), st.integers(0, 119), st.sampled_from(SYNONYMS)), min_size=1, max_size=3
)


def with_slips(chosen: list[tuple[tuple[str, tuple[str | int, ...]], int, str]]) -> Any:
    stem = chosen[0][0][0]
    document = ALL[stem]
    for (other, place), kind, word in chosen:
        node = document
        if other != stem:
            continue
        try:
            for step in place:
                node = node[step]  # type: ignore[index]
        except (KeyError, IndexError, TypeError):  # an earlier slip removed it
            continue
        document = replaced(document, place, slip_of(node, kind, word))
    return document


def validate_text(path: Path, text: str) -> tuple[int, str]:
    path.write_text(text, encoding="utf-8")
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main(["validate", str(path)])
    return code, err.getvalue()


def check_told(path: Path, code: int, told: str) -> None:
    assert code in (0, 2, 3)
    assert "internal error" not in told
    assert "Traceback" not in told
    if code:
        refused = [line for line in told.splitlines() if line.startswith((str(path), "fiducials/"))]
        assert refused
        for line in refused:
            assert f"{path}:" in line or ".csv:" in line or ".mrk.json:" in line
            # a pointer, or (document) at a line
            after = line.removeprefix(str(path))
            assert ": /" in after or after.split(":")[1].isdigit()


@pytest.mark.long
@settings(max_examples=150, deadline=None, suppress_health_check=SLOW)
@given(slips)
def test_the_command_points_at_every_slip(tmp_path: Path, chosen: Any) -> None:
    link = tmp_path / "fiducials"
    if not link.exists():
        link.mkdir()
        for known in (EXAMPLES / "fiducials").iterdir():
            (link / known.name).write_bytes(known.read_bytes())
    path = tmp_path / "design.yaml"
    check_told(path, *validate_text(path, yaml.safe_dump(with_slips(chosen), sort_keys=False)))


@settings(max_examples=100, deadline=None, suppress_health_check=SLOW)
@given(st.sampled_from(sorted(EXAMPLES.glob("*.yaml"))), st.integers(0, 10_000), st.integers(1, 40))
def test_decimal_commas_in_the_text_have_a_line(tmp_path: Path, example: Path, first: int, count: int) -> None:
    """Points of numbers become commas, from one of them on: what is refused stands at a line of the file."""
    text = example.read_text()
    points = [k for k in range(1, len(text) - 1) if text[k] == "." and text[k - 1].isdigit() and text[k + 1].isdigit()]
    chosen = set(points[first % len(points) :][:count])
    path = tmp_path / "design.yaml"
    changed = "".join("," if k in chosen else letter for k, letter in enumerate(text))
    code, told = validate_text(path, changed)
    check_told(path, code, told)
