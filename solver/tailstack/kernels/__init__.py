"""Compiled functions: what compiles them and keeps their machine code, for which processor, and from which sources."""
