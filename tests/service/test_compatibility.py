"""A change of the OpenAPI document that breaks clients is found, and one that does not is left alone."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import yaml
from compatibility import breaking_changes, main
from openapi_scenes import changed_document
from service_scenes import ROOT

TABLES = yaml.safe_load((ROOT / "tests" / "data" / "compatibility.yaml").read_text(encoding="utf-8"))
BASE, BREAKS, HARMLESS = TABLES["base"], TABLES["breaks"], TABLES["harmless"]


def mutated(where: str, patch: dict[str, Any]) -> Any:
    return changed_document(BASE, where, patch)


@pytest.mark.parametrize("name", BREAKS)
def test_what_breaks_is_said(name: str) -> None:
    where, patch, sentence = BREAKS[name]
    assert sentence in breaking_changes(BASE, mutated(where, patch))


@pytest.mark.parametrize("name", HARMLESS)
def test_what_breaks_nothing_is_left_alone(name: str) -> None:
    assert breaking_changes(BASE, mutated(*HARMLESS[name])) == []


def test_the_comparison_has_a_direction_and_refuses_what_nobody_decided_about() -> None:
    """The comparison has a direction: what may come may not go again."""
    for name in ("new path", "new optional parameter", "a request value more", "a response property more"):
        assert breaking_changes(mutated(*HARMLESS[name]), BASE), name
    odd = mutated("Job.progress", {"unevaluatedProperties": False})
    with pytest.raises(ValueError, match="unevaluatedProperties"):
        breaking_changes(BASE, odd)


def test_document_breaks_no_client_of_the_released_one() -> None:
    folder = ROOT / "openapi"
    released, now = (json.loads((folder / name).read_text("utf-8")) for name in ("released.json", "openapi.json"))
    assert breaking_changes(released, now) == [], "see openapi/README.md, 'What may change'"


def test_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    old, new = tmp_path / "old.json", tmp_path / "new.json"
    old.write_text(json.dumps(BASE))
    new.write_text(json.dumps(mutated(*BREAKS["path gone"][:2])))
    assert main([str(old), str(old)]) == 0
    assert main([str(old), str(new)]) == 1
    assert capsys.readouterr().out == "nothing breaks\nGET /version: the operation is gone\n"
    assert main([str(old)]) == 2
