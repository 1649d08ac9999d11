"""Kernels for more than the processor has are refused with the reason, and not met as an illegal instruction."""

from __future__ import annotations

import platform

import pytest

from tailstack.errors import KernelError
from tailstack.kernels import processor

pytestmark = pytest.mark.skipif(
    platform.machine().lower() not in ("x86_64", "amd64"), reason="levels and names of x86-64 processors"
)

V3 = processor.LEVELS["x86-64-v3"]


@pytest.mark.parametrize(
    ("name", "features", "words"),
    [
        ("x86-64-v4", "", "-v4 and NUMBA_CPU_FEATURES= ask for kernels with avx512bw, avx512cd, avx512dq, avx512f"),
        ("x86-64-v4", None, "ask for kernels with avx512bw"),
        ("x86-64-v3", "+avx512f", "NUMBA_CPU_FEATURES=.avx512f ask for kernels with avx512f, which this processor"),
        ("x86-64-v2", "+avx2,+avx99", "with avx99, which"),
        ("haswell", None, "=haswell and NUMBA_CPU_FEATURES= ask for kernels of a processor that is no level"),
        ("native", "", "NUMBA_CPU_NAME=native and"),
        (None, "+avx512f,+avx512vl", "NUMBA_CPU_FEATURES=.avx512f,.avx512vl ask for kernels of a processor that is no"),
    ],
)
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
