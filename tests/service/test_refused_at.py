"""A refusal says where in what was sent, once, and is the same on both sides of a pipe between processes."""

from __future__ import annotations

import json
import pickle
from datetime import date

import pytest
from service_scenes import small_design

from tailstack.errors import DesignError, IllPosedError, Problem
from tailstack_service.gate.request import admit_gate, read_gate
from tailstack_service.http import computations
from tailstack_service.operations.content import canonical
from tailstack_service.operations.request import DesignReferenceUnresolved
from tailstack_service.problems import RefusedAt
from tailstack_service.processes.task import RawRequest
from tailstack_service.settings import Settings

NOWHERE = "0" * 64


def test_a_refusal_is_placed_once_and_keeps_what_it_is() -> None:
    error = IllPosedError([Problem("/fiducials", "coplanar", "all in one plane", "move one"), Problem("", "x", "y")])
    placed = RefusedAt.place(error, "/second")
    assert [problem.pointer for problem in placed.problems] == ["/second/fiducials", "/second"]
    assert (placed.slug, placed.title, placed.exit_code) == ("ill-posed-geometry", error.title, 3)
    assert RefusedAt.place(placed, "/design") is placed
    assert [problem.pointer for problem in error.problems] == ["/fiducials", ""], "the error itself stays as it was"


def test_a_refusal_crosses_a_pipe_whole() -> None:
    placed = RefusedAt.place(DesignError(Problem("/views/0", "wrong-type", "a mapping", "", "d.yaml", 3, 1)), "/design")
    there = pickle.loads(pickle.dumps(placed))
    assert isinstance(there, RefusedAt)
    assert (there.problems, there.slug, there.title, there.exit_code, str(there)) == (
        placed.problems, placed.slug, placed.title, placed.exit_code, str(placed),
    )  # fmt: skip


@pytest.mark.parametrize("operation", ["score", "verification", "batch"])
def test_a_design_that_is_named_is_asked_for_whatever_reads_it(operation: str) -> None:
    body = {
        "design_sha256": NOWHERE,
        **({"table": {"/views/0/fiducial_noise_px": [0.1]}} if operation == "batch" else {}),
    }
    sent = RawRequest("json", canonical(body))
    found = computations.perform(lambda: computations.receive(operation, sent, Settings()))
    assert isinstance(found, DesignReferenceUnresolved)
    assert pickle.loads(pickle.dumps(found)).sha256 == NOWHERE


def test_a_patched_design_is_refused_where_the_design_stands_with_the_place_in_the_patch() -> None:
    body = {"design": small_design(), "patch": {"views": 3}}
    found = computations.perform(lambda: computations.receive("score", RawRequest("json", canonical(body)), Settings()))
    assert isinstance(found, RefusedAt)
    (problem,) = found.problems
    assert problem.pointer == "/design/views"
    assert problem.detail.count("/patch/views") == 1


def test_an_admitted_gate_is_the_one_that_its_content_describes() -> None:
    """What is judged at once and what a job would read are one gate."""
    design = {"file": "a.yaml", "text": json.dumps(small_design())}
    admitted = admit_gate({"designs": [design], "mode": "analytic"}, today=date(2026, 11, 21))
    again = read_gate(admitted.content)
    assert (again.seed, again.mode, again.today) == (admitted.gate.seed, admitted.gate.mode, admitted.gate.today)
    assert [entry.design.sha256 for entry in again.designs if entry.design] == [
        entry.design.sha256 for entry in admitted.gate.designs if entry.design
    ]
    assert admitted.terms["policy_sha256"] == again.policy.sha256
