"""Settings of the study of corrections: campaigns and models, and plans among poses."""

from dataclasses import dataclass
from itertools import product
from typing import Annotated

import numpy as np
import typer
from pydantic import Field

from testbench.arm.folder import find_arm
from testbench.errors import BenchError
from testbench.model.poses import WorkArea
from testbench.studies.study import DEFAULT_WITHOUT_CONE
from testbench.workflows.models import JOINTS

NAME = "compensation"
ARM = "kr500_l480"  #: The panel stands in its work area.
PAYLOAD, PULL, SLING = 460.3, 3000.0, 0.5
"""Hung mass [kg], pull of the rope along world y at the load point [N], and length of the sling [m]."""
RUNS = 2  #: In every pose.
SIGMA = 50e-6  #: Standard deviation of one reading along one axis [m].
STATION = (4.5, -2.5, 1.6)  #: Of the tracker [m].
AREA = WorkArea((1.7, -0.9, 1.1), (2.7, 0.9, 2.1), (1.0, 0.0, 0.0), np.pi / 4)
"""Where the panel stands: the work area of section 6."""
PLANNED, RANDOM = "planned", "random"
WEIGHT, BOTH = "weight", "weight and pull"
"""What loads the arm while it is measured: in every pose the weight, or in every pose one of both."""
FEATURED = 12  #: Poses that the bars are about, and those of all campaigns of a disturbed arm.
IDEAL, LINEAR, REAL = "undisturbed", "linear joints", "disturbed"
"""How a true arm is disturbed: not at all; in all but that its joints are linear springs; in all."""
ARMS = (IDEAL, LINEAR, REAL)
NUMBERS, QUICK_NUMBERS = (6, 12, 20), (FEATURED,)
CANDIDATES, QUICK_CANDIDATES = 2000, 150
NOMINAL, PRIOR, PERFECT = "nominal", "prior alone", "perfect"
"""Not identified: the folder's values; the same as the prior has them, wrong; the true compliances."""
DEFAULT = "default"  #: What `identify` takes by default.
LEAST_SQUARES = "MLS56"
MODELS_WITHOUT_PRIOR = (JOINTS, LEAST_SQUARES, "MGCO56")  #: Identified without a prior.
IDENTIFIED = (*MODELS_WITHOUT_PRIOR, DEFAULT_WITHOUT_CONE, DEFAULT)
MODELS = (NOMINAL, PRIOR, *IDENTIFIED, PERFECT)
DRAWN = (JOINTS, DEFAULT)

Angles = tuple[tuple[float, ...], ...]  #: Joint angles, (poses, n) [rad].


@dataclass(frozen=True)
class CompensationPlanRow:
    """Hold a planned campaign."""

    loads: str  #: What loads the arm, WEIGHT or BOTH.
    poses: int
    q_rad: tuple[float, ...]  #: Joint angles, one pose after the other, (poses * n,) [rad].
    load: tuple[int, ...]  #: Which of the loads acts in each, (poses,).


@dataclass(frozen=True)
class CompensationScene:
    """Hold what all trials share."""

    candidates: Angles = ()  #: Feasible poses to measure.
    program: Angles = ()  #: Programmed joints of all jobs, one job after the other.
    plans: tuple[CompensationPlanRow, ...] = ()


@dataclass(frozen=True)
class Way:
    """Describe how a model is identified; one that is not has a campaign of no poses."""

    by: str = ""  #: PLANNED or RANDOM.
    loads: str = ""  #: WEIGHT or BOTH.
    poses: int = 0

    @property
    def campaign(self) -> str:
        """Describe the campaign in words."""
        return f"{self.by}, {self.loads}" if self.by else "none"


NOWHERE = Way()
ADVISED = Way(PLANNED, BOTH, FEATURED)


@dataclass(frozen=True)
class CompensationOptions:
    """Hold the flags of the study."""

    arm: Annotated[str, typer.Option(metavar="ARM", help="Arm in front of the panel.")] = ARM


@dataclass(frozen=True)
class CompensationSettings:
    """Describe what is tried."""

    arm: str
    seed: int  #: Root of the candidates and of the planner's prior.
    numbers: tuple[int, ...] = NUMBERS  #: Poses of the campaigns.
    candidates: int = CANDIDATES  #: Feasible poses to choose from.
    #: Made of the rest by `plans.prepare`; empty before.
    scene: Annotated[CompensationScene, Field(exclude=True)] = CompensationScene()

    def ways(self, arm: str) -> tuple[Way, ...]:
        """List the campaigns of one of ARMS."""
        if arm == LINEAR:
            return (ADVISED,)
        numbers = self.numbers if arm == IDEAL else (FEATURED,)
        return tuple(Way(*one) for one in product((PLANNED, RANDOM), (WEIGHT, BOTH), numbers))


def settings(options: CompensationOptions, quick: bool, seeds: range) -> CompensationSettings:
    """Make the settings of the flags.

    Args:
        options: Flags of the command line.
        quick: Whether the run is a small one.
        seeds: Seeds of the trials.

    Returns:
        The settings.

    Raises:
        BenchError: When it is an arm that does not reach the panel.
    """
    if find_arm(options.arm).resolve().name != ARM:
        raise BenchError(f"--arm: expected {ARM}, whose work area has the panel, got {options.arm!r}")
    if quick:
        return CompensationSettings(options.arm, seeds[0], QUICK_NUMBERS, QUICK_CANDIDATES)
    return CompensationSettings(options.arm, seeds[0])
