"""What gauges, a ballbar, draw-wires and a camera are worth beside a tracker, in the same poses."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from testbench.design.criteria import criterion_by_name
from testbench.design.exchange import Gauges, gauge_rows, place_gauges
from testbench.design.planning import candidate_set
from testbench.design.rows import MeasurementSetup, PlanSpecification, Tasks, workspace_rows
from testbench.errors import Array
from testbench.identify.prior import cad_prior, scale_by_prior
from testbench.model.load import weight
from testbench.model.structure import all153
from testbench.plant.tracker import BALLBAR, DRAW_WIRE, Gauge, IsotropicTracker
from testbench.plant.true_arms import FAMILY_NAME, true_arm_of_seed
from testbench.report.figure import Figure, forest
from testbench.report.report import Report
from testbench.report.table import Trials
from testbench.runs.rows import trial_rng
from testbench.studies.campaign.report import Preset, TrialTable, by_levels
from testbench.studies.campaign.trial import CampaignFitRow, Cover, TrialCase, cover, fitted, score_cases
from testbench.studies.study import TrueArmFlag
from testbench.workflows.campaign import (
    Scenario,
    draw_poses,
    measure_markers,
    poses_with_weight,
    read_instruments,
    true_cell,
)
from testbench.workflows.cell import Cell
from testbench.workflows.instruments import CAMERA, PROBE, Mounted
from testbench.workflows.models import (
    ALL_UNKNOWNS,
    DEFAULT,
    JOINTS_ONLY,
    named_models,
    with_priors,
    wrong_prior,
)
from testbench.workflows.own_estimator import Models

ARM = "kr500_l480"
TRACKER, THREE, ONE = "tracker, 50 um", "three gauges, 5 um", "one gauge, moved"
LIGHT, LIGHTER = "ballbar, a tenth of the weight", 0.1  #: The payload moves most markers out of its range.
WIRES, WIRE = "three draw-wires, 50 um", "one draw-wire"
INSTRUMENTS = (TRACKER, "probe of six degrees", "camera, 100 um", THREE, ONE, WIRES, WIRE, LIGHT)
ALONE = (ONE, WIRE, LIGHT)  #: Instruments that read one marker in a pose.
POSES, USUAL = (8, 12, 20), 12  #: From how many poses is identified, nested; the number of the headline.
ANCHORS = np.array([[2.2, 0.0, 0.1], [1.2, -1.6, 0.1], [1.2, 1.6, 0.1]])  #: Of wires and ballbar [m].
UNCERTAINTY = 0.3  #: Of the prior that the choice of directions counts with [1].


@dataclass(frozen=True)
class Options:
    """Hold the flags of the study."""

    true_arm: TrueArmFlag = FAMILY_NAME


@dataclass(frozen=True)
class Settings:
    """Hold what is tried."""

    first: int  #: The first seed.
    poses: tuple[int, ...] = POSES
    workspace: int = 100  #: Poses in which the models are judged.
    true_arm: str = FAMILY_NAME  #: One of FAMILY_TRUE_ARMS, or the family in turn.
    arm: str = ARM


def _settings(options: Options, quick: bool, seeds: range) -> Settings:
    """Make the settings of the flags."""
    found = Settings(seeds[0], true_arm=options.true_arm)
    return replace(found, poses=(USUAL,), workspace=30) if quick else found


@dataclass(frozen=True, kw_only=True)
class InstrumentRow(CampaignFitRow):
    """Hold the numbers of one model from the readings of one instrument."""

    read_percent: float  #: Share of the readings that were in range.
    cover: Cover | None = None  #: Of the default.


def _directions(cell: Cell, q: Array, around: Array, mass: float, count: int) -> Array:
    """Choose world axes of gauges in given poses.

    Args:
        cell: The arm with its model.
        q: Poses, (poses, n) [rad, m].
        around: Poses in which the model is to predict, (tasks, n) [rad, m].
        mass: Hung mass [kg].
        count: Gauges in each pose.

    Returns:
        Directions, (poses, m, 3) [1]; zero for markers without a gauge.
    """
    scaling, hung = scale_by_prior(cad_prior(cell.arm), cell.vjm, all153(cell.arm)), weight(cell.vjm, mass)
    setup = MeasurementSetup(cell.vjm, scaling, cell.vjm.markers, Gauge.sigma)
    spec = PlanSpecification(setup, (hung,), Tasks(around, hung), around, UNCERTAINTY, len(q))
    problem, gauges = candidate_set(spec, q).problem, Gauges(count, Gauge.sigma, Gauge.tilt_sigma)
    rows = gauge_rows(spec, q, np.zeros(len(q), dtype=int), gauges, problem.lift)
    chosen = place_gauges(rows, problem, criterion_by_name("I", problem, workspace_rows(spec)), gauges)
    found = np.zeros((len(q), len(cell.arm.markers), 3))
    found[chosen.pose_index[:, None], chosen.marker] = np.eye(3)[chosen.axis]
    return found


def instruments(cell: Cell, q: Array, around: Array, mass: float) -> dict[str, list[Mounted]]:
    """Set up every instrument in all poses.

    Args:
        cell: The arm with its model.
        q: Poses, (poses, n) [rad, m].
        around: Poses in which the model is to predict, (tasks, n) [rad, m].
        mass: Hung mass [kg].

    Returns:
        The instruments by name.
    """
    markers = cell.arm.markers
    three, one = (_directions(cell, q, around, mass, count) for count in (len(markers), 1))
    wires = [Mounted(DRAW_WIRE, name, fixed=at) for name, at in zip(markers, ANCHORS, strict=True)]
    mounted = (
        [Mounted(IsotropicTracker(50e-6))],
        [Mounted(PROBE)],
        [Mounted(CAMERA)],
        [Mounted(Gauge(), name, three[:, k]) for k, name in enumerate(markers)],
        [Mounted(Gauge(), name, one[:, k]) for k, name in enumerate(markers)],
        wires,
        wires[:1],
        [Mounted(BALLBAR, markers[0], fixed=ANCHORS[0])],
    )
    return dict(zip(INSTRUMENTS, mounted, strict=True))


def _cases(cell: Cell, true: Cell, asked: Settings, seed: int, arm: str) -> Iterator[TrialCase]:
    """Yield every instrument in few and in many poses, the few among the many."""
    most = max(asked.poses)
    scenario = Scenario(arm=cell.arm.name, identification_poses=most, workspace_poses=asked.workspace)
    poses = draw_poses(cell, scenario, seed)
    q, around = poses.station[:most], poses.anywhere
    everywhere = poses_with_weight(cell, around, np.arange(len(around)) + 1, scenario.mass)
    truth = measure_markers(true, scenario, everywhere)
    for name, own in instruments(cell, q, around, scenario.mass).items():
        for n in asked.poses:
            some = [m if m.direction is None else replace(m, direction=m.direction[:n]) for m in own]
            mass = scenario.mass * (LIGHTER if name == LIGHT else 1)
            loaded = poses_with_weight(cell, q[:n], np.arange(n) + 1, mass)
            runs = read_instruments(true, scenario.truth, loaded, some, trial_rng(seed, 1))
            shown = runs if (name, n, seed) == (THREE, USUAL, asked.first) else None
            if runs.is_measured.any():
                yield TrialCase(runs, truth, {"true_arm": arm, "instrument": name, "poses": n}, shown)


def _trial(cell: Cell, asked: Settings, seed: int, own: Models) -> Iterator[InstrumentRow]:
    """Yield the rows of a seed, one per model, instrument and number of poses."""
    arm = true_arm_of_seed(asked.true_arm, seed)
    true, prior = true_cell(cell, arm, seed), wrong_prior(cell, seed)
    joints, plain = named_models(cell, (JOINTS_ONLY, ALL_UNKNOWNS))
    models = [joints, *own(cell, prior), *with_priors(cell.arm, [plain], prior)]
    tried = list(_cases(cell, true, asked, seed, arm))
    fits = fitted(cell, models, tried)

    def more(name: str, k: int) -> Mapping[str, object]:
        runs = tried[k].runs
        wanted = runs.n_runs * (1 if tried[k].factors["instrument"] in ALONE else len(runs.markers))
        shares = cover(cell, fits[name][k], tried[k].test) if name == DEFAULT else None
        return {"read_percent": 100 * float(runs.is_measured.sum() / wanted), "cover": shares}

    yield from score_cases(cell, tried, fits, InstrumentRow, more)


# --- The report ---------------------------------------------------------------------------------------------


def _tables(_: Settings) -> Mapping[str, TrialTable]:
    """List the default by instrument; its error by poses; that of Joints-only."""
    usual = {"name": DEFAULT, "poses": USUAL}
    return {
        "instruments": TrialTable(
            f"{DEFAULT}, {USUAL} poses",
            down="instrument",
            columns="instrument rms_um covered_percent half_mm rank read_percent",
            where=usual,
        ),
        "poses": TrialTable(
            f"{DEFAULT}: RMS error, um", down="instrument", across="poses", where={"name": DEFAULT}
        ),
        "joints": TrialTable(
            f"{JOINTS_ONLY}: RMS error, um", down="instrument", across="poses", where={"name": JOINTS_ONLY}
        ),
    }


def _derived(_: Settings, trials: Trials) -> Trials:
    """Name coverage and half width as other studies do."""
    return trials.add(covered_percent=trials["cover.covered_percent"], half_mm=trials["cover.half_mm"])


def _by_instrument(trials: Trials) -> Trials:
    """Name the rows of the default by their instrument, so that instruments are compared."""
    own = trials.where(name=DEFAULT, poses=USUAL)
    return own.add(name=own["instrument"])


def _figures(found: Report) -> Mapping[str, Figure]:
    """Draw the error from every instrument, one pane per number of poses."""
    table, panes = by_levels(found.tables["poses"])
    reading = "Numbers: medians. Dotted: the tracker."
    return {"instruments.png": forest(table, panes, found.question, reading, TRACKER)}


PRESET = Preset(
    name="instruments",
    page="docs/studies/instruments.md",
    question="How do dial gauges, wires, a ballbar and a camera compare with a laser tracker?",
    how="Every instrument reads the KR 500 under its payload in the same random poses. Gauges are half a "
    "degree off. Their directions are chosen in each pose. Models are judged over the workspace.",
    options=Options,
    settings=_settings,
    seeds=(100, 8),
    row=InstrumentRow,
    trial=_trial,
    tables=_tables,
    printed="instruments",
    cells=lambda *_: {"": {"instrument": THREE, "poses": USUAL}},
    ours=THREE,
    rivals=(TRACKER,),
    pairs=tuple((name, TRACKER) for name in INSTRUMENTS if name != TRACKER),
    compared=_by_instrument,
    derived=_derived,
    figures=_figures,
)
STUDY = PRESET.study()
