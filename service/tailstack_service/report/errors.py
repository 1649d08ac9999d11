"""What keeps a report from being written."""

from __future__ import annotations

from tailstack.errors import TailstackError


class PdfUnavailable(TailstackError):
    """The libraries that write PDF are not installed here."""

    slug = "pdf-unavailable"
    title = "PDF cannot be written here"
    exit_code = 3
