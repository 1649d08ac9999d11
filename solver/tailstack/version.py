"""The version of solver and service, which are one distribution."""

__version__ = "0.1.0"
