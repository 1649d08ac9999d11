"""The design document: reading, checking, compiling to a :class:`tailstack.system.System`, writing."""

from ..extras import load_on_first_use

# Who only looks at a text, or asks for the schema, does not wait for the geometry.
__getattr__, __dir__, __all__ = load_on_first_use(__name__, __file__)
