"""Print an example design, or write it with the files that it needs; without a name, list them.

What is printed stands alone: fiducials that the example has in a file of their own are written into it.
"""

from __future__ import annotations

import argparse
import shutil
import sys
from pathlib import Path
from shlex import quote

from tailstack.errors import Problem

from ..console.command_line import Answer, program, suggest
from ..console.files import add_force, refuse_overwriting, writable, write_and_tell
from ..operations.editors import write_document
from ..problems import RequestError
from ..shipped import example_folder, list_example_designs, list_examples, write_example

HELP = "print or write an example design; without a name, their list"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("name", metavar="NAME", nargs="?", help="as tailstack example lists it")
    parser.add_argument(
        "-o", "--output", metavar="NEW", help="write it here, and beside it what it refers to (of a folder: a folder)"
    )
    add_force(parser)


def run(arguments: argparse.Namespace) -> Answer:
    known = list_examples()
    if arguments.name is None:
        width = max(map(len, known)) + 2
        listed = "".join(f"{name:<{width}}{words}\n" for name, words in known.items())
        return Answer(f"{listed}next: {program()} example demo -o demo.yaml\n")
    name = arguments.name.removesuffix(".yaml").rstrip("/").replace("/", "-")  # gallery/flat_plate, too
    if name not in known:
        detail = f"no example is called {arguments.name!r}{suggest(name, known)}"
        raise RequestError(Problem("", "unknown-example", detail, f"one of {', '.join(known)}"))
    designs = list_example_designs()
    if name not in designs:
        source = example_folder() / name
        if arguments.output is None:
            detail = f"{name} is a folder of files"
            raise RequestError(Problem("", "option-missing", detail, f"tailstack example {name} -o {name}"))
        return Answer(_write_folder(source, Path(arguments.output), force=arguments.force))
    if arguments.output is None:
        return Answer(write_example(name).encode())
    return Answer(_write_design(designs[name].path, Path(arguments.output), force=arguments.force))


def _write_design(source: Path, target: Path, *, force: bool) -> str:
    """The design and the files of fiducials and targets that it refers to."""
    from tailstack.design import load_design

    writable(str(target), (".yaml", ".yml"))
    parts = load_design(source).files
    refuse_overwriting([target, *(target.parent / part for part in parts)], force=force)
    for part in parts:
        (target.parent / part).parent.mkdir(parents=True, exist_ok=True)
        write_and_tell(target.parent / part, (source.parent / part).read_bytes())
    write_document(target, source.read_text(encoding="utf-8"))
    print(f"wrote {target}", file=sys.stderr)
    return f"next: {program()} score {quote(str(target))}\n"


def _write_folder(source: Path, target: Path, *, force: bool) -> str:
    """Every file of a folder but what is of no use to others: scripts that made examples, and Python's own files."""
    files = (path for path in sorted(source.rglob("*")) if path.is_file() and path.suffix != ".pyc")
    names = [path.relative_to(source) for path in files if not path.name.startswith("make_")]
    refuse_overwriting([target / name for name in names], force=force)
    for name in names:
        (target / name).parent.mkdir(parents=True, exist_ok=True)
        if name.suffix == ".yaml":
            write_document(target / name, (source / name).read_text(encoding="utf-8"))
        else:
            shutil.copyfile(source / name, target / name)
        print(f"wrote {target / name}", file=sys.stderr)
    return ""
