"""Trials with disturbances that the model does not know: each alone and all together, beside the noise.

The KR 500 under its payload, the poses of section 6; the links weigh only where a case says so. The arm is
identified while it is disturbed; it is judged all over the workspace by deflections of the same disturbed arm
under exactly the recorded loads: a payload that was weighed wrongly spoils the model, not the arm. Every
trial disturbs a true arm of the family, the next one in turn; the model and the prior stay the folder's.
Beside it stand arms of kinds held out of the family, and the same arm disturbed in other sizes.

Settings of the study of disturbances: which ones, how large, on which true arms.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import typer

from testbench.data.dataset import Dataset
from testbench.errors import BenchError
from testbench.plant.disturbance import STIFF_COMPENSATOR, TYPICAL, Disturbances
from testbench.plant.equilibrium import solve_unloaded_and_loaded
from testbench.plant.true_arms import FAMILY, HELD_OUT, disturb, exactly_loaded, true_arm_of_seed, true_arms
from testbench.runs.rows import trial_rng
from testbench.studies.campaign.trial import (
    CampaignFitRow,
    Cover,
    TrialCase,
    cover,
    fitted,
    reread,
    score_cases,
    with_wrong_priors,
)
from testbench.workflows.campaign import Campaign, Scenario, simulate, true_cell
from testbench.workflows.campaign_flags import ArmFlag, TrueArmFlag
from testbench.workflows.cell import Cell
from testbench.workflows.model_names import FILLED
from testbench.workflows.models import DEFAULT, JOINTS, Model
from testbench.workflows.own_estimator import Models, UserEstimator
from testbench.workflows.rows import UM, rms

SIZES = 0.5, 2.0  #: Of all disturbances, over those of the cases [1].
QUICK_WORKSPACE = 20
NONE, ALL = "none", "all together"
PLAIN_COMPENSATOR, STIFF = "gravity compensator", "stiff compensator"
SWITCHES: Mapping[str, str] = {
    "own weight": "own_weight",
    PLAIN_COMPENSATOR: "compensator",
    "nominal geometry": "geometry",
    "joint sensors": "sensor_offset",
    "payload mass": "mass_error",
    "payload centre": "centre_error",
    "stiffening joints": "stiffening",
    "backlash": "backlash",
    "hysteresis": "hysteresis",
    "soft foundation": "foundation",
}
"""The field of Disturbances that each case switches on; their sizes are in docs/studies/model_error.md."""


@dataclass(frozen=True)
class DisturbanceOptions:
    """Hold the flags of the study."""

    scale: Annotated[
        float, typer.Option(min=0, max=10, metavar="X", help="Size of disturbances; 1 is typical.")
    ] = 1.0
    only: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="Only this disturbance; repeatable.")
    ] = None
    sigma_um: Annotated[
        float, typer.Option(min=0.001, max=10_000, metavar="UM", help="Noise of a reading, per axis.")
    ] = 50.0
    arm: ArmFlag = "kr500_l480"
    true_arm: TrueArmFlag = FAMILY
    arms: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="Further kind of true arm; repeatable (default: all)."),
    ] = None
    sizes: Annotated[
        list[float] | None,
        typer.Option(min=0, max=10, metavar="X", help="Further multiple of --scale; repeatable."),
    ] = None


@dataclass(frozen=True)
class DisturbanceSettings:
    """Describe what is tried."""

    arm: str  #: Folder or name of the arm.
    first: int  #: The first seed.
    scale: float = 1.0  #: Size of every disturbance over its typical one [1]; switches are on or off.
    sigma: float = 50e-6  #: Standard deviation of one reading along one axis [m].
    workspace: int = 100  #: Poses in which the models are judged.
    only: tuple[str, ...] = ()  #: Names of cases beside none and all together; none for every one.
    true_arm: str = FAMILY  #: One of TRUTHS, or the family in turn.
    arms: tuple[str, ...] = ()  #: Beside it, of HELD_OUT.
    sizes: tuple[float, ...] = ()  #: In which it is disturbed in every way too, over those of the cases [1].


def settings(options: DisturbanceOptions, quick: bool, seeds: range) -> DisturbanceSettings:
    """Make the settings of the flags; BenchError for a disturbance or a true arm that does not exist.

    Args:
        options: Flags of the command line.
        quick: Whether the run is a small one.
        seeds: Seeds of the trials.

    Returns:
        The settings.
    """
    disturbances(options.scale, options.only or ())
    arms, sizes = tuple(options.arms or HELD_OUT), tuple(options.sizes or SIZES)
    for name in arms:
        if name not in kinds_held_out():
            raise BenchError(f"--arms: expected some of {', '.join(kinds_held_out())}, got {name!r}")
    workspace = QUICK_WORKSPACE if quick else DisturbanceSettings.workspace
    only, sigma = tuple(options.only or ()), options.sigma_um / 1e6
    alone = options.true_arm != FAMILY and options.arms is None
    return DisturbanceSettings(
        options.arm,
        seeds[0],
        options.scale,
        sigma,
        workspace,
        only,
        options.true_arm,
        () if alone else tuple(dict.fromkeys(arms)),
        tuple(dict.fromkeys(size for size in sizes if size != 1)),
    )


def kinds_held_out() -> list[str]:
    """Name the kinds of true arms that are not of the family: ours, and those that users add."""
    return [*HELD_OUT, *true_arms.added]


def disturbances(scale: float, only: Sequence[str] = ()) -> dict[str, Disturbances]:
    """List what disturbs the arm by case: none, each, the stiff compensator, all.

    Those of `only` are kept beside none, and all together are these alone; BenchError for one unknown.

    Args:
        scale: Size over the typical one [1].
        only: Names of the disturbances; empty for all.

    Returns:
        Disturbances by case.
    """
    for name in only:
        if name not in SWITCHES:
            raise BenchError(f"no disturbance {name!r}; disturbances are {', '.join(SWITCHES)}")
    geometry = TYPICAL.geometry
    if geometry is not None:
        geometry = replace(geometry, position=scale * geometry.position, angle=scale * geometry.angle)
    sizes = {field: scale * size for field, size in vars(TYPICAL).items() if type(size) is float}
    fields = {**vars(TYPICAL), **sizes, "geometry": geometry}
    values = {name: {SWITCHES[name]: fields[SWITCHES[name]]} for name in only or SWITCHES}
    alone = {name: Disturbances(**value) for name, value in values.items()}
    stiff = {} if only else {STIFF: Disturbances(compensator=STIFF_COMPENSATOR)}
    together = {field: size for value in values.values() for field, size in value.items()}
    return {NONE: Disturbances(), **alone, **stiff, ALL: Disturbances(**together)}


MODELS, ONLY_WITH_PRIOR = (JOINTS, "MLS56", "MGCO56", "MGCO68"), "MGCO68"
"""All are fitted with a prior too."""
BESIDE = (JOINTS, f"MLS56{FILLED}", DEFAULT)
"""Those that are fitted to arms beside the family too: Joints-only, and LS with the same prior."""
COVERED = (f"{JOINTS}{FILLED}", DEFAULT)  #: Whose intervals are judged.
IN_FAMILY, BESIDE_IT = "family", "beside"  #: Parts of a trial.


@dataclass(frozen=True, kw_only=True)
class DisturbedRow(CampaignFitRow):
    """Hold one model in one case of one true arm."""

    size: float  #: Of the disturbances, over those of the cases [1].
    deflection_um: float  #: What is to be predicted, RMS.
    cover: Cover | None  #: Of models whose intervals are judged, with noise.


def trial(cell: Cell, asked: DisturbanceSettings, seed: int, estimators: Models) -> Iterator[DisturbedRow]:
    """Make the rows of a seed, one per fit.

    Args:
        cell: The arm with its model and its truth.
        asked: Settings of the study.
        seed: Seed of the trial.
        estimators: Estimators of the user.

    Yields:
        The rows.
    """
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
    """Simulate noise-free runs of a disturbed arm, one for every case.

    Args:
        cell: The arm with its model and its truth.
        campaign: The simulated campaign.
        own: The disturbances.
        seed: Seed of the trial.

    Returns:
        Runs to identify from, and those that judge.
    """
    true = disturb(cell.plant, own, trial_rng(seed, 20))
    found = []
    for arm, runs in ((true, campaign.identification), (exactly_loaded(true), campaign.truth)):
        before, after = solve_unloaded_and_loaded(arm, runs.q, runs.wrench, runs.point)
        found.append(replace(runs, before=before.markers, after=after.markers))
    return found[0], found[1]
