"""Trials with disturbances that the model does not know: each alone and all together, beside the noise.

The KR 500 under its payload, the poses of section 6; the links weigh only where a case says so. The arm is
identified while it is disturbed; it is judged all over the workspace by deflections of the same disturbed arm
under exactly the recorded loads: a payload that was weighed wrongly spoils the model, not the arm. Every
trial disturbs a true arm of the family, the next one in turn; the model and the prior stay the folder's.
Beside it stand arms of kinds held out of the family, and the same arm disturbed in other sizes.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from testbench.arm.folder import find_arm
from testbench.data.dataset import Dataset
from testbench.plant.disturbance import Disturbances
from testbench.plant.disturbed import disturb, exactly_loaded
from testbench.plant.equilibrium import solve_unloaded_and_loaded
from testbench.plant.tracker import trial_rng
from testbench.plant.true_arms import true_arm_of_seed
from testbench.studies.campaign.disturbances import ALL, DisturbanceSettings, disturbances
from testbench.studies.campaign.trial import (
    CampaignFitRow,
    Cover,
    TrialCase,
    cover,
    each_seed,
    fitted,
    reread,
    score_cases,
    with_wrong_priors,
)
from testbench.workflows.cell import Campaign, Cell, Scenario, build_cell, simulate, true_cell
from testbench.workflows.model_selection import DEFAULT, FILLED
from testbench.workflows.models import JOINTS, Model
from testbench.workflows.own_estimator import Models, UserEstimator
from testbench.workflows.rows import UM, rms

MODELS, ONLY_WITH_PRIOR = (JOINTS, "MLS56", "MGCO56", "MGCO68"), "MGCO68"
"""All are fitted with a prior too."""
BESIDE = (JOINTS, f"MLS56{FILLED}", DEFAULT)
"""Those that are fitted to arms beside the family too: joint stiffness only, and LS with the same prior."""
COVERED = (f"{JOINTS}{FILLED}", DEFAULT)  #: Whose intervals are judged.
IN_FAMILY, BESIDE_IT = "family", "beside"  #: Parts of a trial.


@dataclass(frozen=True, kw_only=True)
class DisturbedRow(CampaignFitRow):
    """One model in one case of one true arm."""

    size: float  #: Of the disturbances, over those of the cases [1].
    deflection_um: float  #: What is to be predicted, RMS.
    cover: Cover | None  #: Of models whose intervals are judged, with noise.


@each_seed
def trials(asked: DisturbanceSettings, seed: int, estimators: Models) -> Iterator[DisturbedRow]:
    """Rows of a seed, one a fit."""
    cell = build_cell(find_arm(asked.arm))
    every = with_wrong_priors(cell, MODELS, MODELS, seed, estimators)
    models = [model for model in every if model.name != ONLY_WITH_PRIOR]
    own = true_arm_of_seed(asked.true_arm, seed)
    true = true_cell(cell, own, seed)
    cases = list(_cases(true, asked, seed, {"true_arm": own, "part": IN_FAMILY, "size": 1.0}))
    yield from _rows(true, models, cases)
    few = [model for model in models if model.name in BESIDE or isinstance(model.estimator, UserEstimator)]
    for arm, size in [*((own, size) for size in asked.sizes), *((arm, 1.0) for arm in asked.arms)]:
        true = true_cell(cell, arm, seed)
        case = _beside(true, asked, seed, size, {"true_arm": arm, "part": BESIDE_IT, "size": size})
        yield from _rows(true, few, [case])


def _rows(cell: Cell, models: Sequence[Model], cases: Sequence[TrialCase]) -> Iterator[DisturbedRow]:
    """Rows of one true arm, a fit each."""
    fits = fitted(cell, models, cases)

    def more(name: str, k: int) -> dict[str, object]:
        truth, asked = cases[k].test, name in COVERED and cases[k].factors["sigma_um"]
        own = cover(cell, fits[name][k], truth) if asked else None
        return {"deflection_um": UM * rms(truth.deflection), "cover": own}

    yield from score_cases(cell, cases, fits, DisturbedRow, more)


def _campaign(cell: Cell, asked: DisturbanceSettings, seed: int) -> Campaign:
    """For its poses and loads."""
    scenario = Scenario(
        arm=cell.arm.name, truth="linear", noise=False, sigma=asked.sigma, workspace_poses=asked.workspace
    )
    return simulate(cell, scenario, seed)


def _cases(
    cell: Cell, asked: DisturbanceSettings, seed: int, factors: Mapping[str, object]
) -> Iterator[TrialCase]:
    """Every disturbance without noise and with it."""
    campaign, quiet = _campaign(cell, asked, seed), None
    for name, own in disturbances(asked.scale, asked.only).items():
        clean, truth = disturbed(cell, campaign, own, seed)
        quiet = truth.deflection if quiet is None else quiet  # the first case is none
        moved = UM * rms(truth.deflection - quiet)
        for noise in (0.0, asked.sigma):
            runs = reread(clean, noise, trial_rng(seed, 1))
            of_case = {"case": name, "sigma_um": UM * noise, "moved_um": moved}
            shown = runs if (name, noise, seed) == (ALL, asked.sigma, asked.first) else None
            yield TrialCase(runs, truth, {**factors, **of_case}, shown)


def _beside(
    cell: Cell, asked: DisturbanceSettings, seed: int, size: float, factors: Mapping[str, object]
) -> TrialCase:
    """All together with noise, in one size."""
    own = disturbances(size * asked.scale, asked.only)[ALL]
    clean, truth = disturbed(cell, _campaign(cell, asked, seed), own, seed)
    runs = reread(clean, asked.sigma, trial_rng(seed, 1))
    return TrialCase(runs, truth, {**factors, "case": ALL, "sigma_um": UM * asked.sigma})


def disturbed(cell: Cell, campaign: Campaign, own: Disturbances, seed: int) -> tuple[Dataset, Dataset]:
    """Noise-free runs to identify from, and those to be judged by, of a disturbed arm, one for every case."""
    true = disturb(cell.plant, own, trial_rng(seed, 20))
    found = []
    for arm, runs in ((true, campaign.identification), (exactly_loaded(true), campaign.truth)):
        before, after = solve_unloaded_and_loaded(arm, runs.q, runs.wrench, runs.point)
        found.append(replace(runs, before=before.markers, after=after.markers))
    return found[0], found[1]
