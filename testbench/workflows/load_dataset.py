"""Reader of the public dataset: campaigns with their priors, as they were simulated."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from scipy.linalg import block_diag

from testbench.arm.folder import Arm, load_arm
from testbench.data.dataset import Dataset, in_order
from testbench.errors import Array, BenchError, InputError
from testbench.files.names import WHEN, columns_of
from testbench.identify.prior import Prior
from testbench.runs.tables import read_table
from testbench.workflows.cell import Campaign
from testbench.workflows.public_dataset import ARM, CAMPAIGNS, DEFLECTIONS, READINGS, SCENARIO, TURNS

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
    path, arm = Path(folder) / CAMPAIGNS, load_arm(Path(folder) / "arms" / ARM)
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
        own = {name: in_order(data, rows[sets[rows] == name]) for name in dict.fromkeys(sets[rows].tolist())}
        found[int(number[rows[0]])] = own | {"": in_order(data, rows)}
    return found
