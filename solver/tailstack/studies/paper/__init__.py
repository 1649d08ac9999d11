"""The published tables S1 to S4, read and reproduced."""
