"""What unknown disturbances cost beside the noise, and which model bears them best.

The KR 500 under its payload, the poses of section 6; the links weigh only where a case says so. The arm is
identified while it is disturbed; it is judged all over the workspace by deflections of the same disturbed arm
under exactly the recorded loads: a payload that was weighed wrongly spoils the model, not the arm. Every
trial disturbs a true arm of the family, the next one in turn; the model and the prior stay the folder's.
Beside it stand arms of kinds held out of the family, and the same arm disturbed in other sizes.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
import typer

from testbench.data.dataset import Dataset
from testbench.errors import BenchError
from testbench.plant.disturbance import STIFF_COMPENSATOR, TYPICAL_DISTURBANCES, Disturbances
from testbench.plant.equilibrium import solve_unloaded_and_loaded
from testbench.plant.true_arms import (
    FAMILY_NAME,
    HELD_OUT_TRUE_ARMS,
    disturb,
    true_arm_of_seed,
    true_arms,
    with_exact_load,
)
from testbench.report.figure import Figure, ranges
from testbench.report.report import Report
from testbench.report.schema import true_arm_label
from testbench.report.table import TRIAL, Row, Trials, aligned, matched, merged, number
from testbench.runs.rows import trial_rng
from testbench.runs.spread import middle, wins
from testbench.studies.campaign.report import ERROR, Preset, TrialTable, lines
from testbench.studies.campaign.trial import (
    CampaignFitRow,
    Cover,
    TrialCase,
    cover,
    fitted,
    reread,
    score_cases,
    with_wrong_priors,
    worst_tenth,
)
from testbench.studies.study import ArmFlag, TrueArmFlag
from testbench.workflows.campaign import Campaign, Scenario, simulate, true_cell
from testbench.workflows.cell import Cell
from testbench.workflows.model_names import FILLED
from testbench.workflows.models import DEFAULT, JOINTS_ONLY, Model
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
    "joint sensors": "joint_offset_sigma",
    "payload mass": "mass_error",
    "payload centre": "load_point_sigma",
    "stiffening joints": "stiffening",
    "backlash": "backlash",
    "hysteresis": "hysteresis",
    "soft foundation": "foundation_factor",
}
"""The field of Disturbances that each case switches on; their sizes are in docs/studies/model_error.md."""


@dataclass(frozen=True)
class DisturbanceOptions:
    """Hold the flags of the study."""

    scale: Annotated[
        float, typer.Option(min=0, max=10, metavar="X", help="Size of disturbances over the typical size.")
    ] = 1.0
    only: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="Only this disturbance; repeatable.")
    ] = None
    sigma_um: Annotated[
        float, typer.Option(min=0.001, max=10_000, metavar="UM", help="Noise of a reading, per axis.")
    ] = 50.0
    arm: ArmFlag = "kr500_l480"
    true_arm: TrueArmFlag = FAMILY_NAME
    arms: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="Also fit this true arm; repeatable (default: all)."),
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
    true_arm: str = FAMILY_NAME  #: One of FAMILY_TRUE_ARMS, or the family in turn.
    arms: tuple[str, ...] = ()  #: Beside it, of HELD_OUT_TRUE_ARMS.


def _settings(options: DisturbanceOptions, quick: bool, seeds: range) -> DisturbanceSettings:
    """Make the settings of the flags; BenchError for a disturbance or a true arm that does not exist."""
    disturbances(options.scale, options.only or ())
    arms = tuple(options.arms or HELD_OUT_TRUE_ARMS)
    for name in arms:
        if name not in kinds_held_out():
            raise BenchError(f"--arms: expected some of {', '.join(kinds_held_out())}, got {name!r}")
    workspace = QUICK_WORKSPACE if quick else DisturbanceSettings.workspace
    only, sigma = tuple(options.only or ()), options.sigma_um / 1e6
    alone = options.true_arm != FAMILY_NAME and options.arms is None
    return DisturbanceSettings(
        options.arm,
        seeds[0],
        options.scale,
        sigma,
        workspace,
        only,
        options.true_arm,
        () if alone else tuple(dict.fromkeys(arms)),
    )


def kinds_held_out() -> list[str]:
    """Name the kinds of true arms that are not of the family: ours, and those that users add."""
    return [*HELD_OUT_TRUE_ARMS, *true_arms.added]


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
    geometry = TYPICAL_DISTURBANCES.geometry
    if geometry is not None:
        geometry = replace(
            geometry, position_sigma=scale * geometry.position_sigma, angle_sigma=scale * geometry.angle_sigma
        )
    sizes = {field: scale * size for field, size in vars(TYPICAL_DISTURBANCES).items() if type(size) is float}
    fields = {**vars(TYPICAL_DISTURBANCES), **sizes, "geometry": geometry}
    values = {name: {SWITCHES[name]: fields[SWITCHES[name]]} for name in only or SWITCHES}
    alone = {name: Disturbances(**value) for name, value in values.items()}
    stiff = {} if only else {STIFF: Disturbances(compensator=STIFF_COMPENSATOR)}
    together = {field: size for value in values.values() for field, size in value.items()}
    return {NONE: Disturbances(), **alone, **stiff, ALL: Disturbances(**together)}


MODELS, ONLY_WITH_PRIOR = (JOINTS_ONLY, "MLS56", "MGCO56", "MGCO68"), "MGCO68"
"""All are fitted with a prior too."""
BESIDE = (JOINTS_ONLY, f"MLS56{FILLED}", DEFAULT)
"""Those that are fitted to arms beside the family too: Joints-only, and LS with the same prior."""
COVERED = (f"{JOINTS_ONLY}{FILLED}", DEFAULT)  #: Whose intervals are judged.
IN_FAMILY, BESIDE_IT = "family", "beside"  #: Parts of a trial.


@dataclass(frozen=True, kw_only=True)
class DisturbedRow(CampaignFitRow):
    """Hold one model in one case of one true arm."""

    size: float  #: Of the disturbances, over those of the cases [1].
    deflection_um: float  #: What is to be predicted, RMS.
    cover: Cover | None  #: Of models whose intervals are judged, with noise.


def _trial(cell: Cell, asked: DisturbanceSettings, seed: int, estimators: Models) -> Iterator[DisturbedRow]:
    """Make the rows of a seed, one per fit."""
    every = with_wrong_priors(cell, MODELS, MODELS, seed, estimators)
    models = [model for model in every if model.name != ONLY_WITH_PRIOR]
    own = true_arm_of_seed(asked.true_arm, seed)
    true = true_cell(cell, own, seed)
    cases = list(_cases(true, asked, seed, {"true_arm": own, "part": IN_FAMILY, "size": 1.0}))
    yield from _rows(true, models, cases)
    few = [model for model in models if model.name in BESIDE or isinstance(model.estimator, UserEstimator)]
    for arm, size in [*((own, size) for size in SIZES), *((arm, 1.0) for arm in asked.arms)]:
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
    for arm, runs in ((true, campaign.identification), (with_exact_load(true), campaign.truth)):
        before, after = solve_unloaded_and_loaded(arm, runs.q, runs.wrench, runs.point)
        found.append(replace(runs, before=before.marker_positions, after=after.marker_positions))
    return found[0], found[1]


# --- The report ---------------------------------------------------------------------------------------------

CLAIM_PERCENT = 4.8  #: Largest difference in error by a gravity compensator that the paper quotes [%].
RIVALS = {"Joints": JOINTS_ONLY, "same_prior": f"MLS56{FILLED}"}
KINDS = (
    "kind default_um Joints_um same_prior_um covered_percent worst_tenth_percent beats_joints "
    "beats_same_prior removed_percent trials"
)
CLAIM = "case name true_change_percent true_within read_change_percent read_within"


def _tables(asked: DisturbanceSettings) -> Mapping[str, TrialTable]:
    """Tabulate the default by kind of arm, errors by disturbance, what each adds, and the paper's claim."""
    noise, family = UM * asked.sigma, {"part": IN_FAMILY}
    shown = ("noisy", noise, f"with noise of {noise:g} um"), ("calm", 0.0, "without noise")
    errors = {
        name: TrialTable(
            f"RMS error, um, {words}", "case", "name", by="sigma_um", where=family | {"sigma_um": um}
        )
        for name, um, words in shown
    }
    return {
        "kinds": TrialTable(
            f"All disturbances if not stated otherwise, noise of {noise:g} um: median RMS errors",
            columns=KINDS,
            where={"sigma_um": noise},
            rows=kinds,
        ),
        **errors,
        "ranking": TrialTable(
            f"{DEFAULT}, without noise",
            columns="case moved_um added_um",
            where=family | {"sigma_um": 0.0, "name": DEFAULT},
            rows=ranking,
        ),
        "claim": TrialTable(
            "Increase of the error by the compensator, %",
            columns=CLAIM,
            where=family | {"sigma_um": noise, "case": {PLAIN_COMPENSATOR, STIFF}},
            rows=lambda held: merged(held.keep(*CLAIM.split()), "case", "name"),
        ),
    }


def _derived(_: DisturbanceSettings, trials: Trials) -> Trials:
    """Add what a case adds to the error of the same trial without disturbance, and by how much it changes it.

    Against readings the noise of two readings of three axes stands in quadrature in both errors.
    """
    member = trials["part"] == IN_FAMILY
    own, none = trials.pick(member), np.full(len(trials), np.nan)
    none[member] = matched(own, own.where(case=NONE), ERROR, ("name", "sigma_um", TRIAL))
    noise = 6 * trials["sigma_um"] ** 2
    true = 100 * (trials[ERROR] / none - 1)
    read = 100 * (np.sqrt(trials[ERROR] ** 2 + noise) / np.sqrt(none**2 + noise) - 1)
    return trials.add(
        added_um=trials[ERROR] - none,
        true_change_percent=true,
        true_within=np.abs(true) <= CLAIM_PERCENT,
        read_change_percent=read,
        read_within=np.abs(read) <= CLAIM_PERCENT,
    )


def ranking(alone: Trials) -> Sequence[Row]:
    """Rank what each disturbance does to the default, the costliest first; last what is no disturbance."""
    rows = merged(alone.keep("case", "moved_um", "added_um"), "case")
    return sorted((row for row in rows if row.case not in (NONE, ALL)), key=lambda r: -middle(r.added_um))


def kinds(noisy: Trials) -> list[Row]:
    """Summarise the family, each kind held out, other sizes, each kind of the family, and other cases."""
    family = noisy.where(part=IN_FAMILY, case=ALL)
    beside, own = noisy.where(part=BESIDE_IT), family.values("true_arm")
    parts = {"the family": family}
    parts |= {true_arm_label(arm): beside.where(true_arm=arm, size=1.0) for arm in kinds_held_out()}
    parts |= {f"disturbances times {x:g}": beside.where(size=x) for x in beside.values("size") if x != 1}
    parts |= {true_arm_label(arm): family.where(true_arm=arm) for arm in own if len(own) > 1}
    parts["undisturbed family"] = noisy.where(part=IN_FAMILY, case=NONE)
    parts[f"{STIFF} alone"] = noisy.where(part=IN_FAMILY, case=STIFF)
    return [_of_kind(kind, part) for kind, part in parts.items() if len(part)]


def _of_kind(kind: str, part: Trials) -> Row:
    """What the default does on arms of one kind, beside its rivals on the same ones."""
    default = part.where(name=DEFAULT)
    ours, *theirs = aligned(part, (DEFAULT, *RIVALS.values()), ERROR).T
    covered, n = default["cover.covered_percent"], len(default)
    return Row(
        {f"{name}_um": number(own) for name, own in zip(RIVALS, theirs, strict=True)},
        **{f"beats_{name.lower()}": wins(ours, own) / n for name, own in zip(RIVALS, theirs, strict=True)},
        kind=kind,
        trials=n,
        default_um=number(ours),
        covered_percent=float(covered.mean()),  # every arm has as many components
        worst_tenth_percent=worst_tenth(covered),
        removed_percent=number(100 * (1 - default[ERROR] / default["deflection_um"])),
    )


def _figures(found: Report) -> Mapping[str, Figure]:
    """Draw errors of every model by disturbance, without noise and with it."""
    panes = {
        found.tables[name].title: lines(
            found, name, "case name", lambda r: r.name != f"{JOINTS_ONLY}{FILLED}"
        )
        for name in ("calm", "noisy")
    }
    reading = "RMS errors over the workspace. Dots: medians; lines: their spread. Filled: with a prior."
    return {"model_error.png": ranges(panes, found.question, reading)}


PRESET = Preset(
    name="model_error",
    page="docs/studies/model_error.md",
    question="How much do errors grow with disturbances that the model lacks?",
    how="Poses and weight are those of section 6, with and without noise. Models are judged in other poses.",
    options=DisturbanceOptions,
    settings=_settings,
    seeds=(100, 2),
    row=DisturbedRow,
    trial=_trial,
    tables=_tables,
    printed="noisy",
    cells=lambda settings, _: {
        case: {"part": IN_FAMILY, "case": case, "sigma_um": UM * settings.sigma} for case in (ALL, NONE)
    },
    derived=_derived,
    figures=_figures,
    size=2,
)
STUDY = PRESET.study()
