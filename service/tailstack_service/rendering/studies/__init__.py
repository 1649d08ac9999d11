"""Studies as text and as figures."""
