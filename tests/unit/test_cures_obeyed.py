"""Every hint that can be obeyed is obeyed: it helps, or leads to the next refusal, and never back to itself.

Refusals are collected by a walk over every field of every record of the document and every slip of its value, and from
the scenes of the suite.  A hint with a number or a line that nothing here can obey fails, so that none is left out.
"""

from __future__ import annotations

import re
from functools import partial
from itertools import combinations
from typing import Any

import pytest
import test_design_refusals
import test_slips
import yaml

from cure_walk import NUMBER, check_obeyed, refused, walk_slips
from plain_data import DEMO, replaced
from records import fields_of, records_below, sample_of
from tailstack.design import check_design, load_design
from tailstack.design.document import DesignDocument
from tailstack.errors import Problem, TailstackError


def test_every_slip_of_every_field_has_a_cure_that_helps() -> None:
    """Each example of each field of each record, and all ways to write it wrongly."""
    obeyed, total = walk_slips(DesignDocument)
    assert obeyed > 1400, (obeyed, total)


def test_fields_that_exclude_or_need_each_other_are_told_what_helps() -> None:
    """Each record with what it needs, and with every one and every two of its other fields."""
    obeyed = total = 0
    for record in records_below(DesignDocument):
        needed = sample_of(record)
        others = {
            name: info.examples[0] if info.examples else sample_of(info.annotation)
            for name, info in fields_of(record).items() if not info.is_required()
        }  # fmt: skip
        for more in [(), *combinations(others, 1), *combinations(others, 2)]:
            data = needed | {name: others[name] for name in more}
            for problem in refused(record, data):
                if problem.hint:
                    total += 1
                    obeyed += check_obeyed(data, problem, partial(refused, record))
    assert obeyed > 50, (obeyed, total)


def test_what_is_written_for_a_unit_in_a_text_is_the_same_length() -> None:
    """independent: ratios of whole numbers that define the inch, the mil and the degree."""
    mm = {"mm": (1, 1), "um": (1, 1000), "in": (254, 10), "mil": (254, 10000), "cm": (10, 1), "m": (1000, 1)}
    for record in records_below(DesignDocument):
        for field in fields_of(record):
            if field in ("half_width_mm", "limit_mm"):
                for unit, (above, below) in mm.items():
                    problem = next(
                        each for each in refused(record, {field: f"3 {unit}"}) if each.pointer == f"/{field}"
                    )
                    found = re.search(rf"write {NUMBER}$", problem.hint)
                    assert found, problem.hint
                    assert float(found[1]) == pytest.approx(3 * above / below, rel=1e-12)


def judge_design(data: Any) -> tuple[Problem, ...]:
    try:
        check_design(load_design(data))
    except TailstackError as error:
        return error.problems
    return ()


SCENES = [
    *(replaced(DEMO, path, value) for path, value, *_ in test_design_refusals.CASES),
    *(replaced(document, path, value) for document, path, value, *_ in test_slips.GIVEN),
    *(yaml.safe_load(test_slips.TEXT.replace(old, new, 1)) for old, new, *_ in test_slips.TYPED if ",05" not in new),
]


def test_the_hints_of_the_suite_s_own_scenes_are_obeyed() -> None:
    obeyed = 0
    for data in SCENES:
        for problem in judge_design(data):
            if problem.hint:
                obeyed += check_obeyed(data, problem, judge_design)
    assert obeyed >= 20, obeyed
