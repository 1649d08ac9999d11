"""Serve the HTTP API until Ctrl-C or SIGTERM. Limits come from TAILSTACK_ variables (docs/http.md)."""

from __future__ import annotations

import argparse
import os

from .answer import PASS, Answer
from .design_input import whole

HELP = "the HTTP service, on loopback"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--host", default="127.0.0.1", metavar="H", help="address to listen on (default %(default)s)")
    parser.add_argument(
        "--port", type=whole(0, 65535), default=8321, metavar="N", help="port, 0 for any free one (default %(default)s)"
    )
    parser.add_argument(
        "--allow-remote",
        action="store_true",
        help="listen on an address that other machines can reach; there is no authentication yet",
    )


def run(arguments: argparse.Namespace) -> Answer:
    from ..http.server import address_of, bind, log_to_stderr, serve
    from ..settings import settings_from

    settings = settings_from(os.environ)
    bound = bind(arguments.host, arguments.port, allow_remote=arguments.allow_remote)
    log_to_stderr()
    bound.listen(128)  # what connects before the service is up waits instead of being refused
    print(f"serving on {address_of(bound)}   (Ctrl-C stops; /openapi.json describes it)", flush=True)
    serve(bound, settings)
    return Answer("", PASS)
