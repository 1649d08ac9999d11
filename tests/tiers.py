"""Which checks and tests ``./run test`` runs: the short tier, what a change reaches, or everything.

./run test                    linters, types, import rules, and all tests but those marked as long
./run test --quick [PATHS]    lint, and the tests nearest to what changed (or to PATHS), within a minute and a half
./run test --all [--seed N] [--shuffle N]
./run test --all --for 2h     what is random or hostile, again and again with new seeds
./run test --costs [PATHS]    what each unmarked test costs in CPU; those beyond three seconds are named
./run test PYTEST...          the tests that are named, the long ones too
"""

from __future__ import annotations

import csv
import os
import re
import subprocess
import sys
import time
from collections import deque
from collections.abc import Iterable, Iterator
from pathlib import Path
from statistics import median

ROOT = Path(__file__).resolve().parents[1]
COSTS = ROOT / "tests" / "data" / "costs.csv"
# Four on two processors, for most of them wait; in the order of the files, in which the long ones do not come last
SIDE_BY_SIDE = ("-n", "4", "--dist", "loadfile", "--no-loadscope-reorder")
CHECKS = (
    ("ruff", "check", "."),
    ("ruff", "format", "--check", "."),
    ("mypy",),
    ("mypy", "--config-file", "tests/mypy.ini", "--cache-dir", ".mypy_cache/tests"),  # beside the other
    ("lint-imports",),
)
WARM_UP = ("python", "-m", "tailstack_service.cli.main", "warm-up")
# Tests that run a kernel whose instructions differ between processors
OF_PROCESSORS = ("unit/test_montecarlo_*.py", "unit/test_tail_*.py")
MOST_SECONDS = 3.0  # of CPU, of a test without the mark
CHEAP_SECONDS = 1.0  # of CPU, of a test that --quick may choose
UNMEASURED_SECONDS = 0.1  # of a test that COSTS does not name: it cost less than RECORDED_SECONDS
RECORDED_SECONDS = 0.3
QUICK_SECONDS = 70.0  # of CPU, on two processors, of what --quick chooses: with the start of pytest below 90 s
ROOMS = (
    "solver",
    "service",
    "tests",
    "tests/unit",
    "tests/service",
    "tests/properties",
    "openapi",
    "docs",
    "benchmarks",
    ".ci/release",
)


def main(arguments: list[str]) -> int:
    os.chdir(ROOT)
    first, rest = (arguments[0], arguments[1:]) if arguments else ("", [])
    if first == "":
        return run_checks_and_tests("--short")
    if first == "--all":
        return run_all(rest)
    if first == "--quick":
        return run_quick(rest)
    if first == "--costs":
        return print_costs(rest)
    return pytest(*arguments)


def pytest(*arguments: str) -> int:
    return subprocess.call([sys.executable, "-m", "pytest", *arguments])


def run_checks(checks: Iterable[tuple[str, ...]]) -> int:
    """All at the same time; what each says is shown in their order, and the first that fails gives the code."""
    return finish([(check, start_check(check)) for check in checks])


def finish(started: list[tuple[tuple[str, ...], subprocess.Popen[str]]]) -> int:
    code = 0
    for check, process in started:
        print(process.communicate()[0], end="", flush=True)
        if process.returncode:
            print(f"run: {' '.join(check)} failed", file=sys.stderr, flush=True)
            code = code or process.returncode
    return code


def start_check(check: tuple[str, ...]) -> subprocess.Popen[str]:
    command = [str(Path(sys.executable).parent / check[0]), *check[1:]]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)


def run_checks_and_tests(*options: str) -> int:
    """Beside the checks kernels are compiled, and the tests where they never were: each of the processes would compile
    all."""
    beside = None
    if not (ROOT / "tests" / "unit" / "__pycache__").exists():  # to collect them once writes what the others then load
        collect = [sys.executable, "-m", "pytest", "--collect-only", "-qqq"]
        beside = subprocess.Popen(collect, stdout=subprocess.DEVNULL)
    code = run_checks((*CHECKS, WARM_UP))
    if beside is not None:
        beside.wait()
    return code or pytest(*SIDE_BY_SIDE, *options)


def run_tier_of_processors(*options: str) -> int:
    """What the instructions of a processor can change, as one without AVX-512 compiles it."""
    if not has_avx512():
        return 0
    print("run: tests of the kernels as on a processor without AVX-512", file=sys.stderr, flush=True)
    os.environ.update(NUMBA_CPU_NAME="x86-64-v3", NUMBA_CPU_FEATURES="")
    files = sorted(str(file) for pattern in OF_PROCESSORS for file in Path("tests").glob(pattern))
    return pytest(*SIDE_BY_SIDE, "-n", "2", *options, *files)  # these compute all the time: none waits for another


def has_avx512() -> bool:
    try:
        return " avx512f " in Path("/proc/cpuinfo").read_text(encoding="utf-8")
    except OSError:
        return False


# --- everything -----------------------------------------------------------------------------------


def run_all(arguments: list[str]) -> int:
    """Everything once, or what is random again and again; a seed that is not given is the time, and printed."""
    options = dict(zip(arguments[::2], arguments[1::2], strict=False))
    if len(arguments) % 2 or options.keys() - {"--for", "--seed", "--shuffle", "-n"}:
        print("usage: ./run test --all [--seed N] [--shuffle N] [-n N] [--for 90s|20m|2h]", file=sys.stderr)
        return 2
    seed = int(options.get("--seed", time.time_ns() // 1_000_000 % 1_000_000))
    given = [word for name in ("--shuffle", "-n") if name in options for word in (name, options[name])]
    print(f"run: seed {seed}; again with it: ./run test --all --seed {seed}", file=sys.stderr, flush=True)
    if "--for" in options:
        return run_for(seconds_of(options["--for"]), seed)
    more = (*seeded(seed), *given)
    return run_checks_and_tests(*more) or run_tier_of_processors(*more)


def seeded(seed: int) -> tuple[str, ...]:
    return "--seed", str(seed), "--hypothesis-seed", str(seed)


def seconds_of(text: str) -> float:
    found = re.fullmatch(r"(\d+(?:\.\d+)?)([smh])", text)
    if found is None:
        raise SystemExit(f"run: --for {text}: expected a number with s, m or h, as in 2h")
    return float(found[1]) * {"s": 1, "m": 60, "h": 3600}[found[2]]


def run_for(seconds: float, seed: int) -> int:
    """What is marked as hostile with one seed after the other; the first that fails ends it, and is named."""
    ends = time.monotonic() + seconds
    while time.monotonic() < ends:
        if code := pytest(*SIDE_BY_SIDE, "-m", "hostile", *seeded(seed)):
            print(f"run: failed with --seed {seed}", file=sys.stderr)
            return code
        seed += 1
    print(f"run: nothing failed up to seed {seed - 1}", file=sys.stderr)
    return 0


# --- what a change reaches ------------------------------------------------------------------------


def run_quick(paths: list[str]) -> int:
    """Lint and types of what changed, and the cheap tests that import it, the nearest first, as many as there is time
    for."""
    changed = [path for path in (paths or changed_files()) if Path(path).exists()]
    python = [path for path in changed if path.endswith(".py") or Path(path).is_dir()]
    if not changed:
        print("run: nothing changed since main; ./run test --quick PATHS names what to look at", file=sys.stderr)
        return 0
    if python and (code := run_checks((("ruff", "check", *python), ("ruff", "format", "--check", *python)))):
        return code
    chosen, left_out = choose_tests(changed)
    print(f"run: {len(chosen)} test functions; {left_out} more that the change reaches: ./run test", file=sys.stderr)
    types = [(check, start_check(check)) for check in types_of(python)]
    code = pytest("-n", "2", "--dist", "loadfile", "--short", *chosen) if chosen else 0
    return finish(types) or code


def changed_files() -> list[str]:
    """Of commits that main does not have, and of the work tree; on main itself of the work tree alone."""

    def git(*words: str) -> list[str]:
        done = subprocess.run(["git", *words], capture_output=True, text=True, check=False)
        return done.stdout.splitlines() if done.returncode == 0 else []

    base = git("merge-base", "HEAD", "main") or ["HEAD"]
    return sorted({*git("diff", "--name-only", base[0]), *git("ls-files", "--others", "--exclude-standard")})


def types_of(changed: list[str]) -> list[tuple[str, ...]]:
    """mypy of the rooms in which something changed: it looks at that alone, beside what it kept of its last run."""
    rooms = {Path(path).parts[0] for path in changed}
    return [CHECKS[2]] * bool(rooms & {"solver", "service"}) + [CHECKS[3]] * ("tests" in rooms)


def choose_tests(
    changed: list[str], each: float = CHEAP_SECONDS, together: float = QUICK_SECONDS, *, long: bool = False
) -> tuple[list[str], int]:
    """Node ids of test functions, nearest by imports first, and how many more the change reaches.

    each, together: the most CPU seconds of one of them, and of all.  long: of those that are marked.
    """
    costs = read_costs()
    chosen, spent, left_out = [], 0.0, 0
    for file in files_by_distance(changed):
        if not Path(file).name.startswith("test_"):
            continue
        for name, marked in functions_of(file):
            cost = costs.get(f"{file}::{name}", UNMEASURED_SECONDS)
            if marked != long or cost >= each or spent + cost > together:
                left_out += 1
            else:
                chosen.append(f"{file}::{name}")
                spent += cost
    return chosen, left_out


def functions_of(file: str) -> Iterator[tuple[str, bool]]:
    """Test functions, and whether the whole of one is marked as long, or its file is.

    By lines: to parse them all takes seconds.
    """
    whole = long = quoted = False
    for line in Path(file).read_text(encoding="utf-8").splitlines():
        quoted ^= line.count('"""') % 2 == 1
        if quoted:
            continue
        if line == "pytestmark = pytest.mark.long":
            whole = True
        elif line == "@pytest.mark.long":
            long = True
        elif found := re.match(r"(?:async )?def (\w+)", line):
            if found[1].startswith("test_"):
                yield found[1], whole or long
            long = False


def read_costs() -> dict[str, float]:
    """CPU seconds of test functions, all cases together."""
    if not COSTS.exists():
        return {}
    with COSTS.open(encoding="utf-8", newline="") as file:
        return {row["test"]: float(row["cpu_seconds"]) for row in csv.DictReader(file)}


def files_by_distance(changed: list[str]) -> list[str]:
    """Python files that import what changed, by the number of imports between."""
    users = users_of_files()
    distance = dict.fromkeys(changed, 0)
    queue = deque(changed)
    while queue:
        file = queue.popleft()
        for user in sorted(users.get(file, ())):
            if user not in distance:
                distance[user] = distance[file] + 1
                queue.append(user)
    return sorted((file for file in distance if file.endswith(".py")), key=lambda file: (distance[file], file))


def users_of_files() -> dict[str, set[str]]:
    """For each Python file those that import it, by the text of their import statements and of names of modules."""
    modules: dict[str, str] = {}
    files: set[Path] = set()
    for room in map(Path, ROOMS):
        for path in sorted(room.rglob("*.py")):
            files.add(path)
            name = ".".join(path.relative_to(room).with_suffix("").parts).removesuffix(".__init__")
            modules.setdefault(name, str(path))
    users: dict[str, set[str]] = {}
    for path in sorted(files):
        for name in imported_by(path):
            if name.endswith("."):  # a name that is put together: any module of that package
                found = [file for module, file in modules.items() if module.rpartition(".")[0] == name[:-1]]
            else:
                found = [modules[name]] if name in modules else []
            for file in found:
                if file != str(path):
                    users.setdefault(file, set()).add(str(path))
    return users


IMPORTS = re.compile(
    r"^ *(?:from (?P<base>[.\w]+) import (?P<names>\([^)]*\)|[^#\n]*)|import (?P<modules>[^#\n]*))", re.MULTILINE
)
# What import_module is given: f"{__package__}.units.{name}", "..report.chapters.batch", f"tailstack.studies.{name}"
LOADED = re.compile(
    r'f"\{__package__\}(?P<below>(?:\.\w+)*)(?P<open>\.\{)?'
    r'|"(?P<name>(?:\.+|\w+\.)\w+(?:\.\w+)*)(?P<any>\.\{[^"]*)?"'
)


def imported_by(path: Path) -> Iterator[str]:
    """Modules that a file names, and names in them that may be modules; a package whose modules a table names ends in
    a point."""
    parts = path.with_suffix("").parts[1:]

    def absolute(name: str) -> str:
        level = len(name) - len(name.lstrip("."))
        return ".".join([*parts[: len(parts) - level], *filter(None, [name[level:]])]) if level else name

    text = path.read_text(encoding="utf-8")
    for found in IMPORTS.finditer(text):
        if found["modules"]:
            yield from (name.split()[0] for name in found["modules"].split(",") if name.strip())
            continue
        base = absolute(found["base"])
        yield base
        yield from (f"{base}.{name}" for name in re.findall(r"(\w+)(?: as \w+)?", found["names"]))
    for found in LOADED.finditer(text):
        if found["name"]:
            yield absolute(found["name"]) + ("." if found["any"] else "")
        else:
            yield ".".join(parts[:-1]) + found["below"] + ("." if found["open"] else "")


# --- what tests cost ------------------------------------------------------------------------------


def print_costs(paths: list[str]) -> int:
    """Measure the short tier; what costs too much is run alone three times, and named if it does so in all.  Written to
    COSTS where the whole tier was measured."""
    code, costs = measure("--short", *SIDE_BY_SIDE, *paths)
    if code not in (0, 1):
        return code
    named = []
    for test, seconds in sorted(costs.items(), key=lambda item: -item[1]):
        if seconds > MOST_SECONDS:
            alone = [sum(measure(test)[1].values()) for _ in range(3)]
            if min(alone) > MOST_SECONDS:
                named.append((median(alone), test))
    for seconds, test in sorted(named, reverse=True):
        print(f"{seconds:6.1f} s of CPU  {test}")
    print(f"{len(named)} tests without the mark cost more than {MOST_SECONDS:g} s of CPU alone, three times of three")
    print(f"all that were measured: {sum(costs.values()):.0f} s of CPU")
    if not paths:
        write_costs(costs)
    return 1 if named else code


def measure(*arguments: str) -> tuple[int, dict[str, float]]:
    """CPU seconds by node id, of the process of the test and of the children that it waited for."""
    record = ROOT / "tests" / "data" / ".costs"
    record.unlink(missing_ok=True)
    try:
        code = pytest("--costs", str(record), *arguments)
        lines = record.read_text(encoding="utf-8").splitlines() if record.exists() else []
    finally:
        record.unlink(missing_ok=True)
    costs: dict[str, float] = {}
    for line in lines:
        seconds, _, test = line.partition(" ")
        costs[test] = costs.get(test, 0.0) + float(seconds)
    return code, costs


def write_costs(costs: dict[str, float]) -> None:
    """What was measured, and what is known of the tests that were not."""
    functions: dict[str, float] = {}
    for test, seconds in costs.items():
        name = test.partition("[")[0]
        functions[name] = functions.get(name, 0.0) + seconds
    kept = sorted((test, cost) for test, cost in (read_costs() | functions).items() if cost >= RECORDED_SECONDS)
    with COSTS.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["test", "cpu_seconds"])
        writer.writerows((name, f"{seconds:.1f}") for name, seconds in kept)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
