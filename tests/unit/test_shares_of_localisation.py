"""Advice about a limit on the error of localisation names what moves that error, and nothing behind it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import yaml

from tailstack import load_design, score, verify
from tailstack.results import Score
from tailstack_service.documents import from_json, to_json
from tailstack_service.gate.design_rules import name_largest_share
from tailstack_service.rendering.sentences import shares_of
from tailstack_service.report.headline import headline_of

ROOT = Path(__file__).parents[2]


def demo() -> dict[str, Any]:
    document: dict[str, Any] = yaml.safe_load((ROOT / "examples" / "demo.yaml").read_text())
    del document["optimise"]
    return document


@pytest.fixture(scope="module")
def scored() -> Score:
    return score(load_design(demo()))


def test_shares_of_localisation_are_those_of_the_structure_alone(scored: Score) -> None:
    """independent: the same design with nothing behind the structure: its error at the tool is that of localisation"""
    document = demo()
    document["interfaces"]["connector_flange"].pop("tolerances")
    document.pop("execution")
    bare = score(load_design(document)).targets[0]
    expected = {(line.name, line.component): line.variance_share for line in bare.contributors}
    shares = shares_of(scored.targets[0], "localisation")
    assert sum(share for _, share in shares) == pytest.approx(1, abs=1e-9)
    for line, share in shares:
        assert share == pytest.approx(expected[line.name, line.component], abs=1e-9)


def test_a_missed_limit_on_localisation_is_not_blamed_on_the_flange(scored: Score) -> None:
    """The flange has the largest share of the error at the tool, and none of the error of localisation."""
    assert name_largest_share(scored, "tip", "tcp").startswith("connector on flange, spigot and four bolts, 59 %")
    assert name_largest_share(scored, "tip", "localisation").startswith("carrier on connector, two dowel pins, ")
    document = demo()
    document["requirements"].append(
        {"name": "navigation", "error": "localisation", "quantile": 0.99, "limit_mm": 0.3, "targets": "all"}
    )
    document["requirements"][0]["limit_mm"] = 3.0
    design = load_design(document)
    said = " ".join(headline_of(score(design), verify(design, trials=8192)).matters)
    assert "The largest source of error of the located target tip is carrier on connector, two dowel pins: " in said
    assert "spigot" not in said


def test_a_connector_that_grows_has_the_share_of_localisation_of_its_structure() -> None:
    """independent: with nothing behind the structure, where no connector grows either, the error at the tool is that of
    localisation.  The connector's own growth moves the tool, and took its share of localisation along."""
    document = yaml.safe_load((ROOT / "examples/gallery/operating_theatre.yaml").read_text())
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


def test_a_result_without_shares_of_localisation_is_read_by_the_rigid_rule(scored: Score) -> None:
    old = json.loads(to_json(scored))
    for target in old["targets"]:
        for line in target["contributors"]:
            del line["localisation_share"]
    read = from_json(Score, json.dumps(old).encode())
    for one, other in zip(read.targets[0].contributors, scored.targets[0].contributors, strict=True):
        assert one.localisation_share == pytest.approx(other.localisation_share, abs=1e-9)
