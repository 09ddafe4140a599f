"""Random bad inputs through the real command line: none may change an input, leave a thing or raise.

python tools/fuzz.py [COUNT] [SEED]

Each case is a folder of an arm, readings, poses, tasks, a map, a registration and a robot, some of them
spoiled, and a command with random flags. It must end with 0, or with 2, one line, and the folder as it was.
"""

import contextlib
import hashlib
import io
import os
import random
import re
import shutil
import subprocess
import sys
import tempfile
import traceback
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import typer

from testbench.cli.program import COMMANDS, program
from testbench.runs import command

ROOT = Path(__file__).resolve().parents[1]
UNDER_WAY = r"(^|/)\.[^/]+\.(new|lock)(/|$)"  #: Names of what a command makes, and of the lock of its place.
MAIN = "from testbench.cli import main; main()"
READ = 2**20  #: Files above are told by size and time alone [byte].
REAL = 50  #: One of so many cases runs as a process of its own.
ROBOT = """<robot name="r"><link name="base"/>{links}</robot>"""
LINK = """<joint name="j{k}" type="revolute"><parent link="{parent}"/><child link="l{k}"/>
<origin xyz="0 0 0.3"/><axis xyz="{axis}"/><limit lower="-2" upper="2" effort="1" velocity="1"/></joint>
<link name="l{k}"><inertial><mass value="9"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>
</inertial><visual><origin xyz="0 0 .1"/><geometry><box size="0.1 0.1 0.2"/></geometry></visual></link>
"""
MAP = '[columns]\nrun = "run"\npose = "pose"\nmarker = "marker"\n'
FRAME = "translation_m = [1.0, 2.0, 0.5]\nrotation_rad = [0.0, 0.0, 0.3]\n"
NUMBERS = [*"0 -1 1 3 50 0.5 460 nan inf -inf 1e300 1e-300 x".split(), "9" * 30, ""]
TRIPLES = [*"1,2,3 4,-2,1.5 0,0,0,1,1,1 1,1,1,0,0,0 1,2 a,b,c nan,0,0 1e300,0,0 ,".split(), ""]
WORDS = "MGCO56 joints all153 mgco1 test D auto base tracker P1 P1=0,0,0.1 link_1".split()
PLACES = [
    *". .. / /dev/null /dev/full /proc/x new new/deep/place arm arm/rigid.xml arm/new.xml data.csv".split(),
    *"poses.csv tasks.csv map.toml frame.toml robot.urdf link dangling fifo folder notes.txt old -".split(),
    *("", "x" * 300, "no\nname", "a\udcffb", "a[b].csv"),
]
SMALL = {"candidates": ["60", "0", "-5", "x", "99999999"], "poses": ["1", "2", "3", "0", "-1", "999", "x"]}
BAD = [*b"nan inf 1e300 -1 0 x , ; ' \"".split(), b"", b"\x00", b"\xff\xfe", b"\t", b"\n"]


def cell(rng: random.Random, text: bytes) -> bytes:
    """Another value for one number or word."""
    words = list(filter(None, text.replace(b",", b" ").replace(b'"', b" ").split()))
    old = rng.choice(words) if words else b""
    return text.replace(old, rng.choice([*BAD, rng.choice(words or [b""])]), rng.choice([1, 1, -1]))


def line(rng: random.Random, text: bytes) -> bytes:
    """A line gone, twice or elsewhere."""
    lines = text.split(b"\n")
    k = rng.randrange(len(lines))
    new = [[], [lines[k]] * 2, [rng.choice(lines)], [b"," * 3000], [lines[k].replace(b",", b";")]]
    return b"\n".join([*lines[:k], *rng.choice(new), *lines[k + 1 :]])


def raw(rng: random.Random, text: bytes) -> bytes:
    """Bytes as they never should be."""
    k = rng.randrange(len(text) + 1)
    ways = [text[:k], text[:k] + rng.choice(BAD) + text[k + 1 :], b"", rng.randbytes(300), text[k:]]
    ways += [b"\xef\xbb\xbf" + text, text.decode("latin-1").encode("utf-16"), text.replace(b"\n", b"\r\n")]
    return rng.choice(ways)


WAYS: list[Callable[[random.Random, bytes], bytes]] = [cell, cell, cell, line, line, raw]


def spoil(rng: random.Random, path: Path) -> None:
    """Make a file wrong, or something else of it."""
    kind = rng.random()
    if kind < 0.9:
        for _ in range(rng.choice([1, 1, 1, 3])):
            path.write_bytes(rng.choice(WAYS)(rng, path.read_bytes()))
        return
    path.unlink()
    if kind < 0.93:
        path.mkdir()
    elif kind < 0.96:
        os.mkfifo(path)
    elif kind < 0.98:
        path.symlink_to(path.name)


@dataclass(frozen=True)
class Stock:
    """Sound inputs, made once."""

    folder: Path

    def lay_out(self, rng: random.Random, work: Path) -> None:
        """Copy them, spoil some, and lay traps beside them."""
        shutil.copytree(self.folder, work)
        files = sorted(p for p in work.rglob("*") if p.is_file())
        for path in rng.sample(files, rng.choice([0, 1, 1, 1, 2])):
            spoil(rng, path)
        (work / "link").symlink_to("data.csv")
        (work / "dangling").symlink_to("nothing")
        os.mkfifo(work / "fifo")
        (work / "folder").mkdir()
        (work / "notes.txt").write_text("mine")
        shutil.copytree(work / "folder", work / "old")
        (work / "old" / "manifest.json").write_text('{"command": "other", "versions": {"testbench": "0"}}')


def make_stock(folder: Path) -> Stock:
    """An arm with readings, poses, tasks, a map, a registration and a robot."""
    folder.mkdir(parents=True)
    shutil.copytree(ROOT / "models" / "arm_6r", folder / "arm")
    for name in ("poses.csv", "tasks.csv"):
        shutil.copy(ROOT / "docs" / name, folder / name)
    axes, parents = ("0 0 1", "0 1 0") * 2, ("base", "l0", "l1", "l2")
    links = "".join(
        LINK.format(k=k, parent=p, axis=a) for k, (p, a) in enumerate(zip(parents, axes, strict=True))
    )
    (folder / "robot.urdf").write_text(ROBOT.format(links=links))
    (folder / "map.toml").write_text(MAP)
    (folder / "frame.toml").write_text(FRAME)
    head, *_ = (folder / "poses.csv").read_text().splitlines()
    rng = random.Random(1)
    rows = [",".join(f"{rng.uniform(-0.2, 0.4):.4f}" for _ in head.split(",")) for _ in range(6)]
    (folder / "poses.csv").write_text("\n".join([head, *rows]) + "\n")
    args = [
        "simulate",
        folder / "arm",
        folder / "poses.csv",
        "--payload-kg",
        "1",
        "--out",
        folder / "data.csv",
    ]
    code, _, said = run_here([str(a) for a in args], folder)
    if code:
        raise RuntimeError(f"sound inputs were refused: {said}")
    return Stock(folder)


def run_here(args: list[str], work: Path) -> tuple[int, str, str]:
    """Exit code and outputs of a command in this process."""
    out = io.StringIO()
    err = io.StringIO()
    before = Path.cwd()
    argv, sys.argv = sys.argv, ["testbench", *args]
    os.chdir(work)
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err), warnings.catch_warnings():
            warnings.simplefilter("error")
            code = command.run(program(args), err.write)
    except BaseException:
        code = -1
        err.write(traceback.format_exc())
    finally:
        sys.argv = argv
        os.chdir(before)
    return code, out.getvalue(), err.getvalue()


def run_real(args: list[str], work: Path) -> tuple[int, str, str]:
    """The same as a process of its own."""
    env = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, "-c", MAIN, *args], cwd=work, env=env, capture_output=True, check=False
    )
    return done.returncode, done.stdout.decode(errors="replace"), done.stderr.decode(errors="replace")


def arguments(rng: random.Random) -> list[str]:
    """A command line."""
    name = rng.choice([name for name in COMMANDS if name != "demo"])
    found = typer.main.get_command(program([name])).commands[name]
    words = [name]
    if hasattr(found, "commands"):
        sub = rng.choice(sorted(found.commands))
        words, found = [*words, sub], found.commands[sub]
    if name == "plan":
        words += ["--candidates", "60", "--poses", "3"]
    if name == "bench":  # all of its tasks take minutes
        words += ["--quick", "--seeds", "1", "--task", "gravity-8", "--workers", "1"]
    for param in found.params:
        needed = param.required or param.name in ("out", "model")
        if (needed and rng.random() < 0.97) or rng.random() < 0.15:
            words += flag(rng, param)
    return [word for word in words if word is not None]


def flag(rng: random.Random, param: object) -> list[str]:
    """A flag or an argument with a value, sound in two of three."""
    option = [rng.choice([*param.opts, *param.secondary_opts])] if param.param_type_name == "option" else []
    if getattr(param, "is_flag", False):
        return [] if param.name == "help" else option
    sound = {"arm": "arm", "dataset": "data.csv", "poses": "poses.csv", "task": "tasks.csv", "out": "new"}
    sound |= {"source": "robot.urdf", "mapping": "map.toml", "name": "new", "file": "new", "model": "MGCO56"}
    if param.name in sound and not (option and param.name == "poses") and rng.random() < 0.7:
        return [*option, sound[param.name]]
    pool = SMALL.get(param.name if option else "", [])
    return [*option, rng.choice(pool or rng.choice([NUMBERS, TRIPLES, WORDS, PLACES, PLACES]))]


State = dict[str, tuple[object, ...]]


def state(work: Path) -> State:
    """What every path is, and what is in it; pipes and links are not followed."""
    found = {}
    for root, folders, files in os.walk(work):
        for name in (*folders, *files):
            path = Path(root, name)
            found[os.fsencode(path.relative_to(work)).decode(errors="backslashreplace")] = _state(path)
    return found


def _state(path: Path) -> tuple[object, ...]:
    status = path.lstat()
    if path.is_symlink():
        return "link", str(path.readlink())
    if not path.is_file():
        return "other", status.st_mode
    if status.st_size > READ:
        return "large", status.st_size, status.st_mtime_ns
    return "file", hashlib.sha256(path.read_bytes()).hexdigest()


def problem(args: list[str], before: State, after: State, done: tuple[int, str, str]) -> str:
    """What a command did that it must not do; empty if nothing."""
    code, out, err = done
    changed = sorted(name for name in before if after.get(name) != before[name])
    new = sorted(after.keys() - before.keys())
    left = [name for name in new if re.search(UNDER_WAY, name) or "MUJOCO_LOG" in name]
    if "Traceback" in out + err or code not in (0, 2):
        return f"exit code {code}: {err[-1500:]}"
    if code == 2 and (err.count("\n") != 1 or not err.startswith("error: ")):
        return f"expected one line, got {err!r}"
    if code == 0 and err:
        return f"said {err!r}"
    if left or (code == 2 and new):
        return f"left {left or new}"
    free = code == 0 and ("--force" in args or args[0] == "simulate")  # which replaces a dataset
    reads = set() if args[0] in ("check", "simulate") else {"data.csv", "poses.csv", "tasks.csv"}
    if set(changed) - (set(args) - reads if free else set()):
        return f"changed {changed}"
    return ""


def cases(stock: Stock, count: int, seed: int, *, real: int = REAL) -> Iterator[tuple[int, str, int, str]]:
    """Number, command line, exit code and problem of every case."""
    for k in range(count):
        rng = random.Random(f"{seed}/{k}")
        with tempfile.TemporaryDirectory(prefix="fuzz-") as folder:
            work = Path(folder) / "work"
            stock.lay_out(rng, work)
            args, before = arguments(rng), state(work)
            done = (run_real if k % real == real - 1 else run_here)(args, work)
            yield k, repr(args), done[0], problem(args, before, state(work), done)


def main(count: int = 1000, seed: int = 1) -> int:
    """Run so many cases; 1 if one of them did what it must not do."""
    codes: dict[int, int] = {}
    bad = 0
    with tempfile.TemporaryDirectory(prefix="fuzz-") as folder:
        for k, args, code, found in cases(make_stock(Path(folder) / "stock"), count, seed):
            codes[code] = codes.get(code, 0) + 1
            if found:
                bad += 1
                print(f"{seed}/{k} {args}: {found}", flush=True)
    print(f"{count} cases of seed {seed}, exit codes {codes}: {bad} with problems")
    return int(bad > 0)


if __name__ == "__main__":
    sys.exit(main(*map(int, sys.argv[1:])))
