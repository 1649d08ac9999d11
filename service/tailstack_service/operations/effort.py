"""How long a computation will take: reading from the bytes that came, the rest from what was read.

Nothing that a caller writes makes it shorter: a body is as long as it is, and sizes are those of the designs as they
were read, by the process that read them.  The figures were measured on one core of a virtual machine (AMD EPYC,
AVX-512).  They need not be right, only tell what takes milliseconds from what takes seconds.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from tailstack.design import Design

    from ..processes.task import RawRequest

LONG = 60.0  # seconds, of what nobody can say before it is done
# s for reading and checking a byte.  Honest JSON takes 0.3e-6, YAML 1.2e-6; what is wrong everywhere, ten times that
BYTE_SECONDS = {"json": 0.5e-6, "yaml": 1.5e-6, "text/csv": 5e-6, "text/plain": 5e-6, "application/x-ndjson": 5e-6}
TEXT_BYTE_SECONDS = 5e-6  # of JSON that holds documents as texts, which are read as YAML


class Size(NamedTuple):
    """What a design holds."""

    fiducials: int
    views: int
    targets: int  # with regions expanded
    judged: int = 0  # targets of all requirements together: of each the losses of fiducials are looked for; 0: of none
    missed: int = 0  # fiducials that are missed with a probability: the law of every loss of them is put together, too

    def losses(self, among: int) -> int:
        """Ways to lose none, one or two of so many of the fiducials, as far as they are looked at."""
        from tailstack.losses import PAIRS_UP_TO

        return 1 + among + (among * (among - 1) // 2 if self.fiducials <= PAIRS_UP_TO else 0)


def reading_seconds(sent: RawRequest) -> float:
    """For reading and checking what was sent.  Of what is packed nobody knows before it is unpacked."""
    rate = BYTE_SECONDS.get(sent.form)
    return LONG if rate is None else rate * len(sent.body)


def text_reading_seconds(sent: RawRequest) -> float:
    """The same for bodies that hold documents as texts."""
    return max(reading_seconds(sent), TEXT_BYTE_SECONDS * len(sent.body))


def size_of(design: Design) -> Size:
    """What a design holds."""
    from tailstack.design.compile import loss_probabilities
    from tailstack.design.consistency import expand_target

    document = design.document
    samples = {target.name: len(expand_target(target)) for target in document.targets}
    targets = sum(samples.values())
    judged = sum(
        targets if item.targets == "all" else sum(samples.get(name, 1) for name in item.targets)
        for item in document.requirements
    )
    count = len(design.fiducials.labels)
    missed = sum(map(bool, loss_probabilities(document.fiducials, count)))
    return Size(count, len(document.views), targets, judged or targets, missed)


GAIN_SECONDS = 1e-7  # of one fiducial in one view, with one loss, at one target
LAW_SECONDS = 7e-4  # of one exact law with a loss
MISSED_SECONDS = 4e-3  # of one loss at one target: its own validity, and its law in the mixtures of both errors
ASKED = 3  # such laws for each requirement and target, until the worst loss is known: one to ten


def score_seconds(sizes: Iterable[Size], *, second_order: bool = False, losses: bool = True) -> float:
    """Of one core, for scores of designs of these sizes."""
    seconds = 0.0
    for size in sizes:
        fiducials, views, targets, judged, missed = size
        seconds += 0.004 + 0.0005 * fiducials + 0.0035 * targets * (1 + fiducials * views / 200)
        if losses and judged:
            seconds += GAIN_SECONDS * targets * size.losses(fiducials) * views * fiducials
            seconds += LAW_SECONDS * judged * ASKED
        if missed:
            seconds += MISSED_SECONDS * targets * size.losses(missed)
        if second_order:
            seconds += 2e-5 * (targets * fiducials * views) ** 2
    return seconds
