"""Compiled functions, and where their machine code is kept between processes.

``@kernel`` is numba's ``njit`` with a store of our own in place of numba's.  That one looks at the file of the function
alone, so that a change of what it calls brings the old numbers back; it overwrites one version's files with another's;
and it writes an index and data at different moments, between which another process may read the old data by the new
index.  Here a file is named by the hash of everything that it was made from (all sources within reach, the versions of
what compiled them, the processor, the signature, the options) and is never changed once it is there.  It can therefore
be copied between machines and shared by checkouts, and there is no such thing as a stale one.

Of numba this takes what ``Dispatcher`` does with its ``_cache``: ask ``load_overload`` before it compiles and call
``save_overload`` afterwards.  Neither is promised; where they are gone, kernels are compiled in each process anew.
"""

from __future__ import annotations

import json
import logging
import os
import pickle
import platform
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any, TypeVar, cast

import llvmlite
import numba
import numpy as np
import scipy
from numba import njit
from numba.core.caching import _Cache
from numba.core.compiler import CompileResult
from numba.core.serialize import dumps
from numba.core.sigutils import normalize_signature

from . import sources
from .json_text import write_json
from .processor import refuse_unusable

config: Any = numba.config
refuse_unusable(disabled=bool(config.DISABLE_JIT), name=config.CPU_NAME, features=config.CPU_FEATURES)

log = logging.getLogger("tailstack.kernels")
Function = TypeVar("Function", bound=Callable[..., Any])

FORMAT = 1
SUFFIX = ".kernel"
BUILT_WITH = ", ".join(
    f"{name} {version}"
    for name, version in (
        ("python", platform.python_version()),
        ("numba", numba.__version__),
        ("llvmlite", llvmlite.__version__),
        ("numpy", np.__version__),
        ("scipy", scipy.__version__),  # constants that it computed are compiled in
    )
)
PREBUILT = sources.ROOT / "prebuilt"  # kernels that came with the installation; only read
UNUSED_SECONDS = 30 * 86_400.0  # after which a file that nobody loaded goes
TOUCHED_SECONDS = 86_400.0  # between two marks that a file is still in use

KERNELS: dict[str, Any] = {}  # every dispatcher by its name, such as "tail.gaussian.norm_law_jit"
_checked: set[str] = set()  # files whose reach was found unchanged when they were imported


@dataclass
class Traffic:
    """What this process did with the store, and why it cannot write to it, if so."""

    loaded: int = 0
    compiled: int = 0
    unwritable: str = ""


TRAFFIC = Traffic()


def kernel(*, nogil: bool = False, error_model: str = "numpy", **options: Any) -> Callable[[Function], Function]:
    """Compile a function of this package at its first call, or load what an earlier process compiled.

    By default division by zero is infinity, as in numpy; every further option is numba's.
    """
    options |= {"nogil": nogil, "error_model": error_model}

    def compile_later(function: Function) -> Function:
        if function.__closure__:
            raise TypeError(f"{function.__qualname__} closes over values that no file of sources holds")
        module = function.__module__.partition(".")[2]
        name = f"{module}.{function.__qualname__}"
        known = KERNELS.get(name)
        if known is not None and known.py_func.__code__.co_firstlineno != function.__code__.co_firstlineno:
            raise TypeError(f"there is another kernel called {name}, and files are named by it")
        dispatcher = njit(**options)(function)
        file = module.replace(".", "/") + ".py"
        if file in sources.SOURCES and isinstance(getattr(dispatcher, "_cache", None), _Cache):
            if file not in _checked:
                sources.check_unchanged(file)
                _checked.add(file)
            dispatcher._cache = KernelStore(name, file, options)
        KERNELS[name] = dispatcher
        return cast(Function, dispatcher)

    return compile_later


def kernels_without_store() -> list[str]:
    """Names of the kernels that every process compiles anew, because this numba does not take our files of them."""
    return [name for name, dispatcher in KERNELS.items() if not isinstance(dispatcher._cache, KernelStore)]


class KernelStore(_Cache):
    """The files of one kernel, in the shape that numba asks for."""

    def __init__(self, name: str, file: str, options: dict[str, Any]) -> None:
        self._name, self._file, self._options = name, file, options

    @property
    def cache_path(self) -> str:
        """The folder that new files go to."""
        return str(writable_directory())

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """What was compiled for this signature, or None."""
        target_context.refresh()
        key = self._key(sig, target_context.codegen())
        for directory in (PREBUILT, writable_directory()):
            payload = _read(directory / self._file_name(key), key)
            if payload is not None:
                TRAFFIC.loaded += 1
                return CompileResult._rebuild(target_context, *pickle.loads(payload))
        return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep what was just compiled, where there is a place for it."""
        TRAFFIC.compiled += 1
        if data.library.has_dynamic_globals or any(not loop.can_cache for loop in data.lifted):
            warnings.warn(f"{self._name} cannot be kept: it refers to what only this process has", stacklevel=2)
            return
        key = self._key(sig, data.codegen)
        try:
            _write(writable_directory() / self._file_name(key), key, dumps(data._reduce()))
            _remove_unused(self._name)
        except OSError as error:
            _say_unwritable(error)

    def _key(self, sig: Any, codegen: Any) -> bytes:
        """Everything that the machine code follows from."""
        parts = {
            "kernel": self._name,
            "signature": str(normalize_signature(sig)),
            "options": {name: repr(value) for name, value in sorted(self._options.items())},
            "sources": sources.digest_of(self._file),
            "built_with": BUILT_WITH,
            "target": list(codegen.magic_tuple()),
            "format": FORMAT,
        }
        return write_json(parts).encode()

    def _file_name(self, key: bytes) -> str:
        return f"{self._name}-{sha256(key).hexdigest()[:32]}{SUFFIX}"

    def enable(self) -> None:
        """It always is."""

    def disable(self) -> None:
        """Not asked for by anything of ours."""

    def flush(self) -> None:
        """A file is right for as long as it is there."""


# A file is the key as a line of JSON, the SHA-256 of the rest as a line, and numba's own pickle.


def _read(path: Path, key: bytes) -> bytes | None:
    try:
        with open(path, "rb") as file:
            if file.readline() != key + b"\n":
                return None
            digest, payload = file.readline(), file.read()
            age = time.time() - os.fstat(file.fileno()).st_mtime
    except OSError:
        return None
    if digest != sha256(payload).hexdigest().encode() + b"\n":
        return None  # damaged: it is compiled again, and written over
    if age > TOUCHED_SECONDS:
        with suppress(OSError):
            os.utime(path)
    return payload


def _write(path: Path, key: bytes, payload: bytes) -> None:
    """In one piece or not at all, whoever else writes the same."""
    path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=".", suffix=".tmp")
    try:
        with open(handle, "wb") as file:
            file.write(key + b"\n" + sha256(payload).hexdigest().encode() + b"\n" + payload)
        os.replace(temporary, path)
    except BaseException:
        with suppress(OSError):
            os.unlink(temporary)
        raise


def _remove_unused(name: str) -> None:
    """Files of this kernel that no process has loaded for a month: of other sources, or another processor."""
    oldest = time.time() - UNUSED_SECONDS
    for path in writable_directory().glob(f"{name}-*{SUFFIX}"):
        with suppress(OSError):
            if path.stat().st_mtime < oldest:
                path.unlink()


def _say_unwritable(error: OSError) -> None:
    if not TRAFFIC.unwritable:
        TRAFFIC.unwritable = f"{writable_directory()} cannot be written ({error.strerror})"
        log.warning(
            "%s, so every process compiles its kernels anew; set NUMBA_CACHE_DIR to a folder that can be",
            TRAFFIC.unwritable,
        )


@cache
def writable_directory() -> Path:
    """``NUMBA_CACHE_DIR`` where that is set, otherwise a folder in the user's cache."""
    if config.CACHE_DIR:
        return Path(config.CACHE_DIR)
    if sys.platform == "win32":
        base = os.environ.get("LOCALAPPDATA") or tempfile.gettempdir()
    elif sys.platform == "darwin":
        base = os.path.expanduser("~/Library/Caches")
    else:
        base = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    return Path(base) / "tailstack" / "kernels"


@dataclass(frozen=True)
class StoredKernel:
    """One file of a store, by its own words."""

    path: Path
    name: str
    signature: str
    current: bool  # made from the sources, with the versions and for the processor of this process
    sound: bool  # its machine code is what was written


def stored_kernels(directory: Path) -> Iterator[StoredKernel]:
    """Every file of ours in a folder, as far as it can be read."""
    made_for = target()
    for path in sorted(directory.glob(f"*{SUFFIX}")):
        with suppress(OSError, ValueError, KeyError):
            with open(path, "rb") as file:
                line, digest, payload = file.readline(), file.readline(), file.read()
            key = json.loads(line)
            source = key["kernel"].rpartition(".")[0].replace(".", "/") + ".py"
            made_of = (key["sources"], key["built_with"], key["target"], key["format"])
            current = source in sources.SOURCES and made_of == (
                sources.digest_of(source), BUILT_WITH, made_for, FORMAT,
            )  # fmt: skip
            sound = digest == sha256(payload).hexdigest().encode() + b"\n"
            yield StoredKernel(path, key["kernel"], key["signature"], current, sound)


def target() -> list[str]:
    """What numba compiles for in this process: triple, processor, features."""
    from numba.core.registry import cpu_target

    return list(cpu_target.target_context.codegen().magic_tuple())


def files_with_kernels() -> list[str]:
    """Sources that may define kernels, by ``kernel`` or by what the Monte Carlo's lanes make of it."""
    makers = {sources.COMPILER, "montecarlo/lanes.py"}
    return [name for name in sources.SOURCES if makers & sources.imports_of(name)]
