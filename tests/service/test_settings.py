"""Settings: what the environment may say, and what is refused before it could be taken for a limit that holds."""

from __future__ import annotations

import pytest

from tailstack_service.cli.main import main
from tailstack_service.problems import SettingsError
from tailstack_service.settings import Settings, meanings, refuse_unknown, settings_from, told_to_child, variable

NOWHERE = "sqlite:////nowhere/at/all.sqlite3"


def test_a_setting_is_read_and_a_child_is_told_it() -> None:
    settings = settings_from({"TAILSTACK_MAX_TRIALS": " 1000 ", "TAILSTACK_BODY_SECONDS": "", "PATH": "/bin"})
    assert settings == Settings(max_trials=1000)
    here = {"PATH": "/bin", "TAILSTACK_KEY": "tsk_secret", "TAILSTACK_MAX_TRIALS": "7", "TAILSTACK_SLIP": "1"}
    told = told_to_child(settings, here)
    assert (told["PATH"], told["TAILSTACK_MAX_TRIALS"]) == ("/bin", "1000")
    assert "tsk_secret" not in told.values()
    assert settings_from(told) == settings


@pytest.mark.parametrize(
    ("name", "value", "meant"),
    [
        ("TAILSTACK_MAX_TRIAL", "5", "TAILSTACK_MAX_TRIALS"),
        ("TAILSTACK_MAXTRIALS", "5", "TAILSTACK_MAX_TRIALS"),
        ("TAILSTACK_WORKERS_PROCESSES", "", "TAILSTACK_WORKER_PROCESSES"),
        ("TAILSTACK_AUHT", "required", "TAILSTACK_AUTH"),
        ("TAILSTACK_PORT", "9000", "--port"),
        ("TAILSTACK_HOST", "0.0.0.0", "--host"),
        ("TAILSTACK_", "1", "docs/settings.md"),
        ("TAILSTACK_Ω", "1", "docs/settings.md"),
    ],
)
def test_a_name_that_is_no_setting_is_refused_with_the_nearest(name: str, value: str, meant: str) -> None:
    with pytest.raises(SettingsError) as refused:
        settings_from({name: value, "TAILSTACK_MAX_STARTS": "2"})
    (problem,) = refused.value.problems
    assert name in problem.detail
    assert meant in problem.hint
    assert "docs/settings.md" in problem.hint


@pytest.mark.parametrize(
    ("name", "value"),
    [
        *((name, "") for name in meanings()), ("TAILSTACK_KEY", "x"), ("TAILSTACK_URL", "x"),
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
def test_a_value_that_cannot_be_is_refused_with_its_name(value: str) -> None:
    with pytest.raises(SettingsError, match=r"TAILSTACK_MAX_TRIALS must"):
        settings_from({variable("max_trials"): value})


@pytest.mark.parametrize(
    "command",
    [
        ("serve", "--port", "0"), ("worker",), ("worker", "--check"), ("db", "check"), ("db", "migrate"),
        ("db", "backup", "-o", "/nowhere/x"), ("keys", "list"), ("jobs", "list", "--url", "http://127.0.0.1:1"),
    ],
    ids=" ".join,
)  # fmt: skip
def test_commands_of_the_service_refuse_a_slip(
    command: tuple[str, ...], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("TAILSTACK_DATABASE", NOWHERE)
    monkeypatch.setenv("TAILSTACK_MAX_TRIAL", "1000")
    assert main(command) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert "TAILSTACK_MAX_TRIAL, and there is no such setting" in err
    assert "did you mean TAILSTACK_MAX_TRIALS? docs/settings.md lists them all" in err


def test_commands_that_need_no_service_are_not_disturbed(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("TAILSTACK_MAX_TRIAL", "1000")
    assert main(["version"]) == 0
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("command", [("db", "check"), ("keys", "list"), ("worker", "--check")])
def test_an_address_that_is_none_is_bad_usage(command: tuple[str, ...], capsys: pytest.CaptureFixture[str]) -> None:
    for address in ("nonsense", "mysql://host/x", "sqlite://"):
        assert main([*command, "--database", address]) == 2
        assert "--database" in capsys.readouterr().err
