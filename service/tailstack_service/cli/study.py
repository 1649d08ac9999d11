"""Studies of the method itself: published tables reproduced, first order's reach, coupling, measured data."""

from __future__ import annotations

import argparse
from importlib import import_module
from types import ModuleType

from ..console.answer import Answer

HELP = "studies: the paper's tables, reach of first order, coupling, measurements"
# A study is a module of ``cli/studies`` with ``add(parsers)``, which parses, and ``run(arguments) -> Answer``.
STUDIES: tuple[str, ...] = ("paper", "linearity", "coupling", "compare")


def _module(name: str) -> ModuleType:
    return import_module(f"tailstack_service.cli.studies.{name}")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    studies = parser.add_subparsers(dest="study", metavar="STUDY", required=True)
    for name in STUDIES:
        _module(name).add(studies)


def run(arguments: argparse.Namespace) -> Answer:
    arguments.verb = f"study {arguments.study}"  # what a refusal calls it, and names next
    answer: Answer = _module(arguments.study).run(arguments)
    return answer
