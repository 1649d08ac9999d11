"""What a caller of the library hands over, and what it gets back: numbers, frames, refusals, designs."""

from __future__ import annotations

import copy
import dataclasses
import pickle
import re
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from datetime import timedelta
from decimal import Decimal
from importlib import import_module
from multiprocessing import get_context
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pandas as pd  # type: ignore[import-untyped]
import pyarrow as pa
import pytest

from plain_data import EXAMPLES, places_of, problems_of, value_at
from tailstack import DesignFunction, load_design, score, score_batch, sweep
from tailstack.errors import DesignError, Problem, TailstackError

ROOT = Path(__file__).parents[2]
DEMO = load_design(EXAMPLES / "demo.yaml")
NOISE = "views.*.fiducial_noise_px"


class Quantity:
    """Numbers with a unit, as pint has them: NumPy takes them without it."""

    magnitude, units = np.array([0.1, 0.2]), "millimeter"

    def __array__(self, *_: Any, **__: Any) -> Any:
        return self.magnitude


class Column:
    """A column of polars with a null, which NumPy takes as NaN."""

    dtype = np.dtype(float)

    def null_count(self) -> int:
        return 1

    def is_null(self) -> list[bool]:
        return [False, True]

    def __array__(self, *_: Any, **__: Any) -> Any:
        return np.array([0.1, np.nan])


NO_NUMBERS: dict[str, Callable[[], Any]] = {
    "masked": lambda: np.ma.array([0.1, 5.0], mask=[False, True]),
    "a masked element": lambda: [0.1, np.ma.masked],
    "missing in pandas": lambda: pd.array([0.1, None], dtype="Float64"),
    "missing in Arrow": lambda: pa.array([0.1, None]),
    "missing in polars": Column,
    "None": lambda: [0.1, None],
    "boolean": lambda: [True, 0.2],
    "a boolean array": lambda: np.array([True, False]),
    "text": lambda: ["0.1", "0.2"],
    "an array of texts": lambda: np.array(["0.1", "0.2"]),
    "one text": lambda: "0.1",
    "complex": lambda: [0.1 + 1j, 0.2],
    "a complex array": lambda: np.array([0.1 + 1j, 0.2]),
    "durations": lambda: np.array([1, 2], dtype="m8[s]"),
    "a duration": lambda: [timedelta(seconds=1), 0.2],
    "a duration of NumPy": lambda: [np.timedelta64(1, "s"), 0.2],
    "dates": lambda: np.array(["2026-01-01", "2026-01-02"], dtype="M8[D]"),
    "a quantity": Quantity,
    "a list of quantities": lambda: [Quantity(), Quantity()],
    "a generator": lambda: (each for each in (0.1, 0.2)),
    "a set": lambda: {0.1, 0.2},
    "a mapping": lambda: {0: 0.1, 1: 0.2},
    "objects": lambda: [Decimal("0.1"), object()],
    "an object array": lambda: np.array([0.1, None], dtype=object),
    "two dimensions": lambda: np.array([[0.1], [0.2]]),
    "nested lists": lambda: [[0.1], [0.2]],
    "a number too large": lambda: [10**400, 0.1],
}
DOORS: dict[str, Callable[[Any], Any]] = {
    "score_batch": lambda values: score_batch(DEMO, {NOISE: values}),
    "sweep": lambda values: sweep(DEMO, {NOISE: values}),
    "design_at": lambda values: DesignFunction(DEMO, ["views.AP.fiducial_noise_px"] * 2).design_at(values),
    "with_value": lambda values: DEMO.with_value(NOISE, values[1] if isinstance(values, list) else values),
}


@pytest.mark.parametrize("door", DOORS)
@pytest.mark.parametrize("kind", NO_NUMBERS)
def test_what_is_no_number_is_refused_at_every_door(kind: str, door: str) -> None:
    if (kind, door) in {(each, "with_value") for each in ("boolean", "complex", "a duration", "a duration of NumPy")}:
        values: Any = NO_NUMBERS[kind]()[0]  # where there is one value, it is this one
    elif (kind, door) == ("a number too large", "with_value"):
        values = 10**400
    elif kind == "objects":
        values = [object(), object()]
    else:
        values = NO_NUMBERS[kind]()
    problem = problems_of(DOORS[door], values)[0]
    assert problem.code in ("wrong-type", "unsupported-value", "out-of-range", "bad-key"), problem
    assert "got " in problem.detail or "too large" in problem.detail


@pytest.mark.parametrize(
    "numbers",
    [
        [0.1, 1], (0.1, 1), np.array([0.1, 1]), np.array([0.1, 1], dtype=object), [np.float64(0.1), np.int32(1)],
        np.ma.array([0.1, 1.0], mask=[False, False]), pd.Series([0.1, 1.0], index=["b", "a"]), pa.array([0.1, 1.0]),
        pd.array([0.1, 1.0], dtype="Float64"),
    ],
    ids=lambda each: type(each).__name__,
)  # fmt: skip
def test_numbers_in_any_form_are_the_same_numbers(numbers: Any) -> None:
    column = score_batch(DEMO, {NOISE: numbers}).columns["p95_mm:tip"]
    assert column.tolist() == score_batch(DEMO, {NOISE: [0.1, 1.0]}).columns["p95_mm:tip"].tolist()


def test_a_frame_comes_back_with_its_labels() -> None:
    frame = pd.DataFrame({NOISE: [0.3, 0.1, 0.2]}, index=["c", "a", "b"])
    ordered = frame.sort_values(NOISE)
    alone = frame[frame[NOISE] > 0.15]
    for table in (frame, ordered, alone, {NOISE: ordered[NOISE]}):
        scores = score_batch(DEMO, table).to_frame()["p95_mm:tip"]
        for label in scores.index:
            assert scores[label] == score(DEMO.with_value(NOISE, frame.loc[label, NOISE])).targets[0].p95_mm
    assert list(score_batch(DEMO, {NOISE: [0.1, 0.2]}).to_frame().index) == [0, 1]
    twice = {NOISE: frame[NOISE], "interfaces.connector_flange.tolerances.rx.half_width_deg": ordered[NOISE]}
    with pytest.raises(TailstackError, match="different row labels"):
        score_batch(DEMO, twice)


def test_a_table_of_polars_gives_one_back(monkeypatch: pytest.MonkeyPatch) -> None:
    """By a stand-in of its interface: iterating over a frame of polars gives columns, and it has no row labels."""

    class DataFrame:
        def __init__(self, data: dict[str, Any]) -> None:
            self.columns, self.data = list(data), data

        def __getitem__(self, name: str) -> Any:
            return self.data[name]

        def __iter__(self) -> Iterator[Any]:
            return iter(self.data.values())

    polars = ModuleType("polars")
    polars.DataFrame = DataFrame  # type: ignore[attr-defined]
    DataFrame.__module__ = "polars.dataframe.frame"
    monkeypatch.setitem(__import__("sys").modules, "polars", polars)
    found = score_batch(DEMO, DataFrame({NOISE: [0.1, 0.2]})).to_frame()  # type: ignore[arg-type]
    assert isinstance(found, DataFrame)
    assert "p95_mm:tip" in found.columns


def test_what_is_no_table_and_no_element_is_refused() -> None:
    tables: tuple[Any, ...] = (None, [[0.1]], 5, "a")
    for table in tables:
        with pytest.raises(TailstackError, match="a table is a mapping of columns"):
            score_batch(DEMO, table)
    for door in ("score_batch", "sweep", "design_at"):
        problem = problems_of(DOORS[door], np.ma.array([0.1, 5.0], mask=[False, True]))[0]
        assert problem.pointer.endswith("/1")
        assert "missing value" in problem.detail
        assert "leave out" in problem.hint


# --- refusals ----------------------------------------------------------------------------------------------


def list_refusals() -> list[type[TailstackError]]:
    """Every class of refusal in both packages."""
    for room in (ROOT / "solver", ROOT / "service"):
        for path in sorted(room.rglob("*.py")):
            if re.search(r"^class \w+\(\w*(Error|RefusedAt|TooLarge)\b", path.read_text(), re.MULTILINE):
                import_module(".".join(path.relative_to(room).with_suffix("").parts))
    found = [TailstackError]
    for kind in found:
        found += kind.__subclasses__()
    return found


def test_refusals_survive_pickle_and_copy() -> None:
    problems = (Problem("/views", "too-short", "needs two", "add one", "a.yaml", 3, 1), Problem("", "other", "detail"))
    kinds = list_refusals()
    assert len(kinds) > 30
    for kind in kinds:
        error = kind.__new__(kind, "text")
        TailstackError.__init__(error, problems)
        error.extra = {"at": 1}  # type: ignore[attr-defined]
        error.add_note("note")
        for same in (pickle.loads(pickle.dumps(error)), copy.copy(error), copy.deepcopy(error)):
            assert type(same) is kind
            assert (same.problems, str(same), vars(same)) == (problems, str(error), vars(error)), kind


def refuse() -> None:
    load_design({"schema": "tailstack/design/1"})


@pytest.mark.long
def test_a_refusal_crosses_a_process_pool() -> None:
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool, pytest.raises(DesignError) as refused:
        pool.submit(refuse).result()
    assert refused.value.problems == problems_of(refuse)


# --- designs -----------------------------------------------------------------------------------------------


def test_a_design_cannot_be_changed_behind_its_hash() -> None:
    changes: list[Callable[[Any], Any]] = [
        lambda each: each.__setitem__(next(iter(each)) if isinstance(each, dict) else 0, 1),
        lambda each: each.clear(),
        lambda each: each.pop(next(iter(each))) if isinstance(each, dict) else each.pop(),
        lambda each: each.update({"a": 1}) if isinstance(each, dict) else each.append(1),
        lambda each: each.__ior__({"a": 1}) if isinstance(each, dict) else each.__iadd__([1]),
    ]
    data, document = DEMO.source.data, DEMO.document
    containers = [each for place in places_of(data) if isinstance(each := value_at(data, place), dict | list)]
    containers += [document.views, document.targets, document.requirements, document.fiducials.points]
    assert len(containers) > 20
    for container in containers:
        for change in changes:
            with pytest.raises(TypeError, match="with_value"):
                change(container)
    assert load_design(DEMO.source.data).sha256 == DEMO.sha256


def test_a_design_that_is_replaced_copied_or_sent_has_the_hash_of_what_is_scored() -> None:
    other = DEMO.with_value(NOISE, 1.0)
    made = dataclasses.replace(DEMO, document=other.document)
    assert (made.sha256, score(made).provenance.design_sha256) == (other.sha256, other.sha256)
    with pytest.raises(ValueError, match="sha256"):
        dataclasses.replace(DEMO, sha256="0" * 64)
    for same in (pickle.loads(pickle.dumps(DEMO)), copy.deepcopy(DEMO)):
        assert (same.sha256, score(same).targets[0].p95_mm) == (DEMO.sha256, score(DEMO).targets[0].p95_mm)
    plain = copy.deepcopy(DEMO.source.data)
    plain["views"][0]["fiducial_noise_px"] = 1.0
    assert load_design(plain).sha256 != DEMO.sha256
