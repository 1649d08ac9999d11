"""Whether this processor can run what numba is told to compile for.

numba takes a processor's name and features from its settings without a look at the processor underneath.  Code for more
than that has then ended processes with an illegal instruction, minutes later and far away; here it is refused first.
"""

from __future__ import annotations

import platform

import llvmlite.binding as llvm

from ..errors import KernelError, Problem

# What the x86-64 psABI asks of a level, highest first, by LLVM's names
_V2 = {"sse4.2", "ssse3", "popcnt", "cx16", "sahf"}
_V3 = _V2 | {"avx", "avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe"}
LEVELS = {"x86-64-v4": _V3 | {"avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl"}, "x86-64-v3": _V3}
_NAMED = {**LEVELS, "x86-64-v2": _V2, "x86-64": set[str](), "generic": set[str]()}


def features_here() -> set[str]:
    """What this processor and its system have."""
    return {feature for feature, present in llvm.get_host_cpu_features().items() if present}


def levels_here() -> list[str]:
    """Levels that this processor (with its hypervisor and its system) has, highest first."""
    if platform.machine().lower() not in ("x86_64", "amd64"):
        return []
    here = features_here()
    return [level for level, needed in LEVELS.items() if needed <= here]


def refuse_unusable(*, disabled: bool, name: str | None, features: str | None) -> None:
    """Raises KernelError for what NUMBA_DISABLE_JIT, NUMBA_CPU_NAME and NUMBA_CPU_FEATURES (None: not set) rule out.

    Kernels are compiled for this processor or for a level: what another processor has, only LLVM believes to know.
    """
    if disabled:
        detail = (
            "NUMBA_DISABLE_JIT is set, and the kernels are written for the compiler: they do not run as plain Python"
        )
        raise KernelError(Problem("", "kernels-disabled", detail, "unset NUMBA_DISABLE_JIT"))
    if (name is None and features is None) or platform.machine().lower() not in ("x86_64", "amd64"):
        return
    told = f"NUMBA_CPU_NAME={name or ''} and NUMBA_CPU_FEATURES={features or ''}"
    if name not in _NAMED:
        detail = f"{told} ask for kernels of a processor that is no level"
        hint = f"unset both, or let NUMBA_CPU_NAME be one of {', '.join(_NAMED)}"
        raise KernelError(Problem("", "unknown-processor", detail, hint))
    added = {part[1:] for part in (features or "").split(",") if part.startswith("+")}
    missing = sorted((_NAMED[name] | added) - features_here())
    if missing:
        here = llvm.get_host_cpu_name()
        detail = f"{told} ask for kernels with {', '.join(missing)}, which this processor ({here}) does not have"
        hint = "unset both, or name a level that this processor has, such as NUMBA_CPU_NAME=x86-64-v3 for AVX2"
        raise KernelError(Problem("", "processor-lacks", detail, hint))
