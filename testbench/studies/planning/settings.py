"""Settings of the study of pose selection: sizes, where the robot works, how runs are identified."""

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from pydantic import Field

from testbench.arm.folder import find_arm
from testbench.design.baselines import Observability
from testbench.model.poses import WorkArea
from testbench.workflows.campaign_flags import ArmFlag
from testbench.workflows.model_selection import DEFAULT, FILLED
from testbench.workflows.models import JOINTS

NAME = "pose_selection"
RANDOM = "random"  #: Poses without a plan, beside the criteria of criteria.CRITERIA.
Angles = tuple[tuple[float, ...], ...]  #: Joint angles, (poses, n) [rad].
MODELS_WITHOUT_PRIOR = ("MGCO68", "MGCO56", JOINTS)
#: How runs are identified.
FITS = (*(f"{name}{FILLED}" for name in MODELS_WITHOUT_PRIOR), *MODELS_WITHOUT_PRIOR)
#: The fit that plans are made for, and the same without its prior.
PLANNED, BARE = FITS[0], MODELS_WITHOUT_PRIOR[0]
INCUMBENT = JOINTS  #: Six joint compliances by plain least squares.
WHOLE = DEFAULT  #: What `identify` does by default.


@dataclass(frozen=True)
class PlanningOptions:
    """Hold the flags of the study."""

    arm: ArmFlag = "kr500_l480"


@dataclass(frozen=True)
class Ground:
    """Say where the tracker stands and the robot works."""

    name: str  #: In words.
    station: tuple[float, float, float]  #: Of the tracker [m].
    area: WorkArea  #: Where predictions are wanted.


HOME = Ground(
    "in front", (4.5, -2.5, 1.6), WorkArea((1.7, -0.9, 1.1), (2.7, 0.9, 2.1), (1.0, 0.0, 0.0), np.pi / 4)
)
AWAY = Ground(
    "at the side", (-2.5, 4.0, 1.8), WorkArea((-0.9, 1.4, 0.9), (0.9, 2.4, 1.9), (0.0, 1.0, 0.0), np.pi / 4)
)
"""Where section 6 works, and another ground, on which nothing was tuned."""
ANYWHERE = WorkArea((-4.0, -4.0, 0.8), (4.0, 4.0, 4.0))  #: The workspace.


@dataclass(frozen=True)
class Scope:
    """Describe what is tried."""

    payload: float = 460.3  #: Hung mass [kg].
    sigma: float = 50e-6  #: Standard deviation of one reading along one axis [m].
    ground: Ground = HOME  #: Where the tracker stands and the robot works.
    #: Numbers of poses, by the first criterion and at random.
    poses: tuple[int, ...] = (4, 6, 8, 12, 16, 20, 30, 40)
    fewer: tuple[int, ...] = (8, 12, 20)  #: Those of them by the other criteria.
    criteria: tuple[str, ...] = ("test", "I", "D", "A", "E", "G")  #: Keys of criteria.CRITERIA.
    candidates: int = 5000  #: Feasible poses to choose from.
    tasks: int = 20  #: Random poses of the work area where predictions are wanted.
    workspace: int = 200  #: Random poses all over the workspace.
    featured: int = 12  #: Number of poses that the report looks at closely.

    def numbers(self, name: str) -> tuple[int, ...]:
        """Return the numbers of poses by a criterion, or at random."""
        return self.poses if name in (self.criteria[0], RANDOM) else self.fewer


QUICK = Scope(
    poses=(9,),
    fewer=(9,),
    criteria=("test", "D"),
    candidates=60,
    tasks=6,
    workspace=30,
    featured=9,
)


@dataclass(frozen=True)
class PlannedRow:
    """Hold a plan, what it is certified for, and which error at the tasks it forecasts."""

    ground: str  #: Name of the ground that it is for.
    fit: str  #: Name of the fit that it is made for.
    criterion: str  #: Key of criteria.CRITERIA.
    poses: int  #: How many.
    q_rad: tuple[float, ...]  #: Their joint angles, one pose after the other, (poses * n,) [rad].
    seconds: float  #: Wall time of planning.
    efficiency_percent: float  #: At least, of the best that as many of the poses examined can reach.
    expected_tasks_mm: float
    observability: Observability


@dataclass(frozen=True)
class PlanningScene:
    """Hold what all plans and trials share: feasible poses, and where predictions are wanted."""

    candidates: Angles = ()  #: Feasible poses to choose from.
    tasks: Angles = ()  #: Poses where the robot works.
    workspace: Angles = ()  #: Poses all over the workspace.
    plans: tuple[PlannedRow, ...] = ()  #: By criterion and number of poses, then by fit.

    def plan(self, criterion: str, poses: int, fit: str) -> PlannedRow:
        """Return the plan by a criterion of so many poses for a fit.

        Args:
            criterion: The criterion.
            poses: Number of poses.
            fit: Name of the fit.

        Returns:
            The plan.
        """
        return next(p for p in self.plans if (p.criterion, p.poses, p.fit) == (criterion, poses, fit))


EMPTY = PlanningScene()


@dataclass(frozen=True)
class PlanningSettings:
    """Describe what is tried."""

    arm: str  #: Folder or name of the arm.
    seed: int  #: Root of the candidates, the tasks and the planner's prior; the first trial.
    scope: Scope  #: Sizes and numbers.
    #: Made of the rest by `study.prepare`; empty before.
    scene: Annotated[PlanningScene, Field(exclude=True)] = EMPTY
    away: Annotated[PlanningScene, Field(exclude=True)] = EMPTY  #: The same on the other ground.


def elsewhere(asked: PlanningSettings) -> PlanningSettings:
    """Return the settings on the other ground."""
    return replace(asked, scope=replace(asked.scope, ground=AWAY), scene=asked.away)


def settings(options: PlanningOptions, quick: bool, seeds: range) -> PlanningSettings:
    """Make the settings of the flags.

    Args:
        options: Flags of the command line.
        quick: Whether the run is a small one.
        seeds: Seeds of the trials.

    Returns:
        The settings.
    """
    find_arm(options.arm)
    return PlanningSettings(options.arm, seeds[0], QUICK if quick else Scope())
