"""Print the OpenAPI 3.1 document of the HTTP service."""

from __future__ import annotations

import argparse

from ..console.command_line import Answer

HELP = "the OpenAPI document of the service"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """No arguments."""


def run(arguments: argparse.Namespace) -> Answer:
    from ..http.app import create_app
    from ..http.openapi import openapi_json

    return Answer(openapi_json(create_app(warm_up=False)))
