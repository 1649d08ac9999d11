"""Records as text for a terminal.  Pure functions, at most 100 columns."""
