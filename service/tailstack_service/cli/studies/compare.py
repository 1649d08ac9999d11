"""Bench measurements against prediction: bias and spread with intervals, calibrated tests, Q-Q of the tail, and how
large which contributor would have to be to explain a difference.

The file is CSV whose header names the measured quantity and its unit (um, mm, cm, m), one of
  x_mm,y_mm,z_mm (where the point came to lie, connector frame) · error_x_mm,error_y_mm,error_z_mm · error_mm
  with any of level, installation, trial, target before them, or summary statistics: level,n,mean_mm,sd_mm.
rx_deg ... tz_mm state the installation error that a level sets.  Exit code 0: no difference is seen, 1: they differ,
4: nothing in the file can be tested.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from ...console.answer import FAIL, INCONCLUSIVE, PASS, Answer
from ...console.arguments import add_design, coloured_output, read_design, whole
from ...console.progress import Progress

HELP = "bench measurements against prediction"
EXIT = {"agrees": PASS, "differs": FAIL, "not testable": INCONCLUSIVE}


def add(parsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    parser = parsers.add_parser(
        "compare", help=HELP, description=__doc__, allow_abbrev=False,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    add_design(parser)
    parser.add_argument("--measurements", required=True, metavar="FILE", help="what was measured (.csv)")
    parser.add_argument(
        "--error", choices=("tcp", "localisation"), default="tcp", help="which error was measured (default %(default)s)"
    )
    parser.add_argument(
        "--instrument-sd", dest="instrument_sd_mm", type=_length, default=0.0, metavar="MM",
        help="standard deviation of the measuring instrument, mm per coordinate (default 0: taken as exact)",
    )  # fmt: skip
    parser.add_argument("--seed", type=whole(0, 2**63 - 1), default=0, metavar="N", help="seed (default %(default)s)")
    parser.add_argument("--figure", metavar="FILE", help="draw means and Q-Q plots (.svg)")
    parser.add_argument("--threads", type=whole(1, 1024), metavar="N", help="threads; the answer does not depend on it")


def _length(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"expected a length in mm; got {text!r}") from None
    if not 0 <= value <= 1000:
        raise argparse.ArgumentTypeError(f"expected 0 to 1000 mm; got {text}")
    return value


def run(arguments: argparse.Namespace) -> Answer:
    design = read_design(arguments.design)

    from tailstack.design import compile_design
    from tailstack.studies.bench.compare import study_comparison
    from tailstack.studies.bench.file import read_measurements

    from ...console.files import writable_figure, write_figure
    from ...documents import to_json
    from ...rendering.studies.comparison import comparison_text
    from ...rendering.studies.comparison_figure import comparison_svg

    figure = None if arguments.figure is None else writable_figure(arguments.figure)
    targets = [target.name for target in compile_design(design).targets]
    measured = read_measurements(Path(arguments.measurements), targets)
    with Progress("study compare") as progress:
        result = study_comparison(
            design, measured, error=arguments.error, seed=arguments.seed, instrument_sd_mm=arguments.instrument_sd_mm,
            threads=arguments.threads, progress=progress.report,
        )  # fmt: skip
    if figure is not None:
        write_figure(figure, comparison_svg(result))
    code = EXIT[result.verdict]
    if arguments.json:
        return Answer(to_json(result), code)
    return Answer(comparison_text(result, colour=coloured_output()), code)
