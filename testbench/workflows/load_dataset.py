"""The public dataset, read as it was simulated: campaigns of true arms, each with a prior that is wrong.

`tools/build_dataset.py` makes it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import numpy.typing as npt
import pyarrow as pa
from pyarrow import parquet
from scipy.linalg import block_diag

from testbench.arm.folder import Arm, load_arm
from testbench.data.dataset import Dataset, select_rows
from testbench.errors import BenchError, InputError
from testbench.files.names import WHEN, columns_of
from testbench.identify.prior import Prior
from testbench.workflows.campaign import Campaign, Scenario

Cells = npt.NDArray[np.generic]
ARM = "kr500_l480"  #: Which of ours is measured, in its campaign of section 6.
SCENARIO = Scenario(arm=ARM, workspace_poses=100)
SPLITS = ("train", "dev", "test")
CAMPAIGNS, READINGS = "campaigns.parquet", "readings.parquet"
DEFLECTIONS, ARMS = "truth_deflections.parquet", "truth_arms.parquet"  #: What no estimator may see.
TABLES = (CAMPAIGNS, READINGS, DEFLECTIONS, ARMS)

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
    if split not in (None, *SPLITS):
        raise BenchError(f"split: expected {', '.join(SPLITS)}, got {split!r}")
    path = Path(folder) / CAMPAIGNS
    if not path.is_file():
        raise InputError(Path(folder), "", f"expected the folder of the public dataset, with {CAMPAIGNS}")
    arm = load_arm(Path(folder) / "arms" / ARM)
    known = read_table(path, KNOWN, split=split)
    measured, truth = (_sets(Path(folder) / name, arm, split) for name in (READINGS, DEFLECTIONS))
    public_campaigns = []
    for number, of, part, seed, *C in zip(*(known[name].tolist() for name in KNOWN), strict=True):
        try:
            own = measured[number]
            true = truth[number]
            links, joints = np.reshape(C[0], (len(arm.links), 6, 6)), np.reshape(C[1], len(arm.joints))
            prior = Prior(f"{number}", block_diag(*links, np.diag(joints)))
            sets = own[""], own["identification"], own["check"], true["check"], true["workspace"]
        except (KeyError, ValueError) as err:
            problem = "expected its prior, readings and true deflections"
            raise InputError(path, f"campaign {number}", problem) from err
        public_campaigns.append(PublicCampaign(number, of, part, prior, Campaign(SCENARIO, seed, *sets)))
    return public_campaigns


def _sets(path: Path, arm: Arm, split: str | None) -> dict[int, dict[str, Dataset]]:
    """Runs by campaign and set; all of a campaign by no name."""
    joints, m = [joint.file_column for joint in arm.file_joints], len(arm.markers)
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
        run_id=table["run"][::m].astype(int),
        pose_id=table["pose"][::m].astype(int),
        q=arm.to_chain_joints(q[::m]),
        wrench=np.hstack([force, moment])[::m],
        point=point[::m],
        before=before.reshape(-1, m, 3),
        after=after.reshape(-1, m, 3),
        sigma=float(table["sigma_m"][0]),
    )
    number, sets = table["campaign"][::m], table["set"][::m]
    found = {}
    for rows in np.split(np.arange(data.n_runs), np.flatnonzero(np.diff(number)) + 1):
        own = {
            name: select_rows(data, rows[sets[rows] == name]) for name in dict.fromkeys(sets[rows].tolist())
        }
        found[int(number[rows[0]])] = own | {"": select_rows(data, rows)}
    return found


def read_table(path: Path, names: Sequence[str], **kept: str | None) -> dict[str, Cells]:
    """Read columns of a table by name.

    Args:
        path: The file.
        names: The columns that are wanted; there may be more.
        kept: By column the word of the rows that are wanted; None for all rows.

    Returns:
        The columns.

    Raises:
        InputError: When it is no Parquet file, or lacks a column.
    """
    words = [(name, "==", word) for name, word in kept.items() if word is not None]
    try:
        lacking = [name for name in (*names, *kept) if name not in parquet.read_schema(path).names]
        if lacking:
            raise InputError(path, f"column {lacking[0]}", "this column is missing")
        table = parquet.read_table(path, columns=list(names), filters=words or None)
        return {name: _array(table[name]) for name in names}
    except (OSError, ValueError, pa.ArrowException) as err:
        raise InputError(path, "", f"expected a table in Parquet: {err}") from err


def _array(column: pa.ChunkedArray) -> Cells:
    lists = pa.types.is_list(column.type)
    return np.array(column.to_pylist()) if lists else column.to_numpy()
