"""What the words of results mean: the dozen that are met first, one that is named, or all.

The words and their meanings are those of docs/glossary.md, each in one place.
"""

from __future__ import annotations

import argparse
import re
from dataclasses import dataclass

from tailstack.errors import Problem

from ..console.command_line import Answer
from ..problems import RequestError
from ..rendering.text import wrap
from ..shipped import find_manual

HELP = "what the words of results mean: P95, TCP, connector, unit, shot, ..."
FIRST = "First words"  # heading of the section that is printed by itself


@dataclass(frozen=True, slots=True)
class GlossaryTerm:
    """A term of the glossary."""

    term: str
    meaning: str
    section: str


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("word", metavar="WORD", nargs="*", help="words to explain (default: the first dozen)")
    parser.add_argument("--all", action="store_true", help="every word of the glossary")


def run(arguments: argparse.Namespace) -> Answer:
    """Raises RequestError for a word that is not in the glossary."""
    words = read_glossary()
    if arguments.word:
        chosen = [_find(words, name) for name in arguments.word]
    else:
        chosen = [word for word in words if arguments.all or word.section == FIRST]
    lines = [wrap(word.meaning, first=f"{word.term}: ", indent="  ") for word in chosen]
    if not arguments.word and not arguments.all:
        lines.append(wrap("`tailstack words WORD` explains another word, `tailstack words --all` lists all."))
    return Answer("\n".join(lines) + "\n")


def _find(words: list[GlossaryTerm], name: str) -> GlossaryTerm:
    from tailstack.cures import ask_label

    terms = {word.term.lower(): word for word in words}
    if name.lower() in terms:
        return terms[name.lower()]
    hint = ask_label(name, [word.term for word in words], "tailstack words --all lists what there is")
    raise RequestError(Problem("", "unknown-word", f"the glossary has no word {name!r}", hint))


def read_glossary() -> list[GlossaryTerm]:
    """Its words in their order."""
    text = (find_manual() / "glossary.md").read_text(encoding="utf-8")
    words = []
    for section in re.split(r"^## ", text, flags=re.MULTILINE)[1:]:
        title, _, body = section.partition("\n")
        for term, meaning in re.findall(r"^- \*\*(.+?)\*\*: (.+?)(?=\n- |\n\n|\Z)", body, re.MULTILINE | re.DOTALL):
            words.append(GlossaryTerm(term, re.sub(r"[*`]", "", " ".join(meaning.split())), title.strip()))
    return words
