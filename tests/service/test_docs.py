"""The pages name what there is: every verb, path, problem and setting, with its default."""

from __future__ import annotations

import json
import re
from dataclasses import fields
from typing import Any

import pytest
from service_scenes import ROOT

from tailstack_service.cli.verbs import VERBS
from tailstack_service.http.openapi import openapi_json
from tailstack_service.names import OTHERS
from tailstack_service.problems import CATALOGUE
from tailstack_service.settings import Settings, meanings, variable

CLI = (ROOT / "docs" / "cli.md").read_text(encoding="utf-8")
HTTP = (ROOT / "docs" / "http.md").read_text(encoding="utf-8")
SETTINGS = (ROOT / "docs" / "settings.md").read_text(encoding="utf-8")


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


def row_of(variable: str) -> list[str]:
    """The cells of a setting's row."""
    line = next(line for line in SETTINGS.splitlines() if line.startswith(f"| `{variable}` |"))
    return [cell.strip() for cell in line.strip("| ").split(" | ")]


@pytest.mark.parametrize("variable", meanings())
def test_every_setting_is_listed_with_its_default(variable: str) -> None:
    default, _ = meanings()[variable]
    cell = row_of(variable)[1]
    if isinstance(default, str):
        assert cell == (f"`{default}`" if default else "(empty)")
    else:
        assert cell == "the cores" if variable == "TAILSTACK_WORKER_PROCESSES" else float(cell) == default


@pytest.mark.parametrize("setting", fields(Settings), ids=lambda setting: setting.name)
def test_every_setting_is_listed_with_its_meaning(setting: Any) -> None:
    meaning = row_of(variable(setting.name))[2]
    words = [word.strip("`;,.:()") for word in setting.metadata["meaning"].split()]
    assert all(word in meaning for word in words), meaning
    if "low" in setting.metadata:
        low, high = (float(number) for number in re.findall(r"[\d.e+]+", meaning.rpartition("(")[2]))
        assert (low, high) == (setting.metadata["low"], setting.metadata["high"])
    assert all(f"`{choice}`" in meaning or choice in words for choice in setting.metadata.get("choices", ()))


def test_settings_are_listed_in_their_order_and_no_others() -> None:
    listed = re.findall(r"^\| `(TAILSTACK_\w+)` \|", SETTINGS, re.MULTILINE)
    assert listed[: len(meanings())] == list(meanings())
    assert sorted(listed[len(meanings()) :]) == sorted(OTHERS)
