"""An arm looked at as a whole: what it is, what must be confirmed, what may be wrong."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from testbench.arm.catalogue import find_arm
from testbench.arm.elastic import Elastic, read_elastic
from testbench.bench.agreement import check_agreement
from testbench.bench.arm_doubts import Looked, arm_doubts
from testbench.bench.campaign import Cell, build_cell
from testbench.bench.confirm import Item, to_confirm
from testbench.bench.sag import Sag, sag
from testbench.errors import Array
from testbench.identify.doubts import Doubt
from testbench.model.vjm import body_poses, tool_pose


@dataclass(frozen=True, eq=False)
class Checked:
    """An arm and what was found."""

    cell: Cell  #: The arm.
    elastic: Elastic  #: Its elastic.toml, with the origin of every number.
    apart: float  #: Largest distance between the two readings of it [m].
    sag: Sag  #: Of its tool over the work area.
    items: list[Item]  #: To confirm, the largest effect first.
    doubts: list[Doubt]  #: What may be wrong.

    @property
    def reach(self) -> float:
        """Stretched length from the first joint to the tool [m]."""
        return self.cell.vjm.reach

    @cached_property
    def poses(self) -> Array:
        """To draw: zero, or as near to it as the limits let, and the pose of median sag, (2, n) [rad, m].

        A first joint about the vertical does not change the sag: both poses have it at the same angle.
        """
        zero = np.clip(np.zeros(self.cell.arm.n_joints), *self.cell.arm.limits)
        middle = int(np.argsort(self.sag.size)[len(self.sag.size) // 2])
        poses = np.array([zero, self.sag.q[middle]])
        if Looked(self.cell, self.elastic, self.sag).upright:
            poses[1, 0] = poses[0, 0]
        return poses

    @cached_property
    def worst(self) -> int:
        """Which pose has the largest sag."""
        return int(np.argmax(self.sag.size))

    @property
    def worst_place(self) -> list[float]:
        """Where the tool is in it, without the sag [m]."""
        position, _ = tool_pose(self.cell.vjm, self.sag.q[self.worst][None])
        return [float(x) for x in position[0]]

    @property
    def beams(self) -> Array:
        """Where each link's beam begins and how it lies, in both poses, (2, n + 1, 4, 4) [m]."""
        found = np.tile(np.eye(4), (2, len(self.cell.arm.links), 1, 1))
        for k, (link, (p, R)) in enumerate(
            zip(self.cell.arm.links, body_poses(self.cell.vjm, self.poses), strict=False)
        ):
            found[:, k, :3, :3], found[:, k, :3, 3] = R @ link.frame, p
        return found

    @property
    def sizes(self) -> Array:
        """Length and outer diameter of each tube; of a link without one its way, (n + 1, 2) [m]."""
        return np.array(
            [
                (np.linalg.norm(way), 0.0)
                if link.tube is None
                else (link.tube.length.value, link.tube.outer_diameter.value)
                for link, way in zip(self.elastic.link, self.cell.vjm.steps, strict=True)
            ]
        )

    def doubted(self, name: str) -> bool:
        """Whether a doubt is about a link, joint or point of that name."""
        said = [doubt.sentence for doubt in self.doubts]
        return any(s.startswith(f"{name} ") or name in s.partition(":")[0].split(", ") for s in said)


def check(folder: str | Path) -> Checked:
    """Read an arm and look for what must be confirmed and what may be wrong.

    Raises:
        InputError: When the arm's folder is wrong.
    """
    cell = build_cell(folder)
    elastic = read_elastic(find_arm(folder) / "elastic.toml")
    found = sag(cell)
    return Checked(
        cell=cell,
        elastic=elastic,
        apart=check_agreement(cell.vjm, cell.plant),
        sag=found,
        items=to_confirm(cell, elastic, found),
        doubts=arm_doubts(Looked(cell, elastic, found)),
    )
