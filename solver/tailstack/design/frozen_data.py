"""Plain data that does not change: the document behind a design, whose hash would otherwise speak of another one."""

from __future__ import annotations

from typing import Any, NoReturn

from pydantic import BaseModel


def _refuse(self: Any, *_: Any, **__: Any) -> NoReturn:
    raise TypeError("a design does not change: design.with_value(path, value) is one with another value at a place")


class FrozenMapping(dict[str, Any]):
    """A mapping that reads like a dict; a deep copy is an ordinary dict."""

    __slots__ = ()
    __setitem__ = __delitem__ = __ior__ = clear = pop = popitem = setdefault = update = _refuse

    def __deepcopy__(self, memo: Any) -> Any:
        return thaw(self)

    def __reduce__(self) -> Any:
        return FrozenMapping, (dict(self),)


class FrozenList(list[Any]):
    """A list that reads like one; a deep copy is an ordinary list."""

    __slots__ = ()
    __setitem__ = __delitem__ = __iadd__ = __imul__ = _refuse
    append = clear = extend = insert = pop = remove = reverse = sort = _refuse

    def __deepcopy__(self, memo: Any) -> Any:
        return thaw(self)

    def __reduce__(self) -> Any:
        return FrozenList, (list(self),)


def freeze(data: Any) -> Any:
    """Plain data that cannot be changed, what is frozen already as it is."""
    kind = type(data)
    if kind is dict:
        return FrozenMapping({key: freeze(value) for key, value in data.items()})
    return FrozenList(map(freeze, data)) if kind is list else data


def freeze_lists(record: Any) -> None:
    """Make the lists of a record of pydantic, and of the records in it, such as cannot be changed."""
    fields = record.__dict__
    for name, value in fields.items():
        if type(value) is list:
            fields[name] = FrozenList(value)
        for each in value if isinstance(value, list) else (value,):
            if isinstance(each, BaseModel):
                freeze_lists(each)


def thaw(data: Any) -> Any:
    """A copy of plain data that can be changed."""
    if isinstance(data, dict):
        return {key: thaw(value) for key, value in data.items()}
    return [thaw(value) for value in data] if isinstance(data, list) else data
