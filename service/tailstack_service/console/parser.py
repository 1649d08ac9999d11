"""The command line: what the command is called here, what is wrong with one, what was meant, what to type next."""

from __future__ import annotations

import argparse
import os
import re
import shutil
import sys
import textwrap
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, NoReturn

from tailstack.cures import ask_label, ask_meant, find_nearest

from ..environment import COMMAND
from .answer import BAD_INPUT

INSTALLED = "tailstack"
_verbs: list[str] = []
DOCUMENTS = (".yaml", ".yml", ".json")


def know_verbs(verbs: Iterable[str]) -> None:
    """Say which words after ``tailstack`` are verbs; the command does so when it starts."""
    _verbs[:] = verbs


def program() -> str:
    """What a person types before the verb: ``tailstack``, or ``./run tailstack`` in a checkout."""
    return os.environ.get(COMMAND) or INSTALLED


def spell_commands(text: str) -> str:
    """The text with the commands in it (``tailstack score ...``) as they are typed here."""
    here = program()
    if here == INSTALLED or not _verbs:
        return text
    before = re.escape(here.removesuffix(INSTALLED))
    return re.sub(rf"(?<!{before})\b{INSTALLED} (?=({'|'.join(_verbs)})\b)", lambda _: f"{here} ", text)


class Parser(argparse.ArgumentParser):
    """Usage errors name what was perhaps meant and the next command, and leave with the code for bad input."""

    find_verbs: Callable[[str], list[str]] = staticmethod(lambda flag: [])  # that have a flag

    def error(self, message: str) -> NoReturn:
        self.exit(BAD_INPUT, f"{self.prog}: {message}\nnext: {self.prog} --help\n")

    def format_help(self) -> str:
        """Paragraphs as wide as the terminal; what has indented lines is laid out already."""
        width = shutil.get_terminal_size().columns
        paragraphs = spell_commands(super().format_help()).rstrip("\n").split("\n\n")
        return "\n\n".join(text if "\n " in text else textwrap.fill(text, width) for text in paragraphs) + "\n"

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Refused here, what is left over is refused with the verb's own name and flags."""
        parsed, rest = super().parse_known_args(args, namespace)
        if rest:
            self.error(self._explain_rest(rest))
        return parsed, rest

    def _explain_rest(self, rest: Sequence[str]) -> str:
        text = f"unrecognized arguments: {' '.join(rest)}"
        flags = [flag for action in self._actions for flag in action.option_strings]
        for word in rest:
            if word.startswith("-"):
                flag = word.partition("=")[0]
                meant = suggest(flag, (flag for flag in flags if flag.startswith("--")), ask_meant)
                others = [] if meant else self.find_verbs(flag)
                return text + (f"; it is a flag of {program()} {others[0]}" if others else meant)
        return text

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        """As the library does it, with what was perhaps meant."""
        if action.choices is not None and value not in action.choices:
            known = [str(choice) for choice in action.choices]
            ask = ask_meant if action.option_strings else ask_label  # a verb, a shell: they are called so
            message = f"invalid choice: {value!r} (choose from {', '.join(known)}){suggest(str(value), known, ask)}"
            raise argparse.ArgumentError(action, message)


def suggest(word: str, known: Iterable[str], ask: Callable[[str, Iterable[str]], str] = ask_label) -> str:
    """``; did you mean X?`` if something known is like the word, else nothing; ``ask``: how that is found."""
    meant = ask(word, known)
    return f"; {meant}" if meant else ""


def refuse_verb(word: str, rest: Sequence[str], verbs: Sequence[str]) -> int:
    """Say what is wrong with a command whose first word is no verb.  Returns the exit code."""
    here = program()
    following = f"{here} --help"
    if word.startswith("-"):
        meant = suggest(word, ("--help", "--version"))
        detail = f"there is no flag {word!r}{meant}" if meant else f"flags stand after the verb; got {word} before it"
    elif word.lower().endswith(DOCUMENTS) or Path(word).is_file():
        detail = f"{word!r} is a file, and no verb stands before it"
        verb = next((other for other in rest if other in verbs), "score")  # DESIGN VERB: the wrong way round
        following = f"{here} {verb} {word}   (all verbs: {here} --help)"
    else:
        detail = f"there is no verb {word!r}{suggest(word, verbs)}"
        following = f"{here} {' '.join([*find_nearest(word, verbs), '--help'])}"
    print(f"{here}: {detail}\nnext: {following}", file=sys.stderr)
    return BAD_INPUT
