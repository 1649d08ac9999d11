"""STEP files: their text, their solids, their assembly, and the fiducials in them."""

from .reading import StepBody, StepContact, StepReading, StepSelection, read_step

__all__ = ["StepBody", "StepContact", "StepReading", "StepSelection", "read_step"]
