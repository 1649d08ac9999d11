"""Check this installation: versions, processor, threads, compile cache, a solve against a known value, a free port."""

from __future__ import annotations

import argparse
import os
import platform
import sys
from collections.abc import Callable

from tailstack import __version__
from tailstack.errors import MissingExtraError, TailstackError
from tailstack.extras import install_command, missing_extras, name_missing_extra, require_extras

from ..console.command_line import NOT_EVALUATED, PASS, Answer
from ..operations.example import EXAMPLE_DESIGN
from ..rendering.text import wrap

HELP = "check this installation"

PACKAGES = ("numpy", "scipy", "numba", "llvmlite", "casadi", "pydantic", "pyyaml", "fastapi", "starlette", "uvicorn")
# 0.95 quantile of the norm of N(0, I) in three dimensions: square root of the chi-square quantile with 3 degrees
CHI_95_3 = 2.7954834829151074


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """No arguments."""


def run(arguments: argparse.Namespace) -> Answer:
    lines, code = [], PASS
    for name, check in CHECKS.items():
        try:
            with name_missing_extra():
                mark, words = "ok", check()
        except MissingExtraError as error:  # left out on purpose
            mark, words = "-", f"not installed: {error.problems[0].hint}"
        except Ailment as error:
            mark, words, code = "FAIL", str(error), NOT_EVALUATED
        except TailstackError as error:
            mark, words, code = "FAIL", _words_of(error), NOT_EVALUATED
        except Exception as error:  # a doctor reports every ailment
            first = str(error).splitlines()[0] if str(error) else ""
            mark, words, code = "FAIL", f"{type(error).__name__}: {first}", NOT_EVALUATED
        words, _, command = words.partition("\n")  # a command is copied: its line is not folded
        lines.append(wrap(words, first=f"{mark:<6}{name:<15}", indent=" " * 21) + "\n")
        lines += [f"{' ' * 21}{command}\n"] if command else []
    return Answer("".join(lines), code)


class Ailment(Exception):
    """What is wrong with this installation, in words, and what helps."""


def _versions() -> str:
    from importlib.metadata import PackageNotFoundError, version

    def version_of(name: str) -> str:
        try:
            return version(name)
        except PackageNotFoundError:
            return "not installed"

    return f"tailstack {__version__}; " + ", ".join(f"{name} {version_of(name)}" for name in PACKAGES)


def _extras() -> str:
    """What of tailstack is left out here."""
    missing = missing_extras()
    if not missing:
        return "all installed"
    return f"not installed: {', '.join(missing)}; for all of them:\n{install_command(*missing)}"


def _processor() -> str:
    import llvmlite.binding as llvm

    features = llvm.get_host_cpu_features()
    wide = [name for name in ("avx512f", "avx2", "fma", "neon") if features.get(name)]
    return f"{platform.machine()}, {llvm.get_host_cpu_name()}: {', '.join(wide) or 'no vector extensions found'}"


def _threads() -> str:
    from tailstack.kernels.process import usable_cores

    blas = os.environ.get("OMP_NUM_THREADS") or "not set"
    return f"{usable_cores()} usable, OMP_NUM_THREADS {blas}"


def _compile_cache() -> str:
    """Kernels are kept in NUMBA_CACHE_DIR, or in the user's cache; where all of them are there, none has to be."""
    from tailstack.kernels.calls import EVERY
    from tailstack.kernels.store import TRAFFIC, is_writable, writable_directory

    if all(call.file() is not None for call in EVERY):
        return "not needed: every kernel is compiled"
    if is_writable():
        return f"writable: {writable_directory()}"
    raise Ailment(f"{TRAFFIC.unwritable}; set NUMBA_CACHE_DIR to a folder that can be")


def _kernels() -> str:
    """Where the machine code of every kernel is that commands call, and whether its file is undamaged."""
    from tailstack.kernels import store
    from tailstack.kernels.calls import EVERY

    from ..console.compilation import describe_calls

    described = describe_calls(("doctor",))
    if without := store.kernels_without_store():
        raise Ailment(f"{store.BUILT_WITH} keeps no kernels: every process compiles {without[0]} and the others")
    used = {call.file() for call in EVERY}
    folders = (*store.installed_directories(), store.writable_directory())
    damaged = [
        kernel.path
        for folder in folders
        for kernel in store.stored_kernels(folder)
        if kernel.path in used and not kernel.sound
    ]
    if damaged:
        raise Ailment(f"{len(damaged)} damaged, which are compiled again when needed; delete {damaged[0]}")
    return f"{described}; for {store.BUILT_WITH}"


def _solver() -> str:
    """The optimiser's IPOPT, a plugin that CasADi loads when it is first needed."""
    import casadi

    from tailstack.optimisation.solver import require_ipopt

    try:
        require_ipopt()
    except MissingExtraError as error:
        raise Ailment(_words_of(error)) from None
    return f"CasADi {casadi.CasadiMeta.version()} loads IPOPT"


def _pdf() -> str:
    """What writes PDF, and the fonts that it writes with."""
    require_extras("pdf")

    from ..report.pdf import count_fonts, load_weasyprint

    version = load_weasyprint().__version__
    fonts = count_fonts()
    return f"WeasyPrint {version}, {fonts} {'font' if fonts == 1 else 'fonts'}"


def _folders() -> str:
    """Where jobs and results are kept, and temporary files are written."""
    from ..environment import CURE, has_home, state_directory, temporary_directory

    temporary, state = temporary_directory(), state_directory()
    note = "" if has_home() else f", as this user has no home: {CURE}"
    return f"jobs and results in {state}{note}; temporary files in {temporary}"


def _words_of(error: TailstackError) -> str:
    problem = error.problems[0]
    return f"{problem.detail}; {problem.hint}" if problem.hint else problem.detail


def _known_value() -> str:
    """The exact tail of a Gaussian vector against the chi distribution, which is a closed form."""
    import numpy as np

    from tailstack.tail.gaussian import norm_quantile

    p95 = norm_quantile(0.95, np.zeros(3), np.eye(3))
    if not abs(p95 / CHI_95_3 - 1) < 1e-9:
        raise Ailment(f"P95 of |N(0, I)| is {p95!r}, should be {CHI_95_3!r}")
    return f"P95 of |N(0, I)| = {p95:.9f} mm, closed form {CHI_95_3:.9f} mm"


def _chain() -> str:
    """First order against the simulated chain, two pieces of code that share nothing, on a small design."""
    from tailstack.design import load_design
    from tailstack.scoring import score
    from tailstack.verification import verify

    design = load_design(EXAMPLE_DESIGN)
    first = score(design).targets[0].p95_mm
    low, high = verify(design, trials=20_000, seed=1).targets[0].p95_interval_mm
    if not 0.98 * low < first < 1.02 * high:
        raise Ailment(f"first order P95 {first:.4f} mm is far from the simulated {low:.4f} .. {high:.4f} mm")
    return f"first order P95 {first:.4f} mm, simulated {low:.4f} .. {high:.4f} mm"


def _port() -> str:
    from ..http.server import DEFAULT_PORT, address_of, bind
    from ..settings import default_settings

    try:
        bound = bind("127.0.0.1", DEFAULT_PORT, default_settings())
        words = f"{address_of(bound)} is free"
    except Exception:
        bound = bind("127.0.0.1", 0, default_settings())
        words = f"{DEFAULT_PORT} is taken; others are free (serve --port 0)"
    bound.close()
    return words


CHECKS: dict[str, Callable[[], str]] = {
    "python": lambda: f"{platform.python_version()}, {sys.executable}",
    "versions": _versions,
    "extras": _extras,
    "processor": _processor,
    "threads": _threads,
    "compile cache": _compile_cache,
    "kernels": _kernels,
    "folders": _folders,
    "solver": _solver,
    "pdf": _pdf,
    "known value": _known_value,
    "chain": _chain,
    "port": _port,
}
