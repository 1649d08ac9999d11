"""Compute the jobs in a database until Ctrl-C or SIGTERM: any number of these, on any hosts that reach it."""

from __future__ import annotations

import argparse
import signal

from ..console.command_line import NOT_EVALUATED, PASS, Answer, add_database, read_settings, whole

HELP = "compute jobs that services accepted"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_database(parser)
    parser.add_argument(
        "--processes", type=whole(1, 256), metavar="N", help="computing processes (default TAILSTACK_WORKER_PROCESSES)"
    )
    parser.add_argument("--engine", choices=("pool", "dask"), help="where to compute (default TAILSTACK_ENGINE)")
    parser.add_argument(
        "--check", action="store_true", help="compute nothing: exit code 0 if a worker of this host is alive, else 3"
    )
    parser.add_argument("--with-parent", action="store_true", help=argparse.SUPPRESS)  # end when stdin ends
    parser.add_argument("--nursery", default="", help=argparse.SUPPRESS)  # descriptor and code of the parent's


def run(arguments: argparse.Namespace) -> Answer:
    from ..logs import log_to_stderr

    settings = read_settings(arguments)
    if arguments.check:
        from ..jobs.worker import find_live_worker

        worker = find_live_worker(settings)
        if worker is None:
            return Answer("no worker of this host is alive\n", NOT_EVALUATED)
        return Answer(f"worker {worker.id} is alive\n", PASS)

    from ..jobs.worker import run_worker
    from ..processes.birth import Nursery, join_nursery, refuse_unusable_kernels

    refuse_unusable_kernels()
    log_to_stderr(settings.log_format)
    if arguments.nursery:
        join_nursery(Nursery.read(arguments.nursery))
    if run_worker(settings, with_parent=arguments.with_parent) == signal.SIGINT:
        raise KeyboardInterrupt
    return Answer("", PASS)
