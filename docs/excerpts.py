"""What pages quote is run: ``python docs/excerpts.py [PAGE...]`` compares, ``--write`` brings the quotes up to date.

A page is followed from its top in an empty folder, as a reader would:

- ```` ```console ````: lines that begin with ``$`` are commands for one shell that lasts as long as the page; what
  follows a command is what it prints, on both streams.  A line ``...`` stands for any number of lines left out.
- ```` ```yaml title="NAME" ```` (or any language): the file that the reader writes.
- ```` ```diff title="NAME" ````: what the reader changes in it; the lines without ``+`` stand there once.
- ```` ```bash ```` and ```` ```python ````: a script that is run; a block ```` ```text ```` right below it is what it
  prints.

Blocks of another kind are read by nobody but people.  ``--write`` replaces lines between two ``...`` by the lines of
the output that resemble them most: read the difference before you commit it.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from difflib import SequenceMatcher, unified_diff
from pathlib import Path
from tempfile import TemporaryDirectory

ROOT = Path(__file__).resolve().parents[1]
PAGES = ("README.md", "docs/tutorials/*.md", "docs/troubleshooting.md")
FENCE = re.compile(r"^```(\w+)(?: title=\"([^\"]+)\")?[^\n]*\n(.*?)^```$", re.MULTILINE | re.DOTALL)
SCRIPTS = {"bash": "bash", "python": "python -"}
LEFT_OUT = "..."
# On stderr, of what takes longer than a second, as the machine happens to be
PROGRESS = re.compile(r"[a-z]+: \d+ s\b|compiling kernels, once on this machine")
END = "--- end of an answer ---"  # no command prints it
COLUMNS = "80"


@dataclass(frozen=True, slots=True)
class Block:
    """A fenced block of a page: its language, the file that it names, its text, and where the text stands."""

    language: str
    title: str
    text: str
    start: int
    end: int


@dataclass(frozen=True, slots=True)
class Quote:
    """A command or script with the output that the page shows for it; ``start`` and ``end`` hold the output."""

    command: str
    lines: tuple[str, ...]
    start: int
    end: int


def list_pages() -> list[Path]:
    """The pages whose blocks are run."""
    return sorted(page for pattern in PAGES for page in ROOT.glob(pattern))


def read_blocks(text: str) -> list[Block]:
    """The fenced blocks of a page, from its top."""
    return [Block(m[1], m[2] or "", m[3], m.start(3), m.end(3)) for m in FENCE.finditer(text)]


def read_console(block: Block) -> Iterator[Quote]:
    """The commands of a console block with what follows each."""
    place, command, begin, lines = block.start, "", block.start, list[str]()
    for line in block.text.splitlines(keepends=True):
        continued = command.endswith("\\\n") and not lines
        if line.startswith("$ ") or continued:
            if command and not continued:
                yield Quote(command.strip(), tuple(lines), begin, place)
            command = command + line if continued else line[2:]
            begin, lines = place + len(line), []
        else:
            lines.append(line.rstrip())
        place += len(line)
    if command:
        yield Quote(command.strip(), tuple(lines), begin, place)


def list_quotes(text: str) -> list[Quote]:
    """Everything that a page runs, in its order; files are written and changed by commands without an output."""
    quotes: list[Quote] = []
    blocks = read_blocks(text)
    for number, block in enumerate(blocks):
        below = blocks[number + 1] if number + 1 < len(blocks) else None
        if block.language == "console":
            quotes += read_console(block)
        elif block.language in SCRIPTS:
            command = here_document(block.text, SCRIPTS[block.language])
            if below and below.language == "text":
                lines = tuple(line.rstrip() for line in below.text.splitlines())
                quotes.append(Quote(command, lines, below.start, below.end))
            else:
                quotes.append(Quote(command, (), block.end, block.end))
        elif block.language == "diff" and block.title:
            change = f"python '{Path(__file__).resolve()}' --change '{block.title}'"
            quotes.append(Quote(here_document(block.text, change), (), block.end, block.end))
        elif block.title:
            write = f"mkdir -p \"$(dirname '{block.title}')\" && cat > '{block.title}'"
            quotes.append(Quote(here_document(block.text, write), (), block.end, block.end))
    return quotes


def here_document(text: str, command: str) -> str:
    """A shell command with a text on its stdin."""
    return f"{command} <<'END_OF_TEXT'\n{text}END_OF_TEXT"


def change_file(file: Path, difference: str) -> None:
    """Replace the lines of a difference that have no ``+`` before them, which stand once, by those without ``-``."""
    lines = difference.splitlines(keepends=True)
    before = "".join(line[1:] for line in lines if line[0] != "+")
    after = "".join(line[1:] for line in lines if line[0] != "-")
    text = file.read_text(encoding="utf-8")
    if text.count(before) != 1:
        raise SystemExit(f"{file} holds {text.count(before)} times:\n{before}")
    file.write_text(text.replace(before, after), encoding="utf-8")


def run(quotes: Sequence[Quote]) -> list[list[str]]:
    """What each command prints, in one shell and one empty folder; blank lines at either end are left out."""
    script = "".join(
        f"{quote.command}\n{{ code=$?; echo; echo '{END}'; }} 2>/dev/null; (exit $code)\n" for quote in quotes
    )
    path = os.pathsep.join((str(Path(sys.executable).parent), os.environ.get("PATH", "")))
    keep = {key: value for key, value in os.environ.items() if not key.startswith(("TAILSTACK_", "PYTEST_"))}
    with TemporaryDirectory() as folder:
        done = subprocess.run(
            ["bash", "-c", script], cwd=folder, text=True, encoding="utf-8", check=False, timeout=600,
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
            env={**keep, "PATH": path, "COLUMNS": COLUMNS, "NO_COLOR": "1", "XDG_STATE_HOME": f"{folder}/.state"},
        )  # fmt: skip
    answers = done.stdout.split(f"\n{END}\n")[: len(quotes)]
    if len(answers) != len(quotes):
        raise SystemExit(f"the shell ended early:\n{done.stdout[-2000:]}")
    return [trim([line.rstrip() for line in answer.splitlines() if not PROGRESS.match(line)]) for answer in answers]


def trim(lines: Sequence[str]) -> list[str]:
    """The lines without blank ones at either end."""
    filled = [number for number, line in enumerate(lines) if line]
    return list(lines[filled[0] : filled[-1] + 1]) if filled else []


def split_segments(lines: Sequence[str]) -> list[list[str]]:
    """The lines between those that leave something out; an empty first or last one where the quote is open there."""
    segments: list[list[str]] = [[]]
    for line in trim(lines):
        if line == LEFT_OUT:
            segments.append([])
        else:
            segments[-1].append(line)
    return [trim(segment) for segment in segments]


def holds(quoted: Sequence[str], printed: Sequence[str]) -> bool:
    """Whether an output is what a quote says of it."""
    segments = split_segments(quoted)
    if len(segments) == 1:
        return segments[0] == list(printed)
    first, last = segments[0], segments[-1]
    if list(printed[: len(first)]) != first or (last and list(printed[-len(last) :]) != last):
        return False
    place, stop = len(first), len(printed) - len(last)
    for segment in segments[1:-1]:
        places = [k for k in range(place, stop - len(segment) + 1) if list(printed[k : k + len(segment)]) == segment]
        if not places:
            return False
        place = places[0] + len(segment)
    return place <= stop


def refresh(quoted: Sequence[str], printed: Sequence[str]) -> list[str]:
    """The quote brought up to date: each part of it by the part of the output that resembles it most."""
    segments = split_segments(quoted)
    if len(segments) == 1:
        return list(printed)
    fresh: list[str] = []
    place = 0
    for number, segment in enumerate(segments):
        if number:
            fresh.append(LEFT_OUT)
        if not segment:
            continue
        if number == 0:
            begin = 0
        elif number == len(segments) - 1:
            begin = max(place, len(printed) - len(segment))
        else:
            begin = max(
                range(place, max(place, len(printed) - len(segment)) + 1),
                key=lambda k, s=segment: SequenceMatcher(
                    None, "\n".join(s), "\n".join(printed[k : k + len(s)])
                ).ratio(),
            )
        place = begin + len(segment)
        fresh += printed[begin:place]
    return fresh


def check(page: Path, write: bool) -> list[str]:
    """Differences between what a page quotes and what was printed; with ``write`` the page is brought up to date."""
    text = page.read_text(encoding="utf-8")
    quotes = list_quotes(text)
    differences: list[str] = []
    for quote, printed in reversed(list(zip(quotes, run(quotes), strict=True))):
        if holds(quote.lines, printed):
            continue
        fresh = refresh(quote.lines, printed)
        heads = (f"{page.name}: {quote.command.splitlines()[0]}", "printed")
        differences.append("\n".join(unified_diff(quote.lines, fresh, *heads, lineterm="")))
        if write:
            text = text[: quote.start] + "".join(f"{line}\n" for line in fresh) + text[quote.end :]
    if write:
        page.write_text(text, encoding="utf-8")
    return differences[::-1]


def main() -> int:
    parser = argparse.ArgumentParser(description="Run what pages quote, and compare.")
    parser.add_argument("pages", nargs="*", type=Path, metavar="PAGE")
    parser.add_argument("--write", action="store_true", help="bring the quotes up to date")
    parser.add_argument("--change", type=Path, metavar="FILE", help="apply the difference on stdin to a file")
    options = parser.parse_args()
    if options.change:
        change_file(options.change, sys.stdin.read())
        return 0
    differences = [entry for page in options.pages or list_pages() for entry in check(page, options.write)]
    print("\n\n".join(differences) if differences else "all quotes hold")
    return 1 if differences and not options.write else 0


if __name__ == "__main__":
    sys.exit(main())
