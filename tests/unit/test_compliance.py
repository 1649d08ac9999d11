"""A compliance is symmetric and positive semidefinite, or it is refused with what to write instead."""

from __future__ import annotations

import re

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from plain_data import DEMO, problems_of, replaced
from tailstack.design import load_design
from tailstack.design.document import Compliance
from tailstack.errors import DesignError

AT = ("execution", "compliance", "matrix_mm_per_n")
C = np.array([[0.004, 0.0005, 0.0], [0.0005, 0.004, -0.0003], [0.0, -0.0003, 0.001]])


def refused(matrix):
    (problem,) = problems_of(load_design, replaced(DEMO, AT, np.asarray(matrix).tolist()), error=DesignError)
    assert problem.pointer == "/execution/compliance/matrix_mm_per_n"
    return problem


def obeyed(problem):
    """The matrix of a hint, which is accepted."""
    written = yaml.safe_load(re.search(r"matrix_mm_per_n: (\[\[.*\]\])", problem.hint)[1])
    load_design(replaced(DEMO, AT, written))
    return np.array(written)


def test_a_sign_that_is_wrong_is_refused_with_the_eigenvalue_and_the_matrix_to_write():
    problem = refused(-C)
    assert problem.code == "not-passive"
    assert f"{np.linalg.eigvalsh(-C)[0]:.4g} mm/N" in problem.detail
    np.testing.assert_allclose(obeyed(problem), C)


@pytest.mark.parametrize("axis", range(3))
def test_one_wrong_sign_on_the_diagonal_is_none_of_rounding(axis):
    bent = np.diag([0.004, 0.004, 0.001])
    bent[axis, axis] *= -1e-6
    assert refused(bent).code == "not-passive"


def test_an_asymmetric_one_is_refused_with_both_entries_and_their_mean():
    skew = C + np.outer([0.0002, 0, 0], [0, 1, 0])
    problem = refused(skew)
    assert (problem.code, "row 1, column 2 is 0.0007, row 2, column 1 0.0005" in problem.detail) == (
        "not-symmetric",
        True,
    )
    np.testing.assert_allclose(obeyed(problem), (skew + skew.T) / 2)


@pytest.mark.parametrize("half", [np.triu, np.tril])
def test_one_half_of_a_symmetric_matrix_is_completed(half):
    np.testing.assert_allclose(obeyed(refused(half(C))), C)


def test_an_indefinite_one_names_the_entry_that_is_too_large():
    """closed_form: [[a, c], [c, b]] is positive semidefinite up to c^2 = a b, here 0.002."""
    problem = refused([[0.004, 0, 0.003], [0, 0.004, 0], [0.003, 0, 0.001]])
    assert problem.code == "not-passive"
    assert "between x and z it is at most 0.002" in problem.hint


@settings(max_examples=60, deadline=None)
@given(st.lists(st.floats(-1, 1), min_size=9, max_size=9), st.floats(-6, 1), st.integers(1, 3))
def test_every_passive_matrix_of_three_digits_is_accepted_whatever_its_rank(entries, size, rank):
    factor = np.array(entries).reshape(3, 3)[:, :rank]
    written = [[float(f"{x:.4g}") for x in row] for row in 10**size * factor @ factor.T]
    assert Compliance.model_validate({"matrix_mm_per_n": written})


@settings(max_examples=60, deadline=None)
@given(st.lists(st.floats(-1, 1), min_size=9, max_size=9))
def test_what_is_accepted_gives_no_energy_to_any_push(entries):
    """independent of eigenvalues: f . C f of 200 pushes; a matrix that is accepted has none below rounding."""
    matrix = np.array(entries).reshape(3, 3)
    matrix = matrix + matrix.T + 1.5 * np.eye(3)  # about half of them are accepted
    try:
        Compliance.model_validate({"matrix_mm_per_n": matrix.tolist()})
    except ValueError:
        return
    pushes = np.random.default_rng(7).standard_normal((200, 3))
    energy = np.einsum("ki,ij,kj->k", pushes, matrix, pushes) / (pushes**2).sum(axis=1)
    assert energy.min() >= -3e-3 * np.abs(matrix).max()
