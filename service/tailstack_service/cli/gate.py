"""Hold designs to a policy: findings at the line of the offending value, an exit code for a pipeline."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from .answer import PASS, Answer
from .progress import Progress

if TYPE_CHECKING:
    from ..gate.designs import Gate, GateDesign

HELP = "designs against a policy, for a pipeline: findings and an exit code"

FORMATS = ("text", "json", "markdown", "sarif")
MODES = ("analytic", "verify", "auto")
WILD = "*?["


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("design", metavar="DESIGN", nargs="*", help="design documents, or patterns like 'parts/*.yaml'")
    parser.add_argument("--policy", metavar="FILE", help="rules and limits (default: the designs' own requirements)")
    parser.add_argument(
        "--mode", choices=MODES, default="auto",
        help="analytic: first order. verify: Monte Carlo. auto (default): Monte Carlo near a limit",
    )  # fmt: skip
    parser.add_argument(
        "--fail-level", choices=("error", "warning"), default="error", help="findings that fail (default %(default)s)"
    )
    parser.add_argument(
        "--on-inconclusive", choices=("fail", "warn"), help="what an open question counts as (default: exit code 4)"
    )
    parser.add_argument("--baseline", metavar="FILE", help="record of an earlier gate (--format json=FILE)")
    parser.add_argument(
        "--max-regression", type=_percent, metavar="PCT", help="allowed rise of P95 over the baseline (default: policy)"
    )
    parser.add_argument("--waivers", metavar="FILE", help="findings that are accepted for now")
    parser.add_argument(
        "--format", type=_format, action="append", metavar="FORMAT[=FILE]",
        help=f"{', '.join(FORMATS)}; several may be given, all but one with a file (default text)",
    )  # fmt: skip
    parser.add_argument("--explain", metavar="RULE", help="print the page of a rule; 'all' lists the rules")


def _percent(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"expected a number of per cent; got {text!r}") from None
    if not 0 <= value <= 1e6:
        raise argparse.ArgumentTypeError(f"expected 0 or more per cent; got {text}")
    return value


def _format(text: str) -> tuple[str, str | None]:
    name, found, file = text.partition("=")
    if name not in FORMATS or (found and not file):
        raise argparse.ArgumentTypeError(f"expected {', '.join(FORMATS)}, perhaps with =FILE; got {text!r}")
    return name, file or None


def run(arguments: argparse.Namespace) -> Answer:
    if arguments.explain is not None:
        return Answer(_explained(arguments.explain), PASS)
    formats = arguments.format or [("text", None)]
    _check_outputs(formats)
    files = _files(arguments.design)
    gate = _gate(arguments, files)  # policy and waivers are refused before anything is computed

    from ..gate.formats import FORMATS as WRITERS
    from ..gate.judging import judge
    from ..gate.checking import verified
    from ..gate.terminal import gate_text
    from .design_input import coloured_output

    with Progress("gate"):
        record = judge(gate, verified)
    body: str | bytes = ""
    for name, file in formats:
        if file is not None:
            _write(Path(file), WRITERS[name].write(record))
            print(f"wrote {file}", file=sys.stderr)
        elif name == "text":
            body = gate_text(record, colour=coloured_output())
        else:
            body = WRITERS[name].write(record)
    return Answer(body, record.exit_code)


def _explained(rule: str) -> str:
    from difflib import get_close_matches

    from tailstack.errors import Problem

    from ..gate.rules import RULES, explanation
    from ..problems import RequestError

    if rule == "all":
        return "".join(f"{name:<20}{entry.title}\n" for name, entry in RULES.items())
    if rule not in RULES:
        close = get_close_matches(rule, RULES, 1)
        hint = f"did you mean {close[0]}?" if close else f"rules: {', '.join(RULES)}"
        raise RequestError(Problem("", "unknown-rule", f"no rule is called {rule!r}", hint))
    return explanation(RULES[rule])


def _check_outputs(formats: list[tuple[str, str | None]]) -> None:
    """One format at most goes to stdout, and every file can be written.  Raises RequestError."""
    from tailstack.errors import Problem

    from ..problems import RequestError

    if sum(file is None for _, file in formats) > 1:
        detail = "two formats would be written to stdout"
        raise RequestError(Problem("", "two-outputs", detail, "give all but one a file: --format json=gate.json"))
    for _, file in formats:
        if file is not None and (not Path(file).parent.is_dir() or Path(file).is_dir()):
            detail = f"cannot write {file}: no such directory, or a directory"
            raise RequestError(Problem("", "file-unwritable", detail))


def _files(given: list[str]) -> list[str]:
    """The designs' files: names as they are, patterns expanded and sorted, each once.  Raises RequestError."""
    from glob import glob

    from tailstack.errors import Problem

    from ..problems import RequestError

    files: list[str] = []
    for name in given:
        if any(sign in name for sign in WILD) and not Path(name).exists():
            found = sorted(glob(name, recursive=True))
            if not found:  # a pattern that matches nothing must not pass as nothing to complain about
                raise RequestError(Problem("", "no-match", f"no file matches {name!r}", "check the pattern"))
            files += found
        else:
            files.append(name)
    if not files:
        raise RequestError(Problem("", "no-design", "no design was given", "tailstack gate DESIGN..."))
    return list(dict.fromkeys(files))


def _gate(arguments: argparse.Namespace, files: list[str]) -> Gate:
    from datetime import UTC, datetime

    from ..gate.designs import Gate, seed_of
    from ..gate.reading import read_baseline, read_policy, read_waivers

    today = datetime.now(UTC).date()
    policy = read_policy(None if arguments.policy is None else Path(arguments.policy))
    waivers = None if arguments.waivers is None else read_waivers(Path(arguments.waivers), today)
    baseline = None if arguments.baseline is None else read_baseline(Path(arguments.baseline))
    return Gate(
        designs=tuple(_design(name) for name in files),
        policy=policy,
        waivers=waivers,
        baseline=baseline,
        mode=arguments.mode,
        seed=seed_of(None, policy, baseline),
        today=today,
        fail_level=arguments.fail_level,
        on_inconclusive=arguments.on_inconclusive,
        max_regression_percent=arguments.max_regression,
    )


def _design(name: str) -> GateDesign:
    """A design, or the refusal that becomes its finding: the others are judged all the same."""
    from tailstack.errors import DesignError, LimitError

    from ..gate.designs import GateDesign
    from .design_input import read_design

    try:
        return GateDesign(name, read_design(name))
    except (DesignError, LimitError) as error:
        return GateDesign(name, None, error)


def _write(path: Path, content: bytes) -> None:
    """Write a file whole or not at all."""
    import os

    beside = path.with_name(path.name + f".{os.getpid()}.part")
    try:
        beside.write_bytes(content)
        os.replace(beside, path)
    finally:
        beside.unlink(missing_ok=True)
