"""Kills at random moments: no process outlives its parent, nothing stored is lost, nothing is left lying.

python tools/kills.py [COUNT] [SEED] [CASE ...]

Each case is a long command. It is begun and killed some times, then run to its end. Nothing that it started
may live 5 s after a kill; earlier results and stored trials stand; the end has the files of a run that was
left alone, bit by bit but for what tells the time, and leaves nothing beside them.

Moments are drawn inside of what the command takes when it is left alone, of a study for the trials that it
lacks. A kill that came after its end is not counted.
"""

import contextlib
import itertools
import json
import os
import random
import re
import secrets
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from pyarrow import parquet

from testbench.errors import InputError
from testbench.runs.store import part_seeds

ROOT = Path(__file__).resolve().parents[1]
MAIN = (sys.executable, "-c", "from testbench.cli import main; main()")
TRIALS = f"""
from testbench.runs import interrupt
interrupt.handle(interrupt.leave_at_once)
import sys
from testbench.runs import command
sys.path.insert(0, {str(ROOT / "tests" / "scenarios")!r})
from trial_study import app
interrupt.leave(command.run(app))
"""
MARK = "TESTBENCH_KILLS"  #: In the environment of all that a case starts.
GRACE = 5.0  #: Time in which all must have ended [s].
LONGEST = 900.0
"""Time after which a run has failed [s]."""
CHAIN = 5  #: Kills before a case is run to its end.
LATE, MOST_LATE = "too late", 4  #: What a kill after the end counts as; most of them for each that hits.
MOST_FAULTS = 20  #: After which no more is tried.
CLOCKS = ("manifest.json", "recording.rrd", "run.log")  #: Tell the time, or have a random identity.
VIEWS = (".md", ".html")  #: Show the report, and how long solvers took.
TIMED = {
    "solver_comparison": "solver_comparison.png",
    "bench": "time.png",
}  #: Studies of times, their figures.
TIME = r"seconds|ratio_to_conic"  #: In the names of what a clock measured, and of ratios of that.
SHM = Path("/dev/shm")
CODES = {"TERM": (143, -15), "INT": (130, -2), "KILL": (-9,)}
"""Exit codes after each signal; negative ones also before a command has begun, while Python starts."""
TRACKER = r"^.*resource_tracker: There appear to be .*\n  warnings\.warn\(\n"
"""Said by loky's own process, which cleans up behind a study that was killed, or left at once."""
UNDER_WAY = r"(^|/)\.[^/]+\.(new|lock)(/|$)"
"""Names of what a run makes, and of the lock that keeps others out of its place."""
SOCKET = r"/pymp-[^/]+(/listener-[^/]+)?$"
"""In the temporary folder: a socket of Python's own, of a process that had no time to remove it."""
MOVING = r"(^|/)\.[^/]+\.new/(earlier|gone)/"  #: Names of earlier results that have left their place.
STARTING = "Fatal Python error: init_import_site"  #: Said by Python itself: none of our lines has run.
OURS = r"testbench/(?!(cli/|studies/|runs/)?__init__|runs/(interrupt|session))"
"""In a traceback: a module of ours that is imported when stops are heeded already."""
WAYS = ("TERM", "INT", "KILL", "TERM group", "INT group", "KILL group", "INT INT", "TERM KILL")
"""Signals, one after the other; to the process, or to its group as a terminal or a supervisor does."""
STUDY = "--quick --workers 2 --resume --out out".split()
READINGS = "simulate ur10 --absolute --poses 40 --geometry-mm 1 --out"


@dataclass(frozen=True)
class Case:
    """A long command."""

    words: Sequence[str]  #: Its command line.
    out: str = "out"  #: What it writes, in the folder where it runs; nothing if empty.
    resumes: bool = False  #: Whether it stores trials.
    anew: bool = False  #: Whether it makes what must not be there.
    timed: Collection[str] = ()  #: Files that differ from run to run, as they tell how long things took.


def command(line: str, out: str = "out", *, anew: bool = False) -> Case:
    """A command of testbench."""
    return Case((*MAIN, *line.split()), out, anew=anew)


def study(name: str, seeds: int = 1) -> Case:
    """A study, its trials on two workers."""
    script = str(ROOT / "scenarios" / f"{name}.py")
    timed = ("report.json", TIMED[name]) if name in TIMED else ()
    return Case((sys.executable, script, *STUDY, "--seeds", str(seeds)), resumes=True, timed=timed)


STUDIES = {path.stem: study(path.stem) for path in sorted((ROOT / "scenarios").glob("*.py"))}
CASES = {
    "trials": Case((sys.executable, "-c", TRIALS, "out", "--workers", "2", "--resume"), resumes=True),
    "new": command("new out --from ../inputs/robot.urdf", anew=True),
    "check": command("check kr500_l480 --out out"),
    "elastic": command("check kr500_l480 --elastic out.xml", "out.xml"),
    "plan": command(f"plan kr500_l480 --task {ROOT}/docs/tasks.csv --poses 4 --candidates 200 --out out"),
    "plan_absolute": command("plan kr500_l480 --absolute --poses 12 --candidates 60 --out out"),
    "simulate": command("simulate kr500_l480 --poses 40 --payload-kg 460 --out out.csv", "out.csv"),
    "series": command(f"{READINGS} out.csv --series 3", "out*.csv"),
    "data": command("data check kr500_l480 ../inputs/data.csv --out out"),
    "identify": command("identify kr500_l480 ../inputs/data.csv --out out"),
    "calibrate": command("calibrate ur10 ../inputs/readings.csv --orders 1 --out out"),
    "export": command("export ../inputs/calibrated --urdf out.urdf", "out.*"),
    "score": command("calibrate ../inputs/calibrated ../inputs/readings.csv --score", ""),
    "predict": command(f"predict ../inputs/model {ROOT}/docs/tasks.csv --load 460 --out out"),
    "compensate": command(f"compensate ../inputs/model {ROOT}/docs/program.csv --out out.csv", "out*"),
    "compare": command("compare ../inputs/model ../inputs/other --out out"),
    "demo": Case((*MAIN, "demo", *STUDY), resumes=True),
    **STUDIES,
}
"""By the name of the command or the study."""
INPUTS = (
    f"simulate kr500_l480 {ROOT}/docs/poses.csv --out data.csv --payload-kg 460.3",
    f"simulate kr500_l480 {ROOT}/docs/poses.csv --out more.csv --payload-kg 460.3 --seed 2",
    f"{READINGS} readings.csv",
    "identify kr500_l480 data.csv --no-intervals --out model",
    "identify kr500_l480 more.csv --no-intervals --out other",
    "calibrate ur10 readings.csv --orders 1 --out calibrated",
    "export calibrated --urdf robot.urdf",
)


class Fault(Exception):
    """What a kill has shown."""


@dataclass
class Bench:
    """A place for a case."""

    folder: Path  #: Where it runs.
    temporary: Path  #: Its TMPDIR.
    mark: str  #: In the environment of its processes.

    def start(self, case: Case) -> subprocess.Popen[bytes]:
        """Begin it, in a group of its own; what it says goes to a file."""
        environment = {**os.environ, MARK: self.mark, "TMPDIR": str(self.temporary)}
        with (self.temporary.parent / "said").open("wb") as said:
            return subprocess.Popen(
                case.words,
                cwd=self.folder,
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=said,
                start_new_session=True,
                preexec_fn=heed,
            )

    def said(self) -> str:
        """By the last process on standard error."""
        return (self.temporary.parent / "said").read_text(errors="replace")

    def living(self) -> list[str]:
        """Command lines of the processes that run."""
        found = []
        for process in Path("/proc").glob("[0-9]*"):
            with contextlib.suppress(OSError):
                if f"{MARK}={self.mark}".encode() in (process / "environ").read_bytes().split(b"\0"):
                    line = (process / "cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace")
                    found.append(f"{process.name} {line[:100]}")
        return found

    def files(self) -> dict[str, bytes]:
        """What lies in its folder, each file's content; nothing of what tells the time."""
        return {
            path.relative_to(self.folder).as_posix(): timeless(path)
            for path in self.folder.rglob("*")
            if path.is_file()
        }


def timeless(path: Path) -> bytes:
    """What a file holds, without how long a thing took."""
    data = path.read_bytes()
    if path.name in CLOCKS or path.suffix in VIEWS:
        return b""
    if path.suffix == ".parquet":
        table = parquet.read_table(path)
        return repr(
            table.drop_columns([c for c in table.column_names if re.search(TIME, c)]).to_pylist()
        ).encode()
    if path.suffix == ".json":
        return repr(json.loads(data, object_hook=pruned)).encode()
    return data


def pruned(table: dict[str, object]) -> dict[str, object]:
    """A table of a report without what a clock measured."""
    return {key: value for key, value in table.items() if not re.search(TIME, key)}


def heed() -> None:
    """A background job of a shell without job control has Ctrl-C ignored."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


@contextlib.contextmanager
def bench(parent: Path) -> Iterator[Bench]:
    """An empty place, gone with the block, as are all processes that were started there."""
    with tempfile.TemporaryDirectory(dir=parent) as home:
        place = Bench(Path(home, "here"), Path(home, "tmp"), secrets.token_hex(8))
        place.folder.mkdir()
        place.temporary.mkdir()
        if (parent / "inputs").exists():
            Path(home, "inputs").symlink_to(parent / "inputs")
        try:
            yield place
        finally:
            for line in place.living():
                with contextlib.suppress(ProcessLookupError):
                    os.kill(int(line.split()[0]), signal.SIGKILL)


@dataclass(frozen=True)
class Whole:
    """A run that is left alone."""

    files: dict[str, bytes]  #: What it leaves.
    seconds: float  #: Time that it takes [s].
    rest: float = 0.0  #: Time that it takes where all trials are stored [s].
    trials: int = 0  #: Those that it stores.

    def left(self, held: int) -> float:
        """Time that it takes where so many trials are stored [s]."""
        share = held / self.trials if self.trials else 0.0
        return self.seconds + share * (self.rest - self.seconds)


def whole(case: Case, place: Bench) -> Whole:
    """Run the case to its end; a study again, with all its trials."""
    first = finished(case, place)
    if not case.resumes:
        return first
    return replace(first, rest=finished(case, place).seconds, trials=sum(stored(place.folder).values()))


def finished(case: Case, place: Bench) -> Whole:
    """Run the case to its end."""
    clear(case, place)
    start = time.monotonic()
    with place.start(case) as process:
        code = process.wait(LONGEST)
    if code != 0:
        raise Fault(f"ended with {code}: {place.said()[-2000:]}")
    return Whole(place.files(), time.monotonic() - start)


def clear(case: Case, place: Bench) -> None:
    """Remove what the case must not find."""
    if case.anew:
        shutil.rmtree(place.folder / case.out, ignore_errors=True)


def strike(process: subprocess.Popen[bytes], way: str, rng: random.Random) -> None:
    """Kill it so."""
    for k, name in enumerate(way.removesuffix(" group").split()):
        time.sleep(rng.uniform(0, 0.3) if k else 0)
        with contextlib.suppress(ProcessLookupError):
            send = os.killpg if way.endswith(" group") else os.kill
            send(process.pid, getattr(signal, f"SIG{name}"))


def killed(case: Case, place: Bench, after: float, way: str, rng: random.Random) -> bool:
    """Begin the case, kill it after a time [s]; whether it was alive then.

    Raises:
        Fault: When something lives on, or it said more than a line.
    """
    clear(case, place)
    with place.start(case) as process:
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(after)
        early = process.poll() is not None
        strike(process, way, rng)
        end = time.monotonic() + GRACE
        while (left := place.living()) and time.monotonic() < end:
            process.poll()
            time.sleep(0.02)
        if left:
            raise Fault(f"{way} after {after:.2f} s: {GRACE:g} s later there run {left}")
        code = process.wait()
    said, when = place.said(), f"{way} after {after:.2f} s"
    said = re.sub(TRACKER, "", said, flags=re.MULTILINE) if "KILL" in way or way == "INT INT" else said
    if said.startswith(STARTING):
        return not early
    begun = code not in (-2, -15) or re.search(OURS, said)
    if (begun and said.count("\n") > 1) or (early and said):
        raise Fault(f"{when}: said {said[-3000:]!r}")
    if code not in {0, *(code for word in way.split() for code in CODES.get(word, ()))}:
        raise Fault(f"{when}: ended with {code}: {said!r}")
    return not early


def stored(out: Path) -> dict[Path, int]:
    """Trials of a run by the files that hold them; those under way too."""
    found = {}
    for ended in out.rglob("trials.parquet"):
        if not re.search(UNDER_WAY, ended.relative_to(out).as_posix()):
            found[ended.with_suffix("")] = int(parquet.read_schema(ended).metadata[b"trials"])
    for part in out.rglob("trials/*.parquet"):
        with contextlib.suppress(InputError):  # its run has just ended
            found[part.parent] = found.get(part.parent, 0) + len(part_seeds(part))
    return found


def chain(case: Case, place: Bench, whole: Whole, rng: random.Random, kills: int = CHAIN) -> Counter[str]:
    """Kills of a case that lives, and a run to its end; how many of each way, and how many came too late.

    Args:
        case: The command.
        place: Where; earlier results are kept by a command that has no trials.
        whole: A run that was left alone.
        rng: For moments and ways.
        kills: How many.

    Raises:
        Fault: When something is wrong.
    """
    ways: Counter[str] = Counter()
    held: dict[Path, int] = {}
    while hits(ways) < kills:
        if ways[LATE] > MOST_LATE * kills:
            raise Fault(f"ends before it is killed, {ways[LATE]} times: {ways}")
        if case.resumes and sum(held.values()) >= whole.trials:
            shutil.rmtree(place.folder / case.out, ignore_errors=True)
            held = {}
        way = rng.choice(WAYS)
        moment = rng.uniform(0, whole.left(sum(held.values())))
        ways[way if killed(case, place, moment, way, rng) else LATE] += 1
        if case.resumes:
            held = checked(held, stored(place.folder), way)
        else:
            check_stands(case, place.files(), whole.files, way)
    check_alike(finished(case, place).files, whole.files, "run to its end", case.timed)
    left = [
        *place.temporary.rglob("*"),
        *(p for p in place.folder.rglob("*") if re.search(UNDER_WAY, p.name)),
    ]
    if any("KILL" in way for way in ways):
        left = [p for p in left if not re.search(SOCKET, p.as_posix())]
    if left:
        raise Fault(f"left lying: {[str(path) for path in left]}")
    return ways


def hits(ways: Counter[str]) -> int:
    """Kills of what was alive."""
    return ways.total() - ways[LATE]


def checked(held: dict[Path, int], now: dict[Path, int], way: str) -> dict[Path, int]:
    """What is stored now; a Fault if it is less than before."""
    for store, count in held.items():
        if now.get(store, 0) < count:
            raise Fault(f"{way}: of {count} trials in {store.name} there are {now.get(store, 0)}")
    return now


def check_stands(case: Case, files: dict[str, bytes], whole: dict[str, bytes], way: str) -> None:
    """Refuse earlier results that are not as they were; some may be on their way."""
    if not any(re.search(MOVING, name) for name in files):
        stands = {name: data for name, data in files.items() if not re.search(UNDER_WAY, name)}
        check_alike(stands, whole if stands or not case.anew else {}, f"{way}: earlier results")


def check_alike(
    files: dict[str, bytes], whole: dict[str, bytes], what: str, timed: Collection[str] = ()
) -> None:
    """Refuse files that are not those of a run that was left alone; the timed ones must be there."""
    differ = sorted(n for n in files.keys() | whole.keys() if files.get(n) != whole.get(n))
    differ = [n for n in differ if Path(n).name not in timed or n not in files.keys() & whole.keys()]
    if differ:
        raise Fault(f"{what}: not as left alone: {differ}")


def main(count: int = 200, seed: int = 1, *names: str) -> int:
    """Kill every case in turn until so many were alive; prints a line a chain. How many chains failed."""
    rng = random.Random(seed)
    faults = 0
    ways = Counter[str]()
    start, shm = time.monotonic(), set(SHM.iterdir())
    with tempfile.TemporaryDirectory(prefix="kills_") as home, contextlib.ExitStack() as stack:
        make_inputs(Path(home, "inputs"))
        wholes: dict[str, tuple[Bench, Whole]] = {}
        turns = itertools.cycle(names or CASES)
        while hits(ways) < count and faults < MOST_FAULTS:
            name = next(turns)
            try:
                if name not in wholes:
                    place = stack.enter_context(bench(Path(home)))
                    wholes[name] = place, whole(CASES[name], place)
                    print(f"{name}: {wholes[name][1].seconds:.1f} s left alone", flush=True)
                ways += chain(CASES[name], *wholes[name], rng, min(CHAIN, count - hits(ways)))
            except Fault as err:
                faults += 1
                wholes.pop(name, None)
                print(f"FAULT: {name}: {err}", flush=True)
            print(f"{hits(ways)} kills, {ways[LATE]} too late, {faults} faults, {name}", flush=True)
    print(f"{dict(ways)} in {time.monotonic() - start:.0f} s")
    print(f"new in {SHM}: {sorted(path.name for path in set(SHM.iterdir()) - shm)}")
    return faults


def make_inputs(folder: Path) -> None:
    """What commands read."""
    folder.mkdir()
    for line in INPUTS:
        subprocess.run([*MAIN, *line.split()], cwd=folder, check=True, stdout=subprocess.DEVNULL)


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    numbers = [int(word) for word in sys.argv[1:] if word.isdecimal()]
    sys.exit(bool(main(*numbers, *(word for word in sys.argv[1:] if not word.isdecimal()))))
