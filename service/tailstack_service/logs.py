"""Log lines on stderr, as text for people or as JSON for machines; stdout carries answers only."""

from __future__ import annotations

import json
import logging
import re
import sys
from typing import Any, TextIO

from .moments import moment

# What a log call may carry beside its text, in the order in which a person reads it.
FIELDS = (
    "action", "request", "job", "unit", "worker", "tenant", "kind", "method", "path", "route", "status", "ms", "pid",
    "seconds", "detail",
)  # fmt: skip

_PLAIN = re.compile(r"[!#-&(-<>-~]+")  # ASCII, printable, neither space nor quote nor equals sign


def fields_of(record: logging.LogRecord) -> dict[str, Any]:
    """What was said with ``extra={...}``, in a fixed order; unknown names are not told."""
    told = vars(record)
    return {name: told[name] for name in FIELDS if told.get(name) is not None}


class TextFormatter(logging.Formatter):
    """``2026-01-31T12:00:00.123Z INFO tailstack.service action=answered request=... the message``."""

    def format(self, record: logging.LogRecord) -> str:
        parts = [moment(record.created), record.levelname, record.name]
        parts += [f"{name}={_word(value)}" for name, value in fields_of(record).items()]
        message = _one_line(record.getMessage())
        line = " ".join([*parts, message] if message else parts)
        return line + ("\n" + self.formatException(record.exc_info) if record.exc_info else "")


class JsonFormatter(logging.Formatter):
    """One JSON object a line: ts, level, logger, message, then the fields; a traceback is one text."""

    def format(self, record: logging.LogRecord) -> str:
        told: dict[str, Any] = {"ts": moment(record.created), "level": record.levelname.lower(), "logger": record.name}
        message = record.getMessage()
        told |= {"message": message} if message else {}
        told |= fields_of(record)
        if record.exc_info:
            told["exception"] = self.formatException(record.exc_info)
        return json.dumps(told, ensure_ascii=False, default=str)  # noqa: TID251 - a line of a log, whatever stands in it


def log_to_stderr(form: str = "text", level: int = logging.INFO, stream: TextIO | None = None) -> None:
    """Send the lines of this package, and warnings of the libraries it stands on, to stderr.

    form: "text" or "json" (setting ``log_format``).
    """
    handler = logging.StreamHandler(sys.stderr if stream is None else stream)
    handler.setFormatter(JsonFormatter() if form == "json" else TextFormatter())
    for name in ("tailstack", "uvicorn", "sqlalchemy", "alembic", "distributed"):
        logger = logging.getLogger(name)
        logger.handlers, logger.propagate = [handler], False
        logger.setLevel(level if name == "tailstack" else logging.WARNING)
    # no line tells these, and a record would look each of them up
    logging.logThreads = logging.logProcesses = logging.logMultiprocessing = False
    logging._srcfile = None  # documented: no record looks for the line that wrote it


def _word(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.1f}"
    text = str(value)
    return text if _PLAIN.fullmatch(text) else repr(text)


def _one_line(text: str) -> str:
    """A request cannot forge a second line."""
    return text.replace("\r", "\\r").replace("\n", "\\n")
