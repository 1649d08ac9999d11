"""Processes of our own that compute, for the worker and for the API alike: how they are started and what they say."""
