"""What the model does not know: each disturbance of the true arm alone and all together, beside the noise.

The KR 500 under its payload, the poses of section 6; the links weigh only where a case says so. The arm is
identified while it is disturbed; it is judged all over the workspace by deflections of the same disturbed arm
under exactly the recorded loads: a payload that was weighed wrongly spoils the model, not the arm. Every
trial disturbs a true arm of the family, the next one in turn; the model and the prior stay the folder's.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
import typer

from testbench.arm.catalogue import find_arm
from testbench.bench.baselines import JOINTS
from testbench.bench.campaign import Campaign, Cell, Scenario, build_cell, simulate, stream
from testbench.bench.campaign_flags import TrueArmFlag
from testbench.bench.judged import identify_each
from testbench.bench.models import Model
from testbench.bench.rows import UM, dataset_row
from testbench.bench.truths import FAMILY, member, true_cell
from testbench.data.dataset import Dataset
from testbench.plant import Disturbances, disturb, settle_pair
from testbench.studies.model_error.cases import ALL, cases
from testbench.studies.noise_sensitivity.fits import (
    TrialRow,
    judged,
    plain_models,
    reread,
    with_wrong_priors,
)

NAME = "model_error"
MODELS, ONLY_WITH_PRIOR = (JOINTS, "MLS56", "MGCO56", "MGCO68"), "MGCO68"
"""All are fitted with a prior too."""
QUICK_WORKSPACE = 20


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
    scale: float = 1.0  #: Size of every disturbance over its typical one [1]; switches are on or off.
    sigma: float = 50e-6  #: Standard deviation of one reading along one axis [m].
    workspace: int = 100  #: Poses in which the models are judged.
    only: tuple[str, ...] = ()  #: Names of cases beside none and all together; none for every one.
    true_arm: str = FAMILY  #: One of TRUTHS, or the family in turn.


@dataclass(frozen=True, kw_only=True)
class CaseRow(TrialRow):
    """One fit of one trial."""

    case: str  #: What the true arm does.
    sigma_um: float  #: Noise of a reading along an axis.
    moved_um: float  #: How far the disturbance moves the deflections to be predicted, RMS.


def settings(options: Options, quick: bool, _: range) -> Settings:
    """What the flags ask for; raises BenchError for a disturbance that does not exist."""
    cases(options.scale, options.only or ())
    workspace = QUICK_WORKSPACE if quick else Settings.workspace
    only, sigma = tuple(options.only or ()), options.sigma_um / 1e6
    return Settings(options.arm, options.scale, sigma, workspace, only, options.true_arm)


def trials(asked: Settings, seeds: Sequence[int]) -> list[list[CaseRow]]:
    """Rows of some seeds, one a fit."""
    cell = build_cell(find_arm(asked.arm))
    plain = plain_models(cell, MODELS)
    found = []
    for seed in seeds:
        models = with_wrong_priors(cell, plain, MODELS, seed)
        true = true_cell(cell, member(asked.true_arm, seed), seed)
        found.append(list(_trial(true, [m for m in models if m.name != ONLY_WITH_PRIOR], asked, seed)))
    return found


def _trial(cell: Cell, models: Sequence[Model], asked: Settings, seed: int) -> Iterator[CaseRow]:
    scenario = Scenario(
        arm=cell.arm.name, truth="linear", noise=False, sigma=asked.sigma, workspace_poses=asked.workspace
    )
    campaign = simulate(cell, scenario, seed)  # for its poses and loads
    arms = {
        case: disturbed(cell, campaign, disturbances, seed)
        for case, disturbances in cases(asked.scale, asked.only).items()
    }
    noises, true_arm = (0.0, asked.sigma), member(asked.true_arm, seed)
    read = [reread(clean, noise, stream(seed, 1)) for clean, _ in arms.values() for noise in noises]
    fits = [identify_each(cell, model, read) for model in models]
    quiet = next(iter(arms.values()))[1].deflection
    for k, (case, (_, truth)) in enumerate(arms.items()):
        own = slice(len(noises) * k, len(noises) * (k + 1))
        moved = UM * float(np.sqrt(np.square(truth.deflection - quiet).sum(axis=2).mean()))
        rows = [judged(cell, model, found[own], truth) for model, found in zip(models, fits, strict=True)]
        for noise, data, found in zip(noises, read[own], zip(*rows, strict=True), strict=True):
            measured = dataset_row(data) if case == ALL and noise > 0 else None
            for row in found:
                yield CaseRow(
                    **vars(row),
                    true_arm=true_arm,
                    measured=measured,
                    case=case,
                    sigma_um=UM * noise,
                    moved_um=moved,
                )


def disturbed(
    cell: Cell, campaign: Campaign, disturbances: Disturbances, seed: int
) -> tuple[Dataset, Dataset]:
    """Noise-free runs to identify from, and those to be judged by, of a disturbed arm, one for every case."""
    true = disturb(cell.plant, disturbances, stream(seed, 20))
    exact = replace(disturbances, mass_error=0.0, centre_error=0.0)
    judge = replace(true, disturbances=exact, centre=np.zeros(3))
    found = []
    for arm, runs in ((true, campaign.identification), (judge, campaign.truth)):
        before, after = settle_pair(arm, runs.q, runs.wrench, runs.point)
        found.append(replace(runs, before=before.markers, after=after.markers))
    return found[0], found[1]
