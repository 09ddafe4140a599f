"""What the study of pose selection tries: sizes, where the robot works, how runs are identified."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
import typer
from pydantic import Field

from testbench.arm.catalogue import find_arm
from testbench.arm.folder import Arm
from testbench.campaign.perturbed_prior import UNCERTAINTY
from testbench.data.dataset import Dataset
from testbench.design.observability import Observability
from testbench.identify import Estimate
from testbench.identify.method import Method, gco, least_squares, with_prior
from testbench.identify.prior import Prior, Strength
from testbench.model.poses import WorkArea
from testbench.model.structure import Structure, all153, joints_only, mgco68, template56
from testbench.model.vjm import Vjm

NAME = "pose_selection"
RANDOM = "random"  #: Poses without a plan, beside the criteria of planning.CRITERIA.
Angles = tuple[tuple[float, ...], ...]  #: Joint angles, (poses, n) [rad].


@dataclass(frozen=True)
class Fit:
    """How runs are identified: a method on a structure, with the prior or without."""

    name: str
    structure: Callable[[Arm], Structure]
    prior: bool
    method: Method = gco
    learnt: bool = False  #: Whether the readings say how wrong the prior is.

    def each(self, vjm: Vjm, prior: Prior, datasets: Sequence[Dataset]) -> list[Estimate]:
        """Compliances from runs, solved together; the prior's scale, or more if learnt, is left to them."""
        strength = None if self.learnt else Strength(UNCERTAINTY)
        method = with_prior(self.method, prior, strength) if self.prior else self.method
        return method.each(vjm, self.structure(vjm.arm), datasets)


FITS = (
    Fit("MGCO68 + prior", mgco68, True),
    Fit("MGCO56 + prior", template56, True),
    Fit("Joints + prior", joints_only, True, least_squares),
    Fit("MGCO68", mgco68, False),
    Fit("MGCO56", template56, False),
    Fit("Joints", joints_only, False, least_squares),
)
PLANNED, BARE = FITS[0], FITS[3]  #: The fit that plans are made for, and the same without its prior.
INCUMBENT = FITS[-1]  #: Six joint compliances by plain least squares.
WHOLE = Fit("ALL153 + prior", all153, True, learnt=True)  #: What `identify` does by default.


@dataclass(frozen=True)
class Options:
    """Flags of the study."""

    arm: Annotated[str, typer.Option(help="Folder of the arm, or the name of one of ours.")] = "kr500_l480"


@dataclass(frozen=True)
class Ground:
    """Where the tracker stands and the robot works."""

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
    """What is tried."""

    payload: float = 460.3  #: Hung mass [kg].
    sigma: float = 50e-6  #: Standard deviation of one reading along one axis [m].
    ground: Ground = HOME  #: Where the tracker stands and the robot works.
    #: Numbers of poses, by the first criterion and at random.
    poses: tuple[int, ...] = (4, 6, 8, 12, 16, 20, 30, 40)
    fewer: tuple[int, ...] = (8, 12, 20)  #: Those of them by the other criteria.
    criteria: tuple[str, ...] = ("test", "I", "D", "A", "E", "G")  #: Keys of planning.CRITERIA.
    candidates: int = 5000  #: Feasible poses to choose from.
    tasks: int = 20  #: Random poses of the work area where predictions are wanted.
    workspace: int = 200  #: Random poses all over the workspace.
    anywhere: WorkArea = ANYWHERE  #: The workspace.
    featured: int = 12  #: Number of poses that the report looks at closely.

    def numbers(self, name: str) -> tuple[int, ...]:
        """Numbers of poses by a criterion, or at random."""
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
class PlanRow:
    """A plan, what it is certified for, and which error at the tasks it forecasts with its 90 % interval."""

    ground: str  #: Name of the ground that it is for.
    fit: str  #: Name of the fit that it is made for.
    criterion: str  #: Key of planning.CRITERIA.
    poses: int  #: How many.
    q_rad: tuple[float, ...]  #: Their joint angles, one pose after the other, (poses * n,) [rad].
    load: tuple[int, ...]  #: Which of the loads hangs in each, (poses,).
    seconds: float  #: Wall time of planning.
    efficiency_percent: float  #: At least, of the best that as many of the poses examined can reach.
    examined: int  #: Poses.
    expected_tasks_mm: float
    expected_tasks_p05_mm: float
    expected_tasks_p95_mm: float
    expected_workspace_mm: float
    observability: Observability


@dataclass(frozen=True)
class Scene:
    """What all plans and trials share: feasible poses, and where predictions are wanted."""

    candidates: Angles = ()  #: Feasible poses to choose from.
    drawn: int = 0  #: Poses drawn to find them.
    rejected: tuple[int, ...] = ()  #: How many each reason refused, in the order of candidates.REASONS.
    tasks: Angles = ()  #: Poses where the robot works.
    workspace: Angles = ()  #: Poses all over the workspace.
    plans: tuple[PlanRow, ...] = ()  #: By criterion and number of poses, then by fit.

    def plan(self, criterion: str, poses: int, fit: str) -> PlanRow:
        """The plan by a criterion of so many poses for a fit."""
        return next(p for p in self.plans if (p.criterion, p.poses, p.fit) == (criterion, poses, fit))


EMPTY = Scene()


@dataclass(frozen=True)
class Settings:
    """What is tried."""

    arm: str  #: Folder or name of the arm.
    seed: int  #: Root of the candidates, the tasks and the planner's prior.
    scope: Scope  #: Sizes and numbers.
    #: Made of the rest by `plans.prepare`; empty before.
    scene: Annotated[Scene, Field(exclude=True)] = EMPTY
    away: Annotated[Scene, Field(exclude=True)] = EMPTY  #: The same on the other ground.


def elsewhere(asked: Settings) -> Settings:
    """The same on the other ground."""
    return replace(asked, scope=replace(asked.scope, ground=AWAY), scene=asked.away)


def settings(options: Options, quick: bool, seeds: range) -> Settings:
    """What the flags ask for."""
    find_arm(options.arm)
    return Settings(options.arm, seeds[0], QUICK if quick else Scope())
