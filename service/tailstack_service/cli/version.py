"""Version of tailstack."""

from __future__ import annotations

import argparse

from ..console.command_line import Answer

HELP = "version of tailstack"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """No arguments."""


def run(arguments: argparse.Namespace) -> Answer:
    from tailstack import __version__

    return Answer(f"tailstack {__version__}\n")
