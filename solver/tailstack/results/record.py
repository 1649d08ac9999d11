"""What every result can do beside holding its fields: be shown in a notebook, be drawn, be taken as data or table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from importlib import import_module
from typing import TYPE_CHECKING, Any

from ..errors import MissingExtraError, Problem
from .outline import Outline, plain

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def data_frame(data: Any, columns: Sequence[str] = (), library: str = "pandas") -> Any:
    """A DataFrame of pandas or polars, of columns by name or of rows.  Raises MissingExtraError where it is missing."""
    try:
        frames = import_module(library)  # no part of any extra: who wants a frame has it
    except ModuleNotFoundError as error:
        detail = f"to_frame() needs the Python package {library}, which is not installed here"
        raise MissingExtraError(Problem("", "missing-extra", detail, f"pip install {library}")) from error
    return frames.DataFrame(data, **({"columns": columns} if columns else {}))


class Published:
    """A record with a schema of its own: ``repr`` says which and of what, for all that it holds is many screens."""

    __slots__ = ()
    schema: str
    """Name and version of this record's schema."""
    provenance: Any
    """Which design, by which version, under which model, and what is not included."""

    def __repr__(self) -> str:
        provenance = getattr(self, "provenance", None)
        name = getattr(provenance, "design_name", None) or getattr(self, "name", None)
        of = "" if name is None else f" of {name!r}"
        return f"<{type(self).__name__}{of}; fields {', '.join(field.name for field in fields(self))}>"  # type: ignore[arg-type]


class Result(Published):
    """An answer of the library: a frozen record that says of itself (``outline``) what people see of it first."""

    __slots__ = ()

    def outline(self) -> Outline:
        """Verdict, tables and chart, from which what follows is made."""
        raise NotImplementedError

    def to_dict(self) -> dict[str, Any]:
        """The record as dictionaries, lists, texts, numbers and None: what its JSON holds, units in every name."""
        record: dict[str, Any] = plain(self)
        return record

    def to_frame(self, table: str | None = None) -> Any:
        """One of the result's tables as a pandas DataFrame, units in the names of its columns.

        table: its name; the first unless said.  Raises ValueError for a name that this result does not have,
        MissingExtraError where pandas is not installed.
        """
        tables = {entry.name: entry for entry in self.outline().frames}
        name = next(iter(tables)) if table is None else table
        if name not in tables:
            raise ValueError(f"{type(self).__name__} has the tables {', '.join(tables)}; got {name!r}")
        return data_frame(list(tables[name].rows), tables[name].columns)

    def plot(self, ax: Axes | None = None) -> Axes:
        """The result's chart; gives back its axes, in which everything can be changed.

        ax: where to draw; without it in a new figure.  Raises MissingExtraError where matplotlib is not installed.
        """
        from . import plot  # late, as below: no command draws or writes HTML of it

        return plot.draw(self.outline().chart, ax)

    def __repr__(self) -> str:
        """What an interpreter shows: what it is of, its verdict in words, and where the rest is."""
        shown = self.outline()
        status = f"{shown.status}: " if shown.status else ""
        tables = ", ".join(frame.name for frame in shown.frames)
        return f"<{type(self).__name__} of {shown.title!r}\n {status}{shown.sentence}\n tables of to_frame(): {tables}>"

    def _repr_html_(self) -> str:
        """What a notebook shows."""
        from .notebook import html_of

        return html_of(self.outline())
