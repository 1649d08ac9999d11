"""Compiled functions, and where their machine code is kept between processes.

``@kernel`` is numba's ``njit`` with a store of our own in place of numba's.  That one looks at the file of the function
alone, so that a change of what it calls brings the old numbers back; it overwrites one version's files with another's;
and it writes an index and data at different moments, between which another process may read the old data by the new
index.  Here a file is named by the hash of everything that it was made from (all sources within reach, the values that
the code names, the versions of what compiled them, the processor, the signature, the options) and is never changed once
it is there.  It can therefore be copied between machines and shared by checkouts, and there is no such thing as a stale
one.

Files are looked for where the installation brought them (the distribution ``tailstack-kernels``), made for a level of
the x86-64 psABI that this processor has, and then in the user's cache, made for this very processor.  numba goes on
compiling for this processor, and its other users notice nothing: machine code of a level is loaded, never asked for.

Of numba this takes what ``Dispatcher`` does with its ``_cache``: ask ``load_overload`` before it compiles and call
``save_overload`` afterwards.  Neither is promised; where they are gone, kernels are compiled in each process anew.
What was kept is loaded without all that numba needs to compile, and its bitcode is read when a kernel that is compiled
here asks for it (``_get_module_for_linking``): together a fifth of the time of a score.
"""

from __future__ import annotations

import json
import logging
import os
import pickle
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import cache, partial
from hashlib import sha256
from importlib.util import find_spec
from pathlib import Path
from types import CodeType, FunctionType
from typing import Any, TypeVar, cast

import llvmlite
import numba
import numpy as np
from llvmlite.binding import parse_assembly, parse_bitcode
from numba import njit
from numba.core.caching import _Cache
from numba.core.compiler import CompileResult
from numba.core.registry import cpu_target
from numba.core.runtime.nrt import rtsys
from numba.core.serialize import dumps
from numba.core.sigutils import normalize_signature

from ..results.json_text import write_json
from . import sources
from .process import prepare
from .processor import levels_here, refuse_unusable

config: Any = numba.config
refuse_unusable(disabled=bool(config.DISABLE_JIT), name=config.CPU_NAME, features=config.CPU_FEATURES)

log = logging.getLogger("tailstack.kernels")
Function = TypeVar("Function", bound=Callable[..., Any])

FORMAT = 2
SUFFIX = ".kernel"
# Of Python and numpy what compiled code can depend on: the format of pickles, and what numba asks for by minor versions
BUILT_WITH = (
    f"{sys.implementation.name} {sys.version_info.major}.{sys.version_info.minor}, numba {numba.__version__}, "
    f"llvmlite {llvmlite.__version__}, numpy {'.'.join(np.__version__.split('.')[:2])}"
)
INSTALLED = "tailstack_kernels"  # the package of the distribution with compiled kernels
UNUSED_SECONDS = 30 * 86_400.0  # after which a file that nobody loaded goes
TOUCHED_SECONDS = 86_400.0  # between two marks that a file is still in use

KERNELS: dict[str, Any] = {}  # every dispatcher by its name, such as "tail.gaussian.norm_law_jit"
_checked: set[str] = set()  # files whose reach was found unchanged when they were imported


@dataclass
class Traffic:
    """What this process did with the store, and why it cannot write to it, if so."""

    loaded: int = 0
    installed: int = 0  # of those loaded: from the distribution with kernels
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
            dispatcher._cache = KernelStore(name, file, options, cast(FunctionType, function))
        KERNELS[name] = dispatcher
        return cast(Function, dispatcher)

    return compile_later


def kernels_without_store() -> list[str]:
    """Names of the kernels that every process compiles anew, because this numba does not take our files of them."""
    return [name for name, dispatcher in KERNELS.items() if not isinstance(dispatcher._cache, KernelStore)]


def stored_file(dispatcher: Any, signature: Any) -> Path | None:
    """The file that a call with these types would be loaded from."""
    store = dispatcher._cache
    return store.find(signature) if isinstance(store, KernelStore) else None


def place_of(path: Path) -> str:
    """In words, where a file of machine code came from."""
    if path.parent not in installed_directories():
        return f"in {path.parent}"
    with open(path, "rb") as file:
        return f"installed, for {json.loads(file.readline())['target'][1]}"


class KernelStore(_Cache):
    """The files of one kernel, in the shape that numba asks for."""

    def __init__(self, name: str, file: str, options: dict[str, Any], function: FunctionType) -> None:
        self._name, self._file, self._options, self._function = name, file, options, function

    @property
    def cache_path(self) -> str:
        """The folder that new files go to."""
        return str(writable_directory())

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """What was compiled for this signature, or None."""
        payload = self._read(sig)
        if payload is None and prepare():
            payload = self._read(sig)
        if payload is None:
            return None
        # Of what refreshes the context machine code needs the runtime alone; the rest, which is a tenth of a second of
        # imports, numba sees to itself before it compiles
        rtsys.initialize(target_context)
        return _rebuild(target_context, *pickle.loads(payload))

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep what was just compiled, where there is a place for it."""
        TRAFFIC.compiled += 1
        if data.library.has_dynamic_globals or any(not loop.can_cache for loop in data.lifted):
            warnings.warn(f"{self._name} cannot be kept: it refers to what only this process has", stacklevel=2)
            return
        key = self._key(sig, target())
        # Not the annotated source, which is for people and names the folder that it was compiled in
        payload = dumps(data._replace(type_annotation="")._reduce())
        try:
            _write(writable_directory() / self._file_name(key), key, payload)
            _remove_unused(self._name)
        except OSError as error:
            _say_unwritable(error)

    def find(self, sig: Any) -> Path | None:
        """The file that would be loaded for this signature."""
        return next((path for path, _ in self._places(sig) if path.exists()), None)

    def _places(self, sig: Any) -> Iterator[tuple[Path, bytes]]:
        """Files that may hold machine code for this signature, first choice first, each with its key."""
        for directory in installed_directories():
            for made_for in (*level_targets(), target()):
                key = self._key(sig, made_for)
                yield directory / self._file_name(key), key
        key = self._key(sig, target())
        for directory in (writable_directory(), *_lent):
            yield directory / self._file_name(key), key

    def _read(self, sig: Any) -> bytes | None:
        for path, key in self._places(sig):
            payload = _read(path, key)
            if payload is not None:
                installed = path.parent in installed_directories()
                TRAFFIC.loaded += 1
                TRAFFIC.installed += installed
                if not installed:
                    with suppress(OSError):  # it was used
                        if time.time() - path.stat().st_mtime > TOUCHED_SECONDS:
                            os.utime(path)
                return payload
        return None

    def _key(self, sig: Any, made_for: list[str]) -> bytes:
        """Everything that the machine code follows from."""
        parts = {
            "kernel": self._name,
            "signature": str(normalize_signature(sig)),
            "options": {name: repr(value) for name, value in sorted(self._options.items())},
            "sources": sources.digest_of(self._file),
            "constants": digest_of_constants(self._function),
            "built_with": BUILT_WITH,
            "target": made_for,
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


def _rebuild(target_context: Any, library: Any, described: Any, *rest: Any) -> Any:
    """What was compiled, from numba's own parts of it; the bitcode, which takes longer to read than all the rest, waits
    for a kernel that is compiled in this process and calls this one."""
    name, kind, (machine_code, bitcode) = library
    entries = described.mangled_name, described.llvm_cpython_wrapper_name, described.llvm_cfunc_wrapper_name
    target_context.codegen()._engine._defined_symbols.update(entries)
    built = CompileResult._rebuild(target_context, (name, kind, (machine_code, _no_bitcode())), described, *rest)
    built.library._get_module_for_linking = cache(partial(parse_bitcode, bitcode))
    return built


@cache
def _no_bitcode() -> bytes:
    """Of a module that holds nothing."""
    empty: bytes = parse_assembly("").as_bitcode()
    return empty


_lent: list[Path] = []  # folders that only this process reads, with kernels that had no other place


def lend_directory(directory: Path) -> None:
    """Look for kernels in this folder too, for as long as this process runs."""
    _lent.append(directory)


@cache
def digest_of_constants(function: FunctionType) -> str:
    """SHA-256 of the arrays and numbers that the code names, itself or in what it calls: they are compiled in.

    Most stand in the sources as they are; some were computed by a library, whose next version may come to other digits.
    """
    total, met, waiting = sha256(), set(), [function]
    while waiting:
        current = waiting.pop()
        if current in met:
            continue
        met.add(current)
        for name in sorted(_names_in(current.__code__)):
            value = current.__globals__.get(name)
            called = getattr(value, "py_func", value)
            if isinstance(called, FunctionType):
                waiting += [called] if called.__module__.partition(".")[0] == "tailstack" else []
            elif isinstance(value, np.ndarray | np.generic | bool | int | float | complex):
                array = np.asarray(value)
                told = f"{current.__module__}.{name} {array.dtype.str} {array.shape}\0"
                total.update(told.encode() + array.tobytes())
    return total.hexdigest()


def _names_in(code: CodeType) -> set[str]:
    inside = (constant for constant in code.co_consts if isinstance(constant, CodeType))
    return set(code.co_names).union(*(_names_in(inner) for inner in inside))


# A file is the key as a line of JSON, the SHA-256 of the rest as a line, and numba's own pickle.


def _read(path: Path, key: bytes) -> bytes | None:
    try:
        with open(path, "rb") as file:
            if file.readline() != key + b"\n":
                return None
            digest, payload = file.readline(), file.read()
    except OSError:
        return None
    return payload if digest == sha256(payload).hexdigest().encode() + b"\n" else None  # damaged: written over


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


def is_writable() -> bool:
    """Whether kernels that are compiled here can be kept; why not is logged, once."""
    try:
        writable_directory().mkdir(mode=0o700, parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=writable_directory()):
            return True
    except OSError as error:
        _say_unwritable(error)
        return False


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
        named = os.environ.get("XDG_CACHE_HOME", "")
        base = named if os.path.isabs(named) else os.path.expanduser("~/.cache")  # relative: to be ignored, says XDG
    if not os.path.isabs(base):  # a user without HOME and without an entry among the users
        base = os.path.join(os.sep, "nonexistent")  # as Debian calls the home of those who have none
    return Path(base) / "tailstack" / "kernels"


@cache
def installed_directories() -> tuple[Path, ...]:
    """Where the distribution with compiled kernels put them: one folder, or none."""
    spec = find_spec(INSTALLED)
    return tuple(Path(place) for place in spec.submodule_search_locations or ()) if spec else ()


@dataclass(frozen=True)
class StoredKernel:
    """One file of a store, by its own words."""

    path: Path
    name: str
    signature: str
    difference: str  # what it was made with, for or from that is not so here; "" where it can be used

    @property
    def current(self) -> bool:
        """Made from the sources, with the versions and for a processor like those of this process."""
        return not self.difference

    @property
    def sound(self) -> bool:
        """Whether its machine code is what was written."""
        with open(self.path, "rb") as file:
            _, digest, payload = file.readline(), file.readline(), file.read()
        return digest == sha256(payload).hexdigest().encode() + b"\n"


def stored_kernels(directory: Path) -> Iterator[StoredKernel]:
    """Every file of ours in a folder, as far as it can be read."""
    for path in sorted(directory.glob(f"*{SUFFIX}")):
        with suppress(OSError, ValueError, KeyError):
            with open(path, "rb") as file:
                key = json.loads(file.readline())
            yield StoredKernel(path, key["kernel"], key["signature"], _difference(key))


def _difference(key: dict[str, Any]) -> str:
    """The first thing in a key that is not so here."""
    if key["built_with"] != BUILT_WITH:
        pairs = zip(key["built_with"].split(", "), BUILT_WITH.split(", "), strict=False)
        theirs, ours = next(pair for pair in pairs if pair[0] != pair[1])
        return f"built with {theirs}, here is {ours}"
    if key["target"] not in (*level_targets(), target()):
        here = target()[1]
        return f"built for {key['target'][1]}" + (", here is " + here if here != key["target"][1] else "")
    source = key["kernel"].rpartition(".")[0].replace(".", "/") + ".py"
    current = key["format"] == FORMAT and source in sources.SOURCES and key["sources"] == sources.digest_of(source)
    return "" if current else "built from other sources"


def why_not_installed() -> str:
    """Why kernels that came with the installation are not used, or why there are none; "" where all can be."""
    if not installed_directories():
        return "none came with the installation"
    differences = [stored.difference for place in installed_directories() for stored in stored_kernels(place)]
    if not all(differences):  # of two levels, one is used
        differences = [difference for difference in differences if not difference.startswith("built for ")]
    elif any(difference.startswith("built from") for difference in differences):
        differences = ["built from other sources"]
    made: dict[str, list[str]] = {}  # by what is here, which all may share
    for difference in sorted(set(differences) - {""}):
        words, _, here = difference.partition(", here is ")
        group = made.setdefault(here, [])
        group.append(words.removeprefix("built ") if group else words)
    descriptions = [" and ".join(words) + (f", here is {here}" if here else "") for here, words in made.items()]
    return f"those installed were {'; '.join(descriptions)}" if descriptions else ""


@cache
def target() -> list[str]:
    """What numba compiles for in this process: triple, processor, features."""
    return list(cpu_target.target_context.codegen().magic_tuple())


@cache
def level_targets() -> list[list[str]]:
    """The levels whose code this processor runs too, highest first; none where numba was told what to compile for."""
    if config.CPU_NAME is not None or config.CPU_FEATURES is not None:
        return []
    return [[target()[0], level, ""] for level in levels_here()]
