"""One HTML file: everything inside, nothing asked of any network, the record itself at its end.

One script may run in it, the viewer of the layout, named by its hash in the page's content security policy.
"""

from __future__ import annotations

import hashlib
import re
from base64 import b64encode
from collections.abc import Iterable
from functools import cache
from importlib.resources import files

from jinja2 import Environment, PackageLoader, StrictUndefined

from tailstack import __version__
from tailstack.results.tables import Cell, Column, On, write_cell

from ..rendering.document import Block, Document, Figure

LONGEST_WORD = 16  # letters, which the columns of names make room for


def html_report(document: Document, record: bytes | None) -> str:
    """The report as HTML.  ``record``: the result's JSON, which is kept in the file; None leaves it out (print)."""
    document = document.of(On.PAGE)
    blocks = [*document.figures, *(block for section in document.sections for block in section.blocks)]
    turned = any(isinstance(block, Figure) and block.scene for block in blocks)
    template = _environment().get_template("report.html")
    page = template.render(
        document=document,
        record=None if record is None else _inert(record),
        generator=", ".join([f"tailstack {__version__}", *_libraries(blocks)]),
        policy="" if record is None else content_policy(),
        style=_style() if record is not None else _source("report.css"),
        script=_source("viewer.js") if turned else "",
    )
    return f"{page}\n"


def _libraries(blocks: Iterable[Block]) -> list[str]:
    """What drew charts, with its version: another version may draw the same chart in other bytes."""
    svg = "".join(block.svg for block in blocks if isinstance(block, Figure))
    return [f"charts by {name}" for name in sorted(set(re.findall(r'data-drawn-by="([^"]*)"', svg)))]


def content_policy(*, served: bool = False) -> str:
    """The content security policy of every report: nothing is fetched, only its own style and viewer count.

    ``served``: with what only a response header can say; the page then has an origin of its own and may do nothing
    but run the viewer.
    """
    allowed = (
        "default-src 'none'", f"script-src {_hash_source(_source('viewer.js'))}", f"style-src {_hash_source(_style())}",
        "img-src data:", "base-uri 'none'", "form-action 'none'",
    )  # fmt: skip
    return "; ".join([*allowed, *(("frame-ancestors 'none'", "sandbox allow-scripts") if served else ())])


@cache
def _source(name: str) -> str:
    return (files(__package__) / "templates" / name).read_text(encoding="utf-8").strip()


def _style() -> str:
    """Of a screen; on paper every rule would be tried on every element of a page, so that has the first alone."""
    return "\n".join(_source(name) for name in ("report.css", "screen.css", "viewer.css"))


@cache
def _hash_source(content: str) -> str:
    return f"'sha256-{b64encode(hashlib.sha256(content.encode()).digest()).decode()}'"


@cache
def _environment() -> Environment:
    made = Environment(
        loader=PackageLoader("tailstack_service.report", "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    made.filters["shown"] = shown
    made.filters["on_page"] = lambda table: table.on(On.PAGE)
    # Whether a name has a word, ended by a blank or an underscore, that has to be broken within
    made.tests["long"] = lambda name: max(map(len, name.replace("_", " ").split()), default=0) > LONGEST_WORD
    made.filters["kind"] = lambda block: type(block).__name__
    return made


def shown(cell: Cell, column: Column) -> str:
    """A cell as text, with a minus and a dash as print has them."""
    if cell is None:
        return "–"
    text = write_cell(cell, column)
    return text.replace("-", "−") if column.numeric and not isinstance(cell, str) else text


def _inert(record: bytes) -> str:
    """JSON that cannot end the element it stands in, nor begin another."""
    return record.decode().replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e")
