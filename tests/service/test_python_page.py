"""The page of the Python interface: as the docstrings say it, complete, and its code runs."""

from __future__ import annotations

import re
import subprocess

import pytest
from service_scenes import ROOT

import tailstack
import tailstack.design
import tailstack.results
from family import run_python

PAGE = (ROOT / "docs" / "python.md").read_text(encoding="utf-8")
ALIASES = {"DEFAULT_LIMITS", "ERRORS", "Interval", "Matrix3", "Severity", "Vector3", "headline_of", "__version__"}
PUBLIC = sorted({*tailstack.__all__, *tailstack.design.__all__, *tailstack.results.__all__} - ALIASES)


def run(*arguments: object) -> subprocess.CompletedProcess[str]:
    return run_python(*map(str, arguments), cwd=ROOT)


@pytest.mark.long
def test_the_page_says_what_the_docstrings_say() -> None:
    done = run("docs/python_api.py", "--check")
    assert done.returncode == 0, done.stderr[-2000:]


@pytest.mark.parametrize("name", PUBLIC)
def test_every_public_name_is_described(name: str) -> None:
    part = re.search(rf"^### {name}\n\n(.*?)(?=^##+ |\Z)", PAGE, re.MULTILINE | re.DOTALL)
    assert part is not None
    assert re.search(r"^[A-Z(`k].{12,}", part[1].replace("```text", ""), re.MULTILINE), "it has no sentence"
    assert not re.search(rf"^{name}\(\w+: '", part[1], re.MULTILINE), "a dataclass describes itself by its signature"
    empty = re.findall(r"^- `(\w+)` `[^`]+`$", part[1], re.MULTILINE)
    assert empty in ([], ["file"]), "fields without a meaning"


def test_what_is_refused_stands_with_every_verb() -> None:
    for verb in ("load_design", "score", "verify", "optimise", "sweep", "Design.with_value"):
        part = re.search(rf"^###+ {re.escape(verb)}\n(.*?)(?=^##+ )", PAGE, re.MULTILINE | re.DOTALL)
        assert part is not None
        assert "Raises DesignError" in " ".join(part[1].split()), verb


@pytest.mark.long
def test_the_code_of_the_page_runs() -> None:
    (code,) = re.findall(r"^```python\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
    done = run("-c", f"import matplotlib; matplotlib.use('Agg')\n{code}")
    assert done.returncode == 0, done.stderr[-2000:]
    first, check, sharper, *frame = done.stdout.splitlines()
    value, verdict = first.split()
    assert (round(float(value), 3), verdict) == (1.144, "fail")  # as the README's picture has it
    low, high = map(float, check.strip("()").split(","))
    assert low < float(value) < high
    assert float(sharper) < float(value)
    swept, scored = frame[:4], frame[4:]
    assert swept[0].split() == ["p95_mm", "verdict"]
    assert scored[0].split() == ["p95_mm:tip"]
    rows = [float(row.split()[1]) for row in scored[1:]]
    assert len(rows) == 3
    assert rows == sorted(rows)  # more noise is never less risk
