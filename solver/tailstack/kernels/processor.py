"""Whether this processor can run what numba is told to compile for.

numba takes a processor's name and features from its settings without a look at the processor underneath.  Code for more
than that has then ended processes with an illegal instruction, minutes later and far away; here it is refused first.
"""

from __future__ import annotations

import os
import platform
import re
import tempfile

import llvmlite.binding as llvm

from ..errors import KernelError, Problem

# One function for each kind of instruction; which ones LLVM writes for a processor tells what it takes it to have
_PROBE = """
declare double @llvm.fma.f64(double, double, double)
declare i64 @llvm.ctpop.i64(i64)
declare i64 @llvm.ctlz.i64(i64, i1)
declare i64 @llvm.cttz.i64(i64, i1)
declare <8 x i64> @llvm.ctlz.v8i64(<8 x i64>, i1)
define double @fused(double %a, double %b, double %c) {
  %d = call double @llvm.fma.f64(double %a, double %b, double %c)
  ret double %d
}
define i64 @ones(i64 %a) {
  %b = call i64 @llvm.ctpop.i64(i64 %a)
  ret i64 %b
}
define i64 @leading(i64 %a) {
  %b = call i64 @llvm.ctlz.i64(i64 %a, i1 false)
  ret i64 %b
}
define i64 @trailing(i64 %a) {
  %b = call i64 @llvm.cttz.i64(i64 %a, i1 false)
  ret i64 %b
}
define i64 @shifted(i64 %a, i64 %by) {
  %b = shl i64 %a, %by
  ret i64 %b
}
define void @sums(ptr %p) {
  %a = load <4 x double>, ptr %p
  %b = fadd <4 x double> %a, %a
  store <4 x double> %b, ptr %p
  ret void
}
define void @products(ptr %p) {
  %a = load <8 x i64>, ptr %p
  %b = mul <8 x i64> %a, %a
  store <8 x i64> %b, ptr %p
  ret void
}
define void @chosen(ptr %p, ptr %q) {
  %a = load <8 x double>, ptr %p
  %b = load <8 x double>, ptr %q
  %c = fcmp olt <8 x double> %a, %b
  %d = select <8 x i1> %c, <8 x double> %a, <8 x double> zeroinitializer
  store <8 x double> %d, ptr %q
  ret void
}
define void @leading8(ptr %p) {
  %a = load <8 x i64>, ptr %p
  %b = call <8 x i64> @llvm.ctlz.v8i64(<8 x i64> %a, i1 false)
  store <8 x i64> %b, ptr %p
  ret void
}
"""
_WRITTEN_WITH = {
    "popcnt": r"\tpopcnt",
    "lzcnt": r"\tlzcnt",
    "bmi": r"\ttzcnt",
    "bmi2": r"\tshlx",
    "avx": r"\tvaddpd",
    "fma": r"\tvfmadd\d+sd",
    "fma4": r"\tvfmaddsd",
    "avx2": r"\tvpmul\w+.*%[yz]mm",
    "avx512f": r"%k[0-7]",
    "avx512cd": r"\tvplzcntq",
    "avx512dq": r"\tvpmullq",
}


def features_of(name: str, features: str = "") -> set[str]:
    """Which of the instruction sets above LLVM uses for this processor.  For x86-64."""
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    # LLVM ends the process over an unknown name, for which it does not even assume 64 bits
    given = ",".join(part for part in ("+64bit", features) if part)
    machine = llvm.Target.from_default_triple().create_target_machine(cpu=name, features=given, opt=2)
    written = machine.emit_assembly(llvm.parse_assembly(_PROBE))
    return {feature for feature, pattern in _WRITTEN_WITH.items() if re.search(pattern, written)}


def unknown_to_llvm(name: str, features: str = "") -> list[str]:
    """Processors and features, as they were given, that LLVM has no idea of; it says so on stderr alone."""
    with tempfile.TemporaryFile() as output:
        stderr = os.dup(2)
        try:
            os.dup2(output.fileno(), 2)
            features_of(name, features)
        finally:
            os.dup2(stderr, 2)
            os.close(stderr)
        output.seek(0)
        words = output.read().decode(errors="replace")
    return list(dict.fromkeys(re.findall(r"'([^']*)' is not a recognized", words)))


def features_here() -> set[str]:
    """What this processor and its system have."""
    return {feature for feature, present in llvm.get_host_cpu_features().items() if present}


# What the x86-64 psABI asks of a level, highest first, by LLVM's names
_V3 = {"sse4.2", "ssse3", "popcnt", "cx16", "sahf", "avx", "avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe"}
LEVELS = {"x86-64-v4": _V3 | {"avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl"}, "x86-64-v3": _V3}


def levels_here() -> list[str]:
    """Levels that this processor (with its hypervisor and its system) has, highest first."""
    if platform.machine().lower() not in ("x86_64", "amd64"):
        return []
    here = features_here()
    return [level for level, needed in LEVELS.items() if needed <= here]


def refuse_unusable(*, disabled: bool, name: str | None, features: str | None) -> None:
    """Raises KernelError for what NUMBA_DISABLE_JIT, NUMBA_CPU_NAME and NUMBA_CPU_FEATURES (None: not set) rule out."""
    if disabled:
        detail = (
            "NUMBA_DISABLE_JIT is set, and the kernels are written for the compiler: they do not run as plain Python"
        )
        raise KernelError(Problem("", "kernels-disabled", detail, "unset NUMBA_DISABLE_JIT"))
    if (name is None and features is None) or platform.machine().lower() not in ("x86_64", "amd64"):
        return
    here = llvm.get_host_cpu_name()
    if unknown := unknown_to_llvm(name or here, features or ""):
        variable = "NUMBA_CPU_NAME" if name in unknown else "NUMBA_CPU_FEATURES"
        detail = f"{variable} asks for {', '.join(unknown)}, which LLVM does not know"
        hint = f"unset {variable}, or name what LLVM knows, such as NUMBA_CPU_NAME=x86-64-v3; this processor is {here}"
        raise KernelError(Problem("", "unknown-processor", detail, hint))
    missing = sorted(features_of(name or here, features or "") - features_here())
    if missing:
        told = " and ".join(
            f"{variable}={value}"
            for variable, value in (("NUMBA_CPU_NAME", name), ("NUMBA_CPU_FEATURES", features))
            if value
        )
        detail = f"{told} asks for kernels with {', '.join(missing)}, which this processor ({here}) does not have"
        hint = "unset it, or name a level that this processor has, such as NUMBA_CPU_NAME=x86-64-v3 for AVX2"
        raise KernelError(Problem("", "processor-lacks", detail, hint))
