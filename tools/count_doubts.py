"""How often each mistake is named, and how often sound sets are doubted: the table of docs/wrong_inputs.md.

python tools/count_doubts.py --seed 1000 --seeds 500 --planted 100
"""

import csv
import sys
from argparse import ArgumentParser
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from functools import cache, partial
from pathlib import Path

import numpy as np
from scipy.stats import binomtest
from threadpoolctl import threadpool_limits

from testbench.report.markdown import lines
from testbench.runs.rows import trial_rng
from testbench.workflows.cell import build_cell

ROOT = Path(__file__).resolve().parents[1]
sys.path.append(str(ROOT / "tests" / "physics"))

from mistakes import MISTAKES, named  # noqa: E402
from sound_sets import PAYLOAD, sound  # noqa: E402

HEADS = ["mistake", "name of the warning", "sets", "named first, % (95 %)", "no warning, %", "named instead"]
OFTEN = 0.98  #: Share of the data sets from which on a mistake has no row of its own.


@cache
def cells():
    """The arms, built once a process."""
    threadpool_limits(1)
    return {name: build_cell(ROOT / "models" / name) for name in PAYLOAD}


def judge(seed, planted, only):
    """Case, kind of data set and first doubt: of the sound set of a seed, then of every mistake."""
    own = sound(cells(), seed)
    kind = ("one target" if len(own.data.markers) == 1 else "several targets", own.loads)
    kind += ("with backlash and the like" if own.disturbed else "as the models",)
    found = [("sound", kind, first(own))]
    for name in only if seed in planted else ():
        if MISTAKES[name].possible(own):
            found.append((name, kind, first(MISTAKES[name].plant(own, trial_rng(seed, 40)))))
    return found


def first(own):
    """Name of the first doubt about a data set; None where there is none."""
    return next((doubt.name for doubt in named(own)), None)


def right(case, doubt):
    """Whether the first doubt names the mistake; of a sound set, whether there is none."""
    return doubt is None if case == "sound" else doubt in MISTAKES[case].names.split()


def rate(held):
    """Per cent in which something holds, with 95 % interval (Wilson's score)."""
    share = float(np.mean(held))
    low, high = binomtest(sum(held), len(held)).proportion_ci(method="wilson")
    return f"{100 * share:.1f} ({100 * low:.1f} to {100 * high:.1f})"


def table(found):
    """Cells of a row for each mistake named in less than 98 %, the most seldom first, then for all others."""
    rows = []
    always = []
    others = []
    for name, mistake in MISTAKES.items():
        own = [(doubt, right(name, doubt)) for case, _, doubt in found if case == name]
        often = np.mean([well for _, well in own]) if own else 0.0
        if often >= OFTEN:
            always.append(mistake.words)
            others += own
        elif own:
            rows.append((often, [mistake.words, mistake.names.replace(" ", " or "), *counted(own)]))
    yield HEADS
    yield from (row for _, row in sorted(rows, key=lambda row: row[0]))
    if others:
        yield [f"each of {len(always)}: {'; '.join(always)}", "its own", *counted(others)]


def counted(found):
    """Cells of a row: data sets, how many were named first, how many not doubted, other names."""
    silent = 100 * sum(doubt is None for doubt, _ in found) / len(found)
    other = Counter(doubt for doubt, well in found if doubt and not well).most_common(2)
    instead = ", ".join(f"{doubt} ({count})" for doubt, count in other)
    return [len(found), rate([well for _, well in found]), f"{silent:.1f}", instead]


def words(found):
    """Shares over all data sets, and by kind of set."""
    for kind in ("all", *sorted({kind for _, kinds, _ in found for kind in kinds})):
        own = [(case, doubt) for case, kinds, doubt in found if kind in ("all", *kinds)]
        alarms = [doubt is not None for case, doubt in own if case == "sound"]
        held = [(right(case, doubt), doubt is None) for case, doubt in own if case != "sound"]
        if held:
            well, silent = (rate(column) for column in zip(*held, strict=True))
            yield f"{kind}: {len(held)} data sets with a mistake, named first {well} %, no doubt {silent} %; "
            yield f"{len(alarms)} sound ones, {rate(alarms)} % with a doubt.\n"


def main():
    """Count, and print the table; write it with `--into`."""
    flags = ArgumentParser(description=__doc__)
    flags.add_argument("--seed", type=int, default=1000, help="first seed")
    flags.add_argument("--seeds", type=int, default=100, help="sound data sets")
    flags.add_argument("--planted", type=int, default=100, help="data sets in which mistakes are planted")
    flags.add_argument("--into", type=Path, help="CSV file for the table: docs/tables/wrong_inputs.csv")
    flags.add_argument("--fault", action="append", choices=MISTAKES, help="again for more; all else")
    asked = flags.parse_args()
    planted = range(asked.seed, asked.seed + asked.planted)
    work = partial(judge, planted=planted, only=asked.fault or list(MISTAKES))
    with ProcessPoolExecutor() as workers:
        seeds = range(asked.seed, asked.seed + asked.seeds)
        found = [row for own in workers.map(work, seeds) for row in own]
    heads, *rows = table(found)
    print(lines(heads, [[str(cell) for cell in row] for row in rows]), "", *words(found), sep="\n")
    if asked.into:
        with asked.into.open("w", encoding="utf-8", newline="") as file:
            csv.writer(file, lineterminator="\n").writerows([heads, *rows])


if __name__ == "__main__":
    main()
