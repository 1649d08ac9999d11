"""The HTTP service: transport around the solver, which does not know of it."""
