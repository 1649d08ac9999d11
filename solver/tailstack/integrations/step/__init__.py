"""STEP files: their text, their solids, their assembly, and the fiducials in them."""

from .reading import StepBody, StepContact, StepReading, StepSelection, read_step
from .tolerances import StepFace, StepTolerance

__all__ = ["StepBody", "StepContact", "StepFace", "StepReading", "StepSelection", "StepTolerance", "read_step"]
