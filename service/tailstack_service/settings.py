"""Limits and addresses of the service: one frozen record, read once from ``TAILSTACK_*`` variables."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from typing import Any, Literal

from pydantic import Field, ValidationError
from pydantic_settings import BaseSettings, SettingsConfigDict

from tailstack.cures import ask_meant
from tailstack.errors import Problem
from tailstack.kernels.process import usable_cores

from .environment import OF_PROCESSES, OF_TESTS, OTHERS, PREFIX, state_directory, variable
from .problems import SettingsError

# Kubernetes tells every container of every Service of its namespace, one that is called tailstack-... among them
_OF_KUBERNETES = re.compile(
    PREFIX + r"(\w+_)?(SERVICE_HOST|SERVICE_PORT(_\w+)?|PORT_\d+_(TCP|UDP|SCTP)(_(PROTO|PORT|ADDR))?)"
)
_KUBERNETES_ADDRESS = re.compile(r"(tcp|udp|sctp)://.+")  # the value of ..._PORT, of which people think otherwise


def _number(default: float, low: float, high: float, meaning: str) -> Any:
    return Field(default, ge=low, le=high, description=meaning)


class Settings(BaseSettings):
    """Everything that an operator can set.  Field ``max_trials`` is the variable ``TAILSTACK_MAX_TRIALS``.

    Read from the environment when it is made; what it is given by name goes before.
    """

    # the alias is the variable; without the prefix a variable called ``auth`` would be taken for the field
    model_config = SettingsConfigDict(
        alias_generator=variable, env_prefix=PREFIX, populate_by_name=True, case_sensitive=True, env_ignore_empty=True,
        str_strip_whitespace=True, allow_inf_nan=False, extra="forbid", frozen=True,
    )  # fmt: skip

    # What one request may ask for
    max_body_bytes: int = _number(1_000_000, 1_000, 100_000_000, "bytes of a request body")
    max_step_bytes: int = _number(8_000_000, 1_000, 32_000_000, "bytes of a file that is a body as it is, such as STEP")
    body_seconds: float = _number(20.0, 0.1, 3_600, "seconds for a body to arrive")
    max_fiducials: int = _number(200, 6, 1000, "fiducials of a design")
    max_targets: int = _number(50, 1, 200, "targets of a design, regions expanded")
    max_views: int = _number(8, 2, 16, "views of a design")
    max_trials: int = _number(5_000_000, 100, 1_000_000_000, "trials of one check; one that may draw more is refused")
    max_starts: int = _number(32, 1, 256, "starts of one optimisation")
    max_sweep_points: int = _number(2_000, 1, 1_000_000, "points of one sweep")
    max_batch_rows: int = _number(100_000, 1, 1_000_000, "rows of one table of designs")
    max_gate_designs: int = _number(50, 1, 1_000, "designs of one gate")

    # What is computed while the caller waits
    max_seconds: float = _number(60.0, 0.1, 86_400, "seconds of CPU of one computation that is answered at once")
    warm_up_seconds: float = _number(5.0, 0, 600, "seconds that a request waits for the kernels to be compiled")
    max_wait_seconds: float = _number(60.0, 0, 600, "seconds that `Prefer: wait` may ask for")
    short_workers: int = _number(2, 1, 256, "processes that compute what is answered at once, per API process")
    max_waiting: int = _number(64, 0, 100_000, "computations that may wait for one of them, per API process")
    max_process_bytes: int = _number(
        2_000_000_000, 0, 1_000_000_000_000, "bytes of memory of a computing process, a worker's too (Linux); 0: any"
    )
    max_streams: int = _number(100, 1, 10_000, "event streams open at once, per API process")
    max_tenant_streams: int = _number(
        25, 1, 10_000, "event streams of one tenant open at once, per API process, where callers are told apart"
    )
    api_processes: int = _number(1, 1, 64, "API processes behind one port")

    # Jobs
    database: str = Field(
        default="",
        repr=False,
        description="where jobs are kept: sqlite:///PATH or postgresql://USER:PASSWORD@HOST/NAME; empty: a SQLite file "
        "of yours",
    )
    max_queued_jobs: int = _number(2_000, 1, 1_000_000, "unfinished jobs of one tenant")
    cpu_seconds_per_hour: float = _number(0.0, 0, 1e9, "CPU seconds of one tenant's jobs in an hour; 0: any")
    max_job_seconds: float = _number(3_600.0, 1, 1e7, "CPU seconds of one job")
    keep_days: float = _number(30.0, 0.001, 36_500, "days for which finished jobs, their results and designs are kept")
    audit_days: float = _number(365.0, 1, 36_500, "days for which entries of the audit log are kept")
    max_kept_designs: int = _number(
        200, 0, 100_000, "designs that a tenant sent last and can name by their SHA-256; 0: none"
    )
    worker_processes: int = _number(usable_cores(), 1, 256, "computing processes of one worker (engine pool)")
    lease_seconds: float = _number(15.0, 1, 3_600, "seconds after which a silent worker's units are given to another")
    poll_seconds: float = _number(0.05, 0.005, 60, "seconds between an idle worker's looks for work")
    hang_seconds: float = _number(
        30.0, 1, 86_400, "seconds for which a computing process may use no processor time before it counts as hung"
    )
    max_unit_deaths: int = _number(5, 1, 100, "computing processes that one unit may take with it")
    max_unit_attempts: int = _number(25, 1, 1_000, "times that one unit is begun, whatever ended it")

    # Where units are computed
    engine: Literal["pool", "dask"] = Field(default="pool", description="where units are computed")
    dask_scheduler: str = Field(default="", description="address of the Dask scheduler, tls://HOST:PORT")
    dask_ca_file: str = Field(default="", description="certificate authority of the Dask cluster, PEM")
    dask_cert_file: str = Field(default="", description="certificate shown to the Dask cluster, PEM")
    dask_key_file: str = Field(default="", description="private key of that certificate, PEM")

    # Who may ask
    auth: Literal["none", "required"] = Field(default="none", description="none (loopback only) or required")
    jwt_key_file: str = Field(
        default="", description="PEM public key, JWKS file or shared secret that JSON Web Tokens are checked with"
    )
    jwt_algorithm: Literal["RS256", "ES256", "EdDSA", "HS256"] = Field(
        default="RS256", description="the only algorithm accepted in JSON Web Tokens"
    )
    jwt_issuer: str = Field(default="", description="required `iss` of JSON Web Tokens")
    jwt_audience: str = Field(default="tailstack", description="required `aud` of JSON Web Tokens")
    allowed_hosts: str = Field(default="", description="further names, comma-separated, that the Host header may carry")

    # Below which path clients see it
    root_path: str = Field(
        default="", description="path below which a proxy gives the service to clients, such as /tailstack"
    )

    # What is told
    log_format: Literal["text", "json"] = Field(default="text", description="log lines on stderr as text or as JSON")

    @property
    def database_url(self) -> str:
        """``database``, or the user's own SQLite file."""
        return self.database or f"sqlite:///{state_directory() / 'tailstack.sqlite3'}"


def load_settings(**flags: Any) -> Settings:
    """Settings from the environment; flags go before.

    Raises SettingsError for every value that breaks its rule, and for a TAILSTACK_ name that is no setting.
    """
    refuse_unknown(os.environ)
    try:
        return Settings(**flags)
    except ValidationError as error:
        raise SettingsError([_refusal(entry) for entry in error.errors(include_url=False)]) from None


def default_settings() -> Settings:
    """The defaults, whatever the environment says."""
    return Settings.model_construct()


def schemas() -> dict[str, dict[str, Any]]:
    """JSON Schema of each setting by its variable: its default, what it means (``description``) and its bounds."""
    properties: dict[str, dict[str, Any]] = Settings.model_json_schema()["properties"]
    return properties


def _refusal(entry: Any) -> Problem:
    """The rule that a value breaks, and what arrived."""
    [name] = entry["loc"]
    name = name if name.startswith(PREFIX) else variable(name)
    schema = schemas()[name]
    if entry["type"] in ("int_parsing", "int_from_float", "float_parsing"):
        rule = "must be a whole number" if schema["type"] == "integer" else "must be a number"
    elif "enum" in schema:
        rule = f"must be one of {', '.join(schema['enum'])}"
    else:
        rule = f"must lie between {schema['minimum']:g} and {schema['maximum']:g}"
    detail = f"{name} {rule}; got {str(entry['input'])[:40]!r}"
    return Problem("", "bad-setting", detail, "docs/settings.md lists them all")


def refuse_unknown(environment: Mapping[str, str]) -> None:
    """Raise SettingsError for names that look like settings and are none: a slip would be a limit that is not kept."""
    known = [*map(variable, Settings.model_fields), *OTHERS]
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
    meant = f"{ask_meant(name, known)} ".lstrip()
    if name in (PREFIX + "PORT", PREFIX + "HOST"):
        meant = f"tailstack serve takes --{name.removeprefix(PREFIX).lower()}; "
    detail = f"the environment sets {name[:80]}, and there is no such setting"
    return Problem("", "unknown-setting", detail, f"{meant}docs/settings.md lists them all")


def child_environment(settings: Settings, environment: Mapping[str, str]) -> dict[str, str]:
    """The environment for a process of ours: these settings, and of this process's own none."""
    others = {name: value for name, value in environment.items() if not name.startswith(PREFIX) or name in OF_PROCESSES}
    return others | {variable(name): str(value) for name, value in settings}
