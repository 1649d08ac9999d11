"""Texts of fields are read from the sources that they stand in."""

from __future__ import annotations

import ast

import pytest

from tailstack import fields
from tailstack.optimisation.half_widths import Allocation


def test_sources_are_parsed_by_one_thread_at_a_time() -> None:
    """Of two at once one ended, now and then, with a SystemError: of a page's first two requests for a schema one
    got a 500."""
    parse, held = ast.parse, []

    def look_and_parse(source: str) -> ast.Module:
        held.append(fields.PARSING.locked())
        return parse(source)

    fields._read_module.cache_clear()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ast, "parse", look_and_parse)
        texts = fields.read_texts(Allocation)
    assert "least half-widths" in texts["status"]
    assert held
    assert all(held)
    assert not fields.PARSING.locked()
