"""What the library answers with: frozen records of plain Python numbers, units in every name.

The command line prints them, the service serialises them as they stand, and their JSON Schemas are
published.  Names in them are a contract: scripts read them.
"""

from ..extras import load_on_first_use

# Who validates a design does not wait for the records of the optimiser.
__getattr__, __dir__, __all__ = load_on_first_use(__name__, __file__)
