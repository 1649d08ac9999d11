"""What a design has in common with one read before is not worked out again.

A CAD tool sends one design over and over with a few numbers changed.  Its other sections are recognised by their bytes,
and the record of such a section is then one object for all designs that hold it (:func:`recognised`); what is made of
the record is kept by the record's identity (:func:`kept`), as equality would take 0 for -0 and digits would depend on
who asked first.
"""

from __future__ import annotations

import marshal
from collections.abc import Callable
from functools import lru_cache, wraps
from typing import Any, Concatenate, ParamSpec, TypeVar

from .fields import Record

LONGEST = 16_384  # bytes of a section that is worth remembering
MOST = 128
FEW = 16  # entries of a list that are worth looking up one by one

_Part = TypeVar("_Part")
_Rest = ParamSpec("_Rest")
_Made = TypeVar("_Made")


def recognised(kind: type[Record] | None, data: Any) -> Any:
    """The record of ``data``, one object for all data of the same bytes; ``data`` itself where it is not valid."""
    if kind is None or type(data) is not dict:
        return data
    try:
        content = marshal.dumps(data, 2)  # the last version that writes equal data as equal bytes
        return _record(kind, content) if len(content) <= LONGEST else data
    except ValueError:  # refused by the model, or a Vast: the whole document says where
        return data


@lru_cache(maxsize=MOST)
def _record(kind: type[Record], content: bytes) -> Record:
    return kind.model_validate(marshal.loads(content))


def kept(make: Callable[Concatenate[_Part, _Rest], _Made]) -> Callable[Concatenate[_Part, _Rest], _Made]:
    """``make``, remembering what it made of a record (by identity) and further hashable arguments.

    The record is immutable, and so is what is made of it: it is shared.
    """
    made: dict[tuple[Any, ...], tuple[_Part, _Made]] = {}

    @wraps(make)
    def remembered(part: _Part, /, *rest: _Rest.args, **named: _Rest.kwargs) -> _Made:
        key = (id(part), *rest, *named.values())
        found = made.get(key)
        if found is None:
            if len(made) >= MOST:
                made.clear()
            found = made[key] = (part, make(part, *rest, **named))  # while it is here, its id is nobody else's
        return found[1]

    return remembered
