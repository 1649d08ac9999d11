"""The client that the FreeCAD and Slicer examples share: one request at a time, the latest wins, plain refusals.

A server of a few lines stands for the service, so that it can be slow and wrong at will.
"""

from __future__ import annotations

import ast
import importlib.util
import json
import re
from collections.abc import Iterator
from contextlib import AbstractContextManager
from threading import Event
from types import ModuleType
from typing import Any

import pytest
from service_scenes import EXAMPLES, answering, http_answer

from plain_data import read_cases
from waiting import LIMIT_SECONDS, until

DOORS = EXAMPLES / "integrations"
CLIENT = DOORS / "freecad" / "tailstack_http.py"
Answer = tuple[int, Any]


@pytest.fixture(scope="module")
def client() -> ModuleType:
    spec = importlib.util.spec_from_file_location("tailstack_http_of_the_examples", CLIENT)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def serving(*answers: Answer) -> AbstractContextManager[tuple[str, list[bytes]]]:
    """A server that gives these answers, one after the other: a text as it is, anything else as JSON."""
    texts = [content if isinstance(content, str) else json.dumps(content) for _, content in answers]
    return answering(*(http_answer(status, text.encode()) for (status, _), text in zip(answers, texts, strict=True)))


def test_a_drag_has_one_request_in_flight_and_ends_with_the_latest(client: ModuleType) -> None:
    """Nothing is answered before the last of forty is asked: whoever drags does not wait for an answer."""
    dragged, under_way, most = Event(), list[int](), list[int]()

    def slowly(number: int) -> Iterator[int]:
        under_way.append(number)
        most.append(len(under_way))
        assert dragged.wait(LIMIT_SECONDS)
        under_way.remove(number)
        yield number

    latest = client.Latest(slowly)
    for number in range(40):
        latest.ask(number)
        assert latest.take() == []
    dragged.set()
    until(lambda: not latest.is_busy)
    taken = latest.take()
    assert taken[-1] == (39, 39)
    assert [question for question, _ in taken] == sorted(question for question, _ in taken)
    assert max(most) == 1
    assert len(most) <= 2  # the others were overtaken and never sent


def test_a_long_answer_is_given_up_when_something_newer_is_asked(client: ModuleType) -> None:
    steps: list[tuple[str, int]] = []
    begun, overtaken = Event(), Event()

    def in_steps(name: str) -> Iterator[tuple[str, int]]:
        for step in range(100):
            steps.append((name, step))
            begun.set()
            assert overtaken.wait(LIMIT_SECONDS)
            yield name, step

    latest = client.Latest(in_steps)
    latest.ask("old")
    assert begun.wait(LIMIT_SECONDS)
    latest.ask("new")
    overtaken.set()
    until(lambda: not latest.is_busy)
    assert {question for question, _ in latest.take()} == {"new"}
    assert len([step for step in steps if step[0] == "old"]) == 1


def test_an_error_of_a_request_is_an_answer_and_the_thread_lives_on(client: ModuleType) -> None:
    def fail_at_first(number: int) -> Iterator[int]:
        if number == 0:
            raise client.Refusal("no")
        yield number

    latest = client.Latest(fail_at_first)
    answers = []
    for number in (0, 1):
        latest.ask(number)
        until(lambda: not latest.is_busy)
        answers += [str(answer) for _, answer in latest.take()]
    assert answers == ["no", "1"]


@pytest.mark.long
def test_an_optimisation_that_becomes_a_job_is_waited_for(client: ModuleType) -> None:
    states = [(200, {"state": state}) for state in ("queued", "running", "succeeded")]
    with serving((202, {"id": "j1"}), *states, (200, {"p95_after_mm": 0.5})) as (address, asked):
        assert client.Service(address).optimise({}) == {"p95_after_mm": 0.5}
    paths = [head.split()[1].decode() for head in asked]
    assert paths == ["/v1/optimisations", *["/v1/jobs/j1"] * 3, "/v1/jobs/j1/result"]


@pytest.mark.parametrize(("answer", "words"), read_cases("clients", "refused"))
def test_what_a_service_refuses_is_said_in_its_words(client: ModuleType, answer: Answer, words: str) -> None:
    with serving(answer) as (address, _), pytest.raises(client.Refusal, match=re.escape(words)):
        client.Service(address).score({})


def test_other_beads_keep_what_the_design_says_of_beads(client: ModuleType) -> None:
    points = [
        {"label": "A", "position_mm": [1, 2, 3], "loss_probability": 0.2},
        {"label": "B", "position_mm": [0, 0, 0]},
    ]
    design = {"name": "x", "fiducials": {"points": points, "diameter_mm": 3, "origin": {"file": "a.csv"}}}
    made = client.with_beads(design, [("C", (4.0, 5.0, 6.0)), ("A", (7.0, 8.0, 9.0))])
    assert made["fiducials"] == {
        "points": [
            {"label": "C", "position_mm": [4.0, 5.0, 6.0]},
            {"label": "A", "position_mm": [7.0, 8.0, 9.0], "loss_probability": 0.2},
        ],
        "diameter_mm": 3,
    }


def test_the_examples_run_on_the_python_of_the_programs_that_load_them() -> None:
    """FreeCAD and Slicer bring their own Python, back to 3.9, and nothing that is not in it."""
    for path in [*DOORS.glob("freecad/*.py"), *DOORS.glob("slicer/*.py")]:
        ast.parse(path.read_text(encoding="utf-8"), feature_version=(3, 9))
    assert (DOORS / "slicer" / CLIENT.name).read_bytes() == CLIENT.read_bytes()
