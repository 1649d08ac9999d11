"""One FreeCAD document and the service: ask when something changed, write down what comes back.

``refresh`` and ``collect`` return at once and are called by the program's own loop: a timer with a screen, a script
without.  Whatever touches the document runs in that loop; the thread only asks the service.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import FreeCAD
import tailstack_document as cad
from tailstack_http import Design, Latest, Refusal, Service, pick_target, weigh_beads


class Session:
    """Scores of one document, the latest first and only."""

    def __init__(self, document: Any) -> None:
        self.document = document
        self.score: dict[str, Any] | None = None
        self.costs: list[tuple[str, float, float]] = []
        self.remark = ""  # why there is no score
        self._request: cad.Request | None = None
        self._latest = Latest(answer)

    def refresh(self, *, again: bool = False) -> None:
        """Ask for the score of the document as it is now, unless just that has been asked (``again``: even then)."""
        try:
            request = cad.read_request(self.document)
        except Refusal as refusal:
            self._request = None
            self._latest.ask(None)  # what is under way has nothing to do with the document any more
            self._stop(refusal)
            return
        if again or request != self._request:
            self._request = request
            self._latest.ask(request)

    def collect(self) -> bool:
        """Write down what has been answered; whether there was anything.  Waits while somebody is editing."""
        if FreeCAD.getActiveTransaction() is not None:
            return False
        answers = [answer for _, answer in self._latest.take() if answer is not None]
        for answer in answers:
            if isinstance(answer, Exception):
                self._stop(answer)
            elif isinstance(answer, list):
                self.costs = answer
                cad.write_costs(self.document, answer)
                if FreeCAD.GuiUp:
                    cad.colour_beads(self.document, answer)
            else:
                self.score, self.remark = answer, ""
                cad.write_score(self.document, answer)
        return bool(answers)

    @property
    def is_busy(self) -> bool:
        """Whether an answer is still to come."""
        return self._latest.is_busy

    def finish(self, seconds: float = 300.0) -> None:
        """Wait for the answer, where there is no loop to return to.  Raises Refusal when it takes longer."""
        until = time.monotonic() + seconds
        while self.is_busy:
            if time.monotonic() > until:
                raise Refusal(f"no answer within {seconds:g} s")
            time.sleep(0.01)
        self.collect()

    def _stop(self, reason: Exception) -> None:
        sentence = self._name_beads(reason) if isinstance(reason, Refusal) else f"{type(reason).__name__}: {reason}"
        if sentence != self.remark:
            FreeCAD.Console.PrintError(f"tailstack: {sentence}\n")
        self.score, self.costs, self.remark = None, [], sentence
        if cad.find_sheet(self.document) is not None:
            cad.write_remark(self.document, sentence)

    def _name_beads(self, refusal: Refusal) -> str:
        """The sentence with labels in place of numbers of beads."""
        sentence = str(refusal)
        for number, (label, _) in reversed(list(enumerate(self._request.beads if self._request else ()))):
            sentence = sentence.replace(f"/design/fiducials/points/{number}", label)
        return sentence


def answer(request: cad.Request | None) -> Iterator[Any]:
    """The score of a request; None after each bead that is weighed, for a look at what is newer; what they all cost."""
    if request is None:
        return
    service = Service(request.address)
    design = request.apply(service.read_design(request.design_name, request.folder))
    score = service.score(design)
    yield score
    costs = []
    for cost in weigh_beads(service, design, pick_target(score)):
        costs.append(cost)
        yield None
    yield costs


def optimise(request: cad.Request) -> dict[str, Any]:
    """The optimiser's record for a request; takes seconds to minutes, so call it in a thread.  Raises Refusal."""
    service = Service(request.address)
    design: Design = request.apply(service.read_design(request.design_name, request.folder))
    return service.optimise(design)
