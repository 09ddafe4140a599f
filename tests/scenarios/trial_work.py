"""Trials for the tests of the engine: what they draw depends on the seed alone."""

import os
import signal
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from testbench.errors import InputError

SIZE = 60
LATE = 20  # first seed with a long blob, and of those that may never end


@dataclass(frozen=True)
class Toy:
    """A row; blob is long for late seeds, so that a small disk is full in mid-study."""

    kind: str
    norm: float
    rank: int | None
    gap: float | None = None
    whole: bool | None = None
    blob: str = ""


def _touch(pids):
    if pids:
        (Path(pids) / str(os.getpid())).touch()


def trials(pause, pids, seeds):
    """Random numbers and a little of what BLAS and LAPACK do; and a file for every process in folder pids."""
    _touch(pids)
    found = []
    for seed in seeds:
        time.sleep(pause)
        rng = np.random.Generator(np.random.Philox(np.random.SeedSequence(seed)))
        a = rng.normal(size=(SIZE, SIZE))
        solved = np.linalg.solve(a @ a.T + np.eye(SIZE), a[0])
        values = np.linalg.svd(a, compute_uv=False)
        blob = rng.bytes(200 * seed).hex() if seed >= LATE else ""
        rank = np.int64(seed % 3)
        found.append(
            [
                Toy("solve", np.linalg.norm(solved), rank, gap=np.nan, blob=blob),
                Toy("svd", values.sum(), None, whole=bool(seed % 2)),
            ]
        )
    return found


@dataclass(frozen=True)
class Blocked:
    """Stops that do not reach the process of a trial, as it was when its worker began."""

    names: str


def blocked_stops(seeds):
    """What keeps stops from this process since before it imported anything."""
    names = " ".join(sorted(number.name for number in signal.pthread_sigmask(signal.SIG_BLOCK, [])))
    return [[Blocked(names)] for _ in seeds]


def endless_trials(pause, pids, seeds):
    """The same for early seeds; late ones never end, so that whoever is to be stopped still runs."""
    _touch(pids)
    while seeds[-1] >= LATE:
        time.sleep(1)
    return trials(pause, pids, seeds)


def bad_trials(seeds):
    """A problem of the user's, which an exception with three arguments tells."""
    raise InputError(Path("arm.toml"), "line 3", "expected a mass")


def deadly_trials(poison, seeds):
    """Kill the process at one seed."""
    if poison in seeds:
        os._exit(9)
    return trials(0.0, "", seeds)


def faulty_trials(seeds):
    """A fault of the program."""
    raise ZeroDivisionError("no trial of ours")
