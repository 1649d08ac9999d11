"""Settings: what the environment may say, and what is refused before it could be taken for a limit that holds."""

from __future__ import annotations

import os
from typing import Any

import pytest

from plain_data import problems_of, read_cases
from tailstack_service.problems import SettingsError
from tailstack_service.settings import child_environment, default_settings, load_settings, refuse_unknown, schemas

NOWHERE = "sqlite:////nowhere/at/all.sqlite3"


@pytest.fixture
def environment(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    """An environment that says nothing about tailstack."""
    for name in [name for name in os.environ if name.startswith("TAILSTACK_")]:
        monkeypatch.delenv(name)
    return monkeypatch


def test_a_setting_is_read_and_a_child_is_told_it(environment: pytest.MonkeyPatch) -> None:
    environment.setenv("TAILSTACK_MAX_TRIALS", " 1000 ")
    environment.setenv("TAILSTACK_BODY_SECONDS", "")
    settings = load_settings()
    assert settings == default_settings().model_copy(update={"max_trials": 1000})
    here = {"PATH": "/bin", "TAILSTACK_KEY": "tsk_secret", "TAILSTACK_MAX_TRIALS": "7", "TAILSTACK_SLIP": "1"}
    told = child_environment(settings, here)
    assert (told["PATH"], told["TAILSTACK_MAX_TRIALS"]) == ("/bin", "1000")
    assert "tsk_secret" not in told.values()
    for name, value in told.items():
        environment.setenv(name, value)
    assert load_settings() == settings


def test_what_is_set_is_read_in_its_order_and_a_password_not_shown(environment: pytest.MonkeyPatch) -> None:
    environment.setenv("TAILSTACK_ENGINE", "nothing of the kind")
    environment.setenv("max_trials", "7")
    environment.setenv("MAX_TRIALS", "8")
    settings = load_settings(engine="dask")
    assert (settings.engine, settings.max_trials) == ("dask", 5_000_000)
    environment.setenv("TAILSTACK_DATABASE", "postgresql://u:hush@h/d")
    settings = load_settings(engine="dask")
    assert "hush" in settings.database_url
    assert "hush" not in f"{settings} {settings!r}"


def test_every_value_that_cannot_be_is_named_at_once(environment: pytest.MonkeyPatch) -> None:
    for name, value in (("MAX_TRIALS", "many"), ("KEEP_DAYS", "soon"), ("MAX_VIEWS", "17"), ("AUTH", "maybe")):
        environment.setenv("TAILSTACK_" + name, value)
    assert {problem.detail for problem in problems_of(load_settings, error=SettingsError)} == {
        "TAILSTACK_MAX_TRIALS must be a whole number; got 'many'",
        "TAILSTACK_KEEP_DAYS must be a number; got 'soon'",
        "TAILSTACK_MAX_VIEWS must lie between 2 and 16; got '17'",
        "TAILSTACK_AUTH must be one of none, required; got 'maybe'",
    }


@pytest.mark.parametrize(("name", "value", "meant"), read_cases("settings", "nearest"))
def test_a_name_that_is_no_setting_is_refused_with_the_nearest(
    name: str, value: str, meant: str, environment: pytest.MonkeyPatch
) -> None:
    environment.setenv(name, value)
    environment.setenv("TAILSTACK_MAX_STARTS", "2")
    (problem,) = problems_of(load_settings, error=SettingsError)
    assert name in problem.detail
    assert meant in problem.hint
    assert "docs/settings.md" in problem.hint


@pytest.mark.parametrize(
    ("name", "value"),
    [
        *((name, "") for name in schemas()), ("TAILSTACK_KEY", "x"), ("TAILSTACK_URL", "x"),
        ("TAILSTACK_TRACEBACK", "1"), ("TAILSTACK_COMMAND", "./run tailstack"), ("TAILSTACK_TESTS_REQUIRE", "node"),
        ("tailstack_max_trial", "1"), ("MY_TAILSTACK_X", "1"),
        # a Kubernetes Service called tailstack, and one called tailstack-api
        ("TAILSTACK_PORT", "tcp://10.0.0.1:8321"), ("TAILSTACK_SERVICE_HOST", "10.0.0.1"),
        ("TAILSTACK_API_PORT_8321_TCP_ADDR", "10.0.0.1"), ("TAILSTACK_API_SERVICE_PORT_HTTP", "8321"),
    ],
)  # fmt: skip
def test_names_that_have_their_place_are_not_refused(name: str, value: str) -> None:
    refuse_unknown({name: value})


@pytest.mark.parametrize("value", ["many", "1e3", "0", "1000000001", "nan"])
def test_a_value_that_cannot_be_is_refused_with_its_name(value: str, environment: pytest.MonkeyPatch) -> None:
    environment.setenv("TAILSTACK_MAX_TRIALS", value)
    with pytest.raises(SettingsError, match=rf"TAILSTACK_MAX_TRIALS must .*; got '{value}'"):
        load_settings()


@pytest.mark.parametrize("command", read_cases("settings", "commands"), ids=" ".join)
def test_commands_of_the_service_refuse_a_slip(
    command: list[str], monkeypatch: pytest.MonkeyPatch, refused: Any
) -> None:
    monkeypatch.setenv("TAILSTACK_DATABASE", NOWHERE)
    monkeypatch.setenv("TAILSTACK_MAX_TRIAL", "1000")
    said = refused(*command)
    assert "TAILSTACK_MAX_TRIAL, and there is no such setting" in said
    assert "did you mean TAILSTACK_MAX_TRIALS? docs/settings.md lists them all" in said


def test_commands_that_need_no_service_are_not_disturbed(monkeypatch: pytest.MonkeyPatch, call: Any) -> None:
    monkeypatch.setenv("TAILSTACK_MAX_TRIAL", "1000")
    code, _, err = call("version")
    assert (code, err) == (0, "")


@pytest.mark.parametrize("command", [("db", "check"), ("keys", "list"), ("worker", "--check"), ("serve",)])
def test_an_address_that_is_none_is_bad_usage(command: tuple[str, ...], refused: Any, loggers: None) -> None:
    for address in ("nonsense", "mysql://host/x", "sqlite://"):
        assert "--database" in refused(*command, "--database", address)
