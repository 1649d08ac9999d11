"""Print a script that completes verbs, flags, choices and file names in a shell.

  tailstack completion bash > ~/.local/share/bash-completion/completions/tailstack
  tailstack completion zsh  > ~/.zfunc/_tailstack     with, in ~/.zshrc: fpath+=~/.zfunc; autoload -U compinit; compinit
  tailstack completion fish > ~/.config/fish/completions/tailstack.fish

The next shell that is opened has it.  Print it anew after an upgrade: it knows the verbs and flags of its version.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterator

from ..console.answer import Answer
from ..console.parser import INSTALLED

HELP = "a script that completes commands in bash, zsh or fish"

SHELLS = ("bash", "zsh", "fish")
DOCUMENTS = ("*.yaml", "*.yml", "*.json")
# By the words of a metavar
OF_DOCUMENTS, OF_FILES, OF_DIRECTORIES = {"DESIGN", "RESULT"}, {"FILE", "NEW", "IN", "OUT"}, {"DIR"}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("shell", metavar="SHELL", choices=SHELLS, help="bash, zsh or fish")


def run(arguments: argparse.Namespace) -> Answer:
    import shtab

    from ..operations.rendering import FORMATS as REPORT_FORMATS
    from .gate import FORMATS as GATE_FORMATS
    from .main import build_parser

    parser = build_parser(name=INSTALLED)  # that is what is completed, whatever this command was called by
    for action in list_actions(parser):
        words = set(re.findall(r"[A-Z]+", str(action.metavar)))
        if "--format" in action.option_strings:
            action.choices = GATE_FORMATS if "FORMAT" in words else REPORT_FORMATS
        elif words & OF_DOCUMENTS:
            action.complete = shtab.glob(*DOCUMENTS)  # type: ignore[attr-defined]
        elif words & OF_FILES:
            action.complete = shtab.FILE  # type: ignore[attr-defined]
        elif words & OF_DIRECTORIES:
            action.complete = shtab.DIRECTORY  # type: ignore[attr-defined]
    return Answer(shtab.complete(parser, arguments.shell) + "\n")


def list_actions(parser: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    """Every argument of a parser and of the parsers below it."""
    for action in parser._actions:  # noqa: SLF001 - argparse has no public name for them
        if isinstance(action, argparse._SubParsersAction):  # noqa: SLF001
            for below in action.choices.values():
                yield from list_actions(below)
        else:
            yield action
