"""A million designs: one design scored again and again with numbers of a table in it.  Row by row what ``score`` says.

What the columns of the table touch decides how a row is computed, and the answer says which way it was:

- *compiled*: numbers of the compiled design: positions of fiducials and targets, half-widths, image noise, pivots and
  biases, whatever the laws.  What the mounts do is worked out for a block of rows at once, by the functions that
  ``score`` calls for one; gains, law, quantile and mean are its kernels, called from one compiled loop over rows.
- *in full*: everything else goes by its own document through ``load_design`` and ``score``.

Three things are asked for row by row in Python, beside the compiled numbers of the row: a verdict, which takes how far
first order can be trusted; a requirement on each installed unit, which takes a sample of units; and the worst vertex of
bounded components.  They count as in full.  So does a row whose law is too sharp for a lattice, and one that is not
plainly sound (a fiducial near the edge of an image, a layout near a degenerate one, a number out of its range), which
goes by its document: so every refusal is the one of ``score``.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cache
from itertools import chain
from math import hypot, nan, radians
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .contributors import error_law
from .design import Design, compile_design, design_to_data, load_design
from .design.bead_noise import BeadNoise
from .design.document import Interface
from .design.frames import find_detector
from .design.numbers import read_numbers
from .design.pointers import Place, locate_numbers, pointer_of, set_numbers, value_at
from .errors import Problem, TailstackError, describe_refusal, escape
from .fields import Coordinate, Degrees, HalfWidth, HalfWidthDegrees, Pixels, domain_of
from .geometry.arrays import Array, frozen
from .kernels.process import usable_cores
from .laws import BOUNDED, KIND
from .measures import MEASURE
from .propagation.linear import (
    LinearModel,
    chain_of,
    geometry_at,
    imaging_of,
    linearise_all,
    models_of,
    mounts_of,
    pass_mounts,
    shift_together,
)
from .propagation.validity_bounds import ValidityBounds
from .results import Check
from .results.record import data_frame
from .results.verdicts import P95
from .rows import Asked, CompiledRows, score_rows
from .scoring import ErrorScore, check_requirement, score, tightest_limit, trust_of
from .sweeping import SweepError
from .system import (
    MOUNTED_AT,
    TORSOR_COMPONENTS,
    DirectEffect,
    Law,
    Sources,
    System,
    Weighing,
    put_mounts,
    std_per_half_width,
)
from .tail.declared import accuracy_for
from .verdict import conclude

BLOCK = 1024  # rows that are computed in one go
OF_TARGETS = ("p95_mm", "mean_norm_mm", "bias_norm_mm", "localisation_p95_mm")
OF_REQUIREMENTS = ("value",)  # the statistic that a requirement limits, at each of its targets
OF_DESIGNS = ("within_limits", "verdict")
COLUMNS = (*OF_TARGETS, *OF_REQUIREMENTS, *OF_DESIGNS)
DEFAULT_COLUMNS = ("p95_mm", "mean_norm_mm", "bias_norm_mm", "within_limits")
_ASK = {"value", "within_limits", "verdict"}  # for the requirements
REASON = "reason"  # name of the column that says why a row was not evaluated
NO_REQUIREMENT = "no requirement"
WITHIN, OPEN = {True: "yes", False: "no"}, "open"

WAYS = COMPILED, IN_FULL = ("compiled", "in full")
QUANTILES = {"p95_mm": "tcp", "mean_norm_mm": "tcp", "localisation_p95_mm": "localisation"}  # of which error
# Where gains are taken, and where the effects hang that move all images of a view together
LAYOUT = frozenset({"fiducials", "targets", *(f"{name}.{what}" for name in MOUNTED_AT for what in ("pivot", "bias"))})

Numbers = Mapping[str, Array]  # of the compiled design, by field; with a first dimension of rows where a table has them
Progress = Callable[[int, int], None]


@dataclass(frozen=True, slots=True)
class Slot:
    """Where a number of the document stands among the numbers of the compiled design."""

    field: str  # of ``base_numbers``
    index: tuple[Any, ...]
    factor: float  # native units in one of the document's
    low: float  # what the document accepts
    high: float

    @classmethod
    def of(cls, kind: Any, field: str, *index: Any, turns: bool = False) -> Slot:
        """kind: the type of the document's field, which has its bounds; turns: in degrees."""
        return cls(field, index, radians(1.0) if turns else 1.0, *domain_of(kind))


@dataclass(frozen=True, slots=True, eq=False)
class BatchScores:
    """Scores of many designs as columns: row k of each is the design with row k of the table."""

    columns: Mapping[str, Array]
    """(n,) each, by name (``p95_mm:TARGET``): numbers, NaN where a row was not evaluated; texts in verdict (pass, fail,
    inconclusive, no requirement) and within_limits (yes, no, open), empty where it was not."""
    reasons: tuple[str, ...]
    """(n,) why a row was not evaluated; empty: it was."""
    ways: Mapping[str, int]
    """How many rows were computed compiled and in full."""
    why: str
    """All that keeps rows from the fastest way, with ``; `` between; empty: nothing does."""

    index: Any = None
    """Row labels of the pandas table that was scored; None: it had none."""
    library: str = "pandas"
    """pandas or polars: of which ``to_frame`` makes a DataFrame; polars where the table was one of its own."""

    def to_frame(self) -> Any:
        """The columns and the reasons as a DataFrame whose rows are labelled, or ordered, as those of the table.

        Raises MissingExtraError where the library is not installed.
        """
        frame = data_frame({**self.columns, REASON: self.reasons}, library=self.library)
        return frame if self.index is None else frame.set_index(self.index)


def score_batch(
    design: Design,
    table: Mapping[str, Sequence[float] | Array],
    *,
    columns: Sequence[str] = DEFAULT_COLUMNS,
    threads: int | None = None,
    progress: Progress | None = None,
) -> BatchScores:
    """Score a design once for each row of a table, with the row's numbers in it.

    table: (n,) numbers by path, ``{"views.*.fiducial_noise_px": [...]}`` or a JSON pointer, in the unit of the field;
    a DataFrame of pandas or polars will do.  columns: p95_mm, mean_norm_mm, bias_norm_mm and localisation_p95_mm of
    each target; value, the statistic that each requirement limits; within_limits, whether all of these are (open: that
    is not known); verdict, which also takes how far first order can be trusted, and costs some hundred times as much.
    threads: the answer does not depend on them.  ``progress(done, total)`` after each block.

    Each number equals that of ``score`` to 1e-9.  A row that cannot be scored keeps its place, with the reason.  Raises
    SweepError for a path that leads to no number, columns of unequal length and values that are no numbers or missing,
    and what compiling the design raises.
    """
    given = _read_table(table)
    index = _index_of(table, given)
    batch = Batch(design, tuple(given), columns)
    values = [read_numbers(column, f"/table/{escape(name)}", SweepError) for name, column in given.items()]
    if len({len(each) for each in values}) != 1:
        raise SweepError(Problem("/table", "ragged", "the columns of a table are lists of one and the same length"))
    rows = np.column_stack(values)
    blocks = [rows[start : start + BLOCK] for start in range(0, len(rows), BLOCK)]
    results = []
    for block in batch.score_blocks(blocks, threads):
        results.append(block)
        if progress is not None:
            progress(min(len(results) * BLOCK, len(rows)), len(rows))
    return BatchScores(
        {
            name: np.concatenate([block.columns[k] for block in results]) if results else np.zeros(0)
            for k, name in enumerate(batch.names)
        },
        tuple(chain.from_iterable(block.reasons for block in results)),
        {way: sum(block.ways[way] for block in results) for way in WAYS},
        batch.why,
        index,
        "polars" if type(table).__module__.partition(".")[0] == "polars" else "pandas",
    )


def _read_table(table: Any) -> dict[str, Any]:
    """Columns by name, of a mapping or of a frame of pandas, polars or Arrow.  Raises SweepError."""
    names = next((getattr(table, each) for each in ("column_names", "columns") if hasattr(table, each)), None)
    if names is None and not isinstance(table, Mapping):
        detail = f"a table is a mapping of columns by path, or a DataFrame; got a {type(table).__name__}"
        raise SweepError(Problem("/table", "wrong-type", detail, 'for example {"views.*.fiducial_noise_px": [...]}'))
    given = {str(name): table[name] for name in (table if names is None else names)}
    if len(given) < len(table if names is None else names):
        raise SweepError(Problem("/table", "given-twice", "two columns have the same name", "leave one of them out"))
    return given


def _index_of(table: Any, given: Mapping[str, Any]) -> Any:
    """The row labels of a pandas DataFrame, or those that all its columns have in common; None: there are none.

    Raises SweepError for columns whose labels differ: which of them belong together is not known.
    """
    labels = [each.index for each in (table, *given.values()) if hasattr(each, "index") and hasattr(each, "loc")]
    if any(not each.equals(labels[0]) for each in labels):
        hint = "join the columns into one DataFrame first"
        raise SweepError(Problem("/table", "ragged", "the columns of the table have different row labels", hint))
    return labels[0] if labels else None


@dataclass(frozen=True, slots=True, eq=False)
class BatchBlock:
    """What some rows came to."""

    columns: list[Array]  # (n,) each, in the order of the names of the batch
    reasons: list[str]  # of each row; empty: it was evaluated
    ways: dict[str, int]


class Batch:
    """A design that is compiled once, and the numbers of it that every row of a table says anew.

    Raises SweepError that points at ``/table`` or ``/columns``, and what compiling the design as it stands raises.
    """

    def __init__(self, design: Design, paths: Sequence[str], columns: Sequence[str] = DEFAULT_COLUMNS) -> None:
        if design.document.fiducials.file is not None:  # its points get places of their own
            design = load_design(design_to_data(design))
        self.design = design
        self.columns = _check_columns(columns)
        self.pointers = tuple(pointer_of(design.source.data, path) for path in paths)
        self._places = _find_places(design, self.pointers)
        self.system = compile_design(design)
        self.required = [(item, name) for item in self.system.requirements for name in item.targets]
        self.names = tuple(self._name_columns())
        self.slots: list[tuple[int, Slot]] = []  # with the column of the table
        self._loop: _RowLoop | None = None
        self.way, self.why = self._choose_way()

    @property
    def on_lattice(self) -> bool:
        """Whether rows are compiled, and their laws not all normal."""
        return self._loop is not None and bool((self._loop.kinds >= 0).any())

    @property
    def moves_together(self) -> bool:
        """Whether rows are compiled, and what moves all images of a view together differs between them."""
        return self._loop is not None and self._loop.together is None

    def score_blocks(self, blocks: Iterable[Array], threads: int | None = None) -> Iterator[BatchBlock]:
        """What blocks of rows (n, k) come to, in their order; a few are under way at a time."""
        count = usable_cores() if threads is None else threads
        if self._loop is None or count < 2:  # Python runs in one thread at a time
            yield from map(self.score_rows, blocks)
            return
        with ThreadPoolExecutor(count) as pool:
            under_way: deque[Future[BatchBlock]] = deque()
            for block in blocks:
                under_way.append(pool.submit(self.score_rows, block))
                if len(under_way) > count:
                    yield under_way.popleft().result()
            for future in under_way:
                yield future.result()

    def score_rows(self, values: Array) -> BatchBlock:
        """Rows (n, k): a number for each pointer, in the unit of its field."""
        count = len(values)
        columns = [np.full(count, "", object) if name in OF_DESIGNS else np.full(count, nan) for name in self.names]
        ways, reasons = dict.fromkeys(WAYS, 0), [""] * count
        sound = np.asarray(np.isfinite(values).all(axis=1))
        for column, slot in self.slots:
            sound &= (values[:, column] >= slot.low) & (values[:, column] <= slot.high)
        numbers = self._numbers_of(np.where(sound[:, None], values, self._stated)) if self._placed else {}
        done = np.zeros(count, dtype=np.bool_) if self._loop is None else self._loop.fill(numbers, sound, columns)
        ways[COMPILED], ways[IN_FULL] = int(done.sum()), int((~done).sum())
        for row in np.flatnonzero(~done).tolist():
            outcome: list[Any] | str | None = None
            if sound[row] and self._placed:
                outcome = self._score_numbers({field: array[row] for field, array in numbers.items()})
            if outcome is None:
                outcome = self._score_in_full(values[row])
            if isinstance(outcome, str):
                reasons[row] = outcome
                outcome = ["" if name in OF_DESIGNS else nan for name in self.names]
            for array, value in zip(columns, outcome, strict=True):
                array[row] = value
        return BatchBlock(columns, reasons, ways)

    # --- what is asked for ------------------------------------------------------------------------

    def _name_columns(self) -> Iterator[str]:
        for column in self.columns:
            if column in OF_TARGETS:
                yield from (f"{column}:{target.name}" for target in self.system.targets)
            elif column in OF_REQUIREMENTS:
                yield from (f"{column}:{item.name}:{name}" for item, name in self.required)
            else:
                yield column

    def _choose_way(self) -> tuple[str, str]:
        """The fastest way that pointers, laws and columns leave, and all that keeps rows from the first one, each as
        much as a person can take away by itself."""
        system, reasons = self.system, []
        for column, places in enumerate(self._places):
            slots = [find_slot(self.design, system, place) for place in places]
            self.slots += [(column, slot) for slot in slots if slot is not None]
            if None in slots:
                reasons.append(f"{self.pointers[column]} is more than a number of the compiled design")
        judged, ended = ((), ()) if _ASK.isdisjoint(self.columns) else (system.requirements, system.targets)
        measures = [MEASURE[item.error] for item in judged]
        slower = (
            (system.loss_probability, "fiducials that are missed make a law for each pattern of them, row by row"),
            (not all(item.is_quantile for item in judged), "a requirement on what is no quantile is judged row by row"),
            (any(each.paired for each in measures), "a requirement on a corridor takes a sample of rays, row by row"),
            (any(each.side for each in measures), "a requirement on one side is judged row by row"),
            (any(each.two_shots for each in ended), "a trajectory whose ends have a shot each is judged row by row"),
        )
        reasons += [reason for holds, reason in slower if holds]
        self._placed = not reasons
        if self._placed:
            self._stated = np.array([value_at(self.design.source.data, at[0]) for at in self._places], dtype=float)
            self.base = base_numbers(system)
            detectors = np.array([find_detector(view) for view in self.design.document.views])
            self.validity_bounds = ValidityBounds.of(system, detectors)
        effects = (*system.shared_image_errors, *(each for each in system.believed_errors if each is not None))
        named = {**{link.name: link for link in system.links}, **{effect.label: effect for effect in effects}}
        bounded = [name for name, effect in named.items() if effect.sources.are_bounded.any()]
        if bounded:
            reasons.append(f"{', '.join(bounded)}: bounded, and the worst of all ends is searched for, row by row")
        if "verdict" in self.columns and system.requirements:
            reasons.append("a verdict takes how far first order can be trusted, row by row")
        if any(item.risk != "pooled" for item in judged):
            reasons.append("a requirement on each installed unit takes a sample of units, row by row")
        if not reasons:
            self._loop = _RowLoop(self)
        return (IN_FULL, "; ".join(reasons)) if reasons else (COMPILED, "")

    def _numbers_of(self, values: Array) -> dict[str, Array]:
        """The fields that the table touches, (n, ...) each."""
        touched = {slot.field for _, slot in self.slots}
        numbers = {field: np.repeat(self.base[field][None], len(values), axis=0) for field in touched}
        for column, slot in self.slots:
            field, place = numbers[slot.field], (slice(None), *slot.index)
            axes = field[place].ndim - 1  # by a list of axes that is a copy, so it is written by its place
            field[place] = (values[:, column] * slot.factor).reshape(-1, *[1] * axes)
        return numbers

    # --- one row ----------------------------------------------------------------------------------

    def _score_numbers(self, numbers: Numbers) -> list[Any] | None:
        """A row by the numbers of the compiled design; None: it has to go by its document."""
        system = put_numbers(self.system, numbers)
        try:
            at_bias = chain_of(system)
            if not self.validity_bounds.are_certainly_valid(at_bias):
                return None
            return self._read_models(system, linearise_all(at_bias))
        except TailstackError:
            return None

    def _read_models(self, system: System, models: dict[str, LinearModel]) -> list[Any]:
        every = models_of(system, models)

        @cache
        def score_at(name: str, error: str) -> ErrorScore:
            model = every[name, error]
            return ErrorScore(model, error_law(model, error, P95), tightest_limit(system, name, error))

        def of_target(column: str, name: str) -> float:
            found = score_at(name, "localisation" if column == "localisation_p95_mm" else "tcp")
            if column == "mean_norm_mm":
                return found.summary.mean_norm_mm
            return hypot(*found.at.law.mean) if column == "bias_norm_mm" else found.summary.quantile.quantile_mm

        checks: list[Check] = []
        if not _ASK.isdisjoint(self.columns):
            trust = trust_of(system, models)
            checks = [check_requirement(item, name, trust, score_at(name, item.error)) for item, name in self.required]
        return self._arrange(of_target, checks)

    def _score_in_full(self, row: Array) -> list[Any] | str:
        """A row by its own document, or why it cannot be computed."""
        if not np.isfinite(row).all():
            return f"{self.pointers[int(np.isfinite(row).argmin())]}: no finite number"
        try:
            data = set_numbers(self.design.source.data, self._places, row.tolist())
            result = score(load_design(data, base_directory=self.design.source.directory), losses=False)
        except TailstackError as error:
            return describe_refusal(error)
        targets = {target.name: target for target in result.targets}

        def of_target(column: str, name: str) -> float:
            target = targets[name]
            if column == "bias_norm_mm":
                return hypot(*target.bias_mm)
            return target.localisation.p95_mm if column == "localisation_p95_mm" else float(getattr(target, column))

        return self._arrange(of_target, result.verdict.checks)

    def _arrange(self, of_target: Callable[[str, str], float], checks: Sequence[Check]) -> list[Any]:
        """The cells of a row: of_target(column, target), and what the requirements came to."""
        cells: list[Any] = []
        for column in self.columns:
            if column in OF_TARGETS:
                cells += [of_target(column, target.name) for target in self.system.targets]
            elif column in OF_REQUIREMENTS:
                cells += [each.value for each in checks]
            elif column == "verdict":
                cells.append(conclude(tuple(checks), (), "first order").status)
            else:
                within = all(each.value <= each.limit for each in checks)
                unsure = within and any(each.open_because for each in checks)
                cells.append((OPEN if unsure else WITHIN[within]) if checks else NO_REQUIREMENT)
        return cells


# --- the compiled way -------------------------------------------------------------------------------


class _RowLoop:
    """What all rows of the compiled way share."""

    def __init__(self, batch: Batch) -> None:
        self.batch, system = batch, batch.system
        loud = tuple(replace(view, fiducial_noise_px=1.0) for view in system.views)
        geometry = geometry_at(system.projections, system.fiducials_mm, mounts_of(system).first, system.reading)
        self.imaging = imaging_of(replace(system, views=loud), *geometry)
        moved = not LAYOUT.isdisjoint(slot.field for _, slot in batch.slots)
        self.together = None if moved and system.shared_image_errors else self._move_together([system])
        assumed = [each for each in system.believed_errors if each is not None]
        self.scalar = (*assumed, *system.links, *system.shared_image_errors)  # whose sources have a half-width each
        # the spread of each source in its half-widths, as ``assemble_law`` takes it
        self.widths = [
            np.where([law is Law.NORMAL for law in effect.sources.laws], effect.sources.std_per_half_width, 1.0)
            for effect in self.scalar
        ]
        law, count = system.manufacturing_law, len(system.fiducials_mm)
        self.made = std_per_half_width(law, system.manufacturing_coverage_factor) if law is Law.NORMAL else 1.0
        laws = [Law.NORMAL] * (len(system.views) * (2 * count + 2)) + [law] * (3 * count)
        laws += [each for effect in self.scalar for each in effect.sources.laws]
        self.kinds = np.array([KIND[each] for each in laws])
        views = len(system.views)
        of_images = np.repeat(np.arange(2 * views), [2 * count, 2] * views)
        made = 2 * views + np.tile(np.arange(3), count)
        rest = len(laws) - len(of_images) - len(made)
        self.groups = np.concatenate([of_images, made, 2 * views + 3 + np.arange(rest)])
        self.checked = [] if _ASK.isdisjoint(batch.columns) else batch.required
        wanted = {(name, item.error, item.quantile): False for item, name in self.checked}
        for column, error in QUANTILES.items():
            for target in system.targets if column in batch.columns else ():
                key = target.name, error, P95
                wanted[key] = wanted.get(key, False) or column == "mean_norm_mm"
        self.places = {key: k for k, key in enumerate(wanted)}
        self.metrics = list(dict.fromkeys((name, error) for name, error, _ in wanted))
        self.asked = Asked(
            np.array([self.metrics.index(key[:2]) for key in wanted], dtype=np.int64),
            np.array([quantile for _, _, quantile in wanted]),
            np.array(list(wanted.values()), dtype=np.bool_),
            np.array([accuracy_for(quantile, True) for _, _, quantile in wanted]).reshape(-1, 3),
        )
        derived = [metric.site for metric in system.derived_metrics if metric.key in self.metrics]
        self.follow = bool(derived)  # whether weights follow the targets
        several = max((len(site.weights) for site in derived), default=1)
        self.apart = np.arange(len(laws)) < len(of_images)
        self.apart[: len(of_images)] = of_images % 2 == 1  # the images of the target
        again = np.tile(np.flatnonzero(self.apart), several - 1)
        self.groups, self.kinds = np.append(self.groups, self.groups[again]), np.append(self.kinds, self.kinds[again])

    def fill(self, numbers: Numbers, sound: NDArray[np.bool_], columns: list[Array]) -> NDArray[np.bool_]:
        """Write the columns of the rows that are sound (n,) and plainly so; which of them were written, (n,)."""
        batch, count = self.batch, len(sound)
        names = [target.name for target in batch.system.targets]
        rows, plain = self._work_out(numbers)
        done = sound & plain & ~(rows.widths[:, self.groups[self.kinds == BOUNDED]] > 0).any(axis=1)
        tails = np.full((count, len(self.asked.metrics), 2), nan)
        biases = np.full((count, len(names)), nan)
        score_rows(rows, self.asked, batch.validity_bounds, done, tails, biases)
        done &= np.isfinite(biases).all(axis=1) & np.isfinite(tails[..., 0]).all(axis=1)
        done &= np.isfinite(tails[:, self.asked.averaged, 1]).all(axis=1)
        values = [
            (tails[:, self.places[name, item.error, item.quantile], 0], item.limit) for item, name in self.checked
        ]
        place = iter(columns)
        for column in batch.columns:
            if column == "bias_norm_mm":
                for each in biases.T:
                    next(place)[:] = each
            elif column in OF_TARGETS:
                for name in names:
                    which = self.places[name, QUANTILES[column], P95], int(column == "mean_norm_mm")
                    next(place)[:] = tails[:, *which]
            elif column in OF_REQUIREMENTS:
                for value, _ in values:
                    next(place)[:] = value
            elif values:
                within = np.all([value <= limit for value, limit in values], axis=0)
                next(place)[:] = np.where(within, WITHIN[True], WITHIN[False])
            else:
                next(place)[:] = NO_REQUIREMENT
        return done

    def _work_out(self, numbers: Numbers) -> tuple[CompiledRows, NDArray[np.bool_]]:
        """The rows with these numbers (n, ...), and of which targets and noise are plain (n or 1,)."""
        batch, imaging = self.batch, self.imaging
        system = batch.system

        def read(field: str) -> Array:
            return numbers[field] if field in numbers else np.array(batch.base[field])[None]

        names = [mount.name for mount in system.mounts]
        biases, pivots = ([read(f"{name}.{what}") for name in names] for what in ("bias", "pivot"))
        mounts = mounts_of(system, biases, pivots)
        fiducials, targets = read("fiducials"), read("targets")
        projections, points, per_error = geometry_at(system.projections, fiducials, mounts.first, system.reading)
        way = pass_mounts(mounts, np.swapaxes(targets, 0, 1))
        gains = list(way.mount_gains(system).values())
        noise = np.stack(np.broadcast_arrays(read("fiducial_noise_px"), read("target_noise_px")), axis=2)
        precision = imaging.estimation.precision * noise[:, :, :1] ** 2
        moved = (dict(zip(numbers, row, strict=True)) for row in zip(*numbers.values(), strict=True))
        shifts, at_flange = self.together or self._move_together([put_numbers(system, each) for each in moved])
        widths = zip(self.scalar, self.widths, strict=True)
        rows = CompiledRows(
            projections=np.ascontiguousarray(projections),
            fiducials=fiducials,
            points=np.ascontiguousarray(points),
            per_error=np.ascontiguousarray(per_error.reshape(-1, 3, 3)),
            weights=batch.validity_bounds.weights,
            unknowns=imaging.estimation.unknowns,
            weighing=imaging.estimation.weighing,
            precision=precision,
            noise=noise,
            factors=imaging.estimation.factors,
            believed=imaging.believed,
            views_of=imaging.views_of,
            assumed=imaging.assumed,
            aims=np.ascontiguousarray(way.reconstructed_mm),
            biases=_stack([way.localisation_bias_mm, way.tcp_bias_mm]),
            to_tcp=np.ascontiguousarray(way.tcp_from_localisation),
            from_flange=np.ascontiguousarray(way.tcp_from_flange),
            mounts=_stack(
                [np.concatenate(_alike([pair[error] for pair in gains]), axis=-1) for error in ("localisation", "tcp")]
            ),
            shifts=shifts,
            at_flange=at_flange,
            shared=sum(effect.sources.count for effect in system.shared_image_errors),
            widths=_side_by_side(
                noise.reshape(len(noise), -1),
                read("manufacturing") * self.made,
                *(read(f"{effect.name}.half_width") * per for effect, per in widths),
            ),
            groups=self.groups,
            kinds=self.kinds,
            apart=self.apart,
            joints=np.stack([self._joints_at(each) for each in (targets if self.follow else targets[:1])]),
            moving=False,
        )
        weighed = rows.weighing == Weighing.BY_NOISE or precision.any()
        varying = (rows.projections, rows.points, rows.aims[0], rows.mounts[0, 0], rows.shifts[0])
        moving = any(len(each) > 1 for each in varying) or (weighed and len(noise) > 1)
        return rows._replace(moving=bool(moving)), batch.validity_bounds.are_aims_certainly_valid(targets, noise)

    def _joints_at(self, targets: Array) -> Array:
        """(M, T, 3, 6) the weights of the measures that are asked for, of targets (T, 3) mm."""
        system, joints = self.batch.system, np.zeros((len(self.metrics), len(targets), 3, 6))
        moved = [replace(target, position_mm=at) for target, at in zip(system.targets, targets, strict=True)]
        places = {target.name: t for t, target in enumerate(moved)}
        for metric in replace(system, targets=tuple(moved)).metrics:
            if metric.key in self.metrics:
                for name, weights in metric.site.weights.items():
                    joints[self.metrics.index(metric.key), places[name]] = weights
        return joints

    def _move_together(self, systems: Sequence[System]) -> tuple[Array, Array]:
        """What moves the images of all fiducials of a view together, of each system (m): shifts (T, m, V, 2 N + 2,
        C + E) px and, behind the reconstructed point, (T, m, 3, C + E + V) mm."""
        firsts = [(system, mounts_of(system).first) for system in systems]
        shifts = [shift_together(system, first, target) for system, first in firsts for target in system.targets]
        lead = len(systems), len(systems[0].targets)
        both = (np.reshape(each, (*lead, *each[0].shape)) for each in zip(*shifts, strict=True))
        of_images, of_flange = (np.ascontiguousarray(np.swapaxes(each, 0, 1)) for each in both)
        return of_images, of_flange


def _alike(arrays: Sequence[Array]) -> list[Array]:
    """(..., k) with the same leading dimensions all."""
    lead = np.broadcast_shapes(*(each.shape[:-1] for each in arrays))
    return [np.broadcast_to(each, (*lead, each.shape[-1])) for each in arrays]


def _stack(arrays: Sequence[Array]) -> Array:
    return np.ascontiguousarray(np.stack(np.broadcast_arrays(*arrays)))


def _side_by_side(*arrays: Array) -> Array:
    """(n, a) and (n, b) and so on as (n, a + b + ...); one of a single row stands in each."""
    return np.ascontiguousarray(np.concatenate(_alike(arrays), axis=1))


# --- numbers of the document among those of the compiled design -------------------------------------


def base_numbers(system: System) -> dict[str, Array]:
    """Every field that a slot can be in, as the design states it."""
    numbers = {
        "fiducials": system.fiducials_mm,
        "manufacturing": system.manufacturing_half_width_mm[0],  # a document has one for all fiducials
        "fiducial_noise_px": np.array([view.fiducial_noise_px for view in system.views]),
        "target_noise_px": np.array([view.target_noise_px for view in system.views]),
        "targets": np.array([target.position_mm for target in system.targets]),
    }
    for mount in system.mounts:
        numbers |= {f"{mount.name}.pivot": mount.pivot_mm, f"{mount.name}.bias": mount.known}
    every = (*system.links, *system.effects)
    return numbers | {f"{effect.name}.half_width": effect.sources.half_width for effect in every}


def put_numbers(system: System, numbers: Numbers) -> System:
    """The compiled design with other numbers, (...) each as :func:`base_numbers` has them."""

    def read(field: str, now: Array) -> Array:
        return frozen(numbers[field]) if field in numbers else now

    def widen(sources: Sources, name: str) -> Sources:
        return replace(sources, half_width=read(f"{name}.half_width", sources.half_width))

    def move(link: DirectEffect) -> DirectEffect:
        pivot, known = read(f"{link.name}.pivot", link.pivot_mm), read(f"{link.name}.bias", link.known)
        return replace(link, pivot_mm=pivot, known=known, sources=widen(link.sources, link.name))

    stated = {**base_numbers(system), **numbers}
    first, second = move(system.structure_connector), move(system.connector_flange)
    noise = zip(stated["fiducial_noise_px"].tolist(), stated["target_noise_px"].tolist(), strict=True)
    effects = tuple(replace(effect, sources=widen(effect.sources, effect.name)) for effect in system.effects)
    return replace(
        put_mounts(replace(system, effects=effects), first, second),
        fiducials_mm=read("fiducials", system.fiducials_mm),
        manufacturing_half_width_mm=frozen(np.broadcast_to(stated["manufacturing"], system.fiducials_mm.shape)),
        views=tuple(
            replace(view, fiducial_noise_px=fiducial, target_noise_px=target)
            for view, (fiducial, target) in zip(system.views, noise, strict=True)
        ),
        targets=tuple(
            replace(target, position_mm=frozen(place))
            for target, place in zip(system.targets, stated["targets"], strict=True)
        ),
        hand_eye=move(system.hand_eye),
        execution=move(system.execution),
    )


def find_slot(design: Design, system: System, place: Place) -> Slot | None:
    """Where a number of the document stands in the compiled design; None: it decides more than one number there."""
    match place:
        case ("fiducials", "points", int(i), "position_mm", int(k)) if not _is_noise_derived(design):
            return Slot.of(Coordinate, "fiducials", i, k)
        case ("fiducials", "manufacturing", "half_width_mm", *axis):
            return Slot.of(HalfWidth, "manufacturing", *(axis or (slice(None),)))
        case ("views", int(v), "fiducial_noise_px" | "target_noise_px" as field):
            return Slot.of(Pixels, field, v)
        case ("targets", int(i), "position_mm", int(k)):
            name = design.document.targets[i].name
            return Slot.of(Coordinate, "targets", [target.name for target in system.targets].index(name), k)
        case ("interfaces", _, *rest) | ("execution", "hand_eye", *rest):
            mount = next(mount for mount in system.mounts if mount.pointer == f"/{place[0]}/{place[1]}")
            return _find_slot_of_mount(mount, rest, getattr(design.document.interfaces, str(place[1]), None))
        case ("execution", "repeatability", "std_mm" | "half_width_mm", *axis):
            return _find_slot_along_axes(system.execution.sources, "repeatability", axis)
        case ("execution", "compliance", "load_half_width_n", *axis):
            return _find_slot_along_axes(system.execution.sources, "load", axis)
    return _find_slot_of_effect(design, system, place)


def _is_noise_derived(design: Design) -> bool:
    """Whether noise follows from where fiducials are: then a place of one decides more than one number."""
    return any(isinstance(view.fiducial_noise_px, BeadNoise) for view in design.document.views)


def _find_slot_of_effect(design: Design, system: System, place: Place) -> Slot | None:
    """Of the half-widths of an effect in ``effects/``: those that are halved when the document's number is."""
    name = next(step for step in reversed(place) if isinstance(step, str))
    data, stated = design.source.data, value_at(design.source.data, place)
    if not name.startswith("half_width") or not stated > 0:
        return None
    try:
        changed = set_numbers(data, ((place,),), [stated / 2])
        other = compile_design(load_design(changed, base_directory=design.source.directory))
    except TailstackError:  # it is held against another number of the document
        return None
    pairs = zip(system.effects, other.effects, strict=True)
    moved = [pair for pair in pairs if not np.array_equal(pair[0].sources.half_width, pair[1].sources.half_width)]
    if len(moved) != 1:
        return None
    effect, again = moved[0]
    now, then = effect.sources, again.sources
    halved = now.half_width != then.half_width
    if not (
        np.allclose(then.half_width[halved], now.half_width[halved] / 2, rtol=1e-12, atol=0.0)
        and np.array_equal(now.direction, then.direction)
        and np.array_equal(effect.known, again.known)
    ):
        return None
    section: Any = design.document
    for step in place[: place.index(name)]:
        section = section[step] if isinstance(step, int) else getattr(section, step)
    low, high = domain_of(type(section).__pydantic_fields__[name].rebuild_annotation())
    factor = float(now.half_width[halved][0] / stated)
    return Slot(f"{effect.name}.half_width", (np.flatnonzero(halved).tolist(),), factor, low, high)


def _find_slot_of_mount(mount: DirectEffect, place: Sequence[str | int], seat: Interface | None) -> Slot | None:
    """Contacts follow the pivot of their seat, and features add their middles to its bias."""
    field = f"{mount.name}.half_width"
    match place:
        case ("tolerances", str(component), "half_width_deg" | "half_width_mm"):
            k = mount.sources.names.index(component)
            if any(k in group for group in mount.sources.together):
                return None  # its width moves what the others do
            turns = mount.sources.units[k] == "rad"
            return Slot.of(HalfWidthDegrees if turns else HalfWidth, field, k, turns=turns)
        case ("locators", int(k), "half_width_mm"):
            return Slot.of(HalfWidth, field, k)
        case ("pivot_mm", int(k)) if seat is None or not seat.is_held:
            return Slot.of(Coordinate, f"{mount.name}.pivot", k)
        case ("bias", str(component)) if seat is None or seat.features is None:
            k = TORSOR_COMPONENTS.index(component.partition("_")[0])
            return Slot.of(Degrees if k < 3 else Coordinate, f"{mount.name}.bias", k, turns=k < 3)
    return None


def _find_slot_along_axes(sources: Sources, what: str, axis: Sequence[Any]) -> Slot | None:
    """Of one axis of the tool, or of all three; None where some of them do nothing and are no sources."""
    names = [f"{what}.{'xyz'[k]}" for k in (axis or range(3))]
    if not set(names) <= set(sources.names):
        return None
    return Slot.of(HalfWidth, "execution.half_width", [sources.names.index(name) for name in names])


def _find_places(design: Design, pointers: Sequence[str]) -> list[tuple[Place, ...]]:
    """The numbers that each pointer leads to.  Raises SweepError for one that leads to none, or is given twice."""
    if not pointers:
        raise SweepError(Problem("/table", "no-columns", "a table has a column for at least one number of the design"))
    by_pointer: list[tuple[Place, ...]] = []
    for pointer in pointers:
        places = locate_numbers(design.source.data, pointer, "/table", SweepError)
        if any(not set(places).isdisjoint(earlier) for earlier in by_pointer):
            detail = f"two columns give the same number: the one for {pointer}, and one before it"
            raise SweepError(Problem("/table", "given-twice", detail, "leave one of them out"))
        by_pointer.append(places)
    return by_pointer


def _check_columns(columns: Sequence[str]) -> tuple[str, ...]:
    """Raises SweepError for a name that is none, or stands there twice."""
    known = f"known: {', '.join(COLUMNS)}"
    for k, column in enumerate(columns):
        if column not in COLUMNS:
            raise SweepError(Problem(f"/columns/{k}", "unknown-value", f"there is no column {column!r}", known))
        if column in columns[:k]:
            detail = f"the column {column!r} is asked for twice"
            raise SweepError(Problem(f"/columns/{k}", "unknown-value", detail, known))
    if not columns:
        raise SweepError(Problem("/columns", "too-short", "an answer has at least one column", known))
    return tuple(columns)
