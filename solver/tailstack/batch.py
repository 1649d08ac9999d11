"""A million designs: one design scored again and again with numbers of a table in it.  Row by row what ``score`` says.

What the columns of the table touch decides how a row is computed, and the answer says which way it was:

- *compiled*: positions of fiducials, half-widths and image noise under normal laws.  Nothing that they leave alone is
  computed again; gains and quantile are those of ``score``, called from one compiled loop over rows.
- *linearised*: also pivots, biases, targets and other laws.  The compiled design gets its new numbers, and goes through
  ``linearise_at`` and ``law_quantile``: no document is read again, and no budget is made.
- *in full*: everything else.  The document gets its new numbers, and goes through ``load_design`` and ``score``.

A row that is not plainly sound (a fiducial near the edge of an image, a layout near a degenerate one, a number out of
its range) is computed in full, whatever its columns: so every refusal is the one of ``score``.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cache
from itertools import chain
from math import hypot, inf, nan, radians
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from .arrays import Array, frozen
from .contributors import ErrorLaw, error_law
from .cores import usable_cores
from .design import Design, compile_design, design_to_data, load_design
from .design.compile import detector_distances
from .design.fields import Coordinate, Degrees, HalfWidth, HalfWidthDegrees, Pixels
from .design.pointers import Place, locate_numbers, pointer_of, set_numbers, value_at
from .errors import Problem, TailstackError, describe_refusal
from .estimation.checks import COPLANAR, LINEAR, NO_PARALLAX, SINGULAR, TOUCHING_MM, sines_between_rays
from .geometry.symmetric import eigen_symmetric
from .kernels import kernel
from .propagation.linear import Chain, LinearModel, chain_of, linearise_at
from .propagation.noise import eliminate, mean_rows, square_gains
from .results import Check
from .results.record import data_frame
from .scoring import P95, ErrorScore, check_requirement, score, tightest_limit, trust_of
from .sweeping import SweepError
from .system import INTERFACES, STD_PER_HALF_WIDTH, TORSOR_COMPONENTS, Estimator, Law, Mount, Reading, Sources, System
from .tail.declared import LawSummary, law_mean, law_quantile
from .tail.gaussian import norm_mean_jit, norm_quantile_jit
from .verdict import conclude

BLOCK = 1024  # rows that are computed in one go
OF_TARGETS = ("p95_mm", "mean_norm_mm", "bias_norm_mm", "localisation_p95_mm")
OF_REQUIREMENTS = ("value_mm",)  # the quantile that a requirement limits, at each of its targets
OF_DESIGNS = ("within_limits", "verdict")
COLUMNS = (*OF_TARGETS, *OF_REQUIREMENTS, *OF_DESIGNS)
DEFAULT_COLUMNS = ("p95_mm", "mean_norm_mm", "bias_norm_mm", "within_limits")
_ASK = {"value_mm", "within_limits", "verdict"}  # for the requirements
REASON = "reason"  # name of the column that says why a row was not evaluated
NO_REQUIREMENT = "no requirement"
WITHIN = {True: "yes", False: "no"}

WAYS = COMPILED, LINEARISED, IN_FULL = ("compiled", "linearised", "in full")
OF_MOUNTS = (*INTERFACES, "hand_eye", "execution")
KERNEL_FIELDS = frozenset(
    {
        "fiducials",
        "manufacturing",
        "fiducial_noise_px",
        "target_noise_px",
        *(f"{name}.half_width" for name in OF_MOUNTS),
    }
)
SLACK = 1e-6  # px and mm: nearer to an edge than that, a row is computed in full

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
        bounds = {type(each).__name__: each for info in get_args(kind)[1:] for each in info.metadata}
        return cls(field, index, radians(1.0) if turns else 1.0, float(bounds["Ge"].ge), float(bounds["Le"].le))


@dataclass(frozen=True, slots=True, eq=False)
class BatchScores:
    """Scores of many designs as columns: row k of each is the design with row k of the table."""

    columns: Mapping[str, Array]
    """(n,) each, by name (``p95_mm:TARGET``): numbers, NaN where a row was not evaluated; texts in verdict (pass, fail,
    inconclusive, no requirement) and within_limits (yes, no), empty where it was not."""
    reasons: tuple[str, ...]
    """(n,) why a row was not evaluated; empty: it was."""
    ways: Mapping[str, int]
    """How many rows were computed compiled, linearised and in full."""
    why: str
    """Why rows were not computed by the fastest way; empty: they were."""

    def to_frame(self) -> Any:
        """The columns and the reasons as a pandas DataFrame.  Raises MissingExtraError where there is no pandas."""
        return data_frame({**self.columns, REASON: self.reasons})


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
    a DataFrame will do.  columns: p95_mm, mean_norm_mm, bias_norm_mm and localisation_p95_mm of each target; value_mm,
    the quantile that each requirement limits; within_limits, whether all of these are; verdict, which also takes how
    far first order can be trusted, and costs some hundred times as much.  threads: the answer does not depend on them.
    ``progress(done, total)`` after each block.

    Each number equals that of ``score`` to 1e-9.  A row that cannot be scored keeps its place, with the reason.  Raises
    SweepError for a path that leads to no number and columns of unequal length, and what compiling the design raises.
    """
    batch = Batch(design, tuple(str(name) for name in table), columns)
    values = [np.asarray(table[name], dtype=np.float64) for name in table]
    lengths = {each.shape for each in values}
    if len(lengths) != 1 or values[0].ndim != 1:
        raise SweepError(Problem("/table", "ragged", "the columns of a table are lists of one and the same length"))
    rows = np.column_stack(values)
    blocks = [rows[start : start + BLOCK] for start in range(0, len(rows), BLOCK)]
    found = []
    for block in batch.score_blocks(blocks, threads):
        found.append(block)
        if progress is not None:
            progress(min(len(found) * BLOCK, len(rows)), len(rows))
    return BatchScores(
        {
            name: np.concatenate([block.columns[k] for block in found]) if found else np.zeros(0)
            for k, name in enumerate(batch.names)
        },
        tuple(chain.from_iterable(block.reasons for block in found)),
        {way: sum(block.ways[way] for block in found) for way in WAYS},
        batch.why,
    )


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
        self.names = tuple(self._name_columns())
        self.slots: list[tuple[int, Slot]] = []  # with the column of the table
        self._loop: _RowLoop | None = None
        self.way, self.why = self._choose_way()

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
        columns = [
            np.full(count, "", dtype=object) if name in OF_DESIGNS else np.full(count, nan) for name in self.names
        ]
        ways, reasons = dict.fromkeys(WAYS, 0), [""] * count
        sound = np.asarray(np.isfinite(values).all(axis=1))
        for column, slot in self.slots:
            sound &= (values[:, column] >= slot.low) & (values[:, column] <= slot.high)
        numbers = {} if self.way == IN_FULL else self._numbers_of(np.where(sound[:, None], values, self._stated))
        if self._loop is not None:
            sound &= self._loop.fill(numbers, columns)
            ways[COMPILED] = int(sound.sum())
        for row in range(count):
            if sound[row] and self._loop is not None:
                continue
            found: list[Any] | str | None = None
            if sound[row] and self.way == LINEARISED:
                found = self._linearise({field: array[row] for field, array in numbers.items()})
                ways[LINEARISED] += found is not None
            if found is None:
                ways[IN_FULL] += 1
                found = self._score_in_full(values[row])
            if isinstance(found, str):
                reasons[row] = found
                found = ["" if name in OF_DESIGNS else nan for name in self.names]
            for array, value in zip(columns, found, strict=True):
                array[row] = value
        return BatchBlock(columns, reasons, ways)

    # --- what is asked for ------------------------------------------------------------------------

    def _name_columns(self) -> Iterator[str]:
        for column in self.columns:
            if column in OF_TARGETS:
                yield from (f"{column}:{target.name}" for target in self.system.targets)
            elif column in OF_REQUIREMENTS:
                yield from (
                    f"{column}:{item.name}:{name}" for item in self.system.requirements for name in item.targets
                )
            else:
                yield column

    def _choose_way(self) -> tuple[str, str]:
        """The fastest way that pointers, laws and columns leave, and why it is not the first."""
        system = self.system
        if system.estimator is not Estimator.DLT or system.triangulation not in LINEAR:
            return IN_FULL, f"the model is {system.estimator} with {system.triangulation} triangulation"
        for column, places in enumerate(self._places):
            for place in places:
                slot = find_slot(self.design, system, place)
                if slot is None:
                    return IN_FULL, f"{self.pointers[column]} is more than a number of the compiled design"
                self.slots.append((column, slot))
        self._stated = np.array([value_at(self.design.source.data, places[0]) for places in self._places], dtype=float)
        self.base, self.sights = base_numbers(system), Sights.of(self.design, system)
        touched = {slot.field for _, slot in self.slots}
        for column, slot in self.slots:
            if slot.field not in KERNEL_FIELDS:
                return LINEARISED, f"{self.pointers[column]} changes where gains are taken"
        if system.common_shifts:
            return LINEARISED, f"{system.common_shifts[0]} moves the images of all fiducials together"
        other = _find_other_law(system, touched)
        if other:
            return LINEARISED, f"{other} is not under a normal law"
        if "verdict" in self.columns and system.requirements:
            return LINEARISED, "a verdict takes how far first order can be trusted, row by row"
        if any(item.risk != "pooled" for item in system.requirements) and not _ASK.isdisjoint(self.columns):
            return LINEARISED, "a requirement on each installed unit takes a sample of units, row by row"
        try:
            self._loop = _RowLoop(self)
        except TailstackError:
            return LINEARISED, "the layout as the design states it determines no answer"
        return COMPILED, ""

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

    def _linearise(self, numbers: Numbers) -> list[Any] | None:
        """A row by the numbers of the compiled design; None: it has to be computed in full."""
        system = put_numbers(self.system, numbers)
        try:
            at_bias = chain_of(system)
            if not self.sights.are_plain(at_bias):
                return None
            models = {target.name: linearise_at(at_bias, target) for target in system.targets}
            return self._read_models(system, models)
        except TailstackError:
            return None

    def _read_models(self, system: System, models: dict[str, LinearModel]) -> list[Any]:
        @cache
        def law_at(name: str, error: str) -> ErrorLaw:
            return error_law(models[name], error, P95)

        def of_target(column: str, name: str) -> float:
            law = law_at(name, "localisation" if column == "localisation_p95_mm" else "tcp").law
            if column == "mean_norm_mm":
                return law_mean(law, P95)
            return hypot(*law.mean) if column == "bias_norm_mm" else law_quantile(law, P95).quantile_mm

        checks: list[Check] = []
        if not _ASK.isdisjoint(self.columns):
            trust = trust_of(system, models)
            for item in system.requirements:
                for name in item.targets:
                    at = law_at(name, item.error)
                    summary = LawSummary(law_quantile(at.law, P95), nan, nan, None)
                    limit = tightest_limit(system, name, item.error)
                    checks.append(check_requirement(item, name, trust, ErrorScore(models[name], at, limit, summary)))
        return self._arrange(of_target, checks)

    def _score_in_full(self, row: Array) -> list[Any] | str:
        """A row by its own document, or why it cannot be computed."""
        if not np.isfinite(row).all():
            return f"{self.pointers[int(np.isfinite(row).argmin())]}: no finite number"
        try:
            data = set_numbers(self.design.source.data, self._places, row.tolist())
            found = score(load_design(data, base_directory=self.design.source.directory), losses=False)
        except TailstackError as error:
            return describe_refusal(error)
        targets = {target.name: target for target in found.targets}

        def of_target(column: str, name: str) -> float:
            target = targets[name]
            if column == "bias_norm_mm":
                return hypot(*target.bias_mm)
            return target.localisation.p95_mm if column == "localisation_p95_mm" else float(getattr(target, column))

        return self._arrange(of_target, found.verdict.checks)

    def _arrange(self, of_target: Callable[[str, str], float], checks: Sequence[Check]) -> list[Any]:
        """The cells of a row: of_target(column, target), and what the requirements came to."""
        cells: list[Any] = []
        for column in self.columns:
            if column in OF_TARGETS:
                cells += [of_target(column, target.name) for target in self.system.targets]
            elif column in OF_REQUIREMENTS:
                cells += [each.value_mm for each in checks]
            elif column == "verdict":
                cells.append(conclude(tuple(checks), (), "first order").status)
            else:
                cells.append(
                    WITHIN[all(each.value_mm <= each.limit_mm for each in checks)] if checks else NO_REQUIREMENT
                )
        return cells


# --- the compiled way -------------------------------------------------------------------------------


class _RowLoop:
    """What all rows of the compiled way share: the chain at the bias, and what the mounts do to each target."""

    def __init__(self, batch: Batch) -> None:
        """Raises IllPosedError where the design as it stands does not determine a target."""
        self.batch, system = batch, batch.system
        self.chain = chain_of(system)
        self.models = [linearise_at(self.chain, target) for target in system.targets]
        self.aims = np.array([model.reconstructed_mm for model in self.models])
        self.own_factors = np.concatenate([per_half_width(sources) for _, sources in sources_of(system)])
        self.turns = {"tcp": np.array([m.tcp_from_localisation for m in self.models])}
        self.turns["localisation"] = np.broadcast_to(np.eye(3), self.turns["tcp"].shape).copy()
        self.own = {error: np.array([_squares(m, error) for m in self.models]) for error in self.turns}
        self.means = {error: np.array([m.bias_mm(error) for m in self.models]) for error in self.turns}
        moved = any(slot.field == "fiducials" for _, slot in batch.slots)
        self.fixed = None if moved else self._squares_of_images(system.fiducials_mm[None].copy())

    def _squares_of_images(self, fiducials: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Of layouts (n, N, 3): what a unit of variance of each group of sources does to each target, and whether the
        layout is plain."""
        chain, count = self.chain, len(fiducials)
        points = fiducials
        if chain.system.reading is Reading.EQ18:
            points = np.ascontiguousarray(fiducials @ chain.per_error.T + chain.first.shift_mm)
        plain = self.batch.sights.are_plain_rows(chain.projections, fiducials, points)
        plain &= self.batch.sights.aims_are_plain(chain.system)
        squares = np.zeros((count, len(self.aims), 2 * len(chain.projections) + 3, 3, 3))
        square_gains(
            chain.projections,
            points,
            chain.weights[None],
            chain.estimation,
            chain.per_error,
            np.ones(chain.points.shape),
            self.aims,
            squares,
        )
        return squares, plain & np.isfinite(squares).all(axis=(1, 2, 3, 4))

    def fill(self, numbers: Numbers, columns: list[Array]) -> NDArray[np.bool_]:
        """Write the columns of all rows; which of them are sound, (n,)."""
        batch, count = self.batch, len(columns[0])
        squares, plain = self.fixed or self._squares_of_images(np.ascontiguousarray(numbers["fiducials"]))

        def read(field: str) -> Array:
            return numbers.get(field, batch.base[field][None])

        made = read("manufacturing") * _per_half_width_made(batch.system)
        noise = np.stack(np.broadcast_arrays(read("fiducial_noise_px"), read("target_noise_px")), axis=2)
        variances = _side_by_side(noise.reshape(len(noise), -1), made) ** 2
        own = (_side_by_side(*(read(f"{name}.half_width") for name in OF_MOUNTS)) * self.own_factors) ** 2
        sound = np.broadcast_to(plain, count).copy()
        found: dict[tuple[str, float, bool], Array] = {}

        def tails(error: str, quantile: float, mean: bool = False) -> Array:
            """(n, T) mm: the quantile of the error's norm, or its mean."""
            key = (error, quantile, mean)
            if key not in found:
                found[key] = np.empty((count, len(self.aims)))
                gaussian_tails(
                    squares, variances, self.turns[error], self.own[error], own, self.means[error], quantile, mean,
                    found[key],
                )  # fmt: skip
                sound[:] &= np.isfinite(found[key]).all(axis=1)
            return found[key]

        place = iter(columns)
        places = {model.target.name: k for k, model in enumerate(self.models)}
        values = [
            (tails(item.error, item.quantile)[:, places[name]], item.limit_mm)
            for item in batch.system.requirements
            for name in item.targets
            if not _ASK.isdisjoint(batch.columns)
        ]
        for column in batch.columns:
            if column == "bias_norm_mm":
                for mean in self.means["tcp"]:
                    next(place)[:] = hypot(*mean)
            elif column in OF_TARGETS:
                error = "localisation" if column == "localisation_p95_mm" else "tcp"
                for each in tails(error, P95, column == "mean_norm_mm").T:
                    next(place)[:] = each
            elif column in OF_REQUIREMENTS:
                for value, _ in values:
                    next(place)[:] = value
            elif values:
                kept = np.all([value <= limit for value, limit in values], axis=0)
                next(place)[:] = np.where(kept, WITHIN[True], WITHIN[False])
            else:
                next(place)[:] = NO_REQUIREMENT
        return sound


def _squares(model: LinearModel, error: str) -> Array:
    """(M, 3, 3) of each source of the mounts and of the execution: its gain times itself."""
    columns = [gain for block in model.blocks if not block.grouped for gain in model.gain(block, error).T]
    return np.array([np.outer(gain, gain) for gain in columns]).reshape(-1, 3, 3)


def _side_by_side(*arrays: Array) -> Array:
    """(n, a) and (n, b) and so on as (n, a + b + ...); one of a single row stands in each."""
    count = max(map(len, arrays))
    return np.ascontiguousarray(
        np.concatenate([np.broadcast_to(each, (count, each.shape[1])) for each in arrays], axis=1)
    )


@kernel(nogil=True)
def gaussian_tails(
    squares: Array,
    variances: Array,
    turns: Array,
    own: Array,
    own_variances: Array,
    means: Array,
    quantile: float,
    mean: bool,
    out: Array,
) -> None:
    """The quantile of the error's norm, or its mean, of each row and target; NaN where it did not converge.

    squares (n or 1, T, G, 3, 3) of the groups of image-side sources, con, and their variances (n or 1, G); turns
    (T, 3, 3) from con to the frame of the error; own (T, M, 3, 3) of all other sources, in that frame, and their
    variances (n or 1, M); means (T, 3) mm.  Fills out (n, T) mm.
    """
    local = np.empty((3, 3))
    total = np.empty((3, 3))
    for row in range(out.shape[0]):
        square = squares[row if squares.shape[0] > 1 else 0]
        variance = variances[row if variances.shape[0] > 1 else 0]
        own_variance = own_variances[row if own_variances.shape[0] > 1 else 0]
        for t in range(out.shape[1]):
            for a in range(3):
                for b in range(3):
                    local[a, b] = 0.0
                    for g in range(variance.size):
                        local[a, b] += variance[g] * square[t, g, a, b]
            for a in range(3):
                for b in range(3):
                    total[a, b] = 0.0
                    for c in range(3):
                        for d in range(3):
                            total[a, b] += turns[t, a, c] * local[c, d] * turns[t, b, d]
                    for g in range(own_variance.size):
                        total[a, b] += own_variance[g] * own[t, g, a, b]
            if mean:
                out[row, t] = norm_mean_jit(means[t], total)
            else:
                out[row, t] = norm_quantile_jit(means[t], total, quantile)


# --- what is plainly sound --------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class Sights:
    """Where a point may stand so that nothing about its images is in doubt."""

    projections: Array  # (V, 3, 4) as the design states them
    weights: Array  # (V, N) 1 where a view sees a fiducial, otherwise 0
    windows: Array  # (V, 2, 2) px: first and last of u and of v
    detectors: Array  # (V,) mm from the source

    @classmethod
    def of(cls, design: Design, system: System) -> Sights:
        sizes = [(inf, inf) if view.image_size_px is None else view.image_size_px for view in system.views]
        windows = np.array([[[-inf if size == inf else -0.5, size - 0.5] for size in each] for each in sizes])
        return cls(system.projections, system.sees, windows, detector_distances(design))

    def are_plain_rows(self, projections: Array, fiducials: Array, points: Array) -> NDArray[np.bool_]:
        """Which layouts (n, N, 3) are far from everything that is refused; points (n, N, 3) as told."""
        out = np.empty(len(fiducials), dtype=np.bool_)
        find_plain(projections, fiducials, points, self.weights, self.projections, self.windows, self.detectors, out)
        return out

    def aims_are_plain(self, system: System) -> bool:
        """Whether the targets are seen well inside every view, by rays that meet at an angle."""
        aims = np.array([target.position_mm for target in system.targets])
        seen = np.einsum("vij,tj->vti", self.projections[:, :, :3], aims) + self.projections[:, None, :, 3]
        depth, images = seen[..., 2], seen[..., :2] / seen[..., 2:]
        inside = (images > self.windows[:, None, :, 0] + SLACK) & (images < self.windows[:, None, :, 1] - SLACK)
        plain = inside.all() and (depth > SLACK).all() and (depth < self.detectors[:, None] - SLACK).all()
        return bool(plain and (sines_between_rays(self.projections, aims) > 10 * NO_PARALLAX).all())

    def are_plain(self, at_bias: Chain) -> bool:
        """Both, of a system."""
        fiducials = at_bias.system.fiducials_mm[None].copy()
        plain = self.are_plain_rows(at_bias.projections, fiducials, at_bias.points[None].copy())
        return bool(plain[0]) and self.aims_are_plain(at_bias.system)


@kernel(nogil=True)
def find_plain(
    projections: Array,
    fiducials: Array,
    points: Array,
    weights: Array,
    nominal: Array,
    windows: Array,
    detectors: Array,
    out: NDArray[np.bool_],
) -> None:
    """Which layouts are far from everything that ``examine`` refuses.  That it refuses nothing else rests on bounds:

    the second smallest eigenvalue of the normal matrix of a resection, G (12, 12) in normalised coordinates, is at
    least the smallest of a principal minor of order 11 (Cauchy), that one at least 1 / tr(minor^-1), and the largest at
    most tr(G).  What ``eliminate`` gives holds the blocks of the minor's inverse.

    projections (V, 3, 4) effective, |p3| = 1; fiducials (n, N, 3) as designed and points (n, N, 3) as told, mm; weights
    (V, N); nominal (V, 3, 4), windows (V, 2, 2) px, detectors (V,) mm.  Fills out (n,).
    """
    every = np.ones(fiducials.shape[1])
    for row in range(fiducials.shape[0]):
        out[row] = _is_spread(fiducials[row], every)
        for v in range(projections.shape[0]):
            if not (out[row] and (weights[v].all() or _is_spread(fiducials[row], weights[v]))):
                out[row] = False
                break
            for i in range(fiducials.shape[1]):
                depth = nominal[v, 2, 3]
                for k in range(3):
                    depth += nominal[v, 2, k] * fiducials[row, i, k]
                if not SLACK < depth < detectors[v] - SLACK:
                    out[row] = False
            if not _is_seen_well(projections[v], points[row], weights[v], windows[v]):
                out[row] = False


@kernel()
def _is_spread(points: Array, weights: Array) -> bool:
    """Whether points (N, 3) mm with weight are ten times as far apart, and as far from a plane, as they have to be."""
    centre = mean_rows(points, weights)
    scatter = np.zeros((3, 3))
    for i in range(points.shape[0]):
        if weights[i] == 0.0:
            continue
        for j in range(i):
            if weights[j] == 0.0:
                continue
            square = 0.0
            for k in range(3):
                square += (points[i, k] - points[j, k]) ** 2
            if not square > (10.0 * TOUCHING_MM) ** 2:
                return False
        for a in range(3):
            for b in range(3):
                scatter[a, b] += (points[i, a] - centre[a]) * (points[i, b] - centre[b])
    values, _, _ = eigen_symmetric(scatter)
    return bool(values[2] > (10.0 * COPLANAR) ** 2 * values[0])


@kernel()
def _is_seen_well(projection: Array, points: Array, weights: Array, window: Array) -> bool:
    """Whether points (N, 3) mm with weight are imaged inside a window (2, 2) px, and determine the view a hundred times
    as well as they have to."""
    count = weights.sum()
    _, image, local, d_inv, du, dv, s_inv, origin, _ = eliminate(projection, points, weights)
    square, image_square, largest = 0.0, 0.0, 0.0
    for i in range(points.shape[0]):
        if weights[i] == 0.0:
            continue
        if not image[i, 2] > SLACK:
            return False
        for c in range(2):
            place = image[i, c] + origin[c]
            if not window[c, 0] + SLACK < place < window[c, 1] - SLACK:
                return False
            image_square += image[i, c] ** 2 / (2.0 * count)
        for k in range(3):
            square += local[i, k] ** 2 / (3.0 * count)
    for i in range(points.shape[0]):  # in units in which points have the RMS distance sqrt(3), images sqrt(2)
        here = 1.0 + (local[i, 0] ** 2 + local[i, 1] ** 2 + local[i, 2] ** 2) / square
        largest += weights[i] * here * (2.0 + (image[i, 0] ** 2 + image[i, 1] ** 2) / image_square)
    inverse = 2.0 / count
    for k in range(3):
        inverse += s_inv[k, k] * square * image_square + 2.0 * d_inv[k, k] * square
    for j in range(4):
        for k in range(3):
            for m in range(3):
                term = (du[j, k] * du[j, m] + dv[j, k] * dv[j, m]) * s_inv[k, m]
                inverse += term * square if j < 3 else term
    return bool(0.0 < largest * inverse < 1.0 / (100.0 * SINGULAR) ** 2)


# --- numbers of the document among those of the compiled design -------------------------------------


def sources_of(system: System) -> tuple[tuple[str, Sources], ...]:
    """The sources behind the images, in the order of the chain."""
    mounts: tuple[Mount, ...] = (*system.interfaces, system.hand_eye)
    return (*((mount.name, mount.sources) for mount in mounts), ("execution", system.execution))


def per_half_width(sources: Sources) -> Array:
    """(k,) standard deviation in half-widths of each."""
    pairs = zip(sources.laws, sources.coverage_factor.tolist(), strict=True)
    return np.array([1 / factor if law is Law.NORMAL else STD_PER_HALF_WIDTH[law] for law, factor in pairs])


def _per_half_width_made(system: System) -> float:
    law = system.manufacturing_law
    return 1 / system.manufacturing_coverage_factor if law is Law.NORMAL else STD_PER_HALF_WIDTH[law]


def base_numbers(system: System) -> dict[str, Array]:
    """Every field that a slot can be in, as the design states it."""
    numbers = {
        "fiducials": system.fiducials_mm,
        "manufacturing": system.manufacturing_half_width_mm[0],  # a document has one for all fiducials
        "fiducial_noise_px": np.array([view.fiducial_noise_px for view in system.views]),
        "target_noise_px": np.array([view.target_noise_px for view in system.views]),
        "targets": np.array([target.position_mm for target in system.targets]),
    }
    for mount in (*system.interfaces, system.hand_eye):
        numbers |= {f"{mount.name}.pivot": mount.pivot_mm, f"{mount.name}.bias": mount.bias}
    return numbers | {f"{name}.half_width": sources.half_width for name, sources in sources_of(system)}


def put_numbers(system: System, numbers: Numbers) -> System:
    """The compiled design with other numbers, (...) each as :func:`base_numbers` has them."""

    def read(field: str, now: Array) -> Array:
        return frozen(numbers[field]) if field in numbers else now

    def widen(name: str, sources: Sources) -> Sources:
        return replace(sources, half_width=read(f"{name}.half_width", sources.half_width))

    def move(mount: Mount) -> Mount:
        pivot, bias = read(f"{mount.name}.pivot", mount.pivot_mm), read(f"{mount.name}.bias", mount.bias)
        return replace(mount, pivot_mm=pivot, bias=bias, sources=widen(mount.name, mount.sources))

    stated = {**base_numbers(system), **numbers}
    first, second = move(system.structure_connector), move(system.connector_flange)
    noise = zip(stated["fiducial_noise_px"].tolist(), stated["target_noise_px"].tolist(), strict=True)
    return replace(
        system,
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
        structure_connector=first,
        connector_flange=second,
        temperature=system.temperature and system.temperature.follow(first, second),
        hand_eye=move(system.hand_eye),
        execution=widen("execution", system.execution),
    )


def find_slot(design: Design, system: System, place: Place) -> Slot | None:
    """Where a number of the document stands in the compiled design; None: it decides more than one number there."""
    match place:
        case ("fiducials", "points", int(i), "position_mm", int(k)):
            return Slot.of(Coordinate, "fiducials", i, k)
        case ("fiducials", "manufacturing", "half_width_mm", *axis):
            return Slot.of(HalfWidth, "manufacturing", *(axis or (slice(None),)))
        case ("views", int(v), "fiducial_noise_px" | "target_noise_px" as field):
            return Slot.of(Pixels, field, v)
        case ("targets", int(i), "position_mm", int(k)):
            name = design.document.targets[i].name
            return Slot.of(Coordinate, "targets", [target.name for target in system.targets].index(name), k)
        case ("interfaces", str(name), *rest):
            held = getattr(design.document.interfaces, name).locators is not None
            return _find_slot_of_mount(next(m for m in system.interfaces if m.name == name), rest, held)
        case ("execution", "hand_eye", *rest):
            return _find_slot_of_mount(system.hand_eye, rest, False)
        case ("execution", "repeatability", "std_mm" | "half_width_mm", *axis):
            return _find_slot_along_axes(system.execution, "repeatability", axis)
        case ("execution", "compliance", "load_half_width_n", *axis):
            return _find_slot_along_axes(system.execution, "load", axis)
    return None


def _find_slot_of_mount(mount: Mount, place: Sequence[str | int], held: bool) -> Slot | None:
    """held: by six locators, which follow its pivot."""
    field = f"{mount.name}.half_width"
    match place:
        case ("tolerances", str(component), "half_width_deg" | "half_width_mm"):
            k = mount.sources.names.index(component)
            turns = mount.sources.units[k] == "rad"
            return Slot.of(HalfWidthDegrees if turns else HalfWidth, field, k, turns=turns)
        case ("locators", int(k), "half_width_mm"):
            return Slot.of(HalfWidth, field, k)
        case ("pivot_mm", int(k)) if not held:
            return Slot.of(Coordinate, f"{mount.name}.pivot", k)
        case ("bias", str(component)):
            k = TORSOR_COMPONENTS.index(component.partition("_")[0])
            return Slot.of(Degrees if k < 3 else Coordinate, f"{mount.name}.bias", k, turns=k < 3)
    return None


def _find_slot_along_axes(sources: Sources, what: str, axis: Sequence[Any]) -> Slot | None:
    """Of one axis of the tool, or of all three; None where some of them do nothing and are no sources."""
    names = [f"{what}.{'xyz'[k]}" for k in (axis or range(3))]
    if not set(names) <= set(sources.names):
        return None
    return Slot.of(HalfWidth, "execution.half_width", [sources.names.index(name) for name in names])


def _find_other_law(system: System, touched: set[str]) -> str:
    """What of the design has another law than the normal one, and may be there; empty: nothing."""
    made = "manufacturing" in touched or system.manufacturing_half_width_mm.any()
    if made and system.manufacturing_law is not Law.NORMAL:
        return "fiducials.manufacturing"
    for name, sources in sources_of(system):
        for k, law in enumerate(sources.laws):
            if law is not Law.NORMAL and (sources.half_width[k] > 0 or f"{name}.half_width" in touched):
                return f"{name}, {sources.names[k]},"
    return ""


def _find_places(design: Design, pointers: Sequence[str]) -> list[tuple[Place, ...]]:
    """The numbers that each pointer leads to.  Raises SweepError for one that leads to none, or is given twice."""
    if not pointers:
        raise SweepError(Problem("/table", "no-columns", "a table has a column for at least one number of the design"))
    found: list[tuple[Place, ...]] = []
    for pointer in pointers:
        places = locate_numbers(design.source.data, pointer, "/table", SweepError)
        if any(not set(places).isdisjoint(earlier) for earlier in found):
            detail = f"two columns give the same number: the one for {pointer}, and one before it"
            raise SweepError(Problem("/table", "given-twice", detail, "leave one of them out"))
        found.append(places)
    return found


def _check_columns(columns: Sequence[str]) -> tuple[str, ...]:
    """Raises SweepError for a name that is none, or stands there twice."""
    for k, column in enumerate(columns):
        if column not in COLUMNS or column in columns[:k]:
            what = (
                f"the column {column!r} is asked for twice" if column in COLUMNS else f"there is no column {column!r}"
            )
            raise SweepError(Problem(f"/columns/{k}", "unknown-value", what, f"known: {', '.join(COLUMNS)}"))
    if not columns:
        raise SweepError(
            Problem("/columns", "too-short", "an answer has at least one column", f"known: {', '.join(COLUMNS)}")
        )
    return tuple(columns)
