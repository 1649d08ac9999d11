"""Pictures of a report: SVG as text, the same for the same numbers."""
