"""Hold designs to a policy: findings at the line of the offending value, an exit code for a pipeline."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from datetime import date
from functools import partial
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from tailstack.cures import ask_meant
from tailstack.errors import DesignError, LimitError, Problem, TailstackError

from ..clock import SYSTEM_CLOCK
from ..console.command_line import BAD_INPUT, NOT_EVALUATED, PASS, Answer, add_details, read_design, write_out
from ..console.command_line import INTERRUPTED as INTERRUPTED_CODE
from ..console.flags import add_flags, fill_defaults
from ..console.progress import Progress
from ..environment import misses_temporary_folder, no_temporary_folder
from ..gate.asked import GateRequest
from ..gate.file_names import is_wild, normalise
from ..problems import OutputError, RequestError
from .gate_files import Anchors, find_paths, follow_link, resolve, show_name

if TYPE_CHECKING:
    from ..gate.judge import Gate
    from ..gate.reading import GateDesign, GateInput
    from ..gate.records import GateRecord
    from .gate_outputs import Outputs

    _Input = TypeVar("_Input", bound=GateInput)

HELP = "designs against a policy, for a pipeline: findings and an exit code"

FORMATS = ("text", "json", "baseline", "sarif", "junit", "github", "gitlab", "markdown", "needs", "reqif")
LONGEST_NAME = 400


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("design", metavar="DESIGN", nargs="*", help="design documents, or patterns like 'parts/*.yaml'")
    add_flags(
        parser, GateRequest, "policy", "mode", "fail_level", "on_inconclusive", "baseline", "max_regression_percent"
    )
    add_flags(parser, GateRequest)
    words = f"{', '.join(FORMATS)}; several may be given, all but one with a file (default text)"
    parser.add_argument("--format", type=_format, action="append", metavar="FORMAT[=FILE]", help=words)
    parser.add_argument(
        "--remote", metavar="URL", help="let a running service judge, with the key in TAILSTACK_KEY; same answer"
    )
    words = "DESIGN are the files that a commit changes: judge the designs among them, and those that hang on them"
    parser.add_argument("--changed", action="store_true", help=words)
    add_details(parser)
    words = "print the page of a rule; without one, list the rules"
    parser.add_argument("--explain", metavar="RULE", nargs="?", const="all", help=words)


def _format(text: str) -> tuple[str, str | None]:
    name, equals, file = text.partition("=")
    if name not in FORMATS or (equals and not file):
        raise argparse.ArgumentTypeError(f"expected {', '.join(FORMATS)}, perhaps with =FILE; got {text!r}")
    return name, file or None


def run(arguments: argparse.Namespace) -> Answer:
    if arguments.explain is not None:
        return Answer(_explain(arguments.explain), PASS)
    fill_defaults(GateRequest, arguments)

    from ..console.refusals import problem_text
    from ..gate.text import summarise
    from .gate_outputs import FOR_PEOPLE, choose_outputs, record_unwritten, say

    if arguments.changed:
        from .gate_changes import list_affected

        judged_by = (arguments.policy, arguments.waivers, arguments.baseline)
        arguments.design = list_affected(arguments.design, judged_by)
        if not arguments.design:
            say(["no design hangs on what changes, nothing was judged"])
            return Answer("", PASS)
    # before anything is written: no output becomes a design, no design an output
    matches = _find_files(arguments.design)
    inputs = [arguments.policy, arguments.waivers, arguments.baseline, *arguments.design, *chain(*matches.values())]
    outputs, wrong = choose_outputs(
        arguments.format or [("text", None)],
        [name for name in inputs if name is not None],
        Anchors.of_documents([arguments.policy, arguments.waivers]),
    )
    record, outputs = _make_record(arguments, outputs, wrong, matches)
    stopped = record.provenance.policy_sha256 is None  # and stderr says by what
    body = b"" if stopped and outputs.on_stdout == "text" else outputs.stdout(record)
    problems = outputs.publish(record)
    if problems and body:
        body = outputs.stdout(record_unwritten(record, problems))
    unprinted = _print_body(body)
    if problems := [*problems, *unprinted]:
        record = record_unwritten(record, problems)
        outputs.correct(record)
        say(problem_text(replace(problem, file=None)) for problem in problems)
    else:
        for _, file in outputs.usable:
            print(f"wrote {file}", file=sys.stderr)
    if unprinted or not (stopped or outputs.on_stdout in FOR_PEOPLE):
        say(summarise(record))
    return Answer("", record.exit_code)


def _print_body(body: str | bytes) -> list[Problem]:
    """Write to stdout.  Returns what kept it from being written; a reader who has left is no reason."""
    try:
        write_out(body)
    except BrokenPipeError:
        pass
    except OutputError as error:
        with suppress(OSError, AttributeError), open(os.devnull, "wb") as nowhere:
            os.dup2(nowhere.fileno(), sys.stdout.fileno())  # or the interpreter's last flush would complain again
        return [replace(error.problems[0], hint="the verdict is in the exit code: run the gate again")]
    return []


def _make_record(
    arguments: argparse.Namespace, outputs: Outputs, wrong: list[str], matches: dict[str, list[str]]
) -> tuple[GateRecord, Outputs]:
    """The record of the gate, whatever becomes of it, and the outputs that can be written to.

    What stops it stands on stderr and in the record.
    """
    from ..console.refusals import report_error, report_failure
    from .gate_outputs import INTERRUPTED, NOT_FINISHED, record_unfinished

    known = partial(record_unfinished, arguments, today())
    files = [show_name(name) for name in arguments.design]
    try:
        outputs, unwritable = outputs.begin(known(files, (NOT_FINISHED,), NOT_EVALUATED))
        if wrong:
            raise RequestError([Problem("", "bad-output", detail) for detail in wrong])
        if unwritable:
            raise OutputError([replace(problem, file=None) for problem in unwritable])
        if arguments.max_regression_percent is not None and arguments.baseline is None:
            detail = "--max-regression: without a baseline nothing is compared"
            raise RequestError(Problem("", "unused-option", detail, "--baseline FILE, or leave it out"))
        designs = _list_files(arguments.design, matches)
        files = [show_name(name) for name in designs]
        return _judge(arguments, designs, outputs.anchors), outputs
    except KeyboardInterrupt:
        print("tailstack: interrupted", file=sys.stderr)
        return known(files, (INTERRUPTED,), INTERRUPTED_CODE), outputs
    except (TailstackError, OSError) as error:
        code = report_error(error, arguments)
        problems = error.problems if isinstance(error, TailstackError) else (_describe_fault(error),)
        problems = tuple(p if p.file is None else replace(p, file=show_name(p.file)) for p in problems)
        return known(files, problems, code if code == BAD_INPUT else NOT_EVALUATED), outputs
    except (Exception, SystemExit) as error:  # a library that leaves with 0 or 1 gives no verdict
        report_failure(error, arguments)
        problem = Problem("", "internal-error", f"internal error, {type(error).__name__}: {error}")
        return known(files, (problem,), NOT_EVALUATED), outputs


def _describe_fault(error: OSError) -> Problem:
    return no_temporary_folder() if misses_temporary_folder(error) else Problem("", "os-error", str(error))


def today() -> date:
    """The day by which waivers are judged, UTC."""
    return SYSTEM_CLOCK.today()


def _judge(arguments: argparse.Namespace, designs: list[str], anchors: Anchors) -> GateRecord:
    gate = _read_gate(arguments, designs, anchors)  # policy and waivers are refused before anything is computed
    with Progress("gate") as progress:
        if arguments.remote is not None:
            return judge_remotely(gate, arguments.remote, progress)

        from ..gate.judge import judge

        return judge(gate, progress.report)


def judge_remotely(gate: Gate, url: str, progress: Progress) -> GateRecord:
    """The record as it would have been computed here.  Raises RemoteError, also for an answer that is no record."""
    from ..console.remote import RemoteService, compute_remotely, unexpected_error
    from ..gate.judge import judge
    from ..gate.request import complete_record, write_request
    from ..schemas import read_record

    request = write_request(gate)
    service = RemoteService(url)
    if not request["designs"]:  # there is nothing to ask
        return judge(gate)
    try:
        record: GateRecord = read_record("gate", compute_remotely(service, "/v1/gates", request, progress.report))
        names = [entry["file"] for entry in request["designs"]]
        if [design.file for design in record.designs] != names or record.exit_code not in range(5):
            raise ValueError("it is about other designs")
    except ValueError as error:
        raise unexpected_error(service.url, "the record of this gate", error) from None
    return complete_record(record, gate)


def _explain(rule: str) -> str:
    from ..gate.rules import RULES, explain

    if rule == "all":
        return "".join(f"{name:<20}{entry.title}\n" for name, entry in RULES.items())
    if rule not in RULES:
        hint = f"{ask_meant(rule, RULES)} rules: {', '.join(RULES)}".strip()
        raise RequestError(Problem("", "unknown-rule", f"no rule is called {rule!r}", hint))
    return explain(RULES[rule])


def _find_files(given: list[str]) -> dict[str, list[str]]:
    """Of each name that is not there as it is written, the files that it stands for, sorted: of a pattern those that it
    matches, of a name the one that is written in another Unicode form."""
    absent = (name for name in given if name != "-" and (is_wild(name) or not os.path.lexists(name)))
    paths_by_name = {name: find_paths(name) for name in absent}
    return {name: paths for name, paths in paths_by_name.items() if paths or is_wild(name) or _explain_slip(name)}


def _explain_slip(name: str) -> str:
    """What to do about a name of the command line that is nothing and looks like a pattern of another tool."""
    from ..gate.pattern_slips import find_slip

    slip = find_slip(name, of_files=False)
    return f"it {slip.words}: {slip.cure}" if slip else ""


def _list_files(given: list[str], matches: dict[str, list[str]]) -> list[str]:
    """The designs' files: names as they are, patterns as what they match, each once.  Raises RequestError."""
    files: list[str] = []
    for name in given:
        if matches.get(name) == []:  # a pattern that matches nothing must not pass as nothing to complain about
            hint = _explain_slip(name) or "check the pattern"
            raise RequestError(Problem("", "no-match", f"no file matches {name!r}", hint))
        files += matches.get(name, [name])
    if not files:
        raise RequestError(Problem("", "no-design", "no design was given", "tailstack gate DESIGN..."))
    by_place = {name if name == "-" else str(resolve(name)): name for name in reversed(files)}  # by its first name
    files = sorted(by_place.values(), key=files.index)
    if long := next((name for name in files if len(show_name(name)) > LONGEST_NAME), None):
        detail = f"a path has {LONGEST_NAME} characters at most; got {long[:60]!r}..."
        raise RequestError(Problem("", "too-long", detail))
    return files


def _read_gate(arguments: argparse.Namespace, files: list[str], anchors: Anchors) -> Gate:
    from ..gate.baseline import read_baseline
    from ..gate.pattern_slips import check_patterns, list_file_patterns
    from ..gate.policy import read_policy
    from ..gate.request import gate_of
    from ..gate.waivers import read_waivers

    day = today()
    policy = _read_input(arguments.policy, read_policy) or read_policy(None)
    waivers = _read_input(arguments.waivers, partial(read_waivers, today=day))
    baseline = _read_input(arguments.baseline, read_baseline)
    anchors = anchors.with_patterns(list_file_patterns(policy, waivers))
    of_baseline = Anchors.of_documents([arguments.baseline])
    designs = tuple(_read_design(name, anchors, of_baseline) for name in files)
    ascents = [anchors.count_ascent(name) for name in (arguments.policy, arguments.waivers)]
    check_patterns(policy, waivers, designs, ascents=ascents)
    present = () if baseline is None else _list_present(baseline.record, files, of_baseline)
    return gate_of(arguments, designs, policy, waivers, baseline, day, present)


def _read_input(name: str | None, read: Callable[[Path], _Input]) -> _Input | None:
    """What the gate judges by, if a file of it is given, under the name by which findings call it."""
    return None if name is None else replace(read(Path(name)), file=show_name(name))


def _list_present(record: GateRecord, files: list[str], anchors: Anchors) -> tuple[str, ...]:
    """Designs of a baseline that are not judged now and whose files are where they were: they were not renamed.

    Their names are from where that gate ran: here, or at a folder from which names may begin for the baseline.
    """
    judged = {show_name(name) for name in files}
    known = {normalise(name) for file in files for name in (*anchors.list_names(file), str(resolve(file)))}
    here = Path.cwd()
    folders = [here, *(folder for name in files for folder in anchors.list_folders(resolve(name)))]
    return tuple(
        entry.file
        for entry in record.designs
        if entry.file not in judged
        and normalise(entry.file) not in known
        and len(entry.file) <= LONGEST_NAME
        and any(find_paths(str(folder / entry.file)) for folder in dict.fromkeys(folders))
    )


def _read_design(name: str, anchors: Anchors, of_baseline: Anchors) -> GateDesign:
    """A design, or the refusal that becomes its finding: the others are judged all the same."""
    from ..gate.reading import GateDesign

    earlier = (*of_baseline.list_names(name), str(resolve(name)))
    entry = GateDesign(show_name(name), None, names=anchors.list_names(name), earlier=earlier)
    try:
        return replace(entry, design=read_design(follow_link(name)))
    except (DesignError, LimitError) as error:
        return replace(entry, refusal=_place_refusal(error, follow_link(name)))


def _place_refusal(error: TailstackError, name: str) -> TailstackError:
    """A refusal with files as findings call them; what is about the file of fiducials stands there, or, where that is
    not to be found, at the field that names it."""
    from tailstack.design.loading import read_source
    from tailstack.design.refusals import place

    def place_problem(problem: Problem) -> Problem:
        if problem.file is not None and problem.file != str(Path(name)):
            if problem.line is not None:
                return replace(problem, file=show_name(os.path.join(os.path.dirname(name), problem.file)))
            with suppress(TailstackError):
                problem = place(replace(problem, file=None), read_source(Path(name)))
        return replace(problem, file=show_name(name))

    return type(error)([place_problem(problem) for problem in error.problems])
