"""What a person meets: the command line and the HTTP service over the solver in :mod:`tailstack`."""
