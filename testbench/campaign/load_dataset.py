"""The public dataset read back: campaigns with their priors, as they were simulated."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from testbench.arm.folder import Arm, load_arm
from testbench.campaign.campaign import Campaign
from testbench.campaign.public_dataset import (
    ARM,
    CAMPAIGNS,
    DEFLECTIONS,
    NUMBER,
    READINGS,
    SCENARIO,
    SET,
    SPLIT,
    TURNS,
)
from testbench.data.dataset import Dataset, Ids, in_order
from testbench.data.names import WHEN, columns_of
from testbench.display import Displayed
from testbench.errors import Array, BenchError, InputError
from testbench.identify.prior import Prior
from testbench.trials.tables import Cells, read_table


@dataclass(frozen=True, repr=False)
class PublicCampaign(Displayed):
    """One campaign of the public dataset."""

    number: int  #: From 0.
    arm: int  #: Number of the true arm: campaigns of one arm are in one split.
    split: str  #: "train", "dev" or "test".
    prior: Prior  #: What an estimator is given beside the readings.
    campaign: Campaign  #: The readings, and the truth to judge by.

    def about(self) -> dict[str, object]:
        """Which it is."""
        return {"number": self.number, "arm": self.arm, "split": self.split}


def load_dataset(
    folder: str | Path, split: Literal["train", "dev", "test"] | None = None
) -> list[PublicCampaign]:
    """Read the public dataset.

    Args:
        folder: Of `testbench dataset build`; `build_cell(folder / "arms" / "kr500_l480")` is the cell.
        split: Which part; None for all.

    Returns:
        Its campaigns, in order.

    Raises:
        BenchError: When there is no such split, or a file is missing or wrong.
    """
    if split not in (None, *TURNS):
        raise BenchError(f"split: expected {', '.join(dict.fromkeys(TURNS))}, got {split!r}")
    folder = Path(folder)
    arm, path = load_arm(folder / "arms" / ARM), folder / CAMPAIGNS
    names = (NUMBER, "arm", SPLIT, "seed", "prior_links", "prior_joints")
    known = read_table(path, names, split=split)
    measured, truth = (_Runs.read(folder / name, arm, split) for name in (READINGS, DEFLECTIONS))
    found = []
    for number, own, part, seed, links, joints in zip(*(known[name].tolist() for name in names), strict=True):
        campaign = Campaign(
            SCENARIO,
            seed,
            measured.of(number),
            measured.of(number, "identification"),
            measured.of(number, "check"),
            truth.of(number, "check"),
            truth.of(number, "workspace"),
        )
        prior = Prior(f"of campaign {number}", _compliances(path, arm, links, joints))
        found.append(PublicCampaign(number, own, part, prior, campaign))
    return found


def _compliances(path: Path, arm: Arm, links: list[float], joints: list[float]) -> Array:
    """C_theta of the entries of a row."""
    n, C = 6 * len(arm.links), np.zeros((arm.n_theta, arm.n_theta))
    if (len(links), len(joints)) != (6 * n, arm.n_joints):
        problem = f"expected {6 * n} and {arm.n_joints} numbers, got {len(links)} and {len(joints)}"
        raise InputError(path, "columns prior_links, prior_joints", problem)
    blocks = np.reshape(links, (-1, 6, 6))
    for k, block in enumerate(blocks):
        C[6 * k : 6 * k + 6, 6 * k : 6 * k + 6] = block
    C[range(n, arm.n_theta), range(n, arm.n_theta)] = joints
    return C


@dataclass(frozen=True)
class _Runs:
    """All runs of a table, in the order of the campaigns."""

    path: Path
    data: Dataset
    number: Ids  #: Campaign of every run, (runs,).
    set: Cells  #: Its set, (runs,).

    @classmethod
    def read(cls, path: Path, arm: Arm, split: str | None) -> "_Runs":
        names = list(_columns(arm))
        table = read_table(path, (NUMBER, SET, "run", "pose", "marker", *names, "sigma_m"), split=split)
        m = len(arm.markers)
        number = table[NUMBER]
        if table["marker"].tolist() != list(arm.markers) * (len(number) // m):
            raise InputError(path, "column marker", f"expected {', '.join(arm.markers)} in turn")
        if not len(number) or (np.diff(number) < 0).any():
            raise InputError(path, f"column {NUMBER}", "expected numbers that rise")
        return cls(path, _dataset(arm, table), number[::m].astype(int), table[SET][::m])

    def of(self, number: int, name: str | None = None) -> Dataset:
        """The runs of a campaign, or of one set of it."""
        first, end = np.searchsorted(self.number, [number, number + 1])
        rows = np.arange(first, end)
        rows = rows if name is None else rows[self.set[rows] == name]
        if not len(rows):
            raise InputError(
                self.path, f"campaign {number}", f"expected runs to {name or 'read'}, there are none"
            )
        return in_order(self.data, rows)


def _columns(arm: Arm) -> Iterator[str]:
    """Those of numbers, a quantity after the other."""
    yield from (joint.column for joint in arm.joints)
    for what in ("force", "moment", "point"):
        yield from columns_of(what)
    for when in WHEN:
        yield from columns_of("reading", when)


def _dataset(arm: Arm, table: Mapping[str, Cells]) -> Dataset:
    """The runs of a table of points."""
    m = len(arm.markers)

    def rows(names: Iterable[str]) -> Array:
        return np.column_stack([table[name] for name in names])

    before, after = (rows(columns_of("reading", when)).reshape(-1, m, 3) for when in WHEN)
    return Dataset(
        markers=arm.markers,
        run=table["run"][::m].astype(int),
        pose=table["pose"][::m].astype(int),
        q=rows(joint.column for joint in arm.joints)[::m],
        wrench=np.hstack([rows(columns_of("force")), rows(columns_of("moment"))])[::m],
        point=rows(columns_of("point"))[::m],
        before=before,
        after=after,
        sigma=float(table["sigma_m"][0]),
    )
