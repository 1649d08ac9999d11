"""Reads STEP files that were damaged in 2000 ways, and some that were made to be hard, within a limit of memory.

Run as a program by test_design_step.py, with the seconds of CPU after which one of them is said to hang: one line
of JSON says what became of them.
"""

from __future__ import annotations

import json
import random
import re
import resource
import signal
import sys
import traceback
import zipfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from tailstack.errors import TailstackError
from tailstack.integrations.step import StepSelection, read_step

FILES = Path(__file__).parents[1] / "data" / "step" / "files.zip"
MUTANTS = 2000
MEMORY_BYTES = 300_000_000  # of all of them, beyond what Python and numpy take
SMALL = 30_000  # bytes of a file that is damaged
WORDS = [
    *(b"NaN", b"1.E400", b"-1.", b"0.", b"1.E-320", b"$", b"*", b".F.", b"()", b"(((((", b"))", b"'", b"/*", b"*/"),
    *(b";", b"#0", b"#999999999999999999", b"", b"'\\X2\\D800\\X0\\'", b"SPHERICAL_SURFACE", b"\x00", b"\xff\xfe"),
]
REFERENCE, NUMBER, KEYWORD = rb"#\d+", rb"-?\d+\.\d*(?:E[-+]\d+)?", rb"[A-Z_]{5,}"


def damage(text: bytes, draw: random.Random) -> bytes:
    """One to three changes of a text."""
    for _ in range(draw.randint(1, 3)):
        at, length = draw.randrange(len(text)), draw.randint(1, 400)
        match draw.randrange(12):
            case 0:
                text = text[:at] + bytes([draw.randrange(256)]) + text[at + 1 :]
            case 1:
                text = text[:at] + text[at + length :]
            case 2:
                text = text[:at]
            case 3:
                text = text[: at + length] + text[at:]
            case 4:
                text = text[:at] + draw.choice(WORDS) + text[at:]
            case 5 | 6 | 7:
                others = [b"#0", *re.findall(REFERENCE, text)]
                text = change(text, REFERENCE, draw, others)
            case 8 | 9:
                text = change(text, NUMBER, draw, WORDS)
            case _:
                text = change(text, KEYWORD, draw, re.findall(KEYWORD, text))
        text = text or b" "
    return text


def change(text: bytes, pattern: bytes, draw: random.Random, others: list[bytes]) -> bytes:
    """One of the matches, any of them, made another."""
    found = list(re.finditer(pattern, text))
    if not found:
        return text
    one = draw.choice(found)
    return text[: one.start()] + draw.choice(others) + text[one.end() :]


def hard_files(good: bytes) -> Iterator[tuple[str, bytes]]:
    """Files of some megabytes that would take a careless reader for ever, or all memory."""
    head, size = good[: good.index(b"DATA;") + 5], 4_000_000
    end = b"ENDSEC;\nEND-ISO-10303-21;\n"
    yield "a text that does not end", head + b"#1=A('" + b"x" * size
    yield "comments that do not end", head + b"/*" * (size // 2)
    yield "instances that do not end", head + b"#1=A(" * (size // 5)
    yield "slashes", head + b"#1=A(" + b"/ " * (size // 2) + b");" + end
    yield "quotes", head + b"#1=A(" + b"''" * (size // 2) + b");" + end
    yield "a million small instances", head + b"".join(b"#%d=A();" % k for k in range(250_000)) + end
    yield "brackets", good.replace(b"(#", b"(" * 1_500_000 + b"(#", 1)
    yield "a long number", good.replace(b"1.5)", b"1" * 1_500_000 + b")", 1)
    yield "a long name", good.replace(b"PRODUCT('", b"PRODUCT('" + b"\\X2\\00E9\\X0\\" * 100_000, 1)
    yield "a long list", good.replace(b"CLOSED_SHELL('',(", b"CLOSED_SHELL('',(" + b"#3," * 500_000, 1)
    yield "zeros", b"\x00" * size
    yield "only a beginning", b"ISO-10303-21;" + b" " * size
    yield "a keyword that does not end", head + b"#1=" + b"A" * size


def main() -> None:
    with zipfile.ZipFile(FILES) as archive:
        files = {name: archive.read(name) for name in sorted(archive.namelist())}
    good = [content for content in files.values() if len(content) < SMALL]
    selection = StepSelection()
    read_step(good[0], "warm.step", selection)
    np.linalg.inv(np.eye(4))
    taken = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    with open("/proc/self/statm", encoding="ascii") as stream:
        address_space = int(stream.read().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (address_space + MEMORY_BYTES,) * 2)
    signal.signal(signal.SIGVTALRM, hang)
    draw = random.Random(20260722 + int(sys.argv[1]))
    mutants = ((f"mutant {k}", damage(good[k % len(good)], draw)) for k in range(MUTANTS))
    outcomes: Counter[str] = Counter()
    failures: list[str] = []
    for name, content in (*mutants, *hard_files(good[0])):
        signal.setitimer(signal.ITIMER_VIRTUAL, float(sys.argv[2]))
        try:
            read_step(content, "mutant.step", selection)
            outcomes["read"] += 1
        except TailstackError as error:
            outcomes[error.problems[0].code] += 1
        except BaseException:
            failures.append(f"{name}: {traceback.format_exc()[-1500:]}")
    signal.setitimer(signal.ITIMER_VIRTUAL, 0)
    used = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 - taken
    json.dump({"outcomes": outcomes, "failures": failures, "memory_bytes": used}, sys.stdout)


def hang(*_: object) -> None:
    raise TimeoutError(f"more than {sys.argv[2]} s")


if __name__ == "__main__":
    main()
