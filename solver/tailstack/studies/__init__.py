"""Studies: the published tables reproduced, the reach of first order mapped, coupling measured, a bench compared."""
