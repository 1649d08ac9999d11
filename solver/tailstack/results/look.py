"""How charts look, in reports and in notebooks alike: colours, and matplotlib's settings.

Colours are those of Okabe and Ito (https://jfly.uni-koeln.de/color/), some darkened to be read as text: told apart
by colour-blind readers.
"""

from __future__ import annotations

from typing import Any

FONT = 11
LIMIT_COLOUR, VALUE_COLOUR = "#b3261e", "#0072b2"
INK, MUTED, FAINT, PALE, GRID = "#222222", "#555555", "#8a8a8a", "#efefef", "#e3e3e3"
BLUE, VERMILION, GREEN, PURPLE = "#0072b2", "#d55e00", "#00795a", "#a8477f"
COLOURS = (BLUE, VERMILION, GREEN, PURPLE, "#8a6d00", "#5b9bc8")  # of curves, one after the other
BAR, BAR_PALE = "#5b9bc8", "#c9dceb"

STYLE: dict[Any, Any] = {
    "font.family": ["DejaVu Sans"],  # comes with matplotlib: the heights of lines are its own
    "font.size": FONT,
    "text.color": INK,
    "text.parse_math": False,  # a dollar sign in a name is a dollar sign
    "axes.prop_cycle": f"cycler('color', {list(COLOURS)!r})",
    "axes.edgecolor": FAINT,
    "axes.facecolor": "none",
    "axes.linewidth": 1.0,
    "axes.labelcolor": MUTED,
    "axes.labelsize": FONT,
    "axes.labelpad": 3.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.spines.left": False,
    "axes.axisbelow": True,
    "axes.grid": True,
    "axes.xmargin": 0.0,
    "axes.ymargin": 0.0,
    "grid.color": GRID,
    "grid.linewidth": 0.7,
    "xtick.color": FAINT,
    "xtick.labelcolor": MUTED,
    "xtick.labelsize": FONT,
    "xtick.major.size": 4.0,
    "xtick.major.width": 1.0,
    "ytick.color": FAINT,
    "ytick.labelcolor": MUTED,
    "ytick.labelsize": FONT,
    "ytick.major.size": 0.0,
    "ytick.major.pad": 5.0,
    "lines.linewidth": 1.8,
    "lines.scale_dashes": False,
    "lines.markersize": 5.2,
    "lines.markeredgewidth": 1.5,
    "lines.solid_capstyle": "butt",
    "patch.linewidth": 0.0,
    "legend.frameon": False,
    "legend.fontsize": FONT,
    "legend.borderpad": 0.0,
    "legend.borderaxespad": 0.0,
    "legend.columnspacing": 1.6,
    "legend.handlelength": 2.0,
    "legend.handletextpad": 0.5,
}
