"""Locators to torsors: against a rigid motion solved from the contacts' own equations, and by words."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.optimize import root

from tailstack.design.compile import torsor_from_locators
from tailstack.errors import IllPosedError
from tailstack.geometry.rotation import rotation_xyz

POSITIONS = np.array([[-40.0, -30, -80], [40, -30, -80], [0, 35, -80], [-35, -40, -70], [35, -40, -70], [-50, 0, -70]])
NORMALS = np.array([[0.0, 0, 1], [0, 0, 1], [0, 0, 1], [0, 1, 0], [0, 1, 0], [1, 0, 0]])
PIVOT = np.array([3.0, -7.0, -95.0])


def test_columns_satisfy_the_contact_equations():
    torsors = torsor_from_locators(POSITIONS, 2.5 * NORMALS, PIVOT)
    for j in range(6):
        turn, shift = torsors[:3, j], torsors[3:, j]
        moved = [n @ (shift + np.cross(turn, p - PIVOT)) for p, n in zip(POSITIONS, NORMALS, strict=True)]
        np.testing.assert_allclose(moved, np.eye(6)[j], atol=1e-12)


def test_closed_form_of_a_3_2_1_seat():
    """closed_form: raising A2 by d over a base of 80 mm turns the part about y by -d/80 (A1, A3 held)."""
    column = torsor_from_locators(POSITIONS, NORMALS, PIVOT)[:, 1]
    assert column[1] == pytest.approx(-1 / 80, rel=1e-12)
    assert column[0] == pytest.approx(-0.5 / 65, rel=1e-12)  # midway between A1 and A3 in x, 65 mm in y


def test_agrees_with_the_finite_rigid_motion_for_small_deviations():
    """independent: solve n . (R (p - c) + c + t - p) = delta for a full rotation, by a root finder."""
    delta = 1e-3 * np.array([1.0, -2.0, 0.5, 1.5, -1.0, 2.0])

    def residual(torsor):
        moved = (POSITIONS - PIVOT) @ rotation_xyz(torsor[:3]).T + PIVOT + torsor[3:] - POSITIONS
        return (NORMALS * moved).sum(axis=1) - delta

    finite = root(residual, np.zeros(6), tol=1e-14).x
    np.testing.assert_allclose(torsor_from_locators(POSITIONS, NORMALS, PIVOT) @ delta, finite, atol=1e-7)


@given(st.lists(st.floats(-60, 60), min_size=18, max_size=18), st.lists(st.floats(-1, 1), min_size=18, max_size=18))
def test_random_seats_either_hold_or_are_refused(places, directions):
    positions, normals = np.reshape(places, (6, 3)), np.reshape(directions, (6, 3))
    assume(np.linalg.norm(normals, axis=1).min() > 0.1)
    unit = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    rows = np.hstack([np.cross(positions - PIVOT, unit), unit])
    if np.linalg.matrix_rank(rows, tol=1e-12) < 6:
        with pytest.raises(IllPosedError, match="free"):
            torsor_from_locators(positions, normals, PIVOT)
        return
    assume(np.linalg.cond(rows) < 1e8)
    torsors = torsor_from_locators(positions, normals, PIVOT)
    np.testing.assert_allclose(rows @ torsors, np.eye(6), atol=1e-5)


def motion(positions, normals):
    with pytest.raises(IllPosedError) as caught:
        torsor_from_locators(np.array(positions), np.array(normals), PIVOT, "/here")
    problem = caught.value.problems[0]
    assert (problem.pointer, problem.code) == ("/here", "free-motion")
    return problem.detail


def test_a_missing_end_stop_is_a_translation():
    normals = NORMALS.copy()
    normals[5] = [0, 1, 0]
    positions = POSITIONS.copy()
    positions[5] = [5, 40, -60]
    text = motion(positions, normals)
    assert "1 motion" in text
    assert "translation along x" in text


def test_pins_in_one_line_leave_the_turn_about_it():
    positions, normals = POSITIONS.copy(), NORMALS.copy()
    positions[4], normals[4] = [-50, 20, -70], [1, 0, 0]
    positions[5], normals[5] = [-50, 20, -70], [1, 0, 0]  # the same contact twice
    text = motion(positions, normals)
    # closed_form: B1's normal runs along y at x = -35, C's along x at y = 20; only turning about z through where
    # the two meet moves neither
    assert "rotation about z through (-35, 20, " in text


def test_three_normals_through_a_point_with_all_else_parallel():
    positions = [[-40, -30, -80], [40, -30, -80], [0, 35, -80], [-35, 0, -70], [35, 0, -70], [0, -50, -70]]
    normals = [[0, 0, 1], [0, 0, 1], [0, 0, 1], [1, 0, 0], [-1, 0, 0], [0, 1, 0]]
    assert "rotation about z through (0, 0, " in motion(positions, normals)


def test_two_free_motions_are_both_named():
    positions = np.vstack([POSITIONS[:3], POSITIONS[:3]])
    positions[:, 2] = -80
    text = motion(positions, np.tile([0.0, 0, 1], (6, 1)))
    assert "3 motion" in text
    assert "translation along x" in text
    assert "translation along y" in text
    assert "rotation about z" in text
