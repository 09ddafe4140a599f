"""The public dataset: campaigns of true arms of every kind, each with a prior that is wrong in one way.

In a round there is one campaign a kind of true arm in TRUTHS and error of a prior in PRIORS. An arm is
measured once a prior, in other poses and with other noise. The campaign with number k has seed root + k, and
the true arm has that of its first campaign.
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
GRID = len(TRUTHS) * len(PRIORS)  #: Campaigns of a round.
ROUNDS = 100
TURNS = ("train", "dev", "test", *["train"] * 2, "test", *["train"] * 4)
"""The splits that arms of a kind are in, in turn."""
CAMPAIGNS, READINGS = "campaigns.parquet", "readings.parquet"
DEFLECTIONS, ARMS = "truth_deflections.parquet", "truth_arms.parquet"  #: What no estimator may see.
TABLES = (CAMPAIGNS, READINGS, DEFLECTIONS, ARMS)

Row = dict[str, dict[str, Cells]]
"""Of one campaign what stands in every table, by table and column."""


@dataclass(frozen=True)
class Wanted:
    """A true arm, and the first of its campaigns: one a prior."""

    number: int  #: Of that campaign, a multiple of the number of priors.

    @property
    def kind(self) -> str:
        """A name of TRUTHS."""
        return list(TRUTHS)[self.number % GRID // len(PRIORS)]

    @property
    def arm(self) -> int:
        """Number of the arm."""
        return 0 if self.kind == FOLDER else self.number

    @property
    def split(self) -> str:
        """What all its campaigns are for; kinds are not all in the same turn of a round."""
        turn = 0 if self.kind == FOLDER else self.number // GRID + self.number % GRID // len(PRIORS)
        return TURNS[turn % len(TURNS)]


def write_rounds(root: int, folder: str, rounds: Sequence[int]) -> list[list[object]]:
    """Simulate some rounds, each into tables of a folder of its own; see `trials.engine.Work`."""
    cell = build_cell(ARM)
    for k in rounds:
        arms = (Wanted(first) for first in range(GRID * k, GRID * (k + 1), len(PRIORS)))
        own, rows = Path(folder) / str(k), [row for arm in arms for row in _rows(cell, arm, root)]
        own.mkdir()
        for name in TABLES:
            write_table(own / name, _joined([row[name] for row in rows]))
    return [[] for _ in rounds]


def join_rounds(parts: Path, rounds: int, folder: Path) -> None:
    """The tables of all rounds, one behind the other."""
    for name in TABLES:
        join_tables([parts / str(k) / name for k in range(rounds)], folder / name)


def _joined(tables: Sequence[Mapping[str, Cells]]) -> dict[str, Cells]:
    return {name: np.concatenate([own[name] for own in tables]) for name in tables[0]}


def _rows(cell: Cell, wanted: Wanted, root: int) -> Iterator[Row]:
    """All campaigns of an arm: what is known of each, and apart from that what is true."""
    true = true_cell(cell, wanted.kind, root + wanted.number)
    for number, error in enumerate(PRIORS, wanted.number):
        seed = root + number
        own = simulate_at(true, SCENARIO, seed, draw_poses(cell, SCENARIO, seed))
        head = {"campaign": number, "split": wanted.split}
        about = _repeated(1, head | {"arm": wanted.arm, "seed": seed})
        yield {
            CAMPAIGNS: about | _compliances(cell, prior_of(cell, error, seed).C_theta, "prior_"),
            READINGS: _points(cell, head, {"identification": own.identification, "check": own.check}),
            DEFLECTIONS: _points(cell, head, {"check": own.check_true, "workspace": own.truth}),
            ARMS: about
            | _repeated(1, {"true_arm": wanted.kind, "prior_error": error})
            | _compliances(cell, true.plant.arm.C_theta, ""),
        }


def _repeated(rows: int, values: Mapping[str, object]) -> dict[str, Cells]:
    return {name: np.array([value] * rows) for name, value in values.items()}


def _compliances(cell: Cell, C: Array, prefix: str) -> dict[str, Cells]:
    """Of all links in their beam frames, row by row, and of all joints, a row each."""
    k, n = range(len(cell.arm.links)), 6 * len(cell.arm.links)
    links = C[:n, :n].reshape(len(k), 6, len(k), 6)[k, :, k]
    return {f"{prefix}links": links.reshape(1, -1), f"{prefix}joints": np.diag(C)[None, n:]}


def _points(cell: Cell, head: Mapping[str, object], sets: Mapping[str, Dataset]) -> dict[str, Cells]:
    """A row a marker of a run, in the columns of dataset.csv, of some sets of runs."""
    return _joined(
        [
            _repeated(data.points, {**head, "set": name})
            | {key: np.asarray(cells) for key, cells in columns(data, cell.arm).items()}
            for name, data in sets.items()
        ]
    )
