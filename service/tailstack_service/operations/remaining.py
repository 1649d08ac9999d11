"""How long an optimisation will still take, from what its stages have taken so far.

For each number of fiducials the optimiser draws layouts to start from, builds the programme, solves it from every start
and polishes the best.  Then it settles the exact law, checks, traces the front and compares with other layouts.  What
has been measured is extrapolated; what has not begun is a multiple of what has.  The multiples are rough, taken from
recorded courses, so that the time shown is within a factor of two of the truth.
"""

from __future__ import annotations

from dataclasses import dataclass, field

FOR_EACH_COUNT = ("layout", "programme", "point", "start", "polish")
FOR_ALL = ("settle", "check", "front", "compare")
# Of the time before the first report: building a programme, before one is built; so many targets double it
PROGRAMME, MANY_TARGETS = 4.0, 8
# Multiples of the time that building the programme took, which grows with what the other stages grow with
MULTIPLES = {"point": 0.02, "start": 0.05, "settle": 0.25, "check": 0.4, "compare": 0.25}
LEAST_SECONDS = {"settle": 0.15, "check": 0.7, "compare": 0.5}  # their parts that do not grow
PER_UNIT = 2.5  # times as long, where a limit is per unit
POLISHED, POLISH = 3, 2.0  # the best starts are solved again one by one: in units of a start's time and of the cores
FEW_FIDUCIALS = 9  # with more, full precision takes longer in that proportion
SETTLE = 0.3  # of the time for polishing one, at least
FRONT_POINT = 3.7  # of the check, for a point is settled and checked several times
FIRST_COMPARED, SETTLED = 0.45, 5  # of the mean time of the first layouts compared with, for each of the others
BURST = 0.1  # steps that end within this part of the first one's time ended side by side
OVERDUE = 0.3  # what took so much longer than was thought still takes that part of it


@dataclass(slots=True)
class Pace:
    """How fast the steps of a stage follow one another."""

    begun: float  # when the stage began, seconds
    first: float = 0.0  # when its first steps ended
    burst: int = 0  # how many these were
    last: float = 0.0
    done: int = 0

    def report(self, done: int, at: float) -> None:
        if self.done == 0 or at - self.first < BURST * (self.first - self.begun):
            self.first, self.burst = (self.first if self.done else at), done
        self.done, self.last = done, at

    def each(self, now: float) -> float:
        """Seconds for a step: the first ones, which begin it all, count only until others have followed."""
        if self.done > self.burst:
            measured = (self.last - self.first) / (self.done - self.burst)
            return max(measured, (now - self.first) / (self.done - self.burst + 1))
        alone = 1.0 if self.burst == 1 else 0.5
        return alone * (self.last - self.begun) / self.done


@dataclass(slots=True)
class RemainingTime:
    """Fed with what the optimiser reports, it says how long the rest takes."""

    cores: int
    front_points: int = 0  # 0: no front is wanted
    per_unit: bool = False  # whether a limit is per unit
    settles: bool = True  # whether the exact law is settled at the limits
    compares: bool = True  # whether other layouts are compared with
    targets: int = 1
    fiducials: int = 12
    counts: int = 1  # numbers of fiducials that are tried
    tried: int = 0  # of these, the ones that are over
    stage: str = ""  # of the latest report
    at: float = 0.0  # of the latest report, seconds
    steps: int = 0  # of that stage, still to come
    starts: int = 1  # for each number of fiducials
    programme: float = 0.0  # seconds that building it took
    start: float = 0.0  # seconds for one, for the number of fiducials before
    begun: float = 0.0  # the work for this number of fiducials
    spent: list[float] = field(default_factory=list)  # seconds for each of the numbers before
    pace: dict[str, Pace] = field(default_factory=dict)  # by stage, of this number of fiducials

    def report(self, stage: str, done: int, total: int, at: float) -> None:
        """A step that ended, and when, in seconds."""
        if stage in ("layout", "programme") and self.stage == "polish":  # the next number of fiducials
            self.start = self._start(self.at)
            self.spent.append(self.at - self.begun)
            self.tried, self.begun, self.pace = self.tried + 1, self.at, {}
        if not self.stage:
            self.programme = PROGRAMME * at * (1 + self.targets / MANY_TARGETS)
        if stage == "programme":
            self.counts, self.programme = total, max(at - self.at, 1e-3)
        each = total // self.counts if stage in FOR_EACH_COUNT else total
        done = done - self.tried * each if stage in FOR_EACH_COUNT else done
        self.pace.setdefault(stage, Pace(self.at)).report(max(done, 1), at)
        self.starts = each if stage in ("layout", "start") else self.starts
        self.steps = 0 if stage == "check" else max(each - done, 0)  # it passes nearly always at the first time
        self.stage, self.at = stage, at

    def left(self, now: float) -> float | None:
        """Seconds left; None while nothing can be said."""
        if not self.stage:
            return None
        each = self.stage in FOR_EACH_COUNT
        here = self._coming(FOR_EACH_COUNT, now) if each else []
        once = self._coming(FOR_ALL, now)
        others = 0.0
        if each:
            rounds = [*self.spent, self.at - self.begun + sum(here)]
            others = (self.counts - self.tried - 1) * sum(rounds) / len(rounds)
        running = next((seconds for seconds in (*here, *once) if seconds > 0), 0.0)
        if self.steps:
            running = self.pace[self.stage].each(now)
        since = now - self.at
        return sum(here) + others + sum(once) - min(since, running) + OVERDUE * max(since - running, 0.0)

    def _coming(self, stages: tuple[str, ...], now: float) -> list[float]:
        """Seconds of the rest of the present stage and of those after it."""
        if self.stage not in stages:
            return [self._whole(stage, now) for stage in stages]
        after = [self._whole(stage, now) for stage in stages[stages.index(self.stage) + 1 :]]
        pace = self.pace[self.stage]
        if self.stage == "compare" and pace.done < SETTLED:  # the first ones begin it all, and differ
            return [
                max(self._whole("compare", now), FIRST_COMPARED * self.steps * (pace.last - pace.begun) / pace.done)
            ]
        if self.stage == "compare":
            measured = self.steps * pace.each(now)
            return [max(measured, self._whole("compare", now) * max(self.steps / (self.steps + pace.done), 0.5))]
        return [self.steps * pace.each(now), *after] if self.steps else after

    def _whole(self, stage: str, now: float) -> float:
        """Seconds of a stage that has not begun."""
        if (stage == "compare" and not self.compares) or (stage == "settle" and not self.settles):
            return 0.0
        if stage == "start":
            return self.starts * self._start(now)
        if stage == "point":
            return self.starts * MULTIPLES["point"] * self.programme
        if stage == "polish":
            larger = max(self.fiducials / FEW_FIDUCIALS, 1.0)
            return min(POLISHED, self.starts) * POLISH * larger * self.cores * self._start(self.at)
        if stage == "front":
            check = MULTIPLES["check"] * self.programme
            if self.stage == "check":
                check = self.at - self.pace["check"].begun
            return self.front_points * FRONT_POINT * check
        guess = max(MULTIPLES.get(stage, 1.0) * self.programme, LEAST_SECONDS.get(stage, 0.0))
        guess *= PER_UNIT if self.per_unit and stage in ("settle", "check") else 1.0
        if stage == "settle" and "polish" in self.pace:
            guess = max(guess, SETTLE * self.pace["polish"].each(self.at))
        return guess

    def _start(self, now: float) -> float:
        """Seconds for a start."""
        if "start" in self.pace:
            return self.pace["start"].each(now if self.stage == "start" and self.steps else self.at)
        return self.start or MULTIPLES["start"] * self.programme
