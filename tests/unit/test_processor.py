"""Kernels for more than the processor has are refused with the reason, and not met as an illegal instruction; those for
processors with and without AVX-512 come to the same numbers, wherever the tests run."""

from __future__ import annotations

import json
import os
import platform
import sys
from pathlib import Path
from typing import Any

import pytest

from family import run_process
from plain_data import read_cases
from tailstack.errors import KernelError
from tailstack.kernels import processor
from waiting import LIMIT_SECONDS

pytestmark = pytest.mark.skipif(
    platform.machine().lower() not in ("x86_64", "amd64"), reason="levels and names of x86-64 processors"
)

V3 = processor.LEVELS["x86-64-v3"]


@pytest.mark.parametrize(("name", "features", "words"), read_cases("settings", "processors"))
def test_more_than_an_avx2_processor_has_is_refused(
    monkeypatch: pytest.MonkeyPatch, name: str | None, features: str | None, words: str
) -> None:
    """Kernels for a name that LLVM does not know were never there: a score gave no answer in 90 s."""
    monkeypatch.setattr(processor, "features_here", lambda: V3)
    with pytest.raises(KernelError, match=words) as refused:
        processor.refuse_unusable(disabled=False, name=name, features=features)
    assert refused.value.exit_code == 2
    assert "x86-64-v3" in refused.value.problems[0].hint


@pytest.mark.parametrize(
    ("name", "features"), [(None, None), ("x86-64-v3", ""), ("x86-64-v2", "+avx2"), ("generic", "-fma")]
)
def test_what_an_avx2_processor_has_is_let_pass(
    monkeypatch: pytest.MonkeyPatch, name: str | None, features: str | None
) -> None:
    monkeypatch.setattr(processor, "features_here", lambda: V3)
    processor.refuse_unusable(disabled=False, name=name, features=features)


def test_plain_python_is_refused() -> None:
    with pytest.raises(KernelError, match="NUMBA_DISABLE_JIT is set"):
        processor.refuse_unusable(disabled=True, name=None, features=None)


ROOT = Path(__file__).parents[2]
PROGRAM = """
import json
from dataclasses import asdict
from pathlib import Path
from tailstack import load_design, verify
from tailstack.kernels.store import target

sampled, first_order = {}, {}
for file in sorted(Path("examples").glob("*.yaml")):
    for one in verify(load_design(file), trials=20_000, seed=7, threads=1).targets:
        record = asdict(one)
        key = f"{file.name} {one.name}"
        first_order[key] = [record.pop("first_order_p95_mm"), record.pop("first_order_ratio")]
        first_order[key].append(record["localisation"].pop("first_order_ratio"))
        sampled[key] = {name: value for name, value in record.items() if name in (
            "bias_mm", "std_mm", "mean_norm_mm", "p95_mm", "p95_interval_mm", "cvar95_mm", "worst_mm", "exceedance",
            "flagged_trials", "localisation",
        )}
print(json.dumps([target()[1], sampled, first_order]))
"""


def numbers(**variables: str) -> tuple[str, dict[str, Any], dict[str, list[float]]]:
    given = {name: value for name, value in os.environ.items() if not name.startswith("NUMBA_CPU")}
    given |= {"PYTHONPATH": os.pathsep.join(path for path in sys.path if path), "OMP_NUM_THREADS": "1"}
    done = run_process(sys.executable, "-c", PROGRAM, cwd=ROOT, env=given | variables, timeout=5 * LIMIT_SECONDS)
    assert done.returncode == 0, done.stderr
    name, sampled, first_order = json.loads(done.stdout)
    return name, sampled, first_order


@pytest.mark.long
@pytest.mark.skipif("avx512f" not in processor.features_here(), reason="this processor has no wider kernels to compare")
def test_the_digits_of_a_seed_are_those_of_a_processor_without_avx512() -> None:
    wide, narrow = numbers(), numbers(NUMBA_CPU_NAME="x86-64-v3", NUMBA_CPU_FEATURES="")
    assert (wide[0] != "x86-64-v3", narrow[0]) == (True, "x86-64-v3")
    assert len(wide[1]) >= 6
    assert narrow[1] == wide[1]
    for target, values in wide[2].items():  # only its last digits may differ (docs/jobs.md)
        assert narrow[2][target] == pytest.approx(values, rel=1e-12), target
