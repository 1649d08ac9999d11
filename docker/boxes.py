"""Services of compose.yaml as processes in namespaces of their own; what prove.py stands on."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import time
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
SWITCH = "tsp-switch"
NETWORK = "10.213.77."
READY_SECONDS = 120.0

Answer = tuple[int, dict[str, str], bytes]


def call(*arguments: str, **options: Any) -> str:
    """Standard output of a command that must succeed."""
    done = subprocess.run(arguments, text=True, capture_output=True, check=False, **{"timeout": 300, **options})
    if done.returncode != 0:
        raise SystemExit(f"FAIL {' '.join(arguments)}: exit code {done.returncode}\n{done.stdout}{done.stderr}")
    return str(done.stdout)


class Image:
    """What the image says of itself, and compose.yaml as the image's own YAML parser reads it."""

    def __init__(self, root: Path, work: Path) -> None:
        self.root = root
        config = json.loads((work / "image.json").read_text())["Docker"]["config"]
        self.environment = dict(entry.split("=", 1) for entry in config["Env"])
        self.entrypoint, self.command, self.user = config["Entrypoint"], config["Cmd"], config["User"]
        self.health = config["Healthcheck"]["Test"][1:]
        python = "import json, sys, yaml; json.dump(yaml.safe_load(sys.stdin), sys.stdout)"
        text = (HERE / "compose.yaml").read_text().replace("${PROCESSES:-2}", "2")
        read = call("chroot", str(root), "/opt/tailstack/venv/bin/python", "-c", python, input=text)
        self.services: dict[str, dict[str, Any]] = json.loads(read)["services"]


class Network:
    """A switch and one address for each host, all in namespaces: nothing of this machine's network is touched."""

    def __init__(self, work: Path) -> None:
        self.hosts = work / "hosts"
        self.hosts.write_text("127.0.0.1 localhost\n")
        self.count = 0
        call("ip", "netns", "add", SWITCH)
        call("ip", "-n", SWITCH, "link", "add", "switch", "type", "bridge")
        call("ip", "-n", SWITCH, "link", "set", "switch", "up")

    def join(self, name: str, known_as: str) -> str:
        """A new host; gives its address."""
        self.count += 1
        address, namespace, link = f"{NETWORK}{self.count}", f"tsp-{name}", f"p{self.count}"
        call("ip", "netns", "add", namespace)
        call("ip", "-n", SWITCH, "link", "add", link, "type", "veth", "peer", "name", "eth0", "netns", namespace)
        call("ip", "-n", SWITCH, "link", "set", link, "master", "switch", "up")
        call("ip", "-n", namespace, "address", "add", f"{address}/24", "dev", "eth0")
        for device in ("lo", "eth0"):
            call("ip", "-n", namespace, "link", "set", device, "up")
        with open(self.hosts, "a") as hosts:
            hosts.write(f"{address} {name}{'' if known_as == name else ' ' + known_as}\n")
        return address

    def close(self) -> None:
        for entry in call("ip", "netns", "list").split("\n"):
            if entry.startswith("tsp-"):
                call("ip", "netns", "delete", entry.split()[0])


class Place:
    """Where the services run: their image, network, volumes and secrets."""

    def __init__(self, root: Path, work: Path) -> None:
        self.work = work
        for name in ("boxes", "volumes", "secrets", "postgres"):
            shutil.rmtree(work / name, ignore_errors=True)
        self.image, self.network = Image(root, work), Network(work)
        self.boxes: list[Box] = []
        self.others: list[subprocess.Popen[bytes]] = []
        self.secrets = work / "secrets"

    def volume(self, name: str) -> Path:
        path = self.work / "volumes" / name
        if not path.exists():
            path.mkdir(parents=True)
            os.chown(path, 10001, 10001)  # a new volume has the owner of what the image has at its place
            path.chmod(0o750)
        return path

    def box(self, service: str, name: str | None = None, command: list[str] | None = None) -> Box:
        name = name or service
        if not Path(f"/run/netns/tsp-{name}").exists():
            self.network.join(name, service)
        return Box(self, service, name, command)

    def close(self) -> None:
        for box in self.boxes:
            if box.process.poll() is None:
                os.kill(box.pid, signal.SIGKILL)  # process 1: the others of its namespace end with it
                box.process.wait()
        for process in self.others:
            process.send_signal(signal.SIGINT)
            process.wait(30)
        self.network.close()


class Box:
    """One running service."""

    def __init__(self, place: Place, service: str, name: str, command: list[str] | None = None) -> None:
        self.name, self.place = name, place
        self.spec = spec = place.image.services[service]
        environment = {**place.image.environment, **spec.get("environment", {}), "HOSTNAME": name}
        self.environment = [f"{key}={value}" for key, value in environment.items()]
        entrypoint = spec.get("entrypoint", place.image.entrypoint)
        arguments = [str(word) for word in (*entrypoint, *(command or spec.get("command") or place.image.command))]
        self.user = spec["user"].split(":")
        mounts = [(str(place.volume(entry.split(":")[0])), *entry.split(":")[1:]) for entry in spec.get("volumes", [])]
        secrets = [(str(place.secrets / entry), entry) for entry in spec.get("secrets", [])]
        root = place.work / "boxes" / name
        root.mkdir(parents=True, exist_ok=True)
        script = _MOUNTS.format(root=root, image=place.image.root, hosts=place.network.hosts, name=name,
                                tmpfs=spec["tmpfs"][0].split(":")[1])  # fmt: skip
        for source, target, *mode in mounts:
            script += f"mount --bind {source} {root}{target}\n"
            if mode == ["ro"]:
                script += f"mount -o remount,bind,ro {root}{target}\n"
        for source, target in secrets:
            script += f"touch {root}/run/secrets/{target}; mount --bind {source} {root}/run/secrets/{target}\n"
        script += f'mount -o remount,ro {root}/run\nexec chroot {root} "$@"\n'
        self.log = place.work / f"{name}.log"
        self.began = time.monotonic()
        own = ["--mount", "--uts", "--ipc", "--pid", "--fork", "--kill-child"]
        words = ["ip", "netns", "exec", f"tsp-{name}", "unshare", *own, "sh", "-ec", script, name]
        words += self._as_user(["env", "-C", "/data", *arguments])
        with open(self.log, "wb") as log:
            self.process = subprocess.Popen(words, stdin=subprocess.DEVNULL, stdout=log, stderr=log)
        place.boxes.append(self)

    def _as_user(self, arguments: list[str]) -> list[str]:
        uid, gid = self.user
        drop = ["--clear-groups", "--no-new-privs", "--bounding-set=-all", "--inh-caps=-all"]
        privileges = ["/usr/bin/setpriv", "--reuid", uid, "--regid", gid, *drop]
        return [*privileges, "/usr/bin/env", "-i", *self.environment, *arguments]

    @property
    def pid(self) -> int:
        """Of the service itself, whose own idea of it is 1."""
        while self.process.poll() is None:
            children = Path(f"/proc/{self.process.pid}/task/{self.process.pid}/children").read_text().split()
            if children:
                return int(children[0])
            time.sleep(0.01)
        raise SystemExit(f"FAIL {self.name} ended: {self.log.read_text()[-2000:]}")

    def inside(self, *arguments: str, user: bool = True) -> subprocess.CompletedProcess[str]:
        """Run a command where the service runs, as docker exec does."""
        words = self._as_user(list(arguments)) if user else list(arguments)
        enter = ["nsenter", "--target", str(self.pid), "--mount", "--net", "--uts", "--ipc", "--pid", "--root", "--wd"]
        return subprocess.run([*enter, *words], text=True, capture_output=True, timeout=120, check=False)

    def healthy(self) -> bool:
        """The health check of compose.yaml, or else of the image."""
        given = self.spec.get("healthcheck", {}).get("test")
        return self.inside(*(given[1:] if given else self.place.image.health)).returncode == 0

    def wait_healthy(self) -> float:
        """Seconds from the start until the health check passed."""
        while not self.healthy():
            if self.process.poll() is not None or time.monotonic() - self.began > READY_SECONDS:
                raise SystemExit(f"FAIL {self.name} is not healthy: {self.log.read_text()[-3000:]}")
            time.sleep(0.05)
        return time.monotonic() - self.began

    def cpu_seconds(self) -> float:
        """What the service's own process has used so far."""
        fields = Path(f"/proc/{self.pid}/stat").read_text().rpartition(")")[2].split()
        return sum(int(ticks) for ticks in fields[11:13]) / os.sysconf("SC_CLK_TCK")

    def stop(self, number: signal.Signals = signal.SIGTERM) -> tuple[int, float]:
        """Exit code, and seconds that the end took."""
        began = time.monotonic()
        if self.process.poll() is None:
            os.kill(self.pid, number)
        code = self.process.wait(60)
        return code, time.monotonic() - began

    def compiled(self) -> int:
        """Kernels that were compiled here although the image brings its own."""
        found = self.inside("find", "/tmp/tailstack-kernels", "-name", "*.kernel").stdout
        return len(found.split())


_MOUNTS = """
mount --make-rprivate /
hostname {name}
mount --bind {image} {root}
mount -o remount,bind,ro {root}
mount -t proc proc {root}/proc
mount -t tmpfs -o mode=755 tmpfs {root}/dev
for device in null zero full random urandom; do
  touch {root}/dev/$device
  mount --bind /dev/$device {root}/dev/$device
done
mkdir {root}/dev/shm
mount -t tmpfs -o size=64m,mode=1777 tmpfs {root}/dev/shm
mount -t tmpfs -o {tmpfs} tmpfs {root}/tmp
mount -t tmpfs -o mode=755 tmpfs {root}/run
mkdir {root}/run/secrets
mount --bind {hosts} {root}/etc/hosts
"""


class Client:
    """Asks from the network of another host."""

    def __init__(self, name: str, host: str, port: int, key: str = "") -> None:
        self.name, self.host, self.port, self.key = name, host, port, key

    def ask(self, method: str, path: str, body: bytes = b"", seconds: float = 90.0, **headers: str) -> Answer:
        """Status, headers, body; curl in the network namespace of the switch's neighbours."""
        words = [
            "ip",
            "netns",
            "exec",
            f"tsp-{self.name}",
            "curl",
            "-sS",
            "-i",
            "-X",
            method,
            "--max-time",
            str(seconds),
        ]
        words += ["--noproxy", "*", f"http://{self.host}:{self.port}{path}", "--data-binary", "@-"] if body else [
            "--noproxy", "*", f"http://{self.host}:{self.port}{path}"]  # fmt: skip
        sent = {"Content-Type": "application/yaml"} if body else {}
        sent |= {"Authorization": f"Bearer {self.key}"} if self.key else {}
        for key, value in {**sent, **{k.replace("_", "-"): v for k, v in headers.items()}}.items():
            words += ["-H", f"{key}: {value}"]
        done = subprocess.run(words, input=body, capture_output=True, timeout=seconds + 10, check=False)
        head, _, content = done.stdout.partition(b"\r\n\r\n")
        if head.startswith(b"HTTP/1.1 100"):
            head, _, content = content.partition(b"\r\n\r\n")
        lines = head.decode("latin-1").split("\r\n")
        split = (line.partition(":") for line in lines[1:])
        fields = {name.lower(): value.strip() for name, _, value in split}
        status = int(lines[0].split()[1]) if lines[0].startswith("HTTP/") else 0
        return status, fields, content

    def json(self, method: str, path: str, body: bytes = b"", seconds: float = 90.0, **headers: str) -> tuple[int, Any]:
        status, _, content = self.ask(method, path, body, seconds, **headers)
        return status, json.loads(content) if content else None
