"""Kernels for more than the processor has are refused with the reason, and not met as an illegal instruction."""

from __future__ import annotations

import platform

import pytest

from tailstack.errors import KernelError
from tailstack.kernels import processor

pytestmark = pytest.mark.skipif(
    platform.machine().lower() not in ("x86_64", "amd64"), reason="levels and names of x86-64 processors"
)

V2 = {"popcnt"}
V3 = V2 | {"lzcnt", "bmi", "bmi2", "avx", "avx2", "fma"}
V4 = V3 | {"avx512f", "avx512cd", "avx512dq"}


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("x86-64", set()),
        ("x86-64-v2", V2),
        ("x86-64-v3", V3),
        ("x86-64-v4", V4),
        ("haswell", V3),
        ("skylake-avx512", V4),
        ("znver3", V3),
        ("znver4", V4),
        ("knl", V4 - {"avx512dq"}),
        ("bdver4", V3 - {"fma"} | {"fma4"}),  # it has both, and LLVM writes the one with four operands
    ],
)
def test_what_a_processor_has(name: str, expected: set[str]) -> None:
    """published: the levels of the x86-64 psABI, and the makers' lists of what these processors have; as far as looked
    at here."""
    assert processor.features_of(name) == expected


def test_features_are_added_and_taken_away() -> None:
    assert processor.features_of("x86-64", "+avx2,+fma") >= {"avx", "avx2", "fma"}
    assert processor.features_of("x86-64-v4", "-avx512f") == V3


def test_this_processor_has_what_it_says() -> None:
    """What LLVM writes for the processor that it finds here is what it finds here: nothing more is looked for."""
    import llvmlite.binding as llvm

    assert processor.features_of(llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten()) <= (
        processor.features_here()
    )


@pytest.mark.parametrize(
    ("name", "features", "words"),
    [
        ("x86-64-v4", "", "NUMBA_CPU_NAME=x86-64-v4 asks for kernels with avx512cd, avx512dq, avx512f, which this"),
        ("x86-64-v4", None, "NUMBA_CPU_NAME=x86-64-v4 asks"),
        ("znver5", None, "NUMBA_CPU_NAME=znver5 asks"),
        ("x86-64-v3", "+avx512f", "NUMBA_CPU_NAME=x86-64-v3 and NUMBA_CPU_FEATURES=.avx512f asks .* avx512f"),
        (None, "+avx512f,+avx512vl", "NUMBA_CPU_FEATURES=.avx512f,.avx512vl asks"),
    ],
)
def test_more_than_an_avx2_processor_has_is_refused(
    monkeypatch: pytest.MonkeyPatch, name: str | None, features: str | None, words: str
) -> None:
    monkeypatch.setattr(processor, "features_here", lambda: V3)
    monkeypatch.setattr(processor.llvm, "get_host_cpu_name", lambda: "haswell")
    with pytest.raises(KernelError, match=words) as refused:
        processor.refuse_unusable(disabled=False, name=name, features=features)
    assert refused.value.exit_code == 2
    assert "NUMBA_CPU_NAME=x86-64-v3" in refused.value.problems[0].hint


@pytest.mark.parametrize(
    ("name", "features"), [(None, None), ("x86-64-v3", ""), ("haswell", None), ("x86-64-v2", "+avx2"), ("generic", "")]
)
def test_what_an_avx2_processor_has_is_let_pass(
    monkeypatch: pytest.MonkeyPatch, name: str | None, features: str | None
) -> None:
    monkeypatch.setattr(processor, "features_here", lambda: V3)
    processor.refuse_unusable(disabled=False, name=name, features=features)


@pytest.mark.parametrize(
    ("name", "features", "words"),
    [
        ("znver99", None, "NUMBA_CPU_NAME asks for znver99, which LLVM does not know"),
        ("native", "", "NUMBA_CPU_NAME asks for native, which"),
        ("x86-64-v2", "+avx2,+avx99", "NUMBA_CPU_FEATURES asks for .avx99, which LLVM does not know"),
    ],
)
def test_what_llvm_does_not_know_is_refused_and_not_waited_for(
    capfd: pytest.CaptureFixture[str], name: str, features: str | None, words: str
) -> None:
    """Kernels for such a name were never there: a score gave no answer in 90 s."""
    with pytest.raises(KernelError, match=words) as refused:
        processor.refuse_unusable(disabled=False, name=name, features=features)
    assert refused.value.exit_code == 2
    assert "NUMBA_CPU_NAME=x86-64-v3" in refused.value.problems[0].hint
    assert capfd.readouterr().err == ""  # what LLVM said of it is in these words


def test_plain_python_is_refused() -> None:
    with pytest.raises(KernelError, match="NUMBA_DISABLE_JIT is set"):
        processor.refuse_unusable(disabled=True, name=None, features=None)
