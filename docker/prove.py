"""Run what compose.yaml describes from the unpacked image, without a container engine.  Called by prove.sh, as root.

usage: prove.py ROOT WORK_DIRECTORY

A service gets what compose.yaml and the image say: command, environment, user, read-only root, tmpfs, volumes, secrets,
no capabilities, its own network address and host name, and process id 1 (compose puts a small init there; here the
service has to do without).  Exit code 0 if everything was as it should be.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

from boxes import HERE, Box, Client, Place, call

DEMO = HERE.parent / "examples" / "demo.yaml"
ONCE_SECONDS = 600.0


class Proof(Place):
    """Everything that runs, and whether it was as it should be."""

    failures = 0

    def once(
        self, service: str, command: list[str] | None = None, name: str | None = None, good: tuple[int, ...] = (0,)
    ) -> str:
        """What a service that ends prints on its streams.  Any exit code but those of ``good`` is a failure."""
        box = self.box(service, name, command)
        code = box.process.wait(ONCE_SECONDS)
        text = box.log.read_text()
        why = "" if code in good else f": {text.strip().splitlines()[-1:]}"  # not otherwise: it may be a secret
        self.check(code in good, f"{' '.join([service, *(command or [])])}: exit code {code}{why}")
        return text

    def check(self, good: bool, what: str) -> None:
        print(f"{'ok  ' if good else 'FAIL'} {what}", flush=True)
        self.failures += not good


def eventually(good: Callable[[], bool], seconds: float) -> bool:
    deadline = time.monotonic() + seconds
    while not good():
        if time.monotonic() > deadline:
            return False
        time.sleep(0.2)
    return True


def sealed(proof: Proof, box: Box) -> None:
    """The box is as tight as compose.yaml says."""
    status = dict(line.split(":", 1) for line in Path(f"/proc/{box.pid}/status").read_text().splitlines())
    proof.check(status["Uid"].split()[0] == box.user[0], f"{box.name}: runs as user {box.user[0]}")
    proof.check(int(status["CapEff"], 16) == 0 == int(status["CapBnd"], 16), f"{box.name}: has no capabilities")
    proof.check(status["NoNewPrivs"].strip() == "1", f"{box.name}: cannot get new ones")
    for path in ("/", "/opt/tailstack/app", "/etc", "/run"):
        done = box.inside("touch", f"{path}/written", user=False)  # as root: only the mount forbids it
        proof.check("Read-only file system" in done.stderr, f"{box.name}: {path} is read-only")


def single(proof: Proof) -> str:
    """The profile `single`.  Gives the name of the result, which the cluster must come to as well."""
    print("\n== profile single")
    key = proof.once("tailstack", ["keys", "create", "--tenant", "prover", "--name", "prove"], "keys").split()[-1]
    box = proof.box("tailstack")
    seconds = box.wait_healthy()
    print(
        f"     healthy {seconds:.1f} s after the start, on a new volume; {box.cpu_seconds():.1f} s of CPU in process 1"
    )
    proof.network.join("visitor", "visitor")
    client, stranger = (Client("visitor", _address(proof, "tailstack"), 8321, given) for given in (key, ""))
    sealed(proof, box)
    design = DEMO.read_bytes()
    status, document = client.json("POST", "/v1/scores", design)
    proof.check(status == 200, f"POST /v1/scores: {status}, P95 {document['targets'][0]['p95_mm']:.4f} mm")
    status, document = stranger.json("POST", "/v1/scores", design)
    proof.check(status == 401, f"without a key: {status}")
    status, headers, body = client.ask("POST", "/v1/verifications?trials=1000000&seed=7", design, Prefer="wait=60")
    name = headers.get("content-location", "").rpartition("/")[2]
    proof.check(status == 200 and hashlib.sha256(body).hexdigest() == name, f"verification job: {status}, {name[:16]}")
    status, document = client.json("POST", "/v1/optimisations?starts=2", design, Prefer="wait=60")
    proof.check(status == 200, f"optimisation job: {status}, {document.get('status')}")
    status, headers, body = client.ask("GET", f"/v1/results/{name}/report?format=pdf")
    proof.check(status == 200 and body.startswith(b"%PDF"), f"report as PDF: {status}, {len(body):,} bytes")
    proof.check(box.compiled() == 0, f"kernels compiled at run time: {box.compiled()}")
    prebuilt = box.inside("find", "/opt/tailstack/app/tailstack_kernels/", "-name", "*.kernel").stdout.split()
    proof.check(len(prebuilt) > 20, f"kernels in the image: {len(prebuilt)}")
    print(f"     {box.inside('tailstack', 'warm-up').stdout.strip()}")
    worker = box.inside("sh", "-c", "grep -al '[w]ith-parent' /proc/[0-9]*/cmdline").stdout.split("/")[2]
    box.inside("kill", "-9", worker)
    again = client.ask("POST", "/v1/verifications?trials=200000&seed=8", design, Prefer="wait=60")[0]
    proof.check(again == 200, f"after kill -9 of the worker (pid {worker} inside): a job answers {again}")
    zombies = box.inside("sh", "-c", "grep -l 'State:.Z' /proc/[0-9]*/status | wc -l").stdout.strip()
    print(f"     processes left to process 1 after that, without an init: {zombies}")
    code, seconds = box.stop()
    proof.check(code == 0, f"SIGTERM to process 1: exit code {code} after {seconds:.1f} s")
    box = proof.box("tailstack")
    seconds = box.wait_healthy()
    status, document = client.json("GET", f"/v1/results/{name}")
    cpu = box.cpu_seconds()
    proof.check(
        status == 200, f"started again, healthy after {seconds:.1f} s ({cpu:.1f} s of CPU): the result is there"
    )
    proof.check(box.stop()[0] == 0, "stopped again")
    fallback(proof)
    return name


def fallback(proof: Proof) -> None:
    """A processor that no kernel was prebuilt for, and no place for what is compiled; no place that is not needed."""
    design = proof.volume("data") / "demo.yaml"
    shutil.copy(DEMO, design)
    spec = proof.image.services["tailstack"]
    given, score = dict(spec["environment"]), ["score", "/data/demo.yaml"]  # which misses its limit: exit code 1
    spec["environment"] |= {"NUMBA_CPU_NAME": "x86-64-v2", "NUMBA_CACHE_DIR": "/opt/nowhere"}
    began = time.monotonic()
    text = " ".join(proof.once("tailstack", score, "keys", (0, 1)).split())
    print(f"     on a processor without prebuilt kernels they are compiled: {time.monotonic() - began:.0f} s")
    proof.check("kernels are compiled: those installed were built for x86-64-v" in text, "and why is said")
    proof.check("/opt/nowhere cannot be written" in text, "that they cannot be kept is said")
    spec["environment"] = {**given, "NUMBA_CACHE_DIR": "/opt/nowhere"}
    text = proof.once("tailstack", score, "keys", (0, 1))
    proof.check("cannot be written" not in text, "with the kernels of the image nothing has to be kept, or said")
    spec["environment"] = given


def cluster(proof: Proof, expected: str) -> None:
    """The profile `cluster`, with Debian's PostgreSQL and nginx in place of their images."""
    print("\n== profile cluster")
    call("sh", str(HERE / "make_secrets.sh"), env={**os.environ, "SECRETS": str(proof.secrets)})
    shutil.copy(proof.secrets / "pg_service.conf", proof.secrets / "pg_service")
    _postgres(proof)
    proof.once("certificates")
    proof.check("good for another" in proof.once("certificates"), "certificates: the second time they are kept")
    print(proof.once("migrate").strip())
    scheduler = proof.box("dask-scheduler")
    print(f"     dask-scheduler healthy after {scheduler.wait_healthy():.1f} s")
    boxes = [proof.box("dask-worker", f"dask-worker-{n}") for n in (1, 2)]
    boxes += [proof.box("worker", f"worker-{n}") for n in (1, 2)] + [proof.box("api-1"), proof.box("api-2")]
    for box in boxes:
        print(f"     {box.name} healthy after {box.wait_healthy():.1f} s")
    sealed(proof, boxes[0])
    api_1, api_2 = boxes[-2:]
    _proxy(proof)
    key = proof.once("migrate", ["keys", "create", "--tenant", "prover", "--name", "prove"], "keys").split()[-1]
    client, design = Client("visitor", "proxy", 8080, key), DEMO.read_bytes()
    client.host = _address(proof, "proxy")
    proof.check(eventually(lambda: client.ask("GET", "/health/ready")[0] == 200, 20), "the proxy answers")
    status, _ = client.json("POST", "/v1/scores", design)
    proof.check(status == 200, f"POST /v1/scores through the proxy: {status}")
    status, headers, body = client.ask("POST", "/v1/verifications?trials=1000000&seed=7", design, Prefer="wait=60")
    name = headers.get("content-location", "").rpartition("/")[2]
    proof.check(
        status == 200 and name == expected, f"verification on Dask: {status}, the same bytes as before: {name[:16]}"
    )
    _events_across_a_stop(proof, client, design, api_1)
    code, seconds = api_2.stop()
    proof.check(code == 0, f"api-2 stopped: exit code {code} after {seconds:.1f} s")
    status, headers, body = client.ask("GET", "/health/ready")
    proof.check(
        status == 503 and b"No API process" in body, f"with both API processes stopped the proxy says so: {status}"
    )
    compiled = sum(box.compiled() for box in boxes[:4])
    proof.check(compiled == 0, f"kernels compiled at run time by Dask workers and workers: {compiled}")
    intruder = proof.box("dask-worker", "intruder", ["tcp://dask-scheduler:8786", "--no-nanny", "--death-timeout", "5"])
    proof.check(intruder.process.wait(60) != 0, "a Dask worker without TLS does not get in")
    for box in reversed(boxes[:4]):
        code, seconds = box.stop()
        proof.check(code == 0, f"{box.name} stopped: exit code {code} after {seconds:.1f} s")
    proof.check(scheduler.stop()[0] == 0, "dask-scheduler stopped")


def _events_across_a_stop(proof: Proof, client: Client, design: bytes, api: Box) -> None:
    """Follow a job through the proxy while the API process that may be behind it is stopped."""
    status, job = client.json("POST", "/v1/verifications?trials=5000000&seed=9", design)
    path, seen, streams = f"/v1/jobs/{job['id']}/events", "0", 0
    stopped = False
    while streams < 20:
        streams += 1
        status, _, content = client.ask("GET", path, seconds=30 if stopped else 3, Last_Event_ID=seen)
        if status == 204:
            break
        ids = [line[4:] for line in content.decode().splitlines() if line.startswith("id: ")]
        seen = ids[-1] if ids else seen
        if not stopped:
            code, seconds = api.stop()
            proof.check(code == 0, f"api-1 stopped while a job is followed: exit code {code} after {seconds:.1f} s")
            stopped = True
    state = client.json("GET", f"/v1/jobs/{job['id']}")[1]["state"]
    proof.check(status == 204 and state == "succeeded", f"{seen} events in {streams} streams, the job has {state}")


def _address(proof: Proof, name: str) -> str:
    lines = proof.network.hosts.read_text().splitlines()
    return next(line.split()[0] for line in lines if line.split()[1] == name)


def _outside(proof: Proof, name: str, user: str, *arguments: str) -> subprocess.Popen[bytes]:
    """A program of this machine in the place of an image: its network and hosts file, nothing else."""
    proof.network.join(name, name)
    script = f'mount --make-rprivate /; mount --bind {proof.network.hosts} /etc/hosts; exec "$@"'
    words = ["ip", "netns", "exec", f"tsp-{name}", "unshare", "--mount", "sh", "-ec", script, name]
    words += ["setpriv", "--reuid", user, "--regid", user, "--clear-groups", *arguments]
    with open(proof.work / f"{name}.log", "wb") as log:
        process = subprocess.Popen(words, stdin=subprocess.DEVNULL, stdout=log, stderr=log)
    proof.others.append(process)
    return process


def _postgres(proof: Proof) -> None:
    programs = sorted(Path("/usr/lib/postgresql").glob("*/bin/postgres"))[-1].parent
    data = proof.work / "postgres"
    data.mkdir()
    shutil.chown(data, "postgres", "postgres")
    proof.work.chmod(0o755)
    password = Path(shutil.copy(proof.secrets / "postgres_password", proof.work / "initial_password"))
    shutil.chown(password, "postgres", "postgres")
    be = ["setpriv", "--reuid", "postgres", "--regid", "postgres", "--clear-groups"]
    call(*be, str(programs / "initdb"), "-D", str(data), "-U", "tailstack", "--auth-host=scram-sha-256",
         "--auth-local=trust", "--data-checksums", f"--pwfile={password}")  # fmt: skip
    with open(data / "pg_hba.conf", "a") as rules:
        rules.write("host all all all scram-sha-256\n")  # as the official image does
    _outside(proof, "postgres", "postgres", str(programs / "postgres"), "-D", str(data), "-k", str(data), "-h", "*")
    ready = [str(programs / "pg_isready"), "-q", "-h", str(data)]
    if not eventually(lambda: subprocess.run(ready, check=False).returncode == 0, 30):
        raise SystemExit(f"FAIL postgres: {(proof.work / 'postgres.log').read_text()}")
    call(*be, str(programs / "createdb"), "-h", str(data), "-U", "tailstack", "tailstack")
    version = call(str(programs / "postgres"), "--version").strip()
    proof.check(True, f"{version} of this machine, reached with the password of the secret file")


def _proxy(proof: Proof) -> None:
    command = ["nginx", "-c", str(HERE / "nginx.conf"), "-e", "stderr", "-g", "daemon off;"]
    _outside(proof, "proxy", "65534", *command)


def main(root: Path, work: Path) -> int:
    proof = Proof(root, work)
    size = int(call("du", "-sbx", str(root)).split()[0])
    kernels, libraries = (_megabytes(root / "opt/tailstack" / part) for part in ("app/tailstack_kernels", "venv"))
    print(f"\n== the image: {size / 1e6:,.0f} MB unpacked, kernels {kernels}, libraries {libraries}")
    print(f"     load average of this machine: {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    try:
        cluster(proof, single(proof))
    finally:
        proof.close()
    print(_NOT_RUN)
    print(f"{'all as it should be' if proof.failures == 0 else f'{proof.failures} FAILED'}")
    return 1 if proof.failures else 0


def _megabytes(path: Path) -> str:
    return f"{int(call('du', '-sb', str(path)).split()[0]) / 1e6:,.0f} MB"


_NOT_RUN = """
== not run here
     the base image python:3.11-slim-bookworm (Debian's own Python took its place)
     the images postgres:15-bookworm and nginxinc/nginx-unprivileged (Debian's packages took their place)
     docker compose itself: order of start, restart policies, limits of CPU and memory, published ports, init
"""


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), Path(sys.argv[2])))
