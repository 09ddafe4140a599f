"""The true deflections that all cells of a trial share: one arm, its poses nested, two kinds of reading."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from testbench.bench.campaign import Cell, Scenario, draw_poses, simulate_at, stream
from testbench.bench.full_pose import FullPose
from testbench.bench.full_pose import simulate as simulate_full_pose
from testbench.bench.truths import true_cell
from testbench.data.dataset import Dataset, Mask, select
from testbench.studies.factorial.trial import reread

Kind = Literal["gravity", "full_pose"]
"""A weight and three markers (section 6), or wrenches along all axes and the tool's full pose (5.2)."""


@dataclass(frozen=True)
class Grid:
    """The cells of one kind of reading."""

    arm: str  #: Name of the arm.
    poses: tuple[int, ...]  #: Ascending: fewer poses are the first ones of the most.
    sigmas: tuple[float, ...]  #: Of a reading along an axis [m].

    @property
    def cells(self) -> list[tuple[int, float]]:
        """Poses and noise of every cell."""
        return [(poses, sigma) for poses in self.poses for sigma in self.sigmas]


@dataclass(frozen=True)
class Clean:
    """An arm's true deflections."""

    runs: Dataset  #: In the poses to identify from.
    judge: Dataset  #: In poses never measured.
    seed: int  #: Of poses, truth and noise.

    def first(self, poses: int) -> Mask:
        """Which runs are in the first poses, (runs,)."""
        return np.asarray(np.isin(self.runs.pose, np.unique(self.runs.pose)[:poses]))

    def read(self, grid: Grid) -> list[Dataset]:
        """Every cell's runs with noise: at every level, and in every cell, the same random numbers."""
        noisy = {sigma: reread(self.runs, sigma, stream(self.seed, 1)) for sigma in grid.sigmas}
        return [select(noisy[sigma], self.first(poses)) for poses, sigma in grid.cells]


Measure = Callable[[Cell, Grid, int, Sequence[str], int], list[Clean]]
"""Of an arm, its grid, the poses to judge by, names of truths and a seed: what is true, a truth each."""


def gravity(cell: Cell, grid: Grid, judged: int, truths: Sequence[str], seed: int) -> list[Clean]:
    """Under a weight: MuJoCo settles every true arm in the same poses."""
    most = max(grid.poses)
    scenario = Scenario(
        arm=cell.arm.name,
        noise=False,
        identification_poses=most,
        identification_runs=most,
        workspace_poses=judged,
    )
    poses = draw_poses(cell, scenario, seed)
    arms = (true_cell(cell, name, seed) for name in truths)
    campaigns = (simulate_at(arm, scenario, seed, poses) for arm in arms)
    return [Clean(c.identification, c.truth, seed) for c in campaigns]


def full_pose(cell: Cell, grid: Grid, judged: int, truths: Sequence[str], seed: int) -> list[Clean]:
    """Under wrenches along all axes, to first order and with deflections in range, as in section 5.2."""
    scenario = FullPose(
        arm=cell.arm.name, noise=False, poses=max(grid.poses), least=9e-3, most=41e-3, check_runs=judged
    )
    arms = (true_cell(cell, name, seed) for name in truths)
    campaigns = (simulate_full_pose(arm, scenario, seed) for arm in arms)
    return [Clean(c.identification, c.truth, seed) for c in campaigns]


MEASURE: dict[Kind, Measure] = {"gravity": gravity, "full_pose": full_pose}
