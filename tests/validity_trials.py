"""First order against the chain on one design: how far it is off, and whether mode auto passes what it should not."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from datetime import date
from math import nan
from typing import Any
from unittest.mock import patch

import numpy as np

from random_designs import FIDUCIALS, VIEWS, random_design
from tailstack.contributors import error_law
from tailstack.design import check_design, load_design
from tailstack.montecarlo import compile_plan, draw, evaluate, gains_in_plan_order
from tailstack.propagation.linear import linearise
from tailstack.results import Check
from tailstack.system import System
from tailstack.tail.declared import law_quantile
from tailstack_service.gate.case import compare_numbers
from tailstack_service.gate.judge import Gate, ScoredDesign, judge, plan_check, score_designs
from tailstack_service.gate.request import admit_gate, read_gate

ERRORS = ("tcp", "localisation")
FACTORS = (0.9, 0.95, 0.98, 1.0, 1.011, 1.03, 1.051, 1.07, 1.112, 1.15, 1.2, 1.3)  # limits over first order
BATCH = 8192
SECTIONS = 8
TOLERATED = 1.01  # a design may be passed whose quantile is beyond its limit by so much
TODAY = date(2026, 11, 22)


def paired_norms(system: System, error: str, trials: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """(n,) mm: the norm of the error by the full chain, and by first order in the same deviates."""
    plan, model = compile_plan(system), linearise(system, system.targets[0])
    gain = gains_in_plan_order(plan, model.blocks, 0, error)
    chain, linear = np.empty(trials), np.empty(trials)
    for start in range(0, trials, BATCH):
        z = draw(plan, seed, np.arange(start, min(start + BATCH, trials)))
        part = slice(start, start + len(z))
        chain[part] = np.linalg.norm(evaluate(plan, z)[:, 0, ERRORS.index(error)], axis=1)
        linear[part] = np.linalg.norm(z @ gain.T + model.bias_mm(error), axis=1)
    return chain, linear


def ratio(system: System, error: str, quantile: float, trials: int, seed: int) -> tuple[float, float]:
    """The chain's quantile over first order's and its standard error, by sections; most of the chance cancels."""
    norms = paired_norms(system, error, trials, seed)
    whole = np.quantile(norms[0], quantile) / np.quantile(norms[1], quantile)
    parts = [np.delete(np.arange(SECTIONS), k) for k in range(SECTIONS)]
    split = [each.reshape(SECTIONS, -1) for each in norms]
    left = [np.quantile(split[0][p], quantile) / np.quantile(split[1][p], quantile) for p in parts]
    return float(whole), float(np.sqrt((SECTIONS - 1) * np.var(left)))  # jackknife


@dataclass(frozen=True)
class Form:
    """What estimates a design, and what goes wrong in its images."""

    estimator: str = "dlt"
    triangulation: str = ""  # "": normalised, of every tenth design published
    effects: bool = False
    fiducials: tuple[int, ...] = FIDUCIALS

    @property
    def name(self) -> str:
        return f"{self.estimator}, {self.triangulation or 'linear'}"


@dataclass(frozen=True)
class Trial:
    """One design held to limits about its first-order quantile."""

    form: Form
    views: int
    fiducials: int
    published: bool
    quantile: float
    status: str
    believed: bool  # by mode auto, for a limit that is far enough
    ratio: float  # chain over first order; nan where it was not asked
    standard_error: float
    passed_by_first_order: dict[int, float | None]  # guard band, per cent: least factor at which it is passed
    failed_by_first_order: dict[int, float | None]  # the largest at which it fails
    sampled: tuple[float, str] | None  # a limit that was judged by trials: its factor, the verdict
    document: dict[str, Any] = field(repr=False)

    def excess(self, guard: int) -> float:
        """The chain's quantile over the least limit that first order passes it at, less one; -1: passed at none."""
        least = self.passed_by_first_order.get(guard)
        return -1.0 if least is None else self.ratio / least - 1

    def wrong(self, guard: int) -> bool:
        """Passed by first order, or by trials, although beyond the limit by more than is tolerated."""
        by_trials = self.sampled is not None and self.sampled[1] == "pass" and self.ratio / self.sampled[0] > TOLERATED
        return by_trials or self.excess(guard) > TOLERATED - 1


def _gate(document: dict[str, Any], guard: int, max_trials: int, seed: int) -> Gate:
    off = ("overlap", "conditioning", "visibility", "first-order-gap")  # what is remarked besides the numbers
    policy = {
        "schema": "tailstack/policy/1", "guard_band_percent": guard, "verification": {"max_trials": max_trials},
        "rules": {name: {"severity": "note"} for name in off},
    }  # fmt: skip
    body = {"designs": [{"file": "d.json", "design": document}], "policy": policy, "mode": "auto", "seed": seed}
    return read_gate(admit_gate(body, today=TODAY))


def _by_first_order(gate: Gate, computed: ScoredDesign, check: Check) -> str | None:
    """What mode auto says of one of the limits alone without a trial; None: it samples."""
    assert computed.score is not None
    alone = replace(computed, score=replace(computed.score, verdict=replace(computed.score.verdict, checks=(check,))))
    if plan_check(gate, alone) is not None:
        return None
    assert alone.score is not None
    (comparison,) = compare_numbers(alone.score, None, alone.requirements)
    return comparison.number.status


def held_to_limits(
    rng: np.random.Generator, *, trials: int, judged_trials: int, nu: tuple[float, float], form: Form = Form()
) -> Trial:
    """Draw a design of any class and hold it to limits about its first order.

    judged_trials: up to how many a sampled verdict takes; 0: none is sampled.
    """
    views, fiducials = int(rng.choice(VIEWS)), int(rng.choice(form.fiducials))
    published, seed = bool(rng.random() < 0.1) and not form.triangulation, int(rng.integers(2**31))
    document = random_design(
        rng, views, fiducials, published, nu, int(rng.choice([0, 10])), form.estimator, form.triangulation, form.effects
    )
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
    with patch("tailstack.scoring.budget", return_value=()):  # it decides nothing, and is most of a score's time
        (computed,) = score_designs(_gate(held, 10, 2**14, seed))
    assert computed.score is not None
    least: dict[int, float | None] = {}
    highest: dict[int, float | None] = {}
    for guard in (0, 10):
        gate = _gate(held, guard, 2**14, seed)
        said = [_by_first_order(gate, computed, check) for check in computed.score.verdict.checks]
        least[guard] = min((f for f, status in zip(FACTORS, said, strict=True) if status == "pass"), default=None)
        highest[guard] = max((f for f, status in zip(FACTORS, said, strict=True) if status == "fail"), default=None)

    found, deviation = nan, nan  # of what first order does not decide and no verdict was sampled
    if least[0] is not None or judged_trials:
        found, deviation = ratio(system, error, quantile, trials, seed)
    for _ in range(2):  # what is near the tolerance is sampled until it is known on which side of it
        if least[0] is not None and abs(found / (TOLERATED * least[0]) - 1) < 4 * deviation + 0.003:
            trials *= 8
            found, deviation = ratio(system, error, quantile, trials, seed)
    sampled = None
    if judged_trials:
        with patch("tailstack.scoring.budget", return_value=()):
            record = judge(_gate(limited(judged_at * value), 10, judged_trials, seed + 1))
        if record.designs[0].basis == "Monte Carlo":
            sampled = (judged_at, str(record.verdict))
            if record.verdict == "pass" and abs(found / (TOLERATED * judged_at) - 1) < 4 * deviation + 0.003:
                found, deviation = ratio(system, error, quantile, 8 * trials, seed)
    return Trial(
        form, views, fiducials, published, quantile, computed.score.validity.status, least[0] is not None, found,
        deviation, least, highest, sampled, document,
    )  # fmt: skip
