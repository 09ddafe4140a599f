"""The cost of noise by method and structure, and what laser trackers near and far are worth.

Every trial has a true arm of the family, the next one in turn; the model and the prior stay the folder's.
Three parts. `six_dof`: the 108 runs of section 5.2, both positions and orientations, linear truth. `gravity`:
the KR 500 under its payload, 8 poses, non-linear truth, judged all over the workspace. `instrument`: the same
poses read by laser trackers near and far, weighted or not, all identified by one model; weighted or not near
by also by the model that `identify` takes.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
import typer

from testbench.arm.folder import find_arm
from testbench.data.dataset import Dataset
from testbench.errors import Array, BenchError, Mask
from testbench.plant.tracker import TYPICAL_MPE_FRACTION, LaserTracker, deflection_precision, read_positions
from testbench.plant.true_arms import FAMILY_NAME, true_arm_of_seed
from testbench.report.figure import Figure, sweeps
from testbench.report.report import Report
from testbench.report.table import TRIAL, Row, Trials, matched
from testbench.runs.rows import trial_rng
from testbench.studies.campaign.report import ERROR, Preset, TrialTable, Where, duels, lines
from testbench.studies.campaign.trial import (
    CampaignFitRow,
    TrialCase,
    fitted,
    reread,
    score_cases,
    with_wrong_priors,
)
from testbench.studies.study import DEFAULT_WITHOUT_CONE, TrueArmFlag
from testbench.workflows.campaign import (
    Campaign,
    FullPose,
    Scenario,
    draw_poses,
    simulate_at,
    simulate_full_pose,
    true_cell,
)
from testbench.workflows.cell import Cell, build_cell
from testbench.workflows.model_names import CLIPPED, EQUAL_FIT
from testbench.workflows.models import DEFAULT, JOINTS_ONLY, Model
from testbench.workflows.own_estimator import Models
from testbench.workflows.rows import UM

FLAT, WEIGHTED, UNWEIGHTED = "flat 50 um", "weighted", "flat weights"
CENTRE = (2.2, 0.0, 1.6)  #: Middle of the work area, section 6 [m].
LOST, MISREAD, BY = 0.1, 0.05, 1e-3
"""Share of targets that are lost, share that are misread, and by how much [m]."""


DRIFT = 20e-6, 5e-6
"""Standard deviations of the shift along each axis [m], and of the turn about each axis [rad], by which the
frame drifts between the two readings of a run: 20 um at 4 m [assumed]."""


def drifted(readings: Array, station: tuple[float, float, float], rng: np.random.Generator) -> Array:
    """Move and turn the frame of readings about its station by DRIFT, anew for each run.

    Args:
        readings: Positions, (runs, m, 3) [m].
        station: Origin of the tracker's beam [m].
        rng: Source of randomness.

    Returns:
        Positions, (runs, m, 3) [m].
    """
    shift, turn = (size * rng.standard_normal((len(readings), 1, 3)) for size in DRIFT)
    return np.asarray(readings + shift + np.cross(turn, readings - np.array(station)))


def spoil(data: Dataset, share: float, size: float, rng: np.random.Generator) -> tuple[Dataset, Mask]:
    """Put some loaded readings off, each in a random direction.

    They are `share` of all [1], rounded to whole readings, off by `size` [m]; orientations stay as they are.

    Args:
        data: Measured runs.
        share: Share of the readings [1].
        size: Distance by which they are off [m].
        rng: Source of randomness.

    Returns:
        The dataset, and which readings are off, (runs, m).
    """
    readings = data.n_runs * len(data.markers)
    spoiled = np.zeros(readings, dtype=bool)
    spoiled[rng.permutation(readings)[: round(share * readings)]] = True
    mask = spoiled.reshape(data.n_runs, -1)
    direction = rng.standard_normal(data.after.shape)
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    return replace(data, after=data.after + size * direction * mask[..., None]), mask


def readings(
    clean: Dataset, flat: Dataset, distances: Sequence[float], seed: int
) -> Iterator[tuple[str, float, Dataset]]:
    """Read the same poses by every instrument, the one of flat noise first.

    `clean` readings are without noise, `flat` ones have noise alike along all axes.

    Args:
        clean: Readings without noise.
        flat: Readings with noise alike along all axes.
        distances: Distances of the trackers from the work area [m].
        seed: Seed of the trial.

    Yields:
        Name of the instrument, its distance [m], its readings.
    """
    yield FLAT, 0.0, flat
    for distance in distances:
        tracker = LaserTracker((CENTRE[0], CENTRE[1] - distance, CENTRE[2]))
        plain = _by_laser(clean, tracker, seed)
        yield WEIGHTED, distance, plain
        yield UNWEIGHTED, distance, _unweighted(plain)
        yield "weighted, maximum errors", distance, _by_laser(clean, replace(tracker, mpe_fraction=1.0), seed)
        averaged = _by_laser(clean, replace(tracker, mpe_fraction=TYPICAL_MPE_FRACTION / np.sqrt(3)), seed)
        yield "weighted, 3 readings averaged", distance, averaged
        yield "weighted, frame drifts", distance, _by_laser(clean, tracker, seed, drifts=True)
        yield f"weighted, {100 * LOST:.0f} % of targets lost", distance, _lose(plain, seed)
        misread, _ = spoil(plain, MISREAD, BY, trial_rng(seed, 6))
        yield f"weighted, {100 * MISREAD:.0f} % misread by {1e3 * BY:g} mm", distance, misread


def _by_laser(clean: Dataset, tracker: LaserTracker, seed: int, *, drifts: bool = False) -> Dataset:
    """Read a noise-free dataset by a laser tracker, weighted by what it knows of itself: not of its drift."""
    rng = trial_rng(seed, 1)
    before, after = (read_positions(tracker, p, rng) for p in (clean.before, clean.after))
    if drifts:
        after = drifted(after, tracker.position, trial_rng(seed, 2))
    return replace(clean, before=before, after=after, precision=deflection_precision(tracker, before, after))


def _unweighted(data: Dataset) -> Dataset:
    """Weigh readings alike along every axis, by the sigma that they have in the mean."""
    assert data.precision is not None
    covariance = np.linalg.inv(data.precision)  # of the difference of two readings
    variance = np.trace(covariance, axis1=2, axis2=3).mean() / 6  # three axes, two readings
    return replace(data, sigma=float(np.sqrt(variance)), precision=None)


def _lose(data: Dataset, seed: int) -> Dataset:
    """The same without some of its targets."""
    assert data.precision is not None
    gone = trial_rng(seed, 3).random((data.n_runs, len(data.markers))) < LOST
    return replace(data, precision=np.where(gone[..., None, None], 0.0, data.precision))


LIGHT, HEAVY = "arm_6r", "kr500_l480"
SIX_DOF_MODELS = (JOINTS_ONLY, "MLS32", "MLS56", "MGCO56", "MGCO69", "MGCO147")
GRAVITY_MODELS = (JOINTS_ONLY, "MLS32", "MLS56", "MGCO47", "MGCO56", "MGCO68")
"""Without a prior: the incumbent, and the models of sections 5.2 and 6."""
SIX_DOF_FILLED, GRAVITY_FILLED = (
    (JOINTS_ONLY, "MLS56", "MGCO56", "MGCO69"),
    (JOINTS_ONLY, "MLS56", "MGCO56", "MGCO68"),
)
"""Those that are fitted with a prior too."""
INSTRUMENT = "MGCO56 + prior"  #: Instruments are compared by this model alone.
MAX_UM = 10_000.0  #: Largest noise that an instrument can have [um].
FLAT_SIGMA = 50e-6  #: Noise of the instrument that reads all axes alike, wherever it stands [m].
NEAR = 4.0  #: Distance at which instruments are compared [m].


@dataclass(frozen=True)
class NoiseOptions:
    """Hold the flags of the study."""

    sigma_um: Annotated[
        list[float] | None, typer.Option(metavar="UM", help="Noise per axis, beside 0; repeatable.")
    ] = None
    true_arm: TrueArmFlag = FAMILY_NAME


@dataclass(frozen=True)
class NoiseSettings:
    """Describe what is tried."""

    first: int  #: The first seed of all: the parts with fewer trials have the first ones.
    sigmas: tuple[float, ...] = (0.0, 10e-6, 25e-6, 50e-6, 100e-6, 200e-6)  #: Of a reading along an axis [m].
    gravity_trials: int = 200  #: So many of the trials have the gravity part too.
    instrument_trials: int = 100  #: So many have the part of the instruments.
    distances: tuple[float, ...] = (2.0, 4.0, 8.0, 15.0)  #: Of the tracker from the work area [m].
    true_arm: str = FAMILY_NAME  #: One of FAMILY_TRUE_ARMS, or the family in turn.


def _settings(options: NoiseOptions, quick: bool, seeds: range) -> NoiseSettings:
    """Make the settings of the flags: levels ascending, no noise at all among them."""
    found = NoiseSettings(seeds[0], true_arm=options.true_arm)
    if quick:
        found = replace(found, gravity_trials=2, instrument_trials=1, distances=(4.0,))
    levels = options.sigma_um
    if not levels:
        return found
    for value in levels:
        if not 0 <= value <= MAX_UM or levels.count(value) > 1:
            raise BenchError(f"--sigma-um: expected different values of 0 to {MAX_UM:g}, got {value:g}")
    if max(levels) == 0:
        raise BenchError("--sigma-um: expected at least one level above 0")
    return replace(found, sigmas=tuple(value / 1e6 for value in sorted({0.0, *levels})))


def _arms(_: NoiseSettings) -> tuple[Cell, Cell]:
    """Build the arm of section 5.2 and that of section 6."""
    return build_cell(find_arm(LIGHT)), build_cell(find_arm(HEAVY))


def _trial(arms: tuple[Cell, Cell], asked: NoiseSettings, seed: int, own: Models) -> Iterator[CampaignFitRow]:
    """Make the rows of a seed, one per fit."""
    arm = true_arm_of_seed(asked.true_arm, seed)
    light, heavy = arms
    cell, models = (
        true_cell(light, arm, seed),
        with_wrong_priors(light, SIX_DOF_MODELS, SIX_DOF_FILLED, seed, own),
    )
    scenario = FullPose(arm=LIGHT, least=9e-3, most=41e-3, noise=False)
    levels = _levels(asked, "six_dof", arm, simulate_full_pose(cell, scenario, seed))
    yield from score_cases(cell, levels, fitted(cell, models, levels))
    gravity, instruments = (seed - asked.first < n for n in (asked.gravity_trials, asked.instrument_trials))
    if gravity or instruments:
        cell, models = (
            true_cell(heavy, arm, seed),
            with_wrong_priors(heavy, GRAVITY_MODELS, GRAVITY_FILLED, seed, own),
        )
        linear, bent = _campaigns(cell, seed)
    if gravity:
        levels = _levels(asked, "gravity", arm, bent)
        yield from score_cases(cell, levels, fitted(cell, models, levels))
    if instruments:
        named = {model.name: model for model in models}
        for campaign in (linear, bent):
            yield from _instruments(cell, named, asked, arm, campaign)


def _campaigns(cell: Cell, seed: int) -> list[Campaign]:
    """Campaigns under gravity without noise, in the same poses: linear truth, then non-linear."""
    bent = Scenario(arm=HEAVY, noise=False)
    poses = draw_poses(cell, bent, seed)
    linear = bent.model_copy(update={"truth": "linear"})
    return [simulate_at(cell, scenario, seed, poses) for scenario in (linear, bent)]


def _levels(asked: NoiseSettings, part: str, arm: str, campaign: Campaign) -> list[TrialCase]:
    """Every level of noise."""
    clean, seed = campaign.identification, campaign.seed
    factors = {"part": part, "truth": campaign.scenario.truth, "true_arm": arm}
    cases = [
        TrialCase(
            reread(clean, sigma, trial_rng(seed, 1)), campaign.truth, {**factors, "sigma_um": UM * sigma}
        )
        for sigma in asked.sigmas
    ]
    if (part, seed) == ("gravity", asked.first):
        cases[0] = replace(cases[0], saved=reread(clean, FLAT_SIGMA, trial_rng(seed, 1)))
    return cases


def _instruments(
    cell: Cell, models: Mapping[str, Model], asked: NoiseSettings, arm: str, campaign: Campaign
) -> Iterator[CampaignFitRow]:
    """The same poses read by several instruments; by the default model, the two ways of weighting alone."""
    clean, seed = campaign.identification, campaign.seed
    same = {"part": "instrument", "truth": campaign.scenario.truth, "true_arm": arm}
    flat = reread(clean, FLAT_SIGMA, trial_rng(seed, 1))
    read = [
        TrialCase(runs, campaign.truth, {**same, "instrument": name, "distance_m": x})
        for name, x, runs in readings(clean, flat, asked.distances, seed)
    ]
    weights = [
        case
        for case in read
        if case.factors["instrument"] in (WEIGHTED, UNWEIGHTED) and case.factors["distance_m"] == NEAR
    ]
    for name, cases in ((INSTRUMENT, read), (DEFAULT, weights)):
        yield from score_cases(cell, cases, fitted(cell, [models[name]], cases))


# --- The report ---------------------------------------------------------------------------------------------

GRAVITY, SIX_DOF = "KR 500, 8 poses", "108 runs of section 5.2"
TRACKER_UM = {"gravity": 50.0, "six_dof": 25.0}  #: Noise of the paper's trackers, sections 6 and 5.2.
HIDDEN = {
    *("MLS32", EQUAL_FIT, CLIPPED, "MGCO47", "MGCO68", "MGCO69", "MGCO147", DEFAULT_WITHOUT_CONE),
    *("Joints + prior", "MGCO56 + prior", "MGCO68 + prior", "MGCO69 + prior"),
}
"""Models without a line in the figure, where more would cover one another."""


def _tables(_: NoiseSettings) -> Mapping[str, TrialTable]:
    """Tabulate errors by model and noise, with what a um of it costs; instruments by distance."""
    by_noise = TrialTable("", across="sigma_um", columns="um_per_um")
    read = {"part": "instrument"}
    return {
        "gravity": replace(
            by_noise, title=f"{GRAVITY}: RMS error, um, by noise of a reading", where={"part": "gravity"}
        ),
        "six_dof": replace(
            by_noise, title=f"{SIX_DOF}: RMS error, um, by noise of a reading", where={"part": "six_dof"}
        ),
        "instruments": TrialTable(
            f"KR 500, {INSTRUMENT}: RMS error, um, by distance of the instrument",
            down="instrument",
            across="distance_m",
            where=read | {"name": INSTRUMENT},
        ),
        "weights": TrialTable(
            "Full covariances beside flat weights, in the same readings",
            columns="name distance_m truth error_ratio won",
            where=read,
            rows=_weighted,
        ),
    }


def _weighted(read: Trials) -> list[Row]:
    """What full covariances of a laser tracker are worth beside flat weights, by model and truth."""
    rows = []
    for (name, truth, distance), trials in read.groups("name", "truth", "distance_m"):
        ways = trials.add(name=[way.partition(": ")[2] for way in trials["instrument"]])
        pairs = duels(ways, [(WEIGHTED, UNWEIGHTED)])
        rows += [Row(pair, name=name, truth=truth, distance_m=distance) for pair in pairs]
    return rows


def _derived(_: NoiseSettings, trials: Trials) -> Trials:
    """Add what the largest noise adds in quadrature to the error of the same trial without, per noise."""
    truths = zip(trials["truth"], trials["instrument"], strict=True)
    trials = trials.add(instrument=[own and f"{truth} truth: {own}" for truth, own in truths])
    swept, most = trials["part"] != "instrument", np.nanmax(trials["sigma_um"])
    own = trials.pick(swept)
    calm, noisy = (
        matched(own, own.where(sigma_um=sigma), ERROR, ("part", "name", TRIAL)) for sigma in (0.0, most)
    )
    added = np.full(len(trials), np.nan)
    added[swept] = np.sqrt(np.maximum(0, noisy**2 - calm**2)) / most
    return trials.add(um_per_um=added)


def _cells(asked: NoiseSettings, _: Trials) -> Mapping[str, Where]:
    """Choose the noise nearest to that of the paper's tracker, in both parts."""
    levels = [1e6 * sigma for sigma in asked.sigmas]
    return {
        words: {"part": part, "sigma_um": min(levels, key=lambda level: abs(level - TRACKER_UM[part]))}
        for words, part in ((GRAVITY, "gravity"), (SIX_DOF, "six_dof"))
    }


def _figures(found: Report) -> Mapping[str, Figure]:
    """Draw error against noise for both arms."""
    panes = {
        title: lines(found, name, "name sigma_um", lambda row: row.sigma_um > 0 and row.name not in HIDDEN)
        for title, name in ((GRAVITY, "gravity"), (SIX_DOF, "six_dof"))
    }
    reading = "Marks are medians, and bands are their spread. Filled and dashed: with a prior."
    return {
        "noise_sensitivity.png": sweeps(
            panes, found.question, reading, (JOINTS_ONLY, DEFAULT), proportional="proportional to the noise"
        )
    }


PRESET = Preset(
    name="noise_sensitivity",
    page="docs/studies/noise_sensitivity.md",
    question="How much do errors grow with tracker noise, for each method and structure?",
    how="Models fitted to the 108 runs of the paper's section 5.2 are judged in its check runs. "
    "Models of the KR 500 are fitted to 8 poses, read by several instruments, and judged over the workspace. "
    "All levels of noise share their random numbers.",
    options=NoiseOptions,
    settings=_settings,
    seeds=(1000, 4),
    row=CampaignFitRow,
    trial=_trial,
    shared=_arms,
    tables=_tables,
    printed="gravity",
    cells=_cells,
    check=SIX_DOF,
    derived=_derived,
    figures=_figures,
    arms=lambda _: [find_arm(LIGHT), find_arm(HEAVY)],
)
STUDY = PRESET.study()
