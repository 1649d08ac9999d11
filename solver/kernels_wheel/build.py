"""Build the distribution ``tailstack-kernels``: compiled kernels for this platform and Python, or none for all others.

usage: build.py [-o DIRECTORY] [--only NAME,...] [--levels NAME,...] [--store DIRECTORY] [--empty | --release]

Kernels are compiled from the tailstack that this Python imports, once for each level of the x86-64 psABI that this
processor has (on other processors for this very processor, which serves an image that is built where it runs), in an
order that is always the same: what is built twice has the same bytes.

Two wheels belong to a version of tailstack.  VERSION.post1 holds kernels, and asks for the numba, llvmlite and numpy
that they were compiled with; VERSION is empty and fits everywhere.  An installer takes the first where it can, and the
second where platform, Python or other requirements do not let it.  --empty builds the second, --release both and the
wheel of tailstack that asks for one of them.
"""

from __future__ import annotations

import argparse
import base64
import os
import subprocess
import sys
import tempfile
import time
import zipfile
from hashlib import sha256
from importlib.metadata import distribution
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = "tailstack_kernels"
POST = ".post1"  # of kernels compiled anew for the same tailstack, with a newer numba say, a higher number
SUMMARY = "Compiled kernels of tailstack: its first score need not compile any"
EMPTY = '"""Compiled kernels of tailstack; it finds them here by their names."""\n'
LICENSE = "Apache-2.0"
AUTHORS = "the tailstack authors"
CLASSIFIERS = (
    "Development Status :: 4 - Beta",
    "Intended Audience :: Science/Research",
    "Programming Language :: Python :: 3",
    "Programming Language :: Python :: 3 :: Only",
    "Topic :: Scientific/Engineering :: Medical Science Apps.",
)
MOMENT = (1980, 1, 1, 0, 0, 0)  # the first that a zip archive can hold: no two builds differ by their time

# What one process compiles, for one target: the calls of these computations in the order of the table.  numba calls the
# function of an expression of whole arrays by the hash of an object, which is its address, and writes into its messages
# the folder that the sources are in; here it counts the functions and knows no place.
COMPILE = """
import sys
from itertools import count
from numba.core import errors
from numba.np.ufunc import array_exprs
from tailstack.kernels import calls, store
numbers = count()
array_exprs.hash = lambda _: next(numbers)
errors.loc_info = type("NoPlace", (dict,), {"update": lambda *_, **__: None})()
names = sys.argv[1].split(",")
calls = [call for call in calls.calls_for(calls.COMPUTATIONS) if call.kernel in names or call in calls.calls_for(names)]
for call in calls:
    call.compile()
assert store.TRAFFIC.unwritable == "", store.TRAFFIC.unwritable
for call in calls:
    print(call.file())
"""


def compile_kernels(levels: list[str], names: str, place: Path) -> dict[str, bytes]:
    """Files of machine code by their names, for all levels; one process for each, for numba compiles for one target."""
    started = []
    for level in levels or [""]:
        environment = {key: value for key, value in os.environ.items() if not key.startswith("NUMBA_")}
        environment |= {"NUMBA_CACHE_DIR": str(place), "PYTHONHASHSEED": "0"}
        environment |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        environment |= {"NUMBA_CPU_NAME": level, "NUMBA_CPU_FEATURES": ""} if level else {}
        command = [sys.executable, "-c", COMPILE, names]
        process = subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True)
        started.append((level, time.monotonic(), process))
    files = {}
    for level, began, process in started:
        named = [Path(line) for line in (process.communicate()[0]).splitlines()]
        if process.returncode or not named:
            raise SystemExit(f"kernels for {level or 'this processor'} could not be compiled: {process.returncode}")
        # Those alone that Python calls: what only other kernels call is within them
        files |= {path.name: path.read_bytes() for path in named}
        print(f"kernels for {level or 'this processor'}: {len(named)} in {time.monotonic() - began:.0f} s", flush=True)
    return files


def platform_tags() -> list[str]:
    """Where the machine code runs: wherever the llvmlite does that loads it, under this minor version of Python."""
    text = distribution("llvmlite").read_text("WHEEL") or ""
    tags = [line.removeprefix("Tag: ").split("-") for line in text.splitlines() if line.startswith("Tag: ")]
    return sorted({f"{python}-none-{platform}" for python, _, platform in tags})


def requirements() -> list[str]:
    """What the machine code was compiled with, and is only good with."""
    pinned = [f"{name} =={distribution(name).version}" for name in ("numba", "llvmlite")]
    return [*pinned, f"numpy =={'.'.join(distribution('numpy').version.split('.')[:2])}.*"]


def write_wheel(directory: Path, version: str, tags: list[str], files: dict[str, bytes], needs: list[str]) -> Path:
    """A wheel of the package with these files, byte by byte the same for the same content."""
    about = f"{PACKAGE}-{version}.dist-info"
    metadata = ["Metadata-Version: 2.4", "Name: tailstack-kernels", f"Version: {version}", f"Summary: {SUMMARY}"]
    metadata += [f"Author: {AUTHORS}", f"License-Expression: {LICENSE}", "License-File: LICENSE"]
    metadata += [*(f"Classifier: {line}" for line in CLASSIFIERS), "Requires-Python: >=3.11"]
    metadata += [f"Requires-Dist: {need}" for need in needs]
    pure = "true" if tags == ["py3-none-any"] else "false"
    wheel = ["Wheel-Version: 1.0", "Generator: tailstack", f"Root-Is-Purelib: {pure}", *(f"Tag: {tag}" for tag in tags)]
    content = {f"{PACKAGE}/__init__.py": EMPTY.encode()}
    content |= {f"{PACKAGE}/{name}": data for name, data in sorted(files.items())}
    content |= {f"{about}/METADATA": _lines(metadata), f"{about}/WHEEL": _lines(wheel)}
    content |= {f"{about}/licenses/LICENSE": (ROOT / "LICENSE").read_bytes()}
    record = [f"{name},{_digest(data)},{len(data)}" for name, data in content.items()]
    content[f"{about}/RECORD"] = _lines([*record, f"{about}/RECORD,,"])
    python, abi, platforms = tags[0].split("-")[0], tags[0].split("-")[1], ".".join(tag.split("-")[2] for tag in tags)
    directory.mkdir(parents=True, exist_ok=True)
    path = directory / f"{PACKAGE}-{version}-{python}-{abi}-{platforms}.whl"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in content.items():
            member = zipfile.ZipInfo(name, MOMENT)
            member.compress_type, member.external_attr = zipfile.ZIP_DEFLATED, 0o644 << 16
            archive.writestr(member, data)
    return path


def _lines(lines: list[str]) -> bytes:
    return ("\n".join(lines) + "\n").encode()


def _digest(data: bytes) -> str:
    return "sha256=" + base64.urlsafe_b64encode(sha256(data).digest()).rstrip(b"=").decode()


def build_kernels(directory: Path, levels: list[str], names: str, store: Path | None = None) -> Path:
    """The wheel of kernels for this platform and this Python."""
    from tailstack import __version__

    with tempfile.TemporaryDirectory(prefix="tailstack-kernels-") as place:
        files = compile_kernels(levels, names, store or Path(place))
    return write_wheel(directory, __version__ + POST, platform_tags(), files, requirements())


def build_empty(directory: Path) -> Path:
    """The wheel without kernels, for every platform and every Python."""
    from tailstack import __version__

    return write_wheel(directory, __version__, ["py3-none-any"], {}, [])


def build_tailstack(directory: Path) -> None:
    """The wheel of tailstack that asks for kernels (``requirement.py``)."""
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(directory.resolve())]
    subprocess.run(command, cwd=ROOT, env={**os.environ, "TAILSTACK_RELEASE": "1"}, check=True)


def main() -> None:
    """See the head of this file."""
    from tailstack.kernels.calls import COMPUTATIONS
    from tailstack.kernels.processor import levels_here

    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("dist"), help="folder for the wheels (dist)")
    parser.add_argument(
        "--only", default=",".join(COMPUTATIONS), help="these kernels alone, or those of these computations"
    )
    parser.add_argument("--levels", default=",".join(levels_here()), help="levels (those that this processor has)")
    parser.add_argument(
        "--store", type=Path, help="keep what is compiled there, and take what is there; bytes may then differ"
    )
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--empty", action="store_true", help="the wheel without kernels")
    what.add_argument("--release", action="store_true", help="all that belongs to a release")
    arguments = parser.parse_args()
    if arguments.empty or arguments.release:
        print(build_empty(arguments.output))
    if not arguments.empty:
        levels = [level for level in arguments.levels.split(",") if level]
        print(build_kernels(arguments.output, levels, arguments.only, arguments.store))
    if arguments.release:
        build_tailstack(arguments.output)


if __name__ == "__main__":
    main()
