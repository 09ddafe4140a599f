"""A trial: one campaign identified in every way, and one dataset of every kind of interval.

The parts have numbers of trials of their own: each is in the first seeds of the study.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Annotated

import typer

from testbench.arm.catalogue import find_arm
from testbench.arm.folder import load_arm
from testbench.campaign.campaign import Scenario, build_cell, of_arm
from testbench.studies.identifiability import coverage, fits
from testbench.studies.identifiability.coverage import Covered
from testbench.studies.identifiability.fits import TrialRow, Tried

SIX_DOF = "arm_6r"  #: The arm of section 5.2: the data see all its predictions.
QUICK = Tried(structures=("MGCO56", "MGCO68"), scales=(0.5, 2.0), poses=(8, 20))


@dataclass(frozen=True)
class Options:
    """Flags of the study."""

    arm: Annotated[str, typer.Option(help="Folder of the arm, or the name of one of ours.")] = "kr500_l480"
    campaigns: Annotated[
        int, typer.Option(min=1, help="Trials with a campaign too; the others draw intervals alone.")
    ] = 20


@dataclass(frozen=True)
class Settings:
    """What is tried."""

    arm: str  #: Folder or name of the arm.
    scenario: Scenario  #: The campaign; its truth and number of poses are varied.
    tried: Tried  #: What is varied in a campaign.
    first: int  #: The first seed.
    campaigns: int  #: Trials with a campaign.
    bootstraps: int  #: Those with bootstrap intervals.
    bounds: int  #: Those with set-based bounds.
    family: int  #: Those with an arm of the family.


def settings(options: Options, quick: bool, seeds: range) -> Settings:
    """What the flags ask for."""
    return Settings(
        arm=options.arm,
        scenario=of_arm(load_arm(options.arm), Scenario(arm=find_arm(options.arm).resolve().name)),
        tried=QUICK if quick else Tried(),
        first=seeds[0],
        campaigns=min(options.campaigns, len(seeds), 2 if quick else len(seeds)),
        bootstraps=100,
        bounds=2 if quick else 100,
        family=2 if quick else 200,
    )


def trials(asked: Settings, seeds: Sequence[int]) -> list[list[TrialRow]]:
    """Rows of some seeds: first those of their campaigns."""
    cell = build_cell(find_arm(asked.arm))
    light = coverage.full_pose_case(build_cell(find_arm(SIX_DOF)))
    heavy = coverage.gravity_cases(cell)

    def drawn(k: int) -> Iterator[Covered]:
        yield from coverage.fitted(light, k, k < asked.bootstraps)
        for case in heavy:
            yield from coverage.posterior(case, k)
            if k < asked.bounds:
                yield coverage.bounded(case, k)
        if k < asked.family:
            yield from coverage.of_family(cell, asked.first + k)

    found = []
    for seed in seeds:
        k, rows = seed - asked.first, list[TrialRow]()
        if k < asked.campaigns:
            rows += fits.rows(cell, asked.scenario, asked.tried, seed, first=k == 0)
        found.append(rows + [TrialRow(intervals=row) for row in drawn(k)])
    return found
