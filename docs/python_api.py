"""The page of the Python interface, made from docstrings: ``python docs/python_api.py`` writes docs/python.md.

Of each public name the page has the signature, the first sentence of the docstring and what is raised; of the records
that are read most also the names of the fields, of what is no record the first clause of what they mean.
The rest is for ``help`` and ``tailstack schema``.  ``--check`` writes nothing and fails when the page differs.
"""

from __future__ import annotations

import ast
import difflib
import inspect
import re
import sys
import textwrap
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import tailstack
import tailstack.design
import tailstack.results
from tailstack import batch, errors, sweeping
from tailstack.integrations import conversion, step
from tailstack.results.record import Result

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "python.md"
WIDTH = 120
REMEDY = "run docs/python_api.py with the environment's Python, look at what changed, and commit it"

HEAD = """\
# Python

<!-- made by docs/python_api.py from the docstrings: change those -->

```python
from tailstack import load_design, score, score_batch, sweep, verify

design = load_design("examples/demo.yaml")
found = score(design)  # a few milliseconds
print(found.targets[0].p95_mm, found.verdict.status)

check = verify(design, trials=200_000, seed=1)  # Monte Carlo on the full chain
print(check.targets[0].p95_interval_mm)

sharper = design.with_value("views.*.fiducial_noise_px", 0.1)  # a new design; the first one stays
print(score(sharper).targets[0].p95_mm)

grid = sweep(design, {"interfaces.connector_flange.tolerances.rx.half_width_deg": [0.05, 0.1, 0.2]})
print(grid.to_frame()[["p95_mm", "verdict"]])  # pandas, where it is installed
grid.plot()  # matplotlib: the extra report

scores = score_batch(design, {"views.*.fiducial_noise_px": [0.1, 0.2, 0.3]})  # a row each; a million takes minutes
print(scores.to_frame()[["p95_mm:tip"]])
```

In a notebook a result as the last line of a cell shows its verdict, the errors at its targets and the budget; `.plot()`
draws it, `.to_frame()` makes a table, `.to_dict()` the same as its JSON.

Lengths are in mm, angles in degrees; only the compiled design (`help(tailstack.system)`) is in rad. Frames are those of
the [conventions](conventions.md). What is refused is an [exception](#exceptions) that says where, what arrived and what
to do.

This page is an index: `help(tailstack.score)` says what every parameter does, `tailstack schema score` what every field
of a record means. Modules below these names are [not stable](stability.md).
"""

DESIGN_NAMES = (
    "Design", "load_design", "check_design", "compile_design", "design_to_data", "design_to_yaml", "design_to_json",
    "revise_design", "Revision", "list_presets", "design_json_schema", "Limits",
)  # fmt: skip
IMPORTED_FROM = "From `tailstack.integrations.conversion` and `tailstack.integrations.step`.\n"
CONVERSION_NAMES = ("convert", "ConvertedFile")
STEP_NAMES = ("read_step",)
READ_MOST = ("Score", "Verification", "Sweep", "TargetScore", "TargetEstimate", "Check")
WITHOUT_FIELDS = ("tailstack.results", "tailstack.design.reading", "tailstack.design.write")
VERBS = ("score", "verify", "optimise", "allocate", "sweep", "score_batch")


def page() -> str:
    """The whole page."""
    parts = [HEAD, "## Designs\n", *(describe(getattr(tailstack.design, name), 3) for name in DESIGN_NAMES)]
    parts += ["## Files of other programs\n", IMPORTED_FROM]
    parts += [describe(getattr(conversion, name), 3) for name in CONVERSION_NAMES]
    parts += [describe(getattr(step, name), 3) for name in STEP_NAMES]
    parts += ["## What is computed\n", *(describe(getattr(tailstack, name), 3) for name in VERBS)]
    parts += [describe(batch.BatchScores, 3), describe(sweeping.read_axes, 3)]
    parts += [describe(tailstack.DesignFunction, 3), "## What every result can do\n", members_of(Result, 3)]
    parts.append("## Records\n")
    parts.append(
        wrapped(
            "Frozen dataclasses; their fields are those of the JSON of `--json` and of the service. Vectors are tuples "
            "`(x, y, z)`, matrices tuples of three rows, intervals `(low, high)`. `tailstack schema score`, "
            "`verification`, `optimisation` and `sweep` have all fields, with types and meanings."
        )
    )
    parts += [describe(kind, 3) for kind in records()]
    parts += ["## Exceptions\n", describe(errors.Problem, 3)]
    parts += [describe(kind, 3) for kind in refusals()]
    return "\n".join(part.rstrip("\n") + "\n" for part in parts if part)


def records() -> list[type]:
    """The records of results, those that are asked for first."""
    kinds = [getattr(tailstack.results, name) for name in tailstack.results.__all__]
    kinds = [kind for kind in kinds if inspect.isclass(kind) and hasattr(kind, "__dataclass_fields__")]
    return sorted(kinds, key=lambda kind: (not issubclass(kind, Result), kind.__module__, line_of(kind)))


def refusals() -> list[type]:
    """The public exceptions, the general one first."""
    kinds = [getattr(tailstack, name) for name in tailstack.__all__ if name.endswith("Error")]
    return sorted([*kinds, sweeping.SweepError], key=lambda kind: (kind is not errors.TailstackError, kind.__name__))


# --- one name -----------------------------------------------------------------------------------------


def describe(thing: Any, level: int) -> str:
    """A function, a class or an exception, from its source."""
    if inspect.isfunction(thing):
        return function(node_of(thing), thing.__name__, level)
    parts = [f"{'#' * level} {thing.__name__}\n", wrapped(first_sentence(doc_of(thing)))]
    if issubclass(thing, errors.TailstackError):
        parts.append(f"`slug`: `{thing.slug}`, exit code {thing.exit_code}.\n")
    rows = list(fields_of(thing))
    if thing.__name__ in READ_MOST:
        parts.append(names(rows))
    elif rows and not thing.__module__.startswith(WITHOUT_FIELDS):
        parts.append(listing(rows))
    methods = members_of(thing, level + 1) if Result not in thing.__mro__ else ""
    return "\n".join(part for part in (*parts, methods) if part)


def function(node: ast.FunctionDef, name: str, level: int) -> str:
    """Its signature, its first sentence and what it raises."""
    words = ast.get_docstring(node) or ""
    raised = re.search(r"\bRaises [A-Z].*?(?=\n\n|\Z)", words, re.DOTALL)
    said = " ".join([first_sentence(words), *([without_brackets(raised[0])] if raised else [])])
    return "\n".join([f"{'#' * level} {name}\n", signature_of(node), wrapped(said)])


def members_of(kind: type, level: int) -> str:
    """The public methods of a class that are written in it, and the properties that have a text."""
    parts, properties = [], list[tuple[str, str, str]]()
    for node in node_of(kind).body:
        if isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
            if any(isinstance(entry, ast.Name) and entry.id == "property" for entry in node.decorator_list):
                words, returns = ast.get_docstring(node) or "", node.returns
                properties += [(node.name, ast.unparse(returns) if returns else "", words)] * bool(words)
            else:
                parts.append(function(node, f"{kind.__name__}.{node.name}", level))
    return "\n".join([*([listing(properties)] if properties else []), *parts])


def fields_of(kind: type) -> Iterator[tuple[str, str, str]]:
    """Name, type and meaning of each field but ``schema``: the text below it, or the comment beside it."""
    node, lines = node_of(kind), source_of(kind)
    for entry, below in pairwise([*node.body, ast.Pass()]):
        if isinstance(entry, ast.AnnAssign) and isinstance(entry.target, ast.Name) and entry.target.id != "schema":
            words = comment_beside(lines, entry)
            if isinstance(below, ast.Expr) and isinstance(below.value, ast.Constant):
                words = str(below.value.value)
            yield entry.target.id, ast.unparse(entry.annotation), words


def comment_beside(lines: list[str], entry: ast.stmt) -> str:
    """The comment at the end of a field's last line."""
    line = lines[(entry.end_lineno or entry.lineno) - 1][entry.end_col_offset or 0 :]
    return line.partition("#")[2].strip()


def line_of(kind: type) -> int:
    return inspect.getsourcelines(kind)[1]


def source_of(thing: Any) -> list[str]:
    return textwrap.dedent(inspect.getsource(thing)).splitlines()


def node_of(thing: Any) -> Any:
    """The definition of a function or class."""
    return ast.parse("\n".join(source_of(thing))).body[0]


def signature_of(node: ast.FunctionDef) -> str:
    """How it is called, without self: of what must be given the type, of the rest the default."""
    arguments = node.args
    if arguments.args and arguments.args[0].arg == "self":
        arguments.args = arguments.args[1:]
    optional = [*arguments.args[len(arguments.args) - len(arguments.defaults) :]]
    optional += [each for each, default in zip(arguments.kwonlyargs, arguments.kw_defaults, strict=True) if default]
    for each in optional:
        each.annotation = None
    returns = f" -> {ast.unparse(node.returns)}" if node.returns else ""
    one = f"{node.name}({ast.unparse(arguments)}){returns}"
    return "```text\n" + textwrap.fill(one, 100, subsequent_indent="    ", break_long_words=False) + "\n```\n"


# --- words --------------------------------------------------------------------------------------------


def doc_of(thing: Any) -> str:
    return ast.get_docstring(node_of(thing)) or ""


def first_sentence(words: str) -> str:
    """The docstring's first sentence, brackets kept."""
    return re.split(r"(?<=[^.]\.)\s+(?=[^a-z])|\n\n", words, maxsplit=1)[0]


def first_clause(words: str) -> str:
    """What a field is, without remarks; what ``None`` and named values mean stays."""
    sentence = first_sentence(" ".join(words.split()))
    head, *rest = sentence.rstrip(".").split("; ")
    return "; ".join([head, *(part for part in rest if re.match(r"null|None|empty|\w+: ", part))])


def without_brackets(words: str) -> str:
    return re.sub(r"\s+\([^()]*\)", "", words)


def wrapped(words: str) -> str:
    """Paragraphs of a docstring as Markdown."""
    paragraphs = [plain(" ".join(part.split())) for part in inspect.cleandoc(words).split("\n\n") if part.strip()]
    lines = [textwrap.fill(part, WIDTH, break_long_words=False, break_on_hyphens=False) for part in paragraphs]
    return "\n\n".join(lines) + "\n" if lines else ""


def plain(words: str) -> str:
    """A docstring's marks as those of Markdown."""
    words = re.sub(r":\w+:`~?([^`]+)`", r"`\1`", words)
    return words.replace("``", "`").replace(".  ", ". ")


def listing(rows: list[tuple[str, str, str]]) -> str:
    """Fields with their types and meanings, one a line or more."""
    lines = [f"- `{name}` `{kind}`: {first_clause(plain(words))}".removesuffix(": ") for name, kind, words in rows]
    return "\n".join(textwrap.fill(line, WIDTH, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False)
                     for line in lines) + "\n"  # fmt: skip


def names(rows: list[tuple[str, str, str]]) -> str:
    """Names of fields, in a row."""
    return wrapped("Fields: " + ", ".join(f"`{name}`" for name, _, _ in rows) + ".")


def main(arguments: list[str]) -> int:
    made = page()
    if arguments == ["--check"]:
        now = PAGE.read_text(encoding="utf-8") if PAGE.exists() else ""
        if now == made:
            return 0
        sys.stderr.writelines(difflib.unified_diff(now.splitlines(True), made.splitlines(True), "page", "sources", n=0))
        sys.stderr.write(f"docs/python.md is not what the docstrings say: {REMEDY}\n")
        return 1
    PAGE.write_text(made, encoding="utf-8")
    return 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
