"""The public dataset: campaigns of true arms of every kind, each with a prior that is wrong in one way.

In a round there is one campaign a kind of true arm in TRUTHS and error of a prior in PRIORS. An arm is
measured once a prior, in other poses and with other noise. The campaign with number k has seed root + k, and
the true arm has that of its first campaign. They are read back as they were simulated.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from scipy.linalg import block_diag

from testbench.arm.folder import Arm, load_arm
from testbench.data.dataset import Dataset, select_rows
from testbench.errors import Array, BenchError, InputError
from testbench.files.names import WHEN, columns_of
from testbench.files.write import columns
from testbench.identify.metric import Prior
from testbench.plant.true_arms import TRUTHS
from testbench.runs.tables import Cells, read_table, write_table
from testbench.workflows.cell import Campaign, Cell, Scenario, build_cell, draw_poses, simulate_at, true_cell
from testbench.workflows.models import PRIORS, prior_of

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


def kind_of(first: int) -> str:
    """Return the true arm whose campaigns begin with this one, a multiple of the number of priors."""
    return list(TRUTHS)[first % GRID // len(PRIORS)]


def split_of(first: int) -> str:
    """Return what all campaigns of an arm are for; kinds are not all in the same turn of a round."""
    turn = 0 if kind_of(first) == FOLDER else first // GRID + first % GRID // len(PRIORS)
    return TURNS[turn % len(TURNS)]


def write_rounds(root: int, folder: str, rounds: Sequence[int]) -> list[list[object]]:
    """Simulate some rounds, each into tables of a folder of its own; see `runs.engine.Work`.

    Args:
        root: Seed of all randomness.
        folder: Folder of the tables.
        rounds: Numbers of the rounds.

    Returns:
        No rows.
    """
    cell = build_cell(ARM)
    for k in rounds:
        arms = range(GRID * k, GRID * (k + 1), len(PRIORS))
        path, rows = Path(folder) / str(k), [row for first in arms for row in _rows(cell, first, root)]
        path.mkdir()
        for name in TABLES:
            write_table(path / name, _joined([row[name] for row in rows]))
    return [[] for _ in rounds]


def _joined(tables: Sequence[Mapping[str, Cells]]) -> dict[str, Cells]:
    return {name: np.concatenate([own[name] for own in tables]) for name in tables[0]}


def _rows(cell: Cell, first: int, root: int) -> Iterator[Row]:
    """All campaigns of an arm: what is known of each, and apart from that what is true."""
    kind = kind_of(first)
    true = true_cell(cell, kind, root + first)
    for number, error in enumerate(PRIORS, first):
        seed = root + number
        campaign = simulate_at(true, SCENARIO, seed, draw_poses(cell, SCENARIO, seed))
        head = {"campaign": number, "split": split_of(first)}
        about = _repeated(1, head | {"arm": 0 if kind == FOLDER else first, "seed": seed})
        yield {
            CAMPAIGNS: about | _compliance_cells(cell, prior_of(cell, error, seed).C_theta, "prior_"),
            READINGS: _points(
                cell, head, {"identification": campaign.identification, "check": campaign.check}
            ),
            DEFLECTIONS: _points(cell, head, {"check": campaign.check_true, "workspace": campaign.truth}),
            ARMS: about
            | _repeated(1, {"true_arm": kind, "prior_error": error})
            | _compliance_cells(cell, true.plant.arm.C_theta, ""),
        }


def _repeated(rows: int, values: Mapping[str, object]) -> dict[str, Cells]:
    return {name: np.array([value] * rows) for name, value in values.items()}


def _compliance_cells(cell: Cell, C: Array, prefix: str) -> dict[str, Cells]:
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


KNOWN = ("campaign", "arm", "split", "seed", "prior_links", "prior_joints")


@dataclass(frozen=True)
class PublicCampaign:
    """Hold one campaign of the public dataset."""

    number: int  #: Number of the campaign, from 0.
    arm: int  #: Number of the true arm: campaigns of one arm are in one split.
    split: str  #: "train", "dev" or "test".
    prior: Prior  #: Prior that an estimator may use together with the readings.
    campaign: Campaign  #: Its readings, and the truth to judge by.


def load_dataset(
    folder: str | Path, split: Literal["train", "dev", "test"] | None = None
) -> list[PublicCampaign]:
    """Read the public dataset.

    Args:
        folder: Folder that `tools/build_dataset.py` wrote; `build_cell(folder / "arms" / "kr500_l480")` is
            the cell.
        split: Part of the dataset; None for all.

    Returns:
        Its campaigns, in order.

    Raises:
        BenchError: If there is no such split, or a file is missing or wrong.
    """
    if split not in (None, *TURNS):
        raise BenchError(f"split: expected {', '.join(dict.fromkeys(TURNS))}, got {split!r}")
    path = Path(folder) / CAMPAIGNS
    if not path.is_file():
        raise InputError(Path(folder), "", f"expected the folder of the public dataset, with {CAMPAIGNS}")
    arm = load_arm(Path(folder) / "arms" / ARM)
    known = read_table(path, KNOWN, split=split)
    measured, truth = (_sets(Path(folder) / name, arm, split) for name in (READINGS, DEFLECTIONS))
    public_campaigns = []
    for number, of, part, seed, *C in zip(*(known[name].tolist() for name in KNOWN), strict=True):
        try:
            own, true, prior = measured[number], truth[number], Prior(f"{number}", _compliances(arm, *C))
            sets = own[""], own["identification"], own["check"], true["check"], true["workspace"]
        except (KeyError, ValueError) as err:
            problem = "expected its prior, readings and true deflections"
            raise InputError(path, f"campaign {number}", problem) from err
        public_campaigns.append(PublicCampaign(number, of, part, prior, Campaign(SCENARIO, seed, *sets)))
    return public_campaigns


def _compliances(arm: Arm, links: Sequence[float], joints: Sequence[float]) -> Array:
    """C_theta; ValueError for another number of links or joints."""
    C = block_diag(*np.reshape(links, (len(arm.links), 6, 6)), np.diag(joints))
    return C.reshape(arm.n_theta, arm.n_theta)


def _sets(path: Path, arm: Arm, split: str | None) -> dict[int, dict[str, Dataset]]:
    """Runs by campaign and set; all of a campaign by no name."""
    joints, m = [joint.column for joint in arm.file_joints], len(arm.markers)
    blocks = [columns_of("force"), columns_of("moment"), columns_of("point")]
    blocks += [columns_of("reading", when) for when in WHEN]
    numbers = [*joints, *(name for block in blocks for name in block)]
    names = ("campaign", "set", "run", "pose", "marker", "sigma_m", *numbers)
    table = read_table(path, names, split=split)
    if table["marker"].tolist() != list(arm.markers) * (len(table["marker"]) // m):
        raise InputError(path, "column marker", f"expected {', '.join(arm.markers)} in turn")
    q, force, moment, point, before, after = (
        np.column_stack([table[name].astype(float) for name in block]) for block in (joints, *blocks)
    )
    data = Dataset(
        markers=arm.markers,
        run=table["run"][::m].astype(int),
        pose=table["pose"][::m].astype(int),
        q=arm.to_model(q[::m]),
        wrench=np.hstack([force, moment])[::m],
        point=point[::m],
        before=before.reshape(-1, m, 3),
        after=after.reshape(-1, m, 3),
        sigma=float(table["sigma_m"][0]),
    )
    number, sets = table["campaign"][::m], table["set"][::m]
    found = {}
    for rows in np.split(np.arange(data.runs), np.flatnonzero(np.diff(number)) + 1):
        own = {
            name: select_rows(data, rows[sets[rows] == name]) for name in dict.fromkeys(sets[rows].tolist())
        }
        found[int(number[rows[0]])] = own | {"": select_rows(data, rows)}
    return found
