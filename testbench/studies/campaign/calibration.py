"""One campaign a seed: poses, loads, readings, and every model identified from them and judged."""

import time
from collections.abc import Sequence
from dataclasses import dataclass

from testbench.arm.folder import find_arm
from testbench.plant.true_arms import FAMILY, true_arm_of_seed
from testbench.studies.rivals import as_in_paper, plain_models, without_cone
from testbench.workflows.campaign_flags import CampaignOptions
from testbench.workflows.cell import Campaign, Cell, Scenario, build_cell, draw_poses, simulate_at, true_cell
from testbench.workflows.evaluation import CampaignRow, Result, campaign_rows, identify
from testbench.workflows.model_selection import with_priors
from testbench.workflows.models import JOINTS, Model, named_models
from testbench.workflows.own_estimator import estimator_models
from testbench.workflows.own_process import EstimatorSource
from testbench.workflows.perturbed_prior import wrong_prior

QUICK_WORKSPACE = 40
WITHOUT_PRIOR = (JOINTS, "MLS32", "MLS56", "MGCO47", "MGCO56", "MGCO68")
"""The incumbent and the paper's models; beside MLS56 stands what is conservative and fits as well."""
WITH_PRIOR = (JOINTS, "MLS56", "MGCO56", "MGCO68", "ALL153")
"""Models that are fitted with a prior, which learns from the readings how wrong it is."""


Options = CampaignOptions  #: Flags of the study.


@dataclass(frozen=True)
class CalibrationSettings:
    """What is tried."""

    arm: str  #: Folder or name of the arm.
    scenario: Scenario  #: The campaign.
    true_arm: str = FAMILY  #: A name of `TRUTHS`, or all of them in turn.
    first: int = 1  #: The first seed: its errors are kept pose by pose.
    magnification: float = 50.0  #: Of the drawn deflections [1].


def settings(options: CampaignOptions, quick: bool, seeds: range) -> CalibrationSettings:
    """What the flags ask for."""
    scenario = options.scenario(QUICK_WORKSPACE if quick else 200)
    return CalibrationSettings(options.arm, scenario, options.true_arm, seeds[0])


def trials(
    asked: CalibrationSettings, seeds: Sequence[int], own: Sequence[EstimatorSource] = ()
) -> list[list[CampaignRow]]:
    """Rows of some seeds, one a model; estimators of one's own are the last."""
    cell, found = build_cell(find_arm(asked.arm)), []
    models = estimator_models(own)
    for seed in seeds:
        true, campaign = calibrate(cell, asked, seed)
        every = results(true, campaign, models(true, wrong_prior(true, seed)))
        arm, placed = true_arm_of_seed(asked.true_arm, seed), seed == asked.first
        found.append(campaign_rows(true, campaign, every, arm, placed=placed))
    return found


def calibrate(cell: Cell, asked: CalibrationSettings, seed: int) -> tuple[Cell, Campaign]:
    """The same model of the true arm of a seed, and its campaign."""
    true = true_cell(cell, true_arm_of_seed(asked.true_arm, seed), seed)
    return true, simulate_at(true, asked.scenario, seed, draw_poses(cell, asked.scenario, seed))


def results(cell: Cell, campaign: Campaign, more: Sequence[Model] = ()) -> list[Result]:
    """Baselines, the paper's models with and without a trace weight, structures with a prior, and more."""
    structures = [*named_models(cell, WITH_PRIOR), without_cone(cell)]
    filled = with_priors(cell.arm, structures, wrong_prior(cell, campaign.seed))
    plain = plain_models(cell, WITHOUT_PRIOR)
    return identify(cell, campaign, [*plain, *as_in_paper(plain), *filled, *more], time.perf_counter)
