"""Fixtures that several files use."""

from __future__ import annotations

from postgres import database_url, postgres_server, postgres_url

__all__ = ["database_url", "postgres_server", "postgres_url"]
