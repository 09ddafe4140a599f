"""What the study of pose selection tries: sizes, where the robot works, how runs are identified."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated

import numpy as np
import typer
from pydantic import Field

from testbench.arm.folder import Arm
from testbench.arm.library import find_arm
from testbench.data.dataset import Dataset
from testbench.identify import Estimate
from testbench.identify.method import Method, gco, least_squares, with_prior
from testbench.identify.prior import Prior, Strength
from testbench.model.poses import WorkArea
from testbench.model.structure import Structure, mgco68, template56
from testbench.model.vjm import Vjm
from testbench.studies.pose_selection.rows import Scene

NAME = "pose_selection"
RANDOM = "random"
"""Poses without a plan, beside the criteria of planning.CRITERIA."""
SCALE, SHAPE, UNCERTAINTY = 2.0, 0.3, 0.3
"""How wrong the priors are, by a common factor and axis by axis, and how firmly they are believed."""


@dataclass(frozen=True)
class Fit:
    """How runs are identified: a method on a structure, with the prior or without."""

    name: str
    structure: Callable[[Arm], Structure]
    prior: bool
    method: Method = gco

    def identify(self, vjm: Vjm, prior: Prior, data: Dataset) -> Estimate:
        """Compliances from runs; the prior's common scale is left to them."""
        method = with_prior(self.method, prior, Strength(UNCERTAINTY)) if self.prior else self.method
        return method(vjm, self.structure(vjm.arm), data)


FITS = (
    Fit("MGCO68 + prior", mgco68, True),
    Fit("MGCO56 + prior", template56, True),
    Fit("MGCO68", mgco68, False),
    Fit("MGCO56", template56, False),
)
PLANNED, BARE = FITS[0], FITS[2]
"""The fit that plans are made for, and the same without its prior."""
ON_ARMS = (PLANNED, Fit("MLS68 + prior", mgco68, True, least_squares))
"""On arms drawn from the prior, GCO and LS."""


@dataclass(frozen=True)
class Options:
    """Flags of the study."""

    arm: Annotated[str, typer.Option(help="Folder of the arm, or the name of one of ours.")] = "kr500_l480"


AREA = WorkArea((1.7, -0.9, 1.1), (2.7, 0.9, 2.1), (1.0, 0.0, 0.0), np.pi / 4)
ANYWHERE = WorkArea((-4.0, -4.0, 0.8), (4.0, 4.0, 4.0))
"""Where the robot works, that of section 6, and the workspace."""


@dataclass(frozen=True)
class Scope:
    """What is tried.

    Attributes:
        payload: Hung mass [kg].
        sigma: Standard deviation of one reading along one axis [m].
        station: Of the tracker [m].
        poses: Numbers of poses.
        criteria: Keys of planning.CRITERIA.
        candidates: Feasible poses to choose from.
        tasks: Random poses of the work area where predictions are wanted.
        workspace: Random poses all over the workspace.
        area: Work area.
        anywhere: The workspace.
        featured: Number of poses that the report looks at closely.
        variants: How many of the other ways to measure are tried.
    """

    payload: float = 460.3
    sigma: float = 50e-6
    station: tuple[float, float, float] = (4.5, -2.5, 1.6)
    poses: tuple[int, ...] = (4, 6, 8, 12, 16, 20, 30, 40)
    criteria: tuple[str, ...] = ("test", "I", "D", "A", "E", "G")
    candidates: int = 5000
    tasks: int = 20
    workspace: int = 200
    area: WorkArea = AREA
    anywhere: WorkArea = ANYWHERE
    featured: int = 12
    variants: int = 6


QUICK = Scope(poses=(12,), criteria=("test", "D"), candidates=120, tasks=6, workspace=30, variants=1)


EMPTY = Scene()


@dataclass(frozen=True)
class Settings:
    """What is tried.

    Attributes:
        arm: Folder or name of the arm.
        seed: Root of the candidates, the tasks and the planner's prior.
        scope: Sizes and numbers.
        scene: Made of the rest by `plans.prepare`; empty before.
    """

    arm: str
    seed: int
    scope: Scope
    scene: Annotated[Scene, Field(exclude=True)] = EMPTY


def settings(options: Options, quick: bool, seeds: range) -> Settings:
    """What the flags ask for."""
    find_arm(options.arm)
    return Settings(options.arm, seeds[0], QUICK if quick else Scope())
