"""How good the short tier is: random faults are put into the sources, and it is counted who notices.

    ./run bench                      # makes the environment
    .venv/bin/python benchmarks/mutants.py [--count 30] [--seed 1] [--room FOLDER]

A fault is one changed operator, comparison, number or condition of one file of ``solver`` or ``service``, drawn at
random (no two in one file).  A clone of the last commit runs the tests of the short tier that reach the file by
imports, the nearest first, until one fails, up to four minutes of CPU by what they cost at the last ``./run test
--costs``; where none does, the long ones, up to ten.  A fault that nobody notices may change nothing that can be seen,
or be one that farther tests notice.  Each line: who noticed, the place, what stood there and what stands there now; at
the end the share of the faults noticed by anybody that the short tier notices.
"""

from __future__ import annotations

import argparse
import ast
import os
import random
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
OPERATORS = {
    ast.Add: ("+", "-"), ast.Sub: ("-", "+"), ast.Mult: ("*", "/"), ast.Div: ("/", "*"),
    ast.Lt: ("<", "<="), ast.LtE: ("<=", "<"), ast.Gt: (">", ">="), ast.GtE: (">=", ">"),
    ast.Eq: ("==", "!="), ast.NotEq: ("!=", "=="), ast.And: ("and", "or"), ast.Or: ("or", "and"),
    ast.In: ("in", "not in"), ast.Is: ("is", "is not"),
}  # fmt: skip
LEFT_OUT = ("integrations/", "docs_page/", "example_files/", "presets.py", "glossary")


class Mutant(NamedTuple):
    file: str
    line: int
    before: str
    after: str


def mutants_of(file: Path) -> Iterator[Mutant]:
    """Every fault of one file that changes a single line."""
    lines = file.read_text(encoding="utf-8").splitlines()
    name = str(file.relative_to(ROOT))

    def between(left: ast.expr, right: ast.expr, operator: ast.AST) -> Iterator[Mutant]:
        if type(operator) not in OPERATORS or left.end_lineno != right.lineno:
            return
        old, new = OPERATORS[type(operator)]
        text = lines[right.lineno - 1]
        start, end = len(text.encode()[: left.end_col_offset].decode()), len(text.encode()[: right.col_offset].decode())
        if text[start:end].strip(" ()") == old:
            yield Mutant(name, right.lineno, text, text[:start] + text[start:end].replace(old, new, 1) + text[end:])

    for node in ast.walk(ast.parse("\n".join(lines))):
        if isinstance(node, ast.BinOp):
            yield from between(node.left, node.right, node.op)
        elif isinstance(node, ast.Compare) and len(node.ops) == 1:
            yield from between(node.left, node.comparators[0], node.ops[0])
        elif isinstance(node, ast.BoolOp):
            yield from between(node.values[0], node.values[1], node.op)
        elif isinstance(node, ast.If) and node.test.lineno == node.test.end_lineno:
            text = lines[node.test.lineno - 1]
            start, end = node.test.col_offset, node.test.end_col_offset
            if text.isascii():
                yield Mutant(name, node.lineno, text, f"{text[:start]}not ({text[start:end]}){text[end:]}")
        elif isinstance(node, ast.Constant) and type(node.value) in (int, float) and node.lineno == node.end_lineno:
            text = lines[node.lineno - 1]
            if text.isascii():
                start, end = node.col_offset, node.end_col_offset
                new = repr(node.value + 1 if isinstance(node.value, int) else node.value * 1.5)
                yield Mutant(name, node.lineno, text, text[:start] + new + text[end:])


def draw(count: int, seed: int) -> list[Mutant]:
    chance = random.Random(seed)
    files = [
        path
        for room in ("solver/tailstack", "service/tailstack_service")
        for path in sorted((ROOT / room).rglob("*.py"))
        if not any(word in str(path) for word in LEFT_OUT)
    ]
    chance.shuffle(files)
    chosen = []
    for file in files:
        if found := [one for one in mutants_of(file) if "description=" not in one.before and '"""' not in one.before]:
            chosen.append(chance.choice(found))
        if len(chosen) == count:
            break
    return chosen


def noticed_by(room: Path, mutant: Mutant) -> str:
    """The tier that notices, or nobody; tests are those of the clone, whatever stands in this checkout meanwhile."""
    from tiers import choose_tests

    file = room / mutant.file
    whole = file.read_text(encoding="utf-8")
    lines = whole.splitlines(keepends=True)
    assert lines[mutant.line - 1].rstrip("\n") == mutant.before
    lines[mutant.line - 1] = mutant.after + "\n"
    file.write_text("".join(lines), encoding="utf-8")
    try:
        for tier, options, seconds in (("short", ["--short"], 240.0), ("long", ["-m", "long"], 600.0)):
            tests, _ = choose_tests([mutant.file], seconds, seconds, long=tier == "long")
            if not tests:
                continue
            command = [sys.executable, "-m", "pytest", "-x", "-q", "-n", "2", "--dist", "loadfile",
                       "--no-loadscope-reorder", *options, *tests]  # fmt: skip
            code = subprocess.run(command, cwd=room, stdout=subprocess.DEVNULL, check=False).returncode
            if code not in (0, 5):
                return tier
        return "nobody"
    finally:
        file.write_text(whole, encoding="utf-8")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=30)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    os.chdir(ROOT)
    chosen = draw(arguments.count, arguments.seed)
    with tempfile.TemporaryDirectory() as folder:
        Path(folder).chmod(0o755)  # tests that are another user read the clone
        room = Path(folder) / "clone"
        subprocess.run(["git", "clone", "--quiet", "--shared", str(ROOT), str(room)], check=True)
        sys.path.insert(0, str(room / "tests"))
        (room / ".venv").symlink_to(ROOT / ".venv")  # tests that call the clone's own ./run would make another
        counted = {"short": 0, "long": 0, "nobody": 0}
        for mutant in chosen:
            found = noticed_by(room, mutant)
            counted[found] += 1
            print(f"{found:6} {mutant.file}:{mutant.line}")
            print(f"       - {mutant.before.strip()}\n       + {mutant.after.strip()}", flush=True)
            shutil.rmtree(room / ".hypothesis", ignore_errors=True)
    noticed = counted["short"] + counted["long"]
    print(f"{counted}; the short tier notices {100 * counted['short'] / max(noticed, 1):.0f} % of what anybody notices")


if __name__ == "__main__":
    main()
