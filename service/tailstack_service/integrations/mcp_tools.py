"""Six operations as tools of an assistant: what each is asked with, and what it answers.  The SDK is in ``mcp``.

A design is sent once, whole or as the name of a file in the folder; every answer tells its SHA-256, by which later
calls name it, with a patch of what differs.  So an assistant need not repeat a document of several thousand words.
"""

from __future__ import annotations

import json
from collections import OrderedDict
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tailstack.design.loading import read_source
from tailstack.errors import LimitError, Problem, TailstackError
from tailstack.extras import name_missing_extra, require_extras
from tailstack.results.json_text import write_json

from ..clock import SYSTEM_CLOCK, Clock
from ..console.files import replace_file
from ..documents import to_json
from ..environment import variable
from ..operations.content import canonical
from ..operations.operation import Call, Operation
from ..operations.patches import NAMED, PATCH
from ..operations.registry import OPERATIONS
from ..operations.rendering import render
from ..operations.request import DesignReferenceUnresolved, Request, limits_of
from ..operations.validation import Validation, validation_text
from ..problems import RefusedAt, RequestError, problem_document
from ..processes.task import RawRequest

if TYPE_CHECKING:
    from ..settings import Settings

# Tool, and the operation behind it
TOOLS = {
    "validate": "validation", "score": "score", "verify": "verification", "optimise": "optimisation", "sweep": "sweep",
    "report": "report",
}  # fmt: skip
SAVED = {"optimise": ("yaml", "json"), "report": ("html", "pdf", "xlsx", "json")}  # endings of what a tool writes
MOST_KEPT = 100  # designs
LONGEST_NAME = 200  # characters, of a file
CANCELLED = "cancelled"
INSTRUCTIONS = """\
tailstack judges the mechanical design of a surgical robot's X-ray reference structure: how far from the target the tool
ends up in the worst 5 % of shots (P95, mm), which tolerance is to blame, and what the cheapest design within the limit
is. Usual order: validate, score, optimise, verify, report. Every refusal names the field (a JSON pointer) and the cure.

Give a design once, as `design` (an object, or its text in YAML or JSON) or as `file`; afterwards name it by the
`design_sha256` of an answer, with `patch` (a JSON merge patch, RFC 7396) for what is changed. Lengths are in mm, angles
in degrees, as the names of the fields say. The whole schema is the resource tailstack://schemas/design. A design:

"""

Progress = Callable[[float, float], None]


@dataclass(frozen=True, slots=True)
class ToolResult:
    """What a tool came to: words for whoever reads, and the record, or the problem document of a refusal."""

    text: str
    content: dict[str, Any]
    refused: bool


@cache
def input_schema(tool: str, with_folder: bool) -> dict[str, Any]:
    """The JSON Schema of a tool's arguments: the options of its operation as published, and which design."""
    operation = OPERATIONS[TOOLS[tool]]
    options = operation.options.model_json_schema()
    properties: dict[str, Any] = {
        "design": {
            "anyOf": [{"type": "object"}, {"type": "string"}],  # clients refuse a list of types, and all tools with it
            "description": "The design document (tailstack/design/1), as an object or as its text in YAML or JSON.",
        },
        NAMED: {
            "type": "string",
            "pattern": "^[0-9a-f]{64}$",
            "description": "Instead of design: the SHA-256 of one that an earlier answer was about.",
        },
        PATCH: {"type": "object", "description": "What is changed in that design first: a JSON merge patch."},
    }
    if with_folder:
        properties["file"] = {"type": "string", "description": "Instead of design: a design in the folder."}
        if tool in SAVED:
            what = "the new design" if tool == "optimise" else "the report"
            endings = ", ".join(f".{ending}" for ending in SAVED[tool])
            properties["save_as"] = {
                "type": "string",
                "description": f"Write {what} into the folder under this name, which ends in {endings}.",
            }
    return {
        "type": "object",
        "additionalProperties": False,
        "properties": {**properties, **options.get("properties", {})},
        "required": options.get("required", []),
        **({"$defs": options["$defs"]} if "$defs" in options else {}),
    }


class Tools:
    """The tools of one session.  ``folder``: the only place that is read and written; None: no files at all."""

    def __init__(self, settings: Settings, folder: Path | None, *, clock: Clock = SYSTEM_CLOCK) -> None:
        self.settings, self.clock = settings, clock
        self.folder = None if folder is None else folder.resolve()
        self._designs: OrderedDict[str, bytes] = OrderedDict()

    def call(
        self, tool: str, arguments: Mapping[str, Any], progress: Progress, stopped: Callable[[], bool] = lambda: False
    ) -> ToolResult:
        """The answer of a tool.  ``progress`` is told how far it is; ``stopped`` says that nobody waits any more."""
        end = self.clock.monotonic() + self.settings.max_job_seconds

        def report(done: float, total: float) -> None:
            if stopped():
                raise LimitError(Problem("", CANCELLED, "the call was cancelled"))
            if self.clock.monotonic() > end:
                hint = f"ask for less, or set {variable('max_job_seconds')}"
                detail = f"a call may take {self.settings.max_job_seconds:g} s"
                raise LimitError(Problem("", "too-long", detail, hint))
            progress(done, total)

        try:
            with name_missing_extra():
                return self._call(tool, dict(arguments), report)
        except TailstackError as error:
            return _refusal(tool, error)

    def _call(self, tool: str, arguments: dict[str, Any], progress: Progress) -> ToolResult:
        operation = OPERATIONS[TOOLS[tool]]
        save_as = arguments.pop("save_as", None) if tool in SAVED and self.folder is not None else None
        target = None if save_as is None else self._place(save_as, "/save_as", SAVED[tool])
        if target is not None and tool == "report" and target.suffix != ".json":
            require_extras("report", *(["pdf"] if target.suffix == ".pdf" else []))
        request = self._read(operation, self._with_design(arguments))
        operation.check(request, self.settings)
        try:
            record = operation.run(Call(request.designs, request.options, None, progress))
        except LimitError:
            raise
        except TailstackError as error:
            raise request.place(error) from None
        for design, data in zip(request.designs, request.data.values(), strict=True):
            self._keep(design.sha256, data)
        body = to_json(record)
        content = json.loads(body)
        if tool == "optimise":
            self._keep(str(content["provenance"]["design_sha256"]), content["design"])
        if target is not None:
            replace_file(target, _make_file(operation, content, body, target.suffix))
        return ToolResult(_words(operation, record, target), content, False)

    # --- which design -----------------------------------------------------------------------------------

    def _with_design(self, arguments: dict[str, Any]) -> dict[str, Any]:
        """The arguments with the design as plain data.  Raises RefusedAt, RequestError."""
        file = arguments.pop("file", None) if self.folder is not None else None
        given: Any = arguments.get("design")
        try:
            if file is not None:
                if "design" in arguments or NAMED in arguments:
                    raise RequestError(Problem("/file", "one-of", f"give one of design, {NAMED} and file"))
                path = self._place(file, "/file", ("yaml", "yml", "json"))
                return {**arguments, "design": read_source(path, limits=limits_of(self.settings)).data}
            if isinstance(given, str):
                source = read_source(given.encode(errors="replace"), limits=limits_of(self.settings))
                return {**arguments, "design": source.data}
        except RequestError:
            raise
        except TailstackError as error:
            raise RefusedAt.place(error, "" if file is not None else "/design") from None
        return arguments

    def _read(self, operation: Operation, arguments: dict[str, Any]) -> Request:
        """The request, checked as the service checks it.  Raises what ``Operation.read`` raises."""
        sent = RawRequest("json", write_json(arguments).encode(errors="surrogatepass"))  # which the reader then refuses
        try:
            return operation.read(sent, self.settings)
        except DesignReferenceUnresolved as unresolved:
            name = unresolved.sha256
        if name not in self._designs:
            detail = f"no design with the SHA-256 {name} was met in this session"
            hint = "give the design whole, in the field design"
            raise RequestError(Problem(f"/{NAMED}", "unknown-design", detail, hint))
        return operation.read(RawRequest("json", sent.body, (), self._designs[name]), self.settings)

    def _keep(self, sha256: str, data: Any) -> None:
        self._designs[sha256] = canonical(data)
        self._designs.move_to_end(sha256)
        while len(self._designs) > MOST_KEPT:
            self._designs.popitem(last=False)

    def _place(self, name: Any, pointer: str, endings: tuple[str, ...]) -> Path:
        """A file in the folder.  Raises RequestError for a name that leads out of it, also through a link."""
        assert self.folder is not None
        readable = isinstance(name, str) and len(name) <= LONGEST_NAME and name.isprintable()
        path = (self.folder / name).resolve() if readable else self.folder
        if not path.is_relative_to(self.folder) or path == self.folder or not path.parent.is_dir():
            detail = f"a file stands in the folder {self.folder}; got {str(name)[:100]!r}"
            raise RequestError(Problem(pointer, "outside-folder", detail, "give a name relative to the folder"))
        if path.suffix.removeprefix(".") not in endings or path.is_dir():
            listed = ", ".join(f".{ending}" for ending in endings)
            raise RequestError(
                Problem(pointer, "unknown-format", f"the name ends in {listed}; got {path.name[:100]!r}")
            )
        return path


def _make_file(operation: Operation, content: dict[str, Any], body: bytes, suffix: str) -> bytes:
    """What is written: the new design of an optimisation, or a document made of a record."""
    if operation.name != "optimisation":
        return render(operation.name, body, suffix.removeprefix("."))
    from tailstack.design.write import data_to_yaml
    from tailstack.design.write import to_json as design_json

    data = content["design"]
    return (data_to_yaml(data) if suffix == ".yaml" else design_json(data)).encode()


def _words(operation: Operation, record: Any, target: Path | None) -> str:
    """The record for whoever reads."""
    if isinstance(record, Validation):
        text = validation_text("the design", record)
    elif (headline := getattr(record, "headline", None)) is not None:
        text = "\n".join([headline.sentence, *headline.matters]) + "\n"
    else:
        text = operation.write(record)
    return text + ("" if target is None else f"written: {target}\n")


def _refusal(tool: str, error: TailstackError) -> ToolResult:
    document = problem_document(error, instance=f"tailstack://tools/{tool}")
    lines = [
        f"{entry.pointer or '(document)'}: {entry.detail}" + (f" — {entry.hint}" if entry.hint else "")
        for entry in document.errors
    ]
    return ToolResult("\n".join([f"{error.title}.", *lines]), json.loads(to_json(document)), True)
