"""The public dataset: campaigns of true arms of every kind, each with a prior that is wrong in one way.

Of every kind of true arm in TRUTHS and every error of a prior in PRIORS there are as many campaigns. An arm
is measured once a prior, in other poses and with other noise. The k-th campaign has seed root + k and, with
the five beside it, the true arm of the first of the six.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from testbench.campaign.campaign import Cell, Scenario, build_cell, draw_poses, simulate_at
from testbench.campaign.perturbed_prior import PRIORS, prior_of
from testbench.campaign.true_arms import TRUTHS, true_cell
from testbench.data.dataset import Dataset
from testbench.data.write import columns
from testbench.errors import Array
from testbench.trials.tables import Cells, join_tables, write_table

ARM = "kr500_l480"  #: Which of ours is measured, in its campaign of section 6.
SCENARIO = Scenario(arm=ARM, workspace_poses=100)
FOLDER = "tubes"  #: The kind that is the folder's own arm, the same for every seed: one arm, in one split.
GRID = len(TRUTHS) * len(PRIORS)  #: Campaigns of a round: one a kind of arm and error of a prior.
ROUNDS = 100
TURNS = ("train", "dev", "test", *["train"] * 2, "test", *["train"] * 4)
"""The splits that arms of a kind are in, in turn."""
CAMPAIGNS, READINGS = "campaigns.parquet", "readings.parquet"
DEFLECTIONS, ARMS = "truth_deflections.parquet", "truth_arms.parquet"  #: What no estimator may see.
TABLES = (CAMPAIGNS, READINGS, DEFLECTIONS, ARMS)
NUMBER, SPLIT, SET = "campaign", "split", "set"


@dataclass(frozen=True)
class Wanted:
    """One campaign of the dataset."""

    number: int  #: From 0.
    root: int  #: Seed of the whole dataset.

    @property
    def kind(self) -> str:
        """Of the true arm, a name of TRUTHS."""
        return list(TRUTHS)[self.number % GRID // len(PRIORS)]

    @property
    def prior(self) -> str:
        """What is wrong with the prior, a name of PRIORS."""
        return list(PRIORS)[self.number % len(PRIORS)]

    @property
    def seed(self) -> int:
        """Of poses, noise and the errors of the prior."""
        return self.root + self.number

    @property
    def arm(self) -> int:
        """Number of the true arm, that of the first campaign which has it, as far as seeds go."""
        return 0 if self.kind == FOLDER else self.number - self.number % len(PRIORS)

    @property
    def split(self) -> str:
        """What it is for: all campaigns of an arm are for the same."""
        turn = self.number // GRID + self.number % GRID // len(PRIORS)
        return TURNS[0 if self.kind == FOLDER else turn % len(TURNS)]


@dataclass(frozen=True)
class Made:
    """A round that is written."""

    round: int


def write_rounds(root: int, folder: str, rounds: Sequence[int]) -> list[list[Made]]:
    """Simulate some rounds, each into tables of a folder of its own; see `trials.engine.Work`."""
    cell = build_cell(ARM)
    for k in rounds:
        own, rows = Path(folder) / str(k), list(_rows(cell, root, k))
        own.mkdir()
        for name in TABLES:
            every = [row[name] for row in rows]
            write_table(own / name, {key: np.concatenate([row[key] for row in every]) for key in every[0]})
    return [[Made(k)] for k in rounds]


def join_rounds(parts: Path, rounds: int, folder: Path) -> None:
    """The tables of all rounds, one behind the other."""
    for name in TABLES:
        join_tables([parts / str(k) / name for k in range(rounds)], folder / name)


Row = dict[str, dict[str, Cells]]
"""Of one campaign what stands in every table, by table and column."""


def _rows(cell: Cell, root: int, k: int) -> Iterator[Row]:
    """All campaigns of a round; a true arm is built once for its six."""
    for first in range(GRID * k, GRID * (k + 1), len(PRIORS)):
        arm = Wanted(first, root)
        true = true_cell(cell, arm.kind, arm.seed)
        yield from (_row(true, Wanted(number, root)) for number in range(first, first + len(PRIORS)))


def _row(cell: Cell, wanted: Wanted) -> Row:
    """One campaign: what is known of it, and apart from that what is true."""
    seed = wanted.seed
    campaign = simulate_at(cell, SCENARIO, seed, draw_poses(cell, SCENARIO, seed))
    about: dict[str, object] = {NUMBER: wanted.number, "arm": wanted.arm, SPLIT: wanted.split, "seed": seed}
    prior, true = prior_of(cell, wanted.prior, seed).C_theta, cell.plant.arm.C_theta
    kinds = {"true_arm": wanted.kind, "prior_error": wanted.prior}
    measured = {"identification": campaign.identification, "check": campaign.check}
    truth = {"check": campaign.check_true, "workspace": campaign.truth}
    return {
        CAMPAIGNS: _one(about) | _compliances(cell, prior, "prior_"),
        READINGS: _points(cell, wanted, measured),
        DEFLECTIONS: _points(cell, wanted, truth),
        ARMS: _one(about | kinds) | _compliances(cell, true, ""),
    }


def _one(values: Mapping[str, object]) -> dict[str, Cells]:
    return {name: np.array([value]) for name, value in values.items()}


def _compliances(cell: Cell, C: Array, prefix: str) -> dict[str, Cells]:
    """Of all links in their beam frames, row by row, and of all joints, a row each."""
    n = 6 * len(cell.arm.links)
    links = C[:n, :n].reshape(n // 6, 6, n // 6, 6)[range(n // 6), :, range(n // 6)]
    return {f"{prefix}links": links.reshape(1, -1), f"{prefix}joints": np.diag(C)[None, n:]}


def _points(cell: Cell, wanted: Wanted, sets: Mapping[str, Dataset]) -> dict[str, Cells]:
    """A row a marker of a run, in the columns of dataset.csv, of some sets of runs."""
    found = []
    for name, data in sets.items():
        known = _one({NUMBER: wanted.number, SPLIT: wanted.split, SET: name})
        head = {key: np.repeat(value, data.points) for key, value in known.items()}
        found.append(head | {key: np.asarray(cells) for key, cells in columns(data, cell.arm).items()})
    return {key: np.concatenate([own[key] for own in found]) for key in found[0]}
