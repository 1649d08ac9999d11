"""First order against the chain on one design: what is stated of it, what mode auto passes, and what trials say."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from datetime import date
from math import inf
from typing import Any
from unittest.mock import patch

import numpy as np

from random_designs import FIDUCIALS, RADII, RAYS_DEG, VIEWS, farness, random_design
from tailstack.contributors import error_law, mean_at, worst_vertices
from tailstack.design import check_design, load_design
from tailstack.effects import EFFECTS
from tailstack.montecarlo.chain import draw, run_indices
from tailstack.montecarlo.plan import compile_plan
from tailstack.montecarlo.radial import gains_in_plan_order
from tailstack.propagation.linear import LinearModel, linearise
from tailstack.propagation.validity import COUNTED, LEVELS, error_percent
from tailstack.results import Check
from tailstack.scoring import trust_of
from tailstack.system import Estimator, System
from tailstack.tail.declared import law_quantile
from tailstack_service.gate.case import compare_numbers
from tailstack_service.gate.judge import Gate, ScoredDesign, judge, plan_check, score_designs
from tailstack_service.gate.request import admit_gate

ERRORS = ("tcp", "localisation")
QUANTILES = (0.9, 0.95, 0.99, 0.999)
FACTORS = (0.9, 1.0, 1.011, 1.051, 1.31)  # limits over first order
BATCH = 8192
SLICE = 512  # trials whose deviates fit beside their columns into a core's own memory
SECTIONS = 8
CLEAR = 12  # designs drawn in search of one without a remark
MOST_REDONE = 2000  # trials
TOLERATED = 1.01  # trials may pass a design whose quantile is beyond its limit by so much
TODAY = date(2026, 11, 22)
EDGES = tuple(limit for limit, _, _ in LEVELS)  # every other far design is drawn just below one of them
NUMBERS = ("depth", "crossing", "disagreement", "gap", "range", "turns", "bias")
RADII_TO, RAYS_TO_DEG = (8, 16, 30), (8, 20, 35)  # the classes of far designs
DECLARED = (*(name for kind in EFFECTS for name in kind.section.model_fields), "sees")
REMARKS = ("projected-overlap", "flat-structure", "weak-resection", "small-parallax")


def paired_errors(
    system: System, trials: int, seed: int, ends: Mapping[str, float] | None = None
) -> tuple[np.ndarray, np.ndarray, float]:
    """(2, n) mm: the norms of the errors (``ERRORS``) by the full chain, and by first order in the same deviates; and
    which share of the trials the plain form of the chain redid, a thousand times slower.

    ends: of what is bounded, "contributor.component".
    """
    model, ends = linearise(system, system.targets[0]), ends or {}
    plan = compile_plan(system, vertex=ends)
    gains = np.vstack([gains_in_plan_order(plan, model.blocks, (0,), error) for error in ERRORS])
    means = np.concatenate([mean_at(model, error, ends) for error in ERRORS])[:, None]
    chain, linear, redone = np.empty((2, trials)), np.empty((2, trials)), 0
    for start in range(0, trials, BATCH):
        part = slice(start, min(start + BATCH, trials))
        outcome = run_indices(plan, seed, start, part.stop - start)
        chain[:, part] = np.linalg.norm(outcome.errors[0], axis=1)
        redone += outcome.redone
    for start in range(0, trials, SLICE):
        part = slice(start, min(start + SLICE, trials))
        moved = gains @ draw(plan, seed, np.arange(part.start, part.stop)).T + means
        linear[:, part] = np.linalg.norm(moved.reshape(2, 3, -1), axis=1)
    return chain, linear, redone / trials


def paired_norms(system: System, error: str, trials: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """(n,) mm: the norm of the error by the full chain, and by first order in the same deviates."""
    chain, linear, _ = paired_errors(system, trials, seed)
    return chain[ERRORS.index(error)], linear[ERRORS.index(error)]


def ratio(system: System, error: str, quantile: float, trials: int, seed: int) -> tuple[float, float]:
    """The chain's quantile over first order's and its standard error, by sections; most of the chance cancels."""
    norms = paired_norms(system, error, trials, seed)
    whole = np.quantile(norms[0], quantile) / np.quantile(norms[1], quantile)
    parts = [np.delete(np.arange(SECTIONS), k) for k in range(SECTIONS)]
    split = [each.reshape(SECTIONS, -1) for each in norms]
    left = [np.quantile(split[0][p], quantile) / np.quantile(split[1][p], quantile) for p in parts]
    return float(whole), float(np.sqrt((SECTIONS - 1) * np.var(left)))  # jackknife


def quantile_ratios(system: System, trials: int, seed: int) -> tuple[np.ndarray, np.ndarray, float]:
    """The chain's quantiles over first order's, (2, 4) of ``ERRORS`` at ``QUANTILES``, and their standard errors; and
    the share of trials that were redone (``paired_errors``).

    Of what is bounded both are the largest of those at the vertices that a check samples.
    """
    model = linearise(system, system.targets[0])
    found, redone = [], 0.0
    for vertex in _vertices(model):
        chain, linear, share = paired_errors(system, trials, seed, dict(vertex))
        norms, redone = np.stack([chain, linear]), redone + share
        parts = [norms, *np.split(norms, SECTIONS, axis=2)]
        found.append([np.quantile(part, QUANTILES, axis=2).transpose(1, 2, 0) for part in parts])
    chain, linear = np.moveaxis(np.max(found, axis=0), 1, 0)  # (1 + sections, 2, 4) each
    ratios = chain / linear
    return ratios[0], ratios[1:].std(axis=0) / np.sqrt(SECTIONS - 1), redone


def _vertices(model: LinearModel) -> Iterable[tuple[tuple[str, float], ...]]:
    ends = [ends for error in ERRORS for q in QUANTILES for ends in worst_vertices(model, error, q)]
    return dict.fromkeys(tuple(sorted(each.items())) for each in ends)


def classes_of(document: dict[str, Any], rules: Iterable[str]) -> tuple[str, ...]:
    """What a random design has, by name."""
    found = [e for e in DECLARED if any(e in place for place in (*document["views"], document, document["fiducials"]))]
    mounts = list(document["interfaces"].values())
    behind = document.get("execution", {}).get("hand_eye")
    every = [*mounts, *([behind] if behind else [])]
    believed = document["model"].get("estimator", "dlt").startswith("pose")
    wrong = [
        view["intrinsics_error"].get("focal", {}).get("bias_rel")
        for view in document["views"]
        if believed and "intrinsics_error" in view
    ]
    found += ["known error of intrinsics"] if any(wrong) else []
    found += ["hand_eye"] if behind else []
    found += ["robot"] if "robot" in document.get("execution", {}) else []
    found += ["known error of a mount"] if any("bias" in mount for mount in mounts) else []
    found += [document["name"]] if document["name"] != "random" else []
    found += ["locators"] if any("locators" in mount for mount in mounts) else []
    laws = [t["distribution"] for mount in every for t in mount.get("tolerances", {}).values()]
    found += ["bounded"] if "bounded" in laws else []
    turned = [name for mount in every for name in mount.get("tolerances", {}) if name[0] == "r"]
    found += ["turns by tolerances"] if turned else []
    aim = np.array(document["targets"][0]["position_mm"])
    pivots = [mount["pivot_mm"] for mount in (*every, *(v["motion"] for v in document["views"] if "motion" in v))]
    found += ["pivot beyond 400 mm"] if any(np.linalg.norm(aim - pivot) > 400 for pivot in pivots) else []
    found += ["manufacturing errors"] if "manufacturing" in document["fiducials"] else []
    found += ["eq18"] if "installation_reading" in document["model"] else []
    found += far_classes(*farness(document))
    remarks = [rule for rule in REMARKS if rule in rules]
    return (*found, *(remarks or ["no remark"]))


def far_classes(radii: float, rays_deg: float) -> list[str]:
    """Of a target 4 to 30 radii of the fiducials away whose rays are 2 to 35 degrees apart; none of another."""
    if not (RADII[0] <= radii <= RADII[1] and RAYS_DEG[0] <= rays_deg <= RAYS_DEG[1]):
        return []
    return [
        next(f"far: up to {most} radii" for most in RADII_TO if radii <= most),
        next(f"far: rays within {most} deg" for most in RAYS_TO_DEG if rays_deg <= most),
    ]


@dataclass(frozen=True)
class Form:
    """What estimates a design, and what goes wrong."""

    estimator: str = "dlt"
    triangulation: str = "normalised"
    effects: bool = False  # in the images
    corners: bool = False  # turns, locators, motion about far pivots, known errors
    fiducials: tuple[int, ...] = FIDUCIALS
    far: bool = False  # the target lies many radii of the fiducials away, and its rays are nearly parallel
    arm: bool = False  # a robot goes from the shots to the tool

    @property
    def name(self) -> str:
        return f"{self.estimator}, {self.triangulation}"


def form_of(text: str, effects: bool, corners: bool, far: bool = False, arm: bool = False) -> Form:
    """Of an estimator with its triangulation, ``pose+weighted``; what knows the intrinsics needs fewer fiducials."""
    estimator, _, triangulation = text.partition("+")
    few = (4, 5) if Estimator(estimator).believes_intrinsics else ()
    return Form(estimator, triangulation, effects, corners, (*few, *FIDUCIALS), far, arm)


@dataclass(frozen=True)
class Held:
    """What is stated of a design, what the gate does by it, and what trials say."""

    form: Form
    views: int
    fiducials: int
    classes: tuple[str, ...]  # what it has, and what is remarked of its geometry
    status: str
    numbers: tuple[float, ...]  # of the validity: ``NUMBERS``
    percents: tuple[float, ...]  # stated, at each of ``QUANTILES``; infinite where nothing is
    ratios: tuple[tuple[float, ...], ...]  # chain over first order of ``ERRORS`` at each; none where not asked
    deviations: tuple[tuple[float, ...], ...]  # their standard errors
    trials: int
    redone: float  # share of them that the plain form redid
    seed: int  # of the trials
    error: str  # of what the gate was asked
    quantile: float
    passed_by_first_order: float | None  # without a guard band: least factor at which it is passed
    failed_by_first_order: float | None  # the largest at which it fails
    sampled: tuple[float, str] | None  # a limit that was judged by trials: its factor, the verdict
    document: dict[str, Any] = field(repr=False)

    @property
    def stated(self) -> bool:
        return self.status != "not valid"

    @property
    def believed(self) -> bool:
        """By mode auto, for a limit that is far enough."""
        return self.passed_by_first_order is not None

    @property
    def passed_by_trials(self) -> bool:
        return self.sampled is not None and self.sampled[1] == "pass"

    @property
    def ratio(self) -> float:
        """Chain over first order of what the gate was asked."""
        return self.ratios[ERRORS.index(self.error)][QUANTILES.index(self.quantile)]

    def worst(self, quantiles: slice = slice(None)) -> float:
        """How much of what is stated the largest error takes: beyond 1 the statement is broken; its sign is that of
        optimism.  0 where nothing is stated."""
        if not self.stated:
            return 0.0
        used = np.log([each[quantiles] for each in self.ratios])
        shares = used / np.log1p(np.array(self.percents[quantiles]) / 100)
        return float(shares.flat[np.abs(shares).argmax()])

    @property
    def optimistic(self) -> float:
        """How much of what is stated the largest error towards optimism takes."""
        return float((np.log(self.ratios) / np.log1p(np.array(self.percents) / 100)).max()) if self.stated else 0.0

    @property
    def excess(self) -> float:
        """The chain's quantile over the least limit that first order passes it at, less one; -1: passed at none."""
        return self.ratio / self.passed_by_first_order - 1 if self.passed_by_first_order else -1.0

    @property
    def excess_of_trials(self) -> float:
        """The same of a limit that trials passed."""
        return self.ratio / self.sampled[0] - 1 if self.passed_by_trials and self.sampled else -1.0

    @property
    def wrong(self) -> bool:
        """By first order passed although beyond the limit, or failed although within it; or passed by trials although
        beyond by more than is tolerated."""
        return self.wrong_beyond(0.0) or self.excess_of_trials > TOLERATED - 1

    def wrong_beyond(self, errors: float) -> bool:
        """By first order passed or failed wrongly, by more than so many standard errors of the trials."""
        if not self.ratios:
            return False
        chance = errors * self.deviations[ERRORS.index(self.error)][QUANTILES.index(self.quantile)]
        passed, failed = self.passed_by_first_order, self.failed_by_first_order if self.stated else None
        over = passed is not None and self.ratio - chance > passed
        return over or (failed is not None and self.ratio + chance < failed)

    def broken_beyond(self, errors: float) -> bool:
        """Whether something that is stated is broken, by more than so many standard errors of the trials."""
        if not self.stated:
            return False
        off = np.abs(np.log(self.ratios)) - np.log1p(np.array(self.percents) / 100)
        return bool((off > errors * np.array(self.deviations)).any())


def _gate(document: dict[str, Any], guard: int, max_trials: int, seed: int) -> Gate:
    off = ("overlap", "conditioning", "visibility", "first-order-gap")  # what is remarked besides the numbers
    policy = {
        "schema": "tailstack/policy/1", "guard_band_percent": guard, "verification": {"max_trials": max_trials},
        "rules": {name: {"severity": "note"} for name in off},
    }  # fmt: skip
    body = {"designs": [{"file": "d.json", "design": document}], "policy": policy, "mode": "auto", "seed": seed}
    return admit_gate(body, today=TODAY).gate


def _by_first_order(gate: Gate, computed: ScoredDesign, check: Check) -> str | None:
    """What mode auto says of one of the limits alone without a trial; None: it samples."""
    alone = replace(computed, score=replace(computed.score, verdict=replace(computed.score.verdict, checks=(check,))))
    if plan_check(gate, alone) is not None:
        return None
    (comparison,) = compare_numbers(alone.score, None, alone.requirements)
    return comparison.number.status


def hold_design(
    rng: np.random.Generator,
    form: Form,
    nu: tuple[float, float],
    looks: tuple[int, ...],
    precise: float = inf,
    judged_trials: int = 0,
) -> Held:
    """Draw a design, hold it to limits about its first order in the gate, and what is stated of it to trials.

    looks, precise: see :func:`hold_to_trials`.  judged_trials: how many a sampled verdict takes at most; 0: there is
    none.
    """
    views, fiducials = int(rng.choice((2, 2, *VIEWS) if form.far else VIEWS)), int(rng.choice(form.fiducials))
    seed, clear = int(rng.integers(2**31)), int(rng.choice([0, CLEAR, CLEAR]))
    if form.far:
        edge, times = rng.choice(EDGES), COUNTED.get(fiducials, 1.0)
        nu = (0.7 * edge / times, edge / times) if rng.random() < 0.5 else (nu[0] / times, nu[1] / times)
    document = random_design(
        rng, views, fiducials, False, nu, clear, form.estimator, form.triangulation, form.effects, form.corners,
        form.far, form.arm,
    )  # fmt: skip
    error, quantile = str(rng.choice(ERRORS)), float(rng.choice([0.95, 0.95, 0.95, 0.9, 0.99, 0.999]))
    judged_at = float(rng.choice(FACTORS))

    def limited(*limits_mm: float) -> dict[str, Any]:
        named = [
            {"name": f"r{k}", "limit_mm": limit, "error": error, "quantile": quantile}
            for k, limit in enumerate(limits_mm)
        ]
        return {**document, "requirements": named}

    system = check_design(load_design(document))[0]
    law = error_law(linearise(system, system.targets[0]), error, quantile).law
    value = law_quantile(law, quantile).quantile_mm
    held = limited(*(factor * value for factor in FACTORS))
    with patch("tailstack.scoring._score_target"):  # it decides nothing, and is most of a score's time
        (computed,) = score_designs(_gate(held, 10, 2**14, seed))
    score = computed.score
    gate = _gate(held, 0, 2**14, seed)
    said = [_by_first_order(gate, computed, check) for check in score.verdict.checks]
    least = min((f for f, status in zip(FACTORS, said, strict=True) if status == "pass"), default=None)
    highest = max((f for f, status in zip(FACTORS, said, strict=True) if status == "fail"), default=None)
    sampled = None
    if judged_trials:
        with patch("tailstack.scoring.budget", return_value=()):
            record = judge(_gate(limited(judged_at * value), 10, judged_trials, seed + 1))
        if record.designs[0].basis == "Monte Carlo":
            sampled = (judged_at, str(record.verdict))
    percents = tuple(error_percent(score.validity, q) for q in QUANTILES)
    rules = {finding.rule for finding in score.verdict.findings}
    row = Held(
        form, views, fiducials, classes_of(document, rules), score.validity.status,
        tuple(getattr(score.validity, f"nu_{name}") for name in NUMBERS), percents, (), (), 0, 0.0, seed,
        error, quantile, least, highest, sampled, document,
    )  # fmt: skip
    return hold_to_trials(row, looks, precise)


def restate(row: Held) -> Held:
    """The row as it would be stated of its design today."""
    system = check_design(load_design(row.document))[0]
    trust = trust_of(system, {"t": linearise(system, system.targets[0])})
    return replace(
        row, status=trust.status, numbers=tuple(getattr(trust, f"nu_{name}") for name in NUMBERS),
        percents=tuple(error_percent(trust, q) for q in QUANTILES),
        passed_by_first_order=row.passed_by_first_order if trust.expected_error_percent is not None else None,
    )  # fmt: skip


def hold_to_trials(row: Held, looks: tuple[int, ...], precise: float = inf) -> Held:
    """The row with the ratios of its design, where something is stated of it or trials passed it.

    looks: so many trials in turn, from the same seed; where there were none before, the first tells only how many of
    them the plain form has to redo.  They end where no ratio is within four standard errors of what is stated, that of
    a limit which trials passed within four of what is tolerated, and those of P95 have standard errors of ``precise``
    at most; or before so many that the plain form would redo 2,000.
    """
    passed, fresh = row.passed_by_trials, row.trials == 0
    system = check_design(load_design(row.document))[0]
    for trials in looks if row.stated or passed else ():
        if trials > looks[0] and trials * row.redone > MOST_REDONE:
            break
        ratios, deviations, redone = quantile_ratios(system, trials, row.seed)
        each = tuple(map(tuple, ratios.tolist())), tuple(map(tuple, deviations.tolist()))
        row = replace(row, ratios=each[0], deviations=each[1], trials=trials, redone=redone)
        edge = np.log1p(np.array(row.percents) / 100)
        near = bool((np.abs(edge - np.abs(np.log(ratios))) < 4 * deviations).any())
        if passed:
            near |= abs(row.excess_of_trials - (TOLERATED - 1)) < 4 * deviations.max()
        if not near and deviations[:, 1].max() <= precise and not (fresh and trials == looks[0]):
            break
    return row
