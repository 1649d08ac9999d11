"""Log lines on stderr, as text for people or as JSON for machines; stdout carries answers only."""

from __future__ import annotations

import json
import logging
import re
import sys
from datetime import datetime, timedelta
from typing import Any, TextIO

# What a log call may carry beside its text, in the order in which a person reads it.
FIELDS = (
    "action", "request", "job", "unit", "worker", "tenant", "kind", "method", "path", "route", "status", "ms", "pid",
    "seconds", "detail",
)  # fmt: skip

EPOCH = datetime(1970, 1, 1)
_PLAIN = re.compile(r"[!#-&(-<>-~]+")  # ASCII, printable, neither space nor quote nor equals sign


def moment(seconds: float) -> str:
    """Epoch seconds as RFC 3339, UTC, to the millisecond: ``2026-01-31T12:00:00.123Z``."""
    return (EPOCH + timedelta(microseconds=round(1e6 * seconds))).isoformat(timespec="milliseconds") + "Z"


def fields_of(record: logging.LogRecord) -> dict[str, Any]:
    """What a log call gave as ``extra={...}``, in a fixed order; names that are not in ``FIELDS`` are left out."""
    values = vars(record)
    return {name: values[name] for name in FIELDS if values.get(name) is not None}


class TextFormatter(logging.Formatter):
    """``2026-01-31T12:00:00.123Z INFO tailstack.service action=answered request=... the message``."""

    def format(self, record: logging.LogRecord) -> str:
        parts = [moment(record.created), record.levelname, record.name]
        parts += [f"{name}={_word(value)}" for name, value in fields_of(record).items()]
        # A request cannot forge a second line
        line = " ".join([*parts, record.getMessage().replace("\r", "\\r").replace("\n", "\\n")])
        return line + ("\n" + self.formatException(record.exc_info) if record.exc_info else "")


class JsonFormatter(logging.Formatter):
    """One JSON object a line: ts, level, logger, message, then the fields; a traceback is one text."""

    def format(self, record: logging.LogRecord) -> str:
        line = {
            "ts": moment(record.created),
            "level": record.levelname.lower(),
            "logger": record.name,
            "message": record.getMessage(),
            **fields_of(record),
        }
        if record.exc_info:
            line["exception"] = self.formatException(record.exc_info)
        return json.dumps(line, ensure_ascii=False, default=str)  # noqa: TID251 - a line of a log, whatever stands in it


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
    # no line has these, and a record would look each of them up
    logging.logThreads = logging.logProcesses = logging.logMultiprocessing = False


def _word(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.1f}"
    text = str(value)
    return text if _PLAIN.fullmatch(text) else repr(text)
