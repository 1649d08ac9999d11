"""What ``/metrics`` tells Prometheus: requests counted here, jobs and workers read from the database when asked."""

from __future__ import annotations

import os
from collections.abc import Iterator

from prometheus_client import CollectorRegistry, Counter, Histogram, generate_latest, multiprocess
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

from ..environment import COUNTERS
from ..jobs.store.database import Database
from ..jobs.store.usage import Figures, read_figures

FRESH_SECONDS = 60.0  # a worker that was not seen for so long counts as gone
STORE_SECONDS = 5.0  # for the database to answer: Prometheus gives a page up after ten
CONTENT_TYPE = "text/plain; version=0.0.4; charset=utf-8"
SECONDS = (0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1, 2.5, 5, 10, 30, 60)
NO_ROUTE = "(none)"


class Metrics:
    """Counters of this process; with several API processes, of all of them."""

    def __init__(self) -> None:
        # with several processes the values live in files, and a registry of one process would count them twice
        shared = bool(os.environ.get(COUNTERS))
        self._registry = CollectorRegistry()
        own = CollectorRegistry() if shared else self._registry
        labels = ("method", "route")
        self._requests = Counter("tailstack_http_requests", "Requests answered.", (*labels, "status"), registry=own)
        words = "Seconds until a request was answered."
        self._seconds = Histogram("tailstack_http_request_seconds", words, labels, buckets=SECONDS, registry=own)
        if shared:
            multiprocess.MultiProcessCollector(self._registry)  # type: ignore[no-untyped-call]

    def count_answer(self, method: str, route: str, status: int, seconds: float) -> None:
        """Count one request under the template of its route, never under its path: paths are without end."""
        self._requests.labels(method, route, str(status)).inc()
        self._seconds.labels(method, route).observe(seconds)

    def page(self, database: Database | None) -> bytes:
        """The text format of Prometheus.  Without a database, what this process knows."""
        text: bytes = generate_latest(self._registry)
        if database is not None:
            registry = CollectorRegistry()
            registry.register(_StoreCollector(database))
            text += generate_latest(registry)
        return text


class _StoreCollector(Collector):
    """Jobs, units and workers as the database knows them, the same from every API process."""

    def __init__(self, database: Database) -> None:
        self.database = database

    def describe(self) -> list[Metric]:
        return []

    def collect(self) -> Iterator[Metric]:
        now: Figures = read_figures(self.database.within(STORE_SECONDS), fresh_seconds=FRESH_SECONDS)
        jobs = GaugeMetricFamily("tailstack_jobs", "Jobs by state.", labels=["state"])
        for state, count in now.jobs.items():
            jobs.add_metric([state], count)
        yield jobs
        waits = "Age of the unit that waits longest; 0: none waits."
        yield GaugeMetricFamily("tailstack_units_ready", "Units that wait for a worker.", now.ready_units)
        yield GaugeMetricFamily("tailstack_oldest_ready_unit_seconds", waits, now.oldest_ready_seconds)
        yield GaugeMetricFamily("tailstack_units_leased", "Units in the hands of workers.", now.leased_units)
        yield CounterMetricFamily("tailstack_units_recorded", "Units recorded.", now.recorded_units)
        yield CounterMetricFamily("tailstack_units_cpu_seconds", "CPU seconds of recorded units.", now.cpu_seconds)
        yield GaugeMetricFamily("tailstack_workers_alive", "Workers whose heartbeat is fresh.", now.live_workers)
