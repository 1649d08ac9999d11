"""Commands of ``tailstack study``, one a module."""
