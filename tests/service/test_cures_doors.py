"""A name of another meaning is told the same at every door: policy, option, flag, setting, column, axis and patch."""

from __future__ import annotations

import argparse
import io
import re
from collections.abc import Iterator
from typing import Any

import pytest
import yaml
from pydantic import BaseModel, ValidationError
from service_scenes import EXAMPLES

from cure_walk import walk_slips
from plain_data import problems_of, read_cases
from records import examples_with, fields_of, records_below
from tailstack.design import Design, load_design
from tailstack.design.pointers import pointer_of
from tailstack.design.reading import DEFAULT_LIMITS, DocumentSource
from tailstack.design.refusals import refuse
from tailstack.sweeping import SweepError, read_axes
from tailstack_service.cli.main import build_parser
from tailstack_service.console.command_line import Parser
from tailstack_service.environment import variable
from tailstack_service.gate.policy import Policy
from tailstack_service.gate.waivers import Waivers
from tailstack_service.operations.batch import score_table
from tailstack_service.operations.registry import OPERATIONS
from tailstack_service.operations.request import read_options, refuse_query
from tailstack_service.settings import Settings, SettingsError, refuse_unknown
from tailstack_service.tables import read_table

OTHER = {"mm": ("um", 1e3), "deg": ("mrad", 17.453292519943295), "px": ("mm", None), "seconds": ("ms", 1e3)}
DEMO = yaml.safe_load((EXAMPLES / "demo.yaml").read_text())


@pytest.fixture(scope="module")
def design() -> Design:
    return load_design(DEMO)


def slips_of(record: type[BaseModel]) -> Iterator[tuple[str, str, Any, float | None]]:
    """Field, slipped name, example, and how many of the other unit one is."""
    for unit, (other, factor) in OTHER.items():
        for field, value in examples_with(record, unit):
            name = re.sub(rf"(^|_){unit}(?=_|$)", rf"\1{other}", field)
            if name not in fields_of(record):
                yield field, name, value, factor


def test_policies_and_waivers_convert() -> None:
    seen = 0
    for record in {*records_below(Policy), *records_below(Waivers)}:
        for field, name, value, factor in slips_of(record):
            data = {name: value if factor is None else factor * value}
            with pytest.raises(ValidationError) as caught:
                record.model_validate(data)
            source = DocumentSource(data, None, None)
            problems = refuse(caught.value, source, DEFAULT_LIMITS, record).problems
            (problem,) = [each for each in problems if each.pointer == f"/{name}"]
            if factor is None:
                assert problem.fix == ()
                assert "divide by pixel_mm" in problem.hint
            else:
                assert problem.fix[1].value == pytest.approx(value, rel=1e-9)
                assert f"{field}: " in problem.hint
            seen += 1
    assert seen >= 8


def test_slips_in_a_policy_and_in_waivers_have_cures_that_help() -> None:
    assert [walk_slips(root)[0] > least for root, least in ((Policy, 100), (Waivers, 10))] == [True, True]


def test_options_in_a_body_and_in_a_query_convert() -> None:
    seen = 0
    for operation in OPERATIONS.values():
        for field in operation.options.model_fields:
            unit = field.rpartition("_")[2]
            (other, factor), value = OTHER.get(unit, ("", None)), 2.5
            if factor is None:
                continue
            name = f"{field.removesuffix(unit)}{other}"
            problems = problems_of(read_options, operation.options, {name: factor * value})
            (hint,) = [each.hint for each in problems if each.pointer == f"/{name}"]
            assert hint.endswith(f": {field}: {value:.12g}"), hint
            query = [(name, str(factor * value))]
            assert problems_of(refuse_query, query, tuple(fields_of(operation.options)))[0].hint == hint
            seen += 1
    assert seen >= 5


def test_flags_are_not_renamed_without_a_word() -> None:
    """Each flag of each verb whose name has a unit, and what is said of another unit."""
    parsers: list[argparse.ArgumentParser] = [build_parser()]
    for parser in parsers:  # which grows by those of the verbs below
        for action in parser._actions:
            if isinstance(action, argparse._SubParsersAction):
                parsers += action.choices.values()
    seen = 0
    for parser in parsers:
        for flag in [each for action in parser._actions for each in action.option_strings]:
            for unit, (other, factor) in OTHER.items():
                slip = re.sub(rf"-{unit}(?=-|$)", f"-{other}", flag)
                if slip != flag and isinstance(parser, Parser):
                    said = parser._explain_rest([f"{slip}=3"])
                    assert f"did you mean {flag}?" in said
                    assert "divide by pixel_mm" in said if factor is None else "convert the number" in said
                    seen += 1
    assert seen >= 1


def test_settings_are_not_renamed_without_a_word() -> None:
    seen = 0
    for field in Settings.model_fields:
        for unit, other in (("seconds", "MINUTES"), ("seconds", "MS"), ("bytes", "MB"), ("days", "HOURS")):
            if re.search(rf"_{unit}$", field):
                name = variable(field)[: -len(unit)] + other
                hint = problems_of(refuse_unknown, {name: "3"}, error=SettingsError)[0].hint
                assert hint.startswith(f"did you mean {variable(field)}? It is in {unit}, and 1 {other.lower()} is "), (
                    hint
                )
                assert "convert the number, do not only rename it" in hint
                seen += 1
    assert seen >= 20


@pytest.mark.parametrize(("path", "meant", "words"), read_cases("names", "columns"))
def test_columns_and_axes_say_what_happens_to_their_numbers(
    design: Design, path: str, meant: str | None, words: str
) -> None:
    axes = [{"pointer": pointer_of(design.source.data, path), "values": [1.0]}]
    hint = problems_of(read_axes, design, axes, error=SweepError)[0].hint
    if meant is None:
        assert "did you mean" not in hint
    else:
        assert f"did you mean {meant}" in hint
        assert words.lower() in hint.lower()
        assert "convert the number, do not only rename it" in hint
    table = read_table(io.BytesIO(f"{path}\n1\n".encode()), "csv", "t.csv")
    assert problems_of(score_table, design, table, (), None)[0].hint == hint
