"""Convert designs (.yaml, .json) and fiducial files (.csv, .fcsv, .mrk.json) into one another, by file ending."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from ..console.answer import Answer

HELP = "convert designs and fiducial files, by their endings"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("design", metavar="IN", help="file to read: .yaml, .json, .csv, .fcsv or .mrk.json")
    parser.add_argument(
        "-o", "--output", metavar="OUT", required=True, help="file to write; its ending decides the format"
    )


def run(arguments: argparse.Namespace) -> Answer:
    from tailstack.design import convert_file

    conversion = convert_file(Path(arguments.design), Path(arguments.output))
    for note in conversion.notes:
        print(f"note: {note}", file=sys.stderr)
    print(f"wrote {arguments.output}", file=sys.stderr)
    return Answer("")
