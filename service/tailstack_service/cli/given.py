"""Settings as a command was given them: flags go before the environment."""

from __future__ import annotations

import argparse
import os
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ..settings import Settings

SETTING_OF = {"database": "database", "processes": "worker_processes", "engine": "engine"}  # by flag


def add_database(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--database", metavar="URL", help="where jobs are kept (default TAILSTACK_DATABASE)")


def settings_given(arguments: argparse.Namespace) -> Settings:
    """Raises RequestError for a setting that cannot be, or a TAILSTACK_ name in the environment that is none."""
    from dataclasses import replace

    from ..settings import settings_from

    flags = {setting: getattr(arguments, flag, None) for flag, setting in SETTING_OF.items()}
    return replace(settings_from(os.environ), **{name: value for name, value in flags.items() if value is not None})
