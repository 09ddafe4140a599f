"""Freeze the numbers of every command and study, and compare the numbers of two commits.

    python tools/freeze.py run DIR [NAME ...]         run the examples, small, into DIR
    python tools/freeze.py compare DIR OTHER [--at-most 1e-9]

`run` uses the testbench of the interpreter that runs it. Exit code 1 where a number differs by more
than the tolerance, relative to the larger of the two and to 1e-9 of a unit.
"""

import argparse
import json
import math
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

from pyarrow import csv, parquet

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
STUDIES = sorted(path.stem for path in (ROOT / "scenarios").glob("*.py"))
COMMANDS: dict[str, str] = {
    "demo": "demo --out {out}",
    "simulate": "simulate kr500_l480 {docs}/poses.csv --payload-kg 460.3 --seed 3 --out {out}.csv",
    "data": "data check kr500_l480 {maps}/spatialanalyzer.csv --map {maps}/spatialanalyzer.toml --out {out}",
    "plan": "plan kr500_l480 --task {docs}/tasks.csv --poses 8 --load 460 --out {out}",
    "plan_absolute": "plan kr500_l480 --absolute --poses 10 --out {out}",
    "identify": "identify kr500_l480 {docs}/example_dataset.csv --out {out}",
    "identify_robust": "identify kr500_l480 {docs}/example_dataset.csv --robust --no-prior --out {out}",
    "calibrate": "calibrate ur10 {readings}/series_A_every_8th.csv --out {out}",
    "predict": "predict {dir}/identify {docs}/program.csv --load 200 --out {out}",
    "compensate": "compensate {dir}/identify {docs}/program.csv --load 200 --out {out}.csv",
    "export": "compensate {dir}/identify {docs}/program.csv --load 200 --out {out}.src",
    "check": "check kr500_l480 --out {out}",
}
"""Examples by name; later ones read what earlier ones left."""
CLOCK = ("seconds", "hashes", "versions", "commit", "created", "time", "files", "command", "_s")
"""Parts of a key that change with the machine or the commit."""


def run(folder: Path, names: list[str]) -> None:
    """Run the examples into a folder, one after the other."""
    program = Path(sys.executable).with_name("testbench")
    folder.mkdir(parents=True, exist_ok=True)
    elsewhere = tempfile.mkdtemp()  # a result called as an arm would be taken for it
    for name in names or [*COMMANDS, *STUDIES]:
        out = folder / name
        if name in COMMANDS:
            places = {"docs": DOCS, "maps": DOCS / "maps", "readings": ROOT / "models/ur10/readings"}
            words = COMMANDS[name].format(out=out, dir=folder, **places)
            call = [str(program), *words.split()]
        else:
            call = [sys.executable, str(ROOT / "scenarios" / f"{name}.py"), "--seed", "1", "--quick", "--out"]
            call.append(str(out))
        done = subprocess.run([*call, "--quiet"], check=False, capture_output=True, text=True, cwd=elsewhere)
        print(f"{name}: exit code {done.returncode} {done.stderr.strip()[:200]}", flush=True)


def numbers(folder: Path) -> dict[str, object]:
    """Collect every number and word that the runs of a folder left, by file and place in it."""
    found: dict[str, object] = {}
    readers: dict[str, Callable[[Path], object]] = {
        ".json": lambda path: json.loads(path.read_text()),
        ".csv": lambda path: csv.read_csv(path).to_pydict(),
        ".parquet": lambda path: parquet.read_table(path).to_pydict(),
    }
    for path in sorted(folder.rglob("*")):
        if path.suffix in readers and path.name != "manifest.json":
            place = path.relative_to(folder).as_posix()
            found |= {f"{place}: {key}": value for key, value in leaves(readers[path.suffix](path))}
    return found


def leaves(value: object, key: str = "") -> Iterator[tuple[str, object]]:
    """Walk a document to its leaves, but those that follow the clock or the commit."""
    if isinstance(value, dict):
        for name, part in value.items():
            if not any(word in str(name).lower() for word in CLOCK):
                yield from leaves(part, f"{key}.{name}")
    elif isinstance(value, list):
        for k, part in enumerate(value):
            yield from leaves(part, f"{key}[{k}]")
    else:
        yield key, value


def differ(one: object, other: object, at_most: float) -> bool:
    """Tell whether two leaves differ by more than the tolerance."""
    if isinstance(one, float | int) and isinstance(other, float | int):
        if math.isnan(one) and math.isnan(other):
            return False
        return not math.isclose(one, other, rel_tol=at_most, abs_tol=1e-9 * at_most)
    return one != other


def compare(folder: Path, other: Path, at_most: float) -> int:
    """Print what differs between two folders of runs, and count it."""
    mine, theirs = numbers(folder), numbers(other)
    gone, new = [sorted(a.keys() - b.keys()) for a, b in ((mine, theirs), (theirs, mine))]
    moved = [key for key in mine.keys() & theirs.keys() if differ(mine[key], theirs[key], at_most)]
    for title, keys in (("only in the first", gone), ("only in the second", new)):
        print(f"{title}: {len(keys)}", *keys[:20], sep="\n  ")
    print(f"moved: {len(moved)} of {len(mine.keys() & theirs.keys())}")
    for key in sorted(moved)[:60]:
        print(f"  {key}: {mine[key]} -> {theirs[key]}")
    return len(moved) + len(gone)


def main() -> None:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    verbs = parser.add_subparsers(dest="verb", required=True)
    runs = verbs.add_parser("run")
    runs.add_argument("folder", type=Path)
    runs.add_argument("names", nargs="*", metavar="NAME")
    both = verbs.add_parser("compare")
    both.add_argument("folder", type=Path)
    both.add_argument("other", type=Path)
    both.add_argument("--at-most", type=float, default=1e-9)
    asked = parser.parse_args()
    if asked.verb == "run":
        run(asked.folder.absolute(), asked.names)
    else:
        sys.exit(1 if compare(asked.folder, asked.other, asked.at_most) else 0)


if __name__ == "__main__":
    main()
