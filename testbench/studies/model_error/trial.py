"""What the model does not know: each disturbance of the true arm alone and all together, beside the noise.

The KR 500 under its payload, the poses of section 6; the links weigh only where a case says so. The arm is
identified while it is disturbed; it is judged all over the workspace by deflections of the same disturbed arm
under exactly the recorded loads: a payload that was weighed wrongly spoils the model, not the arm. Every
trial disturbs a true arm of the family, the next one in turn; the model and the prior stay the folder's.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
import typer

from testbench.arm.catalogue import find_arm
from testbench.campaign.campaign import Campaign, Cell, Scenario, build_cell, simulate, stream
from testbench.campaign.campaign_flags import TrueArmFlag
from testbench.campaign.models import JOINTS
from testbench.campaign.rows import UM
from testbench.campaign.true_arms import FAMILY, member, true_cell
from testbench.data.dataset import Dataset
from testbench.errors import BenchError
from testbench.plant import STIFF_COMPENSATOR, TYPICAL, Disturbances, disturb, settle_pair
from testbench.studies.factorial.trial import (
    Case,
    FitRow,
    each_seed,
    fitted,
    judged,
    reread,
    with_wrong_priors,
)

MODELS, ONLY_WITH_PRIOR = (JOINTS, "MLS56", "MGCO56", "MGCO68"), "MGCO68"
"""All are fitted with a prior too."""
QUICK_WORKSPACE = 20
NONE, ALL = "none", "all together"
PLAIN_COMPENSATOR, STIFF = "gravity compensator", "stiff compensator"
SPRING = "A spring ties link 2 to 1, {rate:g} kN/m as joint 2 turns, {stiffness:g} kN/m as the arm deflects."
SWITCHES: Mapping[str, tuple[str, float, str]] = {
    "own weight": ("own_weight", 1.0, "The links weigh."),
    PLAIN_COMPENSATOR: ("compensator", 1e-3, SPRING),
    "nominal geometry": ("geometry", 1e3, "Frames are off by {position:g} mm and {angle:g} mrad."),
    "joint sensors": ("sensor_offset", 1e3, "Joint sensors are off by {size:g} mrad."),
    "payload mass": ("mass_error", 100.0, "The payload is {size:g} % heavier than recorded."),
    "payload centre": ("centre_error", 1e3, "The hanging point is off by {size:g} mm."),
    "stiffening joints": ("stiffening", 100.0, "Joints are {size:g} % stiffer a mrad of turn."),
    "backlash": ("backlash", 1e6, "Joints have {size:g} urad of play to either side."),
    "hysteresis": ("hysteresis", 1e6, "Joints have {size:g} urad of hysteresis to either side."),
    "soft foundation": ("foundation", 1.0, "The foundation bends, {size:g} times as much as assumed."),
}
"""The field of Disturbances that each case switches on, and what it does, in so many times SI units."""


@dataclass(frozen=True)
class Options:
    """Flags of the study."""

    scale: Annotated[
        float, typer.Option(min=0, max=10, help="Size of every disturbance over its typical one.")
    ] = 1.0
    only: Annotated[
        list[str] | None, typer.Option(help="Switch on this disturbance alone; again for more.")
    ] = None
    sigma_um: Annotated[float, typer.Option(min=0.001, max=10_000, help="Noise of a reading.")] = 50.0
    arm: Annotated[str, typer.Option(help="Folder of the arm, or the name of one of ours.")] = "kr500_l480"
    true_arm: TrueArmFlag = FAMILY


@dataclass(frozen=True)
class Settings:
    """What is tried."""

    arm: str  #: Folder or name of the arm.
    first: int  #: The first seed.
    scale: float = 1.0  #: Size of every disturbance over its typical one [1]; switches are on or off.
    sigma: float = 50e-6  #: Standard deviation of one reading along one axis [m].
    workspace: int = 100  #: Poses in which the models are judged.
    only: tuple[str, ...] = ()  #: Names of cases beside none and all together; none for every one.
    true_arm: str = FAMILY  #: One of TRUTHS, or the family in turn.


def settings(options: Options, quick: bool, seeds: range) -> Settings:
    """What the flags ask for; raises BenchError for a disturbance that does not exist."""
    disturbances(options.scale, options.only or ())
    workspace = QUICK_WORKSPACE if quick else Settings.workspace
    only, sigma = tuple(options.only or ()), options.sigma_um / 1e6
    return Settings(options.arm, seeds[0], options.scale, sigma, workspace, only, options.true_arm)


def disturbances(scale: float, only: Sequence[str] = ()) -> dict[str, Disturbances]:
    """What disturbs the arm by case, `scale` times as much as typical: none, each, stiff compensator, all.

    Those of `only` are kept beside none, and all together are these alone; BenchError for one unknown.
    """
    for name in only:
        if name not in SWITCHES:
            raise BenchError(f"no disturbance {name!r}; disturbances are {', '.join(SWITCHES)}")
    geometry = TYPICAL.geometry
    if geometry is not None:
        geometry = replace(geometry, position=scale * geometry.position, angle=scale * geometry.angle)
    sizes = {field: scale * size for field, size in vars(TYPICAL).items() if type(size) is float}
    fields = {**vars(TYPICAL), **sizes, "geometry": geometry}
    values = {name: {field: fields[field]} for name in only or SWITCHES for field in SWITCHES[name][:1]}
    alone = {name: Disturbances(**value) for name, value in values.items()}
    stiff = {} if only else {STIFF: Disturbances(compensator=STIFF_COMPENSATOR)}
    together = {field: size for value in values.values() for field, size in value.items()}
    return {NONE: Disturbances(), **alone, **stiff, ALL: Disturbances(**together)}


@each_seed
def trials(asked: Settings, seed: int) -> Iterator[FitRow]:
    """Rows of a seed, one a fit."""
    cell = build_cell(find_arm(asked.arm))
    every = with_wrong_priors(cell, MODELS, MODELS, seed)
    models = [model for model in every if model.name != ONLY_WITH_PRIOR]
    true = true_cell(cell, member(asked.true_arm, seed), seed)
    cases = list(_cases(true, asked, seed))
    yield from judged(true, cases, fitted(true, models, cases))


def _cases(cell: Cell, asked: Settings, seed: int) -> Iterator[Case]:
    """Every disturbance without noise and with it."""
    scenario = Scenario(
        arm=cell.arm.name, truth="linear", noise=False, sigma=asked.sigma, workspace_poses=asked.workspace
    )
    campaign = simulate(cell, scenario, seed)  # for its poses and loads
    quiet = None
    for name, own in disturbances(asked.scale, asked.only).items():
        clean, truth = disturbed(cell, campaign, own, seed)
        quiet = truth.deflection if quiet is None else quiet  # the first case is none
        moved = UM * float(np.sqrt(np.square(truth.deflection - quiet).sum(axis=2).mean()))
        for noise in (0.0, asked.sigma):
            runs = reread(clean, noise, stream(seed, 1))
            factors: dict[str, object] = {"case": name, "sigma_um": UM * noise, "moved_um": moved}
            shown = runs if (name, noise, seed) == (ALL, asked.sigma, asked.first) else None
            yield Case(runs, truth, {"true_arm": member(asked.true_arm, seed), **factors}, shown)


def disturbed(cell: Cell, campaign: Campaign, own: Disturbances, seed: int) -> tuple[Dataset, Dataset]:
    """Noise-free runs to identify from, and those to be judged by, of a disturbed arm, one for every case."""
    true = disturb(cell.plant, own, stream(seed, 20))
    exact = replace(own, mass_error=0.0, centre_error=0.0)
    judge = replace(true, disturbances=exact, centre=np.zeros(3))
    found = []
    for arm, runs in ((true, campaign.identification), (judge, campaign.truth)):
        before, after = settle_pair(arm, runs.q, runs.wrench, runs.point)
        found.append(replace(runs, before=before.markers, after=after.markers))
    return found[0], found[1]
