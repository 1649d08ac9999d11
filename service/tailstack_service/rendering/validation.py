"""A checked design in a few lines."""

from __future__ import annotations

from ..documents import Validation
from .tables import visible, wrapped


def validation_text(file: str, validation: Validation) -> str:
    """``file: valid`` and what the design holds."""
    counts = (
        f"{validation.fiducials} fiducials; views {_listed(validation.views)}; targets {_listed(validation.targets)}; "
        f"requirements {_listed(validation.requirements)}"
    )
    lines = [wrapped(f"{file}: valid, {visible(validation.name)}"), wrapped(counts, first="  ", indent="  ")]
    lines += [wrapped(f.message, first=f"  {f.severity}: ", indent="    ") for f in validation.findings]
    lines += [
        wrapped(f"view {view.view}: outside the image: {', '.join(view.outside)}", first="  warning: ", indent="    ")
        for view in validation.visibility
        if view.outside
    ]
    lines += [wrapped(note, first="  note: ", indent="    ") for note in validation.notes]
    return "\n".join(lines) + "\n"


def _listed(names: tuple[str, ...]) -> str:
    shown = ", ".join(visible(name) for name in names[:6])
    return (shown + (f" and {len(names) - 6} more" if len(names) > 6 else "")) or "none"
