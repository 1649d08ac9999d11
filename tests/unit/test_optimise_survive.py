"""Designs that keep a limit when fiducials are lost: against the optimum that nobody asked for that."""

from __future__ import annotations

import copy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from tailstack import load_design, optimise, score, verify
from tailstack.design import Design
from tailstack.errors import DesignError
from tailstack.optimisation.exact_law import image_parts
from tailstack.optimisation.symbols import plain
from tailstack.optimisation.task import read_task
from tailstack.optimisation.terms import estimator_of, every_terms, image_parts_at
from tailstack.propagation.linear import linearise

DEMO = yaml.safe_load((Path(__file__).parents[2] / "examples" / "demo.yaml").read_text())


def design_of(count: int, survive: dict | None, **section: object) -> Design:
    """The drill guide with so many of its beads."""
    data = copy.deepcopy(DEMO)
    data["fiducials"]["points"] = data["fiducials"]["points"][:count]
    data["optimise"] |= {"starts": 1, **({} if survive is None else {"survive": survive}), **section}
    return load_design(data)


def placed(count: int, survive: dict | None) -> Design:
    """Nothing but the places of the beads is free."""
    data = copy.deepcopy(design_of(count, survive).source.data)
    data["optimise"] |= {"objective": "quantile"}
    data["optimise"].pop("rotation_bounds")
    data["requirements"][0]["limit_mm"] = 2.0
    return load_design(data)


@pytest.mark.long
@pytest.mark.parametrize(
    ("plain", "safe", "lost"),
    [
        (design_of(7, None), design_of(7, {"lost": 1, "limit_mm": 1.02}), 1),
        (placed(7, None), placed(7, {"lost": 1, "limit_mm": 1.12}), 1),
        (placed(9, None), placed(9, {"lost": 2, "limit_mm": 1.5}), 2),
    ],
    ids=["cost", "places", "places, pairs"],
)
def test_what_survives_a_loss_beats_what_was_not_asked_to(plain, safe, lost):
    """sampled: Monte Carlo of both designs without the beads whose loss is worst for each."""
    before, after = optimise(plain), optimise(safe)
    assert before.survived is None
    found = after.survived
    assert len(found.lost) == lost
    assert found.interval_mm[1] <= found.limit_mm
    for record, beaten in ((before, True), (after, False)):
        design = load_design(record.design)
        (losses,) = score(design).losses
        worst = losses.single if lost == 1 else losses.double
        assert (worst.value_mm > found.limit_mm) == beaten
        left = copy.deepcopy(design.source.data)
        labels = [point["label"] for point in left["fiducials"]["points"]]
        gone = [labels.index(label) for label in worst.lost]
        left["fiducials"]["points"] = [p for k, p in enumerate(left["fiducials"]["points"]) if k not in gone]
        left.pop("optimise")
        estimate = verify(load_design(left), trials=2**15, seed=3).targets[0]
        assert (estimate.p95_interval_mm[0] > found.limit_mm) == beaten


def test_what_cannot_be_survived_is_refused_where_it_is_asked_for():
    with pytest.raises(DesignError) as caught:
        design_of(7, {"lost": 2, "limit_mm": 1.0})
    assert (caught.value.problems[0].pointer, caught.value.problems[0].code) == (
        "/optimise/survive/lost", "too-few-fiducials",
    )  # fmt: skip
    with pytest.raises(DesignError):
        design_of(8, {"lost": 1, "limit_mm": 1.0}, objective="pareto")
    data = copy.deepcopy(design_of(8, {"lost": 2, "limit_mm": 1.0}).source.data)
    data["views"][0]["sees"] = [point["label"] for point in data["fiducials"]["points"]][:7]
    with pytest.raises(DesignError, match="5 fiducials would be left"):
        load_design(data)
    data["model"] = {"estimator": "pose"}  # which four fiducials determine
    load_design(data)


def test_every_loss_is_a_demand_with_the_covariance_of_what_is_left():
    """brute force: the linear model of the system without the fiducial."""
    problem = read_task(design_of(8, {"lost": 1, "limit_mm": 1.0})).problems[0]
    terms = every_terms(problem)
    estimator = estimator_of(problem.system)
    assert [term.demand.lost for term in terms] == [(), *((label,) for label in problem.system.fiducial_labels)]
    for term in terms:
        laid = replace(problem.system, fiducials_mm=plain(problem.system.fiducials_mm))
        given = (laid, plain(estimator.projections), plain(estimator.assumed_shift_mm))
        images = image_parts_at(estimator, term, *given, plain(term.reconstructed_mm))
        rest = [i for i, label in enumerate(problem.system.fiducial_labels) if label not in term.demand.lost]
        system = replace(
            problem.system,
            fiducial_labels=tuple(problem.system.fiducial_labels[i] for i in rest),
            fiducials_mm=problem.system.fiducials_mm[rest],
            manufacturing_half_width_mm=problem.system.manufacturing_half_width_mm[rest],
        )
        expected = image_parts(linearise(system, system.targets[0]), "tcp")
        np.testing.assert_allclose(images.noise.astype(float), expected[0], rtol=1e-9)
        np.testing.assert_allclose(images.made.astype(float), expected[1], rtol=1e-9)
