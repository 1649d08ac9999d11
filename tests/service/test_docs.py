"""The pages name what there is: every verb, path, problem and setting, with its default."""

from __future__ import annotations

import json

import pytest
from service_scenes import ROOT

from tailstack_service.cli.main import VERBS
from tailstack_service.http.openapi import openapi_json
from tailstack_service.problems import CATALOGUE
from tailstack_service.settings import meanings

CLI = (ROOT / "docs" / "cli.md").read_text(encoding="utf-8")
HTTP = (ROOT / "docs" / "http.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_is_described(verb: str) -> None:
    assert verb in CLI


@pytest.mark.parametrize("path", json.loads(openapi_json())["paths"])
def test_every_path_is_described(path: str) -> None:
    assert f"`{path}`" in HTTP or f"{path}`" in HTTP


@pytest.mark.parametrize("slug", CATALOGUE)
def test_every_problem_is_listed_with_its_status(slug: str) -> None:
    row = next(line for line in HTTP.splitlines() if line.startswith(f"| `{slug}` |"))
    assert str(CATALOGUE[slug].status) in row


@pytest.mark.parametrize("variable", meanings())
def test_every_setting_is_listed_with_its_default(variable: str) -> None:
    default, _ = meanings()[variable]
    row = next(line for line in HTTP.splitlines() if line.startswith(f"| `{variable}` |"))
    assert f"| {default:g} |" in row or str(default) in row or "core" in row
