"""The measuring cell: an arm with its model, its simulated robot and its surroundings."""

from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from testbench.arm.folder import Arm, load_arm
from testbench.display import Displayed
from testbench.errors import Array, BenchError, InputError
from testbench.model.kinematics import build_vjm
from testbench.model.structure import theta_row_labels
from testbench.model.vjm import Vjm, WorkArea, body_poses, random_poses

if TYPE_CHECKING:  # importing MuJoCo takes a sixth of a second, and --help does without
    from testbench.identify.estimate import Estimate
    from testbench.identify.posterior import ArmModel, ModelSource
    from testbench.plant.build import Plant
    from testbench.plant.rigid_cell import RigidCell

AGREEMENT, POSES = 1e-9, 8
"""Distance between two readings of an arm [m] over one metre plus that from the origin; poses compared."""


@dataclass(frozen=True, repr=False)
class Cell(Displayed):
    """Hold an arm with its model, its truth and its surroundings, built once for many campaigns.

    Truth and surroundings are built when they are first needed.
    """

    arm: Arm
    vjm: Vjm
    truth: "Plant | None" = None  #: Simulated arm if it is not that of the arm's folder; None for that one.
    floor: float | None = None  #: Height of a floor that rigid.xml does not have [m]; None for none.

    def summary(self) -> dict[str, object]:
        """Summarise the arm."""
        return self.arm.summary()

    @cached_property
    def plant(self) -> "Plant":
        """Return the simulated true arm."""
        from testbench.plant.build import build_plant

        return self.truth or build_plant(self.arm)

    @cached_property
    def room(self) -> "RigidCell":
        """Return the arm's surroundings, for collisions."""
        from testbench.plant.rigid_cell import build_rigid_cell

        return build_rigid_cell(self.arm, floor_height=self.floor)

    def model(self, found: "Estimate | ModelSource") -> "ArmModel":
        """Make the model of this arm that `predict`, `compensate`, `stiffness` and `save_model` take.

        Args:
            found: An estimate of compliances by any estimator, or what `calibrate` returns.

        Returns:
            The identified arm: its state theta = theta_0 + C_theta u, and the posterior of what is uncertain.
            From an estimate it is the arm as drawn, bent by its own weight where rigid.xml states masses.

        Raises:
            BenchError: When the estimate is one of another arm.
        """
        from testbench.identify.estimate import Estimate  # here: simulating needs no fits
        from testbench.identify.posterior import ModelSource, model_of_estimate
        from testbench.model.load import read_body_masses_with_note

        if isinstance(found, ModelSource):
            return found.model()
        if not isinstance(found, Estimate):
            raise BenchError(f"model: expected an Estimate or a Calibration, got {type(found).__name__}")
        names, own = found.structure.row_labels, theta_row_labels(self.arm)
        if names[: len(own)] != own:
            raise BenchError(f"model: expected an estimate of {self.arm.name}, got one of {names[0]} ...")
        return model_of_estimate(self.vjm, found, read_body_masses_with_note(self.arm)[0])


def build_cell(folder: str | Path) -> Cell:
    """Load an arm and build its model.

    Args:
        folder: Folder of the arm, or name of an arm that comes with testbench.

    Returns:
        The cell on which simulations, plans and predictions work.

    Raises:
        InputError: If the arm's folder is wrong, or MuJoCo and the model disagree on the arm.
    """
    arm = load_arm(folder)
    cell = Cell(arm, build_vjm(arm))
    check_agreement(cell.vjm, cell.plant)
    return cell


def check_agreement(vjm: Vjm, plant: "Plant") -> float:
    """Compute the largest distance between bodies as truth and model place them; axes count at one metre.

    MuJoCo and Pinocchio read the arm independently.

    Args:
        vjm: The model of the arm.
        plant: The true arm.

    Returns:
        Distance [m].

    Raises:
        InputError: If it exceeds rounding; names the body.
    """
    from testbench.plant.shapes import undeflected_body_poses

    arm = vjm.arm
    q = arm.draw_poses(np.random.default_rng(0), POSES)
    ours = [np.dstack([R, p]) for p, R in body_poses(vjm, q)]  # axes and origin as columns
    at, axes = ours[-1][..., 3:], ours[-1][..., :3]  # of points on the tool the model knows no axes
    ours += [at + axes @ point[:, None] for point in (vjm.load_point, *vjm.markers)]
    names = (*(link.name for link in arm.links), arm.tool, arm.load_point, *arm.markers)
    largest = 0.0
    for name, own, (p, R) in zip(names, ours, undeflected_body_poses(plant, q, names), strict=True):
        theirs = np.dstack([R, p])[..., -own.shape[2] :]
        apart = float(np.abs(own - theirs).max())
        if not apart <= AGREEMENT * (1 + float(np.abs(p).max())):
            problem = f"MuJoCo and Pinocchio place it {apart:.1e} m apart"
            raise InputError(arm.mjcf_path, f"<body name={name!r}>", problem)
        largest = max(largest, apart)
    return largest


def clear_poses(cell: Cell, area: WorkArea | None, count: int, rng: np.random.Generator) -> Array:
    """Draw random poses without collision.

    Args:
        cell: The arm.
        area: Work area of the tool; None for anywhere.
        count: Number of poses.
        rng: Source of the poses.

    Returns:
        Actuated joints, (count, n) [rad, m].
    """
    from testbench.plant.rigid_cell import collision_free

    return random_poses(cell.vjm, area, count, partial(collision_free, cell.room), rng)
