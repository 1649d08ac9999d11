"""Where information is worth having: against a second solver, and in designs that say where it must be."""

from __future__ import annotations

import cvxpy as cp
import numpy as np
import pytest

from plain_data import DEMO, EXAMPLES, replaced
from tailstack import load_design
from tailstack.optimisation.global_bound import cells_of, information_of, mix_layouts, target_information
from tailstack.optimisation.request import read_request
from tailstack.optimisation.terms import every_terms
from tailstack.optimisation.worth import worthy_places


@pytest.mark.parametrize("spacing_mm", [0.0, 40.0])
def test_the_best_mixture_is_that_of_a_second_solver(spacing_mm: float) -> None:
    """independent: cvxpy over the weights of the cells, at most one fiducial in each where they are kept apart."""
    data = replaced(DEMO, ("optimise", "min_spacing_mm"), spacing_mm)
    problem = read_request(load_design(data | {"model": {"estimator": "pose"}})).problem
    term = every_terms(problem)[0]
    information = information_of(problem, term)
    (cells,) = (cells_of(information, beads) for beads in information.beads)
    kept = np.linspace(0, len(cells.centres) - 1, 60).astype(int)
    cells = cells._replace(centres=cells.centres[kept], slopes=cells.slopes[kept])
    _, (weights,) = mix_layouts(information, [cells], term.to_error.T)
    base, aim = target_information(information), np.vstack([term.to_error.T, np.zeros((information.unknowns - 3, 3))])
    # in unknowns in which fiducials everywhere know the unit matrix, which a solver takes more easily
    root = np.linalg.inv(np.linalg.cholesky(base + cells.evenly))
    each = np.einsum("nrd,nre->nde", cells.slopes @ root.T, cells.slopes @ root.T)
    base, aim = root @ base @ root.T, root @ aim

    def left(of: np.ndarray) -> float:
        return float(np.trace(aim.T @ np.linalg.solve(base + np.tensordot(of, each, 1), aim)))

    free = cp.Variable(len(kept), nonneg=True)
    known = base + sum(free[k] * each[k] for k in range(len(kept)))
    apart = [free <= 1] if spacing_mm else []
    within = [cp.sum(free) == cells.beads.number, *apart]
    cp.Problem(cp.Minimize(sum(cp.matrix_frac(aim[:, k], known) for k in range(3))), within).solve(solver=cp.CLARABEL)
    assert weights.sum() == pytest.approx(cells.beads.number)
    assert weights.max() <= 1 + 1e-9 or not spacing_mm
    assert left(weights) == pytest.approx(left(free.value), rel=2e-3)


def test_places_lie_in_the_envelope_and_copies_tell_as_much() -> None:
    """closed_form: a tube whose fiducials come in threes, each a third of a turn from the next."""
    places = worthy_places(load_design(EXAMPLES / "tube_carrier.yaml"))
    at = np.array([place.position_mm for place in places])
    assert np.hypot(at[:, 0], at[:, 1]).max() <= 42.0 + 1e-3
    turn = np.array([[-0.5, -np.sqrt(0.75)], [np.sqrt(0.75), -0.5]])
    for place, (x, y, z) in zip(places, at, strict=True):
        there = np.append(turn @ [x, y], z)
        k = int(np.linalg.norm(at - there, axis=1).argmin())
        assert np.linalg.norm(at[k] - there) < 2e-3
        assert places[k].fiducials == place.fiducials


def test_without_a_free_fiducial_there_is_no_place() -> None:
    assert worthy_places(load_design(EXAMPLES / "locators_321.yaml")) == ()
