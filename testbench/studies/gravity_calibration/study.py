"""Section 6 in simulation: a heavy arm under a hung weight, three markers, LS against GCO."""

from testbench.arm.catalogue import find_arm
from testbench.campaign.campaign_flags import CampaignOptions
from testbench.campaign.campaign_row import CampaignRow
from testbench.studies.gravity_calibration import report, trial
from testbench.studies.study import Study

STUDY = Study(
    name="gravity_calibration",
    about="Calibrate the arm under gravity as section 6 of the paper does, and judge its models.",
    options=CampaignOptions,
    settings=trial.settings,
    seeds=(1, 10_000),
    arms=lambda asked: [find_arm(asked.arm)],
    row=CampaignRow,
    trials=trial.trials,
    report=report.report,
    printed=("short",),
    figures=report.figures,
    write=report.write,
    size=4,
)
