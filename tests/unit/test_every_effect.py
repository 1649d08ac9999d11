"""Statements about *all* that a design declares, on a scene in which everything is at work.

A new field of a system fails the first test until the scene has it; the others then ask of it what they ask of all:
no list of names in them.
"""

from __future__ import annotations

import re
from dataclasses import fields, replace
from functools import partial
from pathlib import Path
from typing import Annotated

import numpy as np
import pytest
import yaml
from pydantic import Field

from plain_data import DEMO, EXAMPLES, replaced
from random_designs import random_document, under
from random_designs import with_effects as with_typical
from scenes import every_effect, with_effects
from tailstack import load_design, score, verify
from tailstack.effects import EFFECTS
from tailstack.fields import INTERFACES, Typical
from tailstack.laws import Drawn
from tailstack.montecarlo.chain import draw, evaluate
from tailstack.montecarlo.plan import compile_plan
from tailstack.propagation.linear import linearise
from tailstack.results import Score
from tailstack.studies.bench.levels import draw_time, share_draws
from tailstack.studies.coupling import name_sources, remove_biases, study_coupling
from tailstack.studies.linearity import study_linearity
from tailstack.system import Law, Sources, System, View, no_sources
from tailstack_service.gate.design_rules import name_largest_share
from tailstack_service.rendering.sentences import shares_of
from tailstack_service.report.records import headline_of
from typical import draw_value

# What is no source of error, known or random: what is seen, from where, where to, and how it is computed.
GEOMETRY = {
    System: {
        "name", "views", "fiducial_labels", "fiducials_mm", "manufacturing_law", "manufacturing_coverage_factor",
        "T_flange_con", "T_tcp_flange", "targets", "requirements", "reading", "rotation_form", "estimator",
        "triangulation", "notes", "design_sha256", "fiducial_radius_mm", "assumed", "title_block",
        "loss_probability",  # moves nothing: it is asked what is left when images are missing
    },
    View: {"name", "projection", "image_size_px", "sees", "intrinsics_prior"},
}  # fmt: skip

CONVENTIONS = Path(__file__).parents[2] / "docs" / "conventions.md"
CALLED = {  # there
    "structure_connector": "both interfaces", "connector_flange": "both interfaces", "hand_eye": "hand–eye",
    "fiducial_manufacturing": "manufacturing", "image_field": "residual image fields", "execution": "repeatability",
    "assumed_intrinsics": "assumed intrinsics", "detector_tilt": "tilts of the detector", "fiducial_noise": "noise",
    "clamping": "clampings", "robot": "robot's joints and links", "joint_scatter": "scatter of the joints",
    "target_noise": "noise", "motion": "motion between the shots", "temperature": "temperature",
}  # fmt: skip


@pytest.fixture(scope="module")
def scene() -> System:
    return every_effect(np.random.default_rng(3))


def test_the_scene_has_every_effect(scene: System) -> None:
    kinds = {effect.name.split(":")[0] for effect in scene.effects} - {"joint_scatter"}  # declared with the robot
    assert len(kinds) == len(EFFECTS), "put the new effect into scenes.every_effect"
    for effect in scene.effects:
        assert effect.sources.count or effect.known.any(), effect.name
    places: tuple[System | View, ...] = (scene, *scene.views)
    for place in places:
        for each in fields(place):
            if each.name not in GEOMETRY[type(place)]:
                value = getattr(place, each.name)
                assert value is not None, f"put {each.name} into scenes.every_effect, or call it geometry"
                if isinstance(value, (float, np.ndarray)):
                    assert np.any(np.asarray(value) != 0), each.name
                if (sources := getattr(value, "sources", value)) is not value:
                    assert sources.count, each.name
                if (bias := getattr(value, "bias", None)) is not None:
                    assert np.any(bias != 0), each.name


def test_what_is_typical_lies_in_its_domain_and_random_designs_have_all_of_it() -> None:
    """sampled: each effect is in 35 of a hundred designs, so that none of thirty has it in 1 of 4e5."""
    met: set[str] = set()
    for seed in range(30):
        rng = np.random.default_rng([39, seed])
        document = with_typical(under(random_document(rng, 2, 8, False), "pose", "", rng), rng)
        met.update(document, document["fiducials"], document.get("execution", ()), *document["views"])
    assert {name for kind in EFFECTS for name in kind.section.model_fields} <= met


NUMBER = Annotated[float, Field(ge=0, le=10)]
WRONG = [NUMBER, Annotated[NUMBER, Typical(-1, 5)], Annotated[NUMBER, Typical(1, 11)]]


@pytest.mark.parametrize("kind", WRONG, ids=["none", "below", "above"])
def test_a_number_without_a_typical_value_or_with_one_outside_its_domain_fails(kind: object) -> None:
    with pytest.raises(AssertionError, match="typical"):
        draw_value(kind, np.random.default_rng(0), 1.0, {})


def test_without_biases_nothing_is_left_that_is_known(scene: System) -> None:
    """closed form: the error of the full chain at the centre of all that is random is 0."""
    before = evaluate(compile_plan(scene), np.zeros((1, compile_plan(scene).dimension)))
    plan = compile_plan(remove_biases(scene))
    after = evaluate(plan, np.zeros((1, plan.dimension)))
    assert np.abs(before).max() > 0.1
    assert np.abs(after).max() < 1e-9
    model = linearise(plan.system, plan.system.targets[0])
    assert not model.known
    assert np.abs(model.bias_mm("tcp")).max() < 1e-9
    assert plan.dimension == compile_plan(scene).dimension


def test_what_is_known_counts_once(scene: System) -> None:
    """closed form: where noise is next to nothing, so is what it adds, whatever else is known."""
    quiet = replace(
        scene,
        views=tuple(replace(view, fiducial_noise_px=1e-6, target_noise_px=1e-6) for view in scene.views),
        execution=replace(scene.execution, sources=no_sources(3)),
        effects=tuple(
            replace(effect, sources=no_sources(len(effect.known))) if effect.drawn is Drawn.SHOT else effect
            for effect in scene.effects
        ),
    )
    for case in study_coupling(quiet, levels=((1.0, 2.0),), trials=2**13).cases:
        assert case.p95_noise_mm < 1e-4
        assert case.p95_vector_sum_mm == pytest.approx(case.p95_installation_mm, rel=1e-3)


def test_every_source_is_named_as_installation_or_as_noise(scene: System) -> None:
    model = linearise(scene, scene.targets[0])
    once, again = (name_sources(model, held=held) for held in (True, False))
    for block in model.blocks:
        kind = block.contributor.split(":")[0].replace("_", " ")
        assert (kind in once) == (block.effect.drawn is Drawn.UNIT)
        assert (kind in again) != (block.effect.drawn is Drawn.UNIT)
    assert "all that is known" in once


def sources_of(system: System) -> dict[str, System]:
    """The system with everything bounded in one place, for each place that may be."""
    found = {}
    for each in fields(system):
        value = getattr(system, each.name)
        if hasattr(value, "sources"):
            found[each.name] = replace(system, **{each.name: replace(value, sources=bound(value.sources))})
    for effect in system.effects:
        if effect.sources.count:
            found[effect.name] = with_effects(system, replace(effect, sources=bound(effect.sources)))
    return found


def bound(sources: Sources) -> Sources:
    return replace(sources, laws=tuple(Law.BOUNDED if j == 0 else law for j, law in enumerate(sources.laws)))


def test_every_place_that_may_be_bounded_is_noticed(scene: System) -> None:
    counts = (len(scene.fiducials_mm),)
    study = partial(
        study_linearity, noises_px=(0.5,), rotations_deg=(0.0,), spreads=(1.0,), counts=counts, trials=2**13
    )
    said = study(scene).varied
    assert "pooled" in said
    assert "bounded" not in said
    every = sources_of(scene)
    assert len(every) >= 8
    for place, system in every.items():
        assert "bounded components stand" in study(system).varied, place


def test_only_what_is_mounted_anew_is_drawn_at_each_installation(scene: System) -> None:
    """What stays with a unit and is no mount is of the structure, the C-arm or the robot: one for a bench."""
    plan = compile_plan(scene)
    z = share_draws(plan, draw(plan, 5, np.arange(12)), (2, 4, 6))
    model = linearise(scene, scene.targets[0])
    for block in model.blocks:
        wanted = 12 if block.effect.drawn is Drawn.SHOT else 3 if block.contributor in INTERFACES else 1
        columns = z[:, plan.columns_of(block.contributor)]
        assert len(np.unique(columns, axis=0)) == wanted, block.contributor
        assert draw_time(block.effect) == {12: "shot", 3: "installation", 1: "unit"}[wanted]


def test_the_page_of_conventions_says_how_often_each_source_is_drawn(scene: System) -> None:
    text = " ".join(CONVENTIONS.read_text(encoding="utf-8").split())
    said = re.search(r"\*\*Drawn\*\* once per unit: (.*?)\. At each shot: (.*?)\.", text)
    drawn = [block for block in linearise(scene, scene.targets[0]).blocks if block.laws]
    lists = {Drawn.UNIT: said[1], Drawn.SHOT: said[2]}
    for block in drawn:
        words = CALLED.get(block.contributor.partition(":")[0], "")
        assert words, f"say on the page when {block.contributor} is drawn, and its words there in CALLED"
        assert [often for often, listed in lists.items() if words in listed] == [block.effect.drawn], block.contributor
    assert {block.contributor.partition(":")[0] for block in drawn} == CALLED.keys()


def test_shares_of_localisation_are_of_the_error_that_each_source_makes(scene: System) -> None:
    """sampled: the full chain with one source at work at a time; 4,000 trials of a variance are good to 10 %."""
    found: Score = score(scene)
    shares = shares_of(found.targets[0], "localisation")
    assert sum(share for _, share in shares) == pytest.approx(1.0, abs=1e-9)
    by_source: dict[str, float] = {}
    for line, share in shares:
        by_source[line.name] = by_source.get(line.name, 0.0) + share
    plan = compile_plan(scene)
    z = draw(plan, 9, np.arange(4000))
    total = sum(std**2 for std in found.targets[0].localisation.std_mm)
    for block in plan.blocks:
        alone = np.zeros_like(z)
        alone[:, block.start : block.stop] = z[:, block.start : block.stop]
        variance = float(np.trace(np.cov(evaluate(plan, alone)[:, 0, 1].T)))
        assert by_source.get(block.name, 0.0) == pytest.approx(variance / total, rel=0.12, abs=1e-4), block.name


def test_a_missed_limit_on_localisation_is_not_blamed_on_the_flange() -> None:
    """The flange has the largest share of the error at the tool, and none of the error of localisation."""
    scored = score(load_design(DEMO))
    assert name_largest_share(scored, "tip", "tcp").startswith("connector on flange, spigot and four bolts, 59 %")
    assert name_largest_share(scored, "tip", "localisation").startswith("carrier on connector, two dowel pins, ")
    navigation = {"name": "navigation", "error": "localisation", "quantile": 0.99, "limit_mm": 0.3, "targets": "all"}
    asked = [DEMO["requirements"][0] | {"limit_mm": 3.0}, navigation]
    design = load_design(replaced(DEMO, ("requirements",), asked))
    said = " ".join(headline_of(score(design), verify(design, trials=8192)).matters)
    assert "The largest source of error of the located target tip is carrier on connector, two dowel pins: " in said
    assert "spigot" not in said


def test_a_connector_that_grows_has_the_share_of_localisation_of_its_structure() -> None:
    """independent: with nothing behind the structure, where no connector grows either, the error at the tool is that of
    localisation.  The connector's own growth moves the tool, and took its share of localisation along."""
    document = yaml.safe_load((EXAMPLES / "gallery/operating_theatre.yaml").read_text())
    whole = score(load_design(document), losses=False)
    document["interfaces"]["connector_flange"].pop("tolerances")
    document.pop("execution")
    document["temperature"]["connector_expansion_um_per_m_k"] = 0
    bare = score(load_design(document), losses=False).targets[0]
    expected = {(line.name, line.component): line.variance_share for line in bare.contributors}
    shares = {(line.name, line.component): share for line, share in shares_of(whole.targets[0], "localisation")}
    assert sum(shares.values()) == pytest.approx(1, abs=1e-9)
    assert shares == pytest.approx({key: expected[key] for key in shares}, abs=1e-9)
    assert shares["temperature", "difference"] > 1e-6
