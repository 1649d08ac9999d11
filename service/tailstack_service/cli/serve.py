"""Serve the HTTP API, with a worker beside it, until Ctrl-C or SIGTERM. docs/settings.md lists the settings."""

from __future__ import annotations

import argparse

from ..console.command_line import PASS, Answer, add_database, read_settings, whole

HELP = "the HTTP service and its worker"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--host", default="127.0.0.1", metavar="H", help="address to listen on (default %(default)s)")
    parser.add_argument(
        "--port", type=whole(0, 65535), default=8321, metavar="N", help="port, 0 for any free one (default %(default)s)"
    )
    add_database(parser)
    words = "computing processes of the worker (default TAILSTACK_WORKER_PROCESSES)"
    parser.add_argument("--processes", type=whole(1, 256), metavar="N", help=words)
    parser.add_argument(
        "--no-worker", action="store_true", help="accept jobs, and leave computing them to tailstack worker elsewhere"
    )


def run(arguments: argparse.Namespace) -> Answer:
    from ..http.server import address_of, bind, serve
    from ..logs import log_to_stderr
    from ..processes.birth import refuse_unusable_kernels

    settings = read_settings(arguments)
    refuse_unusable_kernels()
    bound = bind(arguments.host, arguments.port, settings)
    log_to_stderr(settings.log_format)
    address = f"serving on {address_of(bound)}   (open it in a browser; Ctrl-C stops)"
    with bound:
        serve(bound, settings, worker=not arguments.no_worker, announce=lambda: print(address, flush=True))
    return Answer("", PASS)
