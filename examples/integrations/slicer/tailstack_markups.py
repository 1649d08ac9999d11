"""A point list of 3D Slicer as the beads of a design: nothing here imports Slicer, a node is handed in.

Slicer's scene is RAS, in mm; a design is LPS, the frame of DICOM: x and y change sign. Positions are those in the
node's own coordinates, which are also what a saved .mrk.json holds: a transform above the node moves the structure in
the scene and not in the connector's frame.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from tailstack_http import Design, Latest, Refusal, Service, pick_target, weigh_beads, with_beads

DEFINED = 2  # vtkMRMLMarkupsNode.PositionDefined; 0: not yet placed, 1: a preview under the mouse, 3: missing


Bead = tuple[str, tuple[float, float, float]]  # label, and position in LPS, mm
Question = tuple[str, str, list[Bead]]  # address of the service, design, beads


def read_beads(node: Any) -> list[Bead]:
    """Labels, and positions in LPS, mm, of the points that are placed.  Raises Refusal."""
    beads = []
    for number in range(node.GetNumberOfControlPoints()):
        if node.GetNthControlPointPositionStatus(number) != DEFINED:
            continue
        right, anterior, superior = node.GetNthControlPointPosition(number)
        label = node.GetNthControlPointLabel(number) or f"F{number + 1}"
        beads.append((label, (-right + 0.0, -anterior + 0.0, superior)))  # adding 0.0 turns -0.0 into 0.0
    labels = [label for label, _ in beads]
    twice = sorted({label for label in labels if labels.count(label) > 1})
    if twice:
        raise Refusal(f"several points are called {', '.join(twice)}: a bead needs a name of its own")
    return beads


def describe_score(score: dict[str, Any]) -> str:
    """P95 against its limit, and what contributes most."""
    target = pick_target(score)
    limit = f", limit {target['limit_mm']:g} mm" if target.get("limit_mm") else ""
    verdict = f": {score['verdict']['status']}" if score.get("verdict") else ""
    first = max(target["contributors"], key=lambda entry: entry["variance_share"] or 0.0)
    share = f"{100 * first['variance_share']:.0f} % from {first['label']}"
    return f"P95 at {target['name']} {target['p95_mm']:.3f} mm{limit}{verdict}; {share}"


def describe_costs(costs: list[tuple[str, float, float]]) -> str:
    """The bead that is missed most, and the one whose place matters most."""
    losing, moving = max(costs, key=lambda cost: cost[1]), max(costs, key=lambda cost: cost[2])
    without = f"P95 {losing[1]:.3f} mm" if math.isfinite(losing[1]) else "nothing can be said"
    return f"Worst to lose: {losing[0]} ({without} without it). Worst to move: {moving[0]} ({moving[2]:.4f} mm per mm)"


def answer(question: Question | None) -> Iterator[str]:
    """A line about the score, and later one about the beads; empty in between."""
    if question is None:
        return
    address, design_name, beads = question
    service = Service(address)
    design: Design = with_beads(service.read_design(design_name), beads)
    score = service.score(design)
    yield describe_score(score)
    costs = []
    for cost in weigh_beads(service, design, pick_target(score)):
        costs.append(cost)
        yield ""
    yield describe_costs(costs)


class Follower:
    """Scores of one point list, the latest only; ``refresh`` and ``collect`` return at once."""

    def __init__(self) -> None:
        self.address = ""
        self.design_name = "example:first_carrier"
        self.lines: list[str] = []  # what there is to show
        self._latest = Latest(answer)

    def refresh(self, node: Any) -> None:
        """Ask for the score of a point list as it is now."""
        try:
            beads = read_beads(node)
        except Refusal as refusal:
            self._latest.ask(None)  # gives up what is under way
            self.lines = [str(refusal)]
            return
        self._latest.ask((self.address, self.design_name, beads))

    def collect(self) -> bool:
        """Take what has been answered; whether the lines changed."""
        before = list(self.lines)
        for _, said in self._latest.take():
            if isinstance(said, Exception):
                self.lines = [str(said)]
            elif said:
                self.lines = [said] if said.startswith("P95") else [*self.lines[:1], said]
        return self.lines != before

    @property
    def is_busy(self) -> bool:
        """Whether an answer is still to come."""
        return self._latest.is_busy
