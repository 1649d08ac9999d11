"""Write a tolerance-budget report of a design, of two designs side by side, or of a result; or verify a report."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from tailstack.errors import DesignError, LimitError, Problem
from tailstack.extras import require_extras

from ..console.command_line import FAIL, NOT_EVALUATED, PASS, Answer, whole
from ..console.files import replace_file, writable_directory
from ..console.flags import add_flags
from ..console.progress import Progress
from ..documents import to_json
from ..operations.registry import OPERATIONS
from ..operations.report import ReportOptions
from ..problems import RequestError
from ..report.records import Comparison, Report

if TYPE_CHECKING:
    from tailstack.design import Design

    from ..operations.reading import ReadResult
    from ..report.assembling import ReportContents as Parts
    from ..report.chapters.supplier import Sheet
HELP = "tolerance-budget report: HTML, PDF, spreadsheet, JSON"

FORMATS = ("html", "pdf", "xlsx", "json", "csv")
OF_A_DESIGN = (*ReportOptions.model_fields, "starts", "against")
BOUNDS = ("max_trials", "starts")  # with --verify: the most that is computed again
MOST_BYTES = 200_000_000  # of a file that is verified


def add_arguments(parser: argparse.ArgumentParser) -> None:
    words = "a design document, or the JSON of a result of tailstack; two designs are compared; - reads stdin"
    parser.add_argument("sources", metavar="RESULT|DESIGN", nargs="+", help=words)
    words = "html, pdf, xlsx, json, with --supplier csv, separated by commas (default html)"
    parser.add_argument("--format", type=_read_forms, metavar="LIST", help=words)
    words = "directory for the files (default: this one), or the file, whose ending is then the format"
    parser.add_argument("-o", "--output", metavar="DIR|FILE", help=words)
    parser.add_argument("--summary", action="store_true", help="one page to sign, A4, as a PDF")
    words = "of a design: the sheet for whoever makes it, beads and seats as drawn and nothing that was computed"
    parser.add_argument("--supplier", action="store_true", help=words)
    words = "of a design: compare it with the version of this name that its review section keeps"
    parser.add_argument("--against", metavar="VERSION", help=words)
    add_flags(parser, ReportOptions, "parts")
    add_flags(parser, ReportOptions)
    parser.add_argument("--starts", type=whole(1, 10_000), metavar="N", help="of a design: starts of the optimiser")
    parser.add_argument(
        "--verify",
        action="store_true",
        help="RESULT is a report or result in any format: compute its hash, pages and numbers again and compare; of a "
        "result without its design give the design as well; --max-trials and --starts then bound what is computed "
        "(default 100000000 and 256)",
    )
    parser.add_argument("--fast", action="store_true", help="with --verify: without Monte Carlo and optimiser")


def _read_forms(text: str) -> tuple[str, ...]:
    """Formats separated by commas, each once."""
    names = tuple(dict.fromkeys(name.strip() for name in text.split(",") if name.strip()))
    if not names or not set(names) <= set(FORMATS):
        raise argparse.ArgumentTypeError(f"expected {', '.join(FORMATS)}; got {text!r}")
    return names


def run(arguments: argparse.Namespace) -> Answer:
    from ..operations.rendering import render_all

    if len(arguments.sources) > 2 or arguments.sources.count("-") > 1:
        hint = "tailstack report DESIGN, or tailstack report FIRST SECOND"
        _refuse("too-many", f"one or two documents are reported; {len(arguments.sources)} were given", hint)
    if arguments.verify:
        return _verify(arguments)
    if arguments.fast:
        _refuse("unused-option", "--fast: it is read only with --verify", "leave it out")

    file = _file(arguments.output, arguments.format)
    usual = ("pdf",) if arguments.summary else ("html",)
    forms = arguments.format or usual if file is None else (file.suffix[1:].lower(),)
    if arguments.summary and forms != ("pdf",):
        _refuse("unused-option", f"--summary is a page of PDF; got {', '.join(forms)}", "--format pdf, or -o NAME.pdf")
    if set(forms) != {"json"}:  # before the work, and not after it
        require_extras("report", *(["pdf"] if "pdf" in forms else []))
    if "csv" in forms and not arguments.supplier:
        _refuse("unused-option", "csv is a form of the sheet for the supplier alone", "--supplier --format csv")
    output = writable_directory((arguments.output or ".") if file is None else str(file.parent), "-o")
    given = [_read(name) for name in arguments.sources]
    record: Any
    if arguments.supplier:
        kind, record = "sheet", _draw_up_sheet(arguments, given)
    elif len(given) == 2 or arguments.against is not None:
        kind, record = "comparison", _compare(arguments, given)
    elif not isinstance(given[0], bytes | Path):
        kind, record = given[0].kind, given[0].record
        _no_options(arguments, OF_A_DESIGN, "a result is rendered as it is", "give the design instead")
    else:
        kind, record = "report", _compute(arguments, given[0])
    body = to_json(record)
    stem = "-".join("stdin" if name == "-" else _stem(Path(name).name) for name in arguments.sources)
    stem = "report" if stem == "stdin" else stem
    with Progress("drawing the report"):  # its own phase, with a count of its own
        rendered = render_all(kind, body, forms, summary=arguments.summary)
    written = []
    for form, content in rendered:
        part = "supplier." if kind == "sheet" else "summary." if arguments.summary else ""
        ending = f"report.{form}" if form == "json" and not part else f"{part}{form}"
        path = file or output / f"{stem}.{ending}"
        replace_file(path, content)
        written.append(str(path))
    return Answer("".join(f"{each}\n" for each in (*_tell(record), *written)), OPERATIONS[kind].exit_code(record))


def _tell(record: Any) -> Iterator[str]:
    """What stands in the terminal, too: the chapter of a profile."""
    if getattr(record, "radiostereometry", None) is not None:
        from ..rendering.document import blocks_text
        from ..report.chapters.radiostereometry import radiostereometry_blocks

        yield blocks_text(radiostereometry_blocks(record.radiostereometry))


def _stem(name: str) -> str:
    """What a file is called without its ending; revisions like guide.v1.yaml and guide.v2.yaml stay apart."""
    endings = (".report.json", ".yaml", ".yml", *(f".{form}" for form in FORMATS))
    ending = next((end for end in endings if name.endswith(end) and name != end), "")
    return name.removesuffix(ending)


def _read(name: str) -> ReadResult | bytes | Path:
    """A result, or where a design is to be loaded from.  Raises RequestError, LimitError."""
    from ..audit import read_report
    from ..gate.reading import LIMITS
    from ..operations.reading import ReadResult, read_document

    given = sys.stdin.buffer.read(LIMITS.document_bytes + 1) if name == "-" else Path(name)
    file = "<stdin>" if name == "-" else name
    if (page := _page(given)) is not None:
        return read_report(page, file).result
    document = read_document(given, file)
    return document if isinstance(document, ReadResult) else given


def _page(given: bytes | Path) -> bytes | None:
    """The content of a report that is not JSON: its record is rendered again."""
    from ..audit import form_of

    if isinstance(given, Path):
        try:
            with given.open("rb") as stream:
                head = stream.read(64)
        except OSError:  # the reader says what is wrong with it
            return None
        return _bytes_of(given) if form_of(head) != "json" else None
    return given if form_of(given[:64]) != "json" else None


def _options(arguments: argparse.Namespace) -> Parts:
    from ..report.assembling import options_of

    return options_of({**ReportOptions.of_flags(arguments).model_dump(), "starts": arguments.starts})


def _design(given: bytes | Path) -> Design:
    from tailstack.design import load_design

    return load_design(given, base_directory=Path.cwd() if isinstance(given, bytes) else None)


def _compute(arguments: argparse.Namespace, given: bytes | Path) -> Report:
    """The report of a design, computed here."""
    from ..report.assembling import compute_report

    design, options = _design(given), _options(arguments)
    with Progress("report") as progress:
        return compute_report(design, options, progress=progress.report)


def _draw_up_sheet(arguments: argparse.Namespace, given: Sequence[ReadResult | bytes | Path]) -> Sheet:
    """The sheet for the supplier of one design.  Raises RequestError."""
    from ..report.chapters.supplier import draw_up_sheet

    if len(given) > 1:
        _refuse("too-many", "--supplier is a sheet of one design", "give one design")
    _no_options(arguments, OF_A_DESIGN, "nothing is computed for the supplier", "leave it out")
    return draw_up_sheet(_as_design(given[0], arguments.sources[0]))


def _compare(arguments: argparse.Namespace, given: Sequence[ReadResult | bytes | Path]) -> Comparison:
    """The comparison of two designs, computed here; a result that holds its design stands for that."""
    from ..report.comparing import compute_comparison

    designs = [_as_design(source, name) for source, name in zip(given, arguments.sources, strict=True)]
    options = _options(arguments)
    if arguments.against is not None:
        if len(designs) > 1:
            _refuse("too-many", "--against names a version of one design", "give one design, or leave it out")
        designs.insert(0, _version_of(designs[0], arguments.against, arguments.sources[0]))
        options = replace(options, names=(arguments.against, "now"))
    _no_options(arguments, ("profile",), "two designs are compared without it", "report each by itself")
    with Progress("report") as progress:
        return compute_comparison(designs[0], designs[1], options, progress=progress.report)


def _as_design(given: ReadResult | bytes | Path, file: str) -> Design:
    """A design, or the one that a result holds.  Raises RequestError."""
    from tailstack.design import load_design

    if isinstance(given, bytes | Path):
        return _design(given)
    if given.kind not in ("report", "optimisation"):
        detail = f"a {given.kind} does not hold the design that it is of"
        _refuse("missing-design", detail, "give the design document", file)
    return load_design(given.record.design, allow_files=False)


def _version_of(design: Design, name: str, file: str) -> Design:
    """A version that a design keeps.  Raises RequestError for one that it has not, or that is no design."""
    from tailstack.design import load_design

    review = design.document.review
    version = None if review is None else review.version(name)
    if version is None:
        known = ", ".join(each.name for each in review.versions) if review is not None else ""
        hint = f"it keeps {known}" if known else "it keeps none; to compare two files give both"
        _refuse("unknown-value", f"--against: the design keeps no version {name!r}", hint, file)
    try:
        return load_design(version.text.encode(), base_directory=design.source.directory)
    except (DesignError, LimitError) as error:
        problem = error.problems[0]
        detail = f"version {name!r} is no design: {problem.pointer or 'the text'}: {problem.detail}"
        _refuse("bad-version", detail, problem.hint, file)


def _verify(arguments: argparse.Namespace) -> Answer:
    """Exit code 0 when everything is the same, 1 when something differs, 3 when it could not be compared."""
    from ..audit import Effort, audit, audit_text

    for name in ("summary", "supplier"):
        if getattr(arguments, name):
            _refuse("unused-option", f"--{name}: a report is verified as it is", "leave it out")
    refused = ("format", "output", *(name for name in OF_A_DESIGN if name not in BOUNDS))
    _no_options(arguments, refused, "a report is verified as it is", "leave it out")
    usual = Effort()
    most = Effort(arguments.max_trials or usual.trials, arguments.starts or usual.starts)
    name, *rest = arguments.sources
    if name.lower().endswith(".csv"):
        _refuse("unknown-format", f"{name}: a CSV has no record to verify", "take the HTML, PDF, XLSX or JSON of it")
    if name == "-":
        content, file = sys.stdin.buffer.read(MOST_BYTES + 1), "<stdin>"
    else:
        content, file = _bytes_of(Path(name)), name
    design = _design(sys.stdin.buffer.read() if rest[0] == "-" else Path(rest[0])) if rest else None
    with Progress("verify") as progress:
        audit_result = audit(content, file, design, fast=arguments.fast, most=most, progress=progress.report)
    code = {"verified": PASS, "differs": FAIL, "not verified": NOT_EVALUATED}[audit_result.verdict]
    return Answer(audit_text(audit_result), code)


def _bytes_of(path: Path) -> bytes:
    from tailstack.design.reading import read_bytes

    try:
        return read_bytes(path, MOST_BYTES, str(path))
    except DesignError as error:
        raise RequestError(error.problems) from None


def _no_options(arguments: argparse.Namespace, names: Sequence[str], reason: str, hint: str) -> None:
    given = [f"--{name.replace('_', '-')}" for name in names if getattr(arguments, name) is not None]
    if given:
        _refuse("unused-option", f"{', '.join(given)}: {reason}", hint, arguments.sources[0])


def _refuse(code: str, detail: str, hint: str, file: str | None = None) -> NoReturn:
    raise RequestError(Problem("", code, detail, hint, file))


def _file(name: str | None, forms: Sequence[str] | None) -> Path | None:
    """The file that -o names by its ending; None where it names a directory.  Raises RequestError."""
    path = Path(name or "")
    form = path.suffix[1:].lower()
    if path.is_dir() or not (2 <= len(form) <= 5 and form.isalpha()) or (form not in FORMATS and path.exists()):
        return None
    if form not in FORMATS:
        known = ", ".join(f".{each}" for each in FORMATS)
        hint = f"a file that ends in {known}; for a directory of that name make it first"
        _refuse("unknown-format", f"-o {name}: reports are not written as .{form}", hint)
    if forms and tuple(forms) != (form,):
        detail = f"-o {name} is one file, of {form}; --format asks for {', '.join(forms)}"
        _refuse("format-mismatch", detail, "give a directory with -o, or leave --format out")
    return path
