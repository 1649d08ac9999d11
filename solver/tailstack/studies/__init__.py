"""Studies: the reach of first order mapped, coupling measured, a bench compared."""
