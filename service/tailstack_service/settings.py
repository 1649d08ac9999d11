"""Limits and addresses of the service: one frozen record, read once from ``TAILSTACK_*`` variables."""

from __future__ import annotations

import difflib
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from tailstack.cores import usable_cores
from tailstack.errors import Problem

from .names import OF_PROCESSES, OF_TESTS, OTHERS, PREFIX
from .problems import SettingsError

# Kubernetes tells every container of every Service of its namespace, one that is called tailstack-... among them
_OF_KUBERNETES = re.compile(
    PREFIX + r"(\w+_)?(SERVICE_HOST|SERVICE_PORT(_\w+)?|PORT_\d+_(TCP|UDP|SCTP)(_(PROTO|PORT|ADDR))?)"
)
_KUBERNETES_ADDRESS = re.compile(r"(tcp|udp|sctp)://.+")  # the value of ..._PORT, of which people think otherwise


def _setting(default: Any, meaning: str, low: float, high: float) -> Any:
    return field(default=default, metadata={"meaning": meaning, "low": low, "high": high})


def _text(default: str, meaning: str, *, choices: tuple[str, ...] = ()) -> Any:
    return field(default=default, metadata={"meaning": meaning, "choices": choices})


@dataclass(frozen=True, slots=True)
class Settings:
    """Everything that an operator can set.  Field ``max_trials`` is the variable ``TAILSTACK_MAX_TRIALS``."""

    # What one request may ask for
    max_body_bytes: int = _setting(1_000_000, "bytes of a request body", 1_000, 100_000_000)
    body_seconds: float = _setting(20.0, "seconds for a body to arrive", 0.1, 3_600)
    max_fiducials: int = _setting(200, "fiducials of a design", 6, 1000)
    max_targets: int = _setting(50, "targets of a design, regions expanded", 1, 200)
    max_views: int = _setting(8, "views of a design", 2, 16)
    max_trials: int = _setting(5_000_000, "trials of one verification", 100, 1_000_000_000)
    max_starts: int = _setting(32, "starts of one optimisation", 1, 256)
    max_sweep_points: int = _setting(2_000, "points of one sweep", 1, 1_000_000)
    max_gate_designs: int = _setting(50, "designs of one gate", 1, 1_000)

    # What is computed while the caller waits
    max_seconds: float = _setting(60.0, "seconds of one computation that is answered at once", 0.1, 86_400)
    warm_up_seconds: float = _setting(5.0, "seconds that a request waits for the kernels to be compiled", 0, 600)
    max_wait_seconds: float = _setting(60.0, "seconds that `Prefer: wait` may ask for", 0, 600)
    short_workers: int = _setting(2, "processes that compute what is answered at once, per API process", 1, 256)
    max_waiting: int = _setting(64, "computations that may wait for one of them, per API process", 0, 100_000)
    max_streams: int = _setting(100, "event streams open at once, per API process", 1, 10_000)
    max_tenant_streams: int = _setting(
        25, "event streams of one tenant open at once, per API process, where callers are told apart", 1, 10_000
    )
    api_processes: int = _setting(1, "API processes behind one port", 1, 64)

    # Jobs
    database: str = _text(
        "", "where jobs are kept: sqlite:///PATH or postgresql://USER:PASSWORD@HOST/NAME; empty: a SQLite file of yours"
    )
    max_queued_jobs: int = _setting(2_000, "unfinished jobs of one tenant", 1, 1_000_000)
    cpu_seconds_per_hour: float = _setting(0.0, "CPU seconds of one tenant's jobs in an hour; 0: any", 0, 1e9)
    max_job_seconds: float = _setting(3_600.0, "CPU seconds of one job", 1, 1e7)
    keep_days: float = _setting(30.0, "days for which finished jobs and their results are kept", 0.001, 36_500)
    audit_days: float = _setting(365.0, "days for which entries of the audit log are kept", 1, 36_500)
    worker_processes: int = _setting(usable_cores(), "computing processes of one worker (engine pool)", 1, 256)
    lease_seconds: float = _setting(15.0, "seconds after which a silent worker's units are given to another", 1, 3_600)
    poll_seconds: float = _setting(0.05, "seconds between an idle worker's looks for work", 0.005, 60)
    hang_seconds: float = _setting(
        30.0, "seconds for which a computing process may use no processor time before it counts as hung", 1, 86_400
    )
    max_unit_deaths: int = _setting(5, "computing processes that one unit may take with it", 1, 100)
    max_unit_attempts: int = _setting(25, "times that one unit is begun, whatever ended it", 1, 1_000)

    # Where units are computed
    engine: str = _text("pool", "where units are computed", choices=("pool", "dask"))
    dask_scheduler: str = _text("", "address of the Dask scheduler, tls://HOST:PORT")
    dask_ca_file: str = _text("", "certificate authority of the Dask cluster, PEM")
    dask_cert_file: str = _text("", "certificate shown to the Dask cluster, PEM")
    dask_key_file: str = _text("", "private key of that certificate, PEM")

    # Who may ask
    auth: str = _text("none", "none (loopback only) or required", choices=("none", "required"))
    jwt_key_file: str = _text("", "PEM public key, JWKS file or shared secret that JSON Web Tokens are checked with")
    jwt_algorithm: str = _text(
        "RS256", "the only algorithm accepted in JSON Web Tokens", choices=("RS256", "ES256", "EdDSA", "HS256")
    )
    jwt_issuer: str = _text("", "required `iss` of JSON Web Tokens")
    jwt_audience: str = _text("tailstack", "required `aud` of JSON Web Tokens")
    allowed_hosts: str = _text("", "further names, comma-separated, that the Host header may carry")

    # What is told
    log_format: str = _text("text", "log lines on stderr as text or as JSON", choices=("text", "json"))

    def __post_init__(self) -> None:
        for entry in fields(self):
            value, rule = getattr(self, entry.name), entry.metadata
            if "low" in rule and not rule["low"] <= value <= rule["high"]:
                raise _bad(entry.name, f"must lie between {rule['low']:g} and {rule['high']:g}; got {value}")
            if rule.get("choices") and value not in rule["choices"]:
                raise _bad(entry.name, f"must be one of {', '.join(rule['choices'])}; got {value[:40]!r}")

    @property
    def database_url(self) -> str:
        """``database``, or the user's own SQLite file."""
        return self.database or f"sqlite:///{_state_directory() / 'tailstack.sqlite3'}"


def _state_directory() -> Path:
    """Where a program keeps what it must not lose (XDG base directory specification)."""
    return Path(os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state") / "tailstack"


def _bad(name: str, detail: str) -> SettingsError:
    return SettingsError(Problem("", "bad-setting", f"{variable(name)} {detail}", "docs/settings.md lists them all"))


def variable(name: str) -> str:
    """The environment variable of a setting."""
    return PREFIX + name.upper()


def refuse_unknown(environment: Mapping[str, str]) -> None:
    """Raise SettingsError for names that look like settings and are none: a slip would be a limit that is not kept."""
    known = [*meanings(), *OTHERS]
    problems = [
        _unknown(name, known)
        for name, value in sorted(environment.items())
        if name.startswith(PREFIX) and name not in known and not _is_anothers(name, value)
    ]
    if problems:
        raise SettingsError(problems)


def _is_anothers(name: str, value: str) -> bool:
    if name.startswith(OF_TESTS) or _OF_KUBERNETES.fullmatch(name):
        return True
    return name.endswith("_PORT") and _KUBERNETES_ADDRESS.fullmatch(value) is not None


# What was a setting once: where it is said now
GONE = {
    "TAILSTACK_HEAD_SECONDS": "client_header_timeout of the proxy in front says it: docs/deploy.md, Slow clients",
    "TAILSTACK_ANSWER_SECONDS": "send_timeout of the proxy in front says it: docs/deploy.md, Slow clients",
}


def _unknown(name: str, known: list[str]) -> Problem:
    if name in GONE:
        return Problem("", "unknown-setting", f"the environment sets {name}, which is no setting any more", GONE[name])
    close = difflib.get_close_matches(name.removeprefix(PREFIX), [each.removeprefix(PREFIX) for each in known], 1)
    meant = f"did you mean {PREFIX}{close[0]}? " if close else ""
    if name in (PREFIX + "PORT", PREFIX + "HOST"):
        meant = f"tailstack serve takes --{name.removeprefix(PREFIX).lower()}; "
    detail = f"the environment sets {name[:80]}, and there is no such setting"
    return Problem("", "unknown-setting", detail, f"{meant}docs/settings.md lists them all")


def settings_from(environment: Mapping[str, str]) -> Settings:
    """Settings from an environment.

    Raises SettingsError for a value that is not a number or out of range, and for a TAILSTACK_ name that is no setting.
    """
    refuse_unknown(environment)
    given: dict[str, Any] = {}
    for entry in fields(Settings):
        text = environment.get(variable(entry.name), "").strip()
        if not text:
            continue
        kind = {"float": float, "int": int}.get(str(entry.type), str)
        try:
            given[entry.name] = kind(text)
        except ValueError:
            what = "a number" if kind is float else "a whole number"
            raise _bad(entry.name, f"must be {what}; got {text[:40]!r}") from None
    return Settings(**given)


def told_to_child(settings: Settings, environment: Mapping[str, str]) -> dict[str, str]:
    """The environment for a process of ours: these settings, and of this process's own none."""
    others = {name: value for name, value in environment.items() if not name.startswith(PREFIX) or name in OF_PROCESSES}
    return others | {variable(entry.name): str(getattr(settings, entry.name)) for entry in fields(settings)}


def meanings() -> dict[str, tuple[Any, str]]:
    """Variable, its default and what it bounds, for help texts and documentation."""
    return {variable(entry.name): (entry.default, entry.metadata["meaning"]) for entry in fields(Settings)}
