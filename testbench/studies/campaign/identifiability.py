"""What the data cannot see, what a prior is worth, how often intervals hold.

A trial is one campaign identified in every way, and one dataset of every kind of interval. All models of a
campaign see the same runs, with a linear truth and with MuJoCo's; of the linear one the scale of the prior
and the number of poses are varied. Campaigns and intervals have numbers of trials of their own: each is in
the first seeds of the study.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Literal

import numpy as np
import typer

from testbench.arm.folder import find_arm, load_arm
from testbench.data.dataset import Dataset
from testbench.identify.estimate import Estimate, Estimator
from testbench.identify.method import gco, least_squares, with_prior
from testbench.identify.prior import Prior, rescale_to_data, scale_by_prior
from testbench.identify.regression import reduce
from testbench.model.structure import Structure
from testbench.model.vjm import Vjm
from testbench.report.colours import look
from testbench.report.figure import Figure, forest
from testbench.report.figures_fit import coverage_figure
from testbench.report.report import Report
from testbench.report.schema import KNOWN
from testbench.report.table import Row, Trials
from testbench.runs.spread import Number
from testbench.studies.campaign import coverage
from testbench.studies.campaign.coverage import CONFIDENCE, LEVELS, Covered
from testbench.studies.campaign.report import ERROR, Preset, TrialTable, Where
from testbench.studies.campaign.trial import CampaignFitRow, TrialCase, fitted, score_cases
from testbench.studies.intervals import (
    choose_strength,
    every_fold,
    gco_least_trace,
    gco_stein,
    stein_parameters,
)
from testbench.studies.study import ArmFlag, plain_models
from testbench.workflows.campaign import Campaign, Scenario, draw_poses, of_arm, simulate, simulate_at
from testbench.workflows.cell import Cell, build_cell
from testbench.workflows.models import JOINTS_ONLY, SCALE, Model, named_models, wrong_prior
from testbench.workflows.own_estimator import Models

SIX_DOF = "arm_6r"  #: The arm of section 5.2: the data see all its predictions.
MODELS_WITHOUT_PRIOR = (JOINTS_ONLY, "MLS56", "MGCO56", "MGCO68")
"""Models without a prior; beside MLS56 stands what is conservative and fits as well."""
VARIED = ("MGCO56", "MGCO68")  #: Structures whose prior's scale and number of poses are varied.

Filling = Literal["none", "least trace", "prior", "log-det prior"]
"""What fills the directions that the data do not see: nothing but the method, or a prior in its metric."""


@dataclass(frozen=True)
class Filler:
    """Describe a method that takes a prior."""

    name: str  #: Behind that of the structure.
    filling: Filling
    estimator: Callable[[Cell, Prior], Estimator]


@dataclass(frozen=True)
class PriorOptions:
    """Hold the flags of the study."""

    arm: ArmFlag = "kr500_l480"
    campaigns: Annotated[int, typer.Option(min=1, metavar="N", help="Trials that also run a campaign.")] = 20


@dataclass(frozen=True)
class PriorSettings:
    """Describe what is tried."""

    arm: str  #: Folder or name of the arm.
    scenario: Scenario  #: The campaign; its truth and number of poses are varied.
    first: int  #: The first seed.
    campaigns: int  #: Trials with a campaign.
    bootstraps: int  #: Those with bootstrap intervals.
    family: int  #: Those with an arm of the family.
    structures: tuple[str, ...] = ("MGCO56", "MGCO68", "ALL153")  #: With a prior.
    scales: tuple[float, ...] = (0.2, 0.5, 1.0, 2.0, 5.0)  #: Factors by which the prior is wrong.
    poses: tuple[int, ...] = (5, 8, 12, 20, 40)  #: Numbers of identification poses.


@dataclass(frozen=True, kw_only=True)
class PriorMethodRow(CampaignFitRow):
    """Hold one method in one case."""

    filling: Filling
    scale: float | None = None  #: How many times too soft the prior is, where that is varied.
    uncertainty_percent: Number = None  #: Of the prior, as the readings or cross-validation chose it.


@dataclass(frozen=True)
class TrialRow:
    """Hold one fit of a campaign, or the intervals of one dataset."""

    fit: PriorMethodRow | None = None
    intervals: Covered | None = None
    data_file: str | None = None  #: dataset.csv, in a row of the first seed.


def _settings(options: PriorOptions, quick: bool, seeds: range) -> PriorSettings:
    """Make the settings of the flags."""
    found = PriorSettings(
        arm=options.arm,
        scenario=of_arm(load_arm(options.arm), Scenario(arm=find_arm(options.arm).resolve().name)),
        first=seeds[0],
        campaigns=min(options.campaigns, len(seeds), 2 if quick else len(seeds)),
        bootstraps=100,
        family=2 if quick else 200,
    )
    return replace(found, structures=VARIED, scales=(0.5, 2.0), poses=(8, 20)) if quick else found


def _trial(cell: Cell, asked: PriorSettings, seed: int, own: Models) -> Iterator[TrialRow]:
    """Make the fits of the campaign of a seed, then intervals."""
    heavy = coverage.gravity_cases(cell)
    if seed - asked.first < asked.campaigns:
        for row in _fits(cell, asked, seed, own):
            yield TrialRow(fit=replace(row, data_file=None), data_file=row.data_file)
    yield from (TrialRow(intervals=row) for row in _intervals(cell, heavy, asked, seed - asked.first))


def _intervals(
    cell: Cell, heavy: Sequence[coverage.CoverageCase], asked: PriorSettings, k: int
) -> Iterator[Covered]:
    """Intervals of every kind from dataset k."""
    light = coverage.full_pose_case(build_cell(find_arm(SIX_DOF)))
    yield from coverage.refitted(light, k, k < asked.bootstraps)
    for case in heavy:
        yield from coverage.posterior(case, k)
    if k < asked.family:
        yield from coverage.of_family(cell, asked.first + k)


def _fits(cell: Cell, asked: PriorSettings, seed: int, own: Models) -> Iterator[PriorMethodRow]:
    """All fits of one campaign."""
    straight, bent = _campaigns(cell, asked.scenario, seed)
    linear = asked.scenario.model_copy(update={"truth": "linear"})
    plain = plain_models(cell, MODELS_WITHOUT_PRIOR)
    every = [*plain, *_filled(cell, seed, asked.structures, FILLERS), *own(cell, wrong_prior(cell, seed))]
    trial_case = replace(_case(bent, "nonlinear"), saved=bent.measured if seed == asked.first else None)
    yield from _judged(cell, every, [_case(straight, "linear"), trial_case])
    for scale in asked.scales:
        _, *filled = _filled(cell, seed, VARIED, (LS, GCO), scale)
        yield from _judged(cell, filled, [_case(straight, "scale", scale=scale)])
    cases = []
    for count in asked.poses:
        runs = round(count * asked.scenario.identification_runs / asked.scenario.identification_poses)
        more = linear.model_copy(update={"identification_poses": count, "identification_runs": runs})
        cases.append(_case(simulate(cell, more, seed), "poses", poses=count))
    yield from _judged(cell, [*plain, *_filled(cell, seed, VARIED, (GCO,))], cases)


def _campaigns(cell: Cell, scenario: Scenario, seed: int) -> list[Campaign]:
    """Campaigns in the same poses, of a linear truth and of a non-linear one."""
    poses = draw_poses(cell, scenario, seed)
    truths = (scenario.model_copy(update={"truth": truth}) for truth in ("linear", "nonlinear"))
    return [simulate_at(cell, own, seed, poses) for own in truths]


def _case(campaign: Campaign, part: str, **more: object) -> TrialCase:
    factors = {"part": part, "truth": campaign.scenario.truth, "true_arm": "tubes", **more}
    return TrialCase(campaign.identification, campaign.truth, factors)


def _judged(cell: Cell, models: Sequence[Model], cases: Sequence[TrialCase]) -> Iterator[PriorMethodRow]:
    fits, filling = fitted(cell, models, cases), {filler.name: filler.filling for filler in FILLERS}

    def more(name: str, k: int) -> dict[str, object]:
        estimate = fits[name][k]
        weighted_prior = estimate.weighted_prior
        return {
            "filling": filling.get(name.partition(", ")[2], "none"),
            "uncertainty_percent": 100 * weighted_prior.uncertainty.relative if weighted_prior else None,
        }

    yield from score_cases(cell, cases, fits, PriorMethodRow, more)


def _filled(
    cell: Cell, seed: int, structures: Sequence[str], fillers: Sequence[Filler], scale: float = SCALE
) -> list[Model]:
    """Joints alone, then structures by these methods, all with the same wrong prior."""
    prior = wrong_prior(cell, seed, scale)
    joints, *models = named_models(cell, (JOINTS_ONLY, *structures))
    asked = [(joints, LS), *((model, filler) for model in models for filler in fillers)]
    return [
        Model(f"{m.name}, {filler.name}", m.structure, filler.estimator(cell, prior)) for m, filler in asked
    ]


Fill = Callable[[Vjm, Structure, Dataset, Prior], Estimate]


def _of(fill: Fill) -> Callable[[Cell, Prior], Estimator]:
    """A method of a prior that `with_prior` does not have."""
    return lambda cell, prior: lambda _, structure, data: fill(cell.vjm, structure, data, prior)


def _least_trace(vjm: Vjm, structure: Structure, data: Dataset, prior: Prior) -> Estimate:
    """GCO of least trace in the metric of a prior, no compliance believed."""
    regression = reduce(vjm, structure, data)
    return gco_least_trace(regression, rescale_to_data(scale_by_prior(prior, vjm, structure), regression))


def _log_det(vjm: Vjm, structure: Structure, data: Dataset, prior: Prior) -> Estimate:
    """GCO with the log-determinant prior."""
    regression = reduce(vjm, structure, data)
    scaling = rescale_to_data(scale_by_prior(prior, vjm, structure), regression)
    return gco_stein(
        regression, scaling, choose_strength(every_fold(vjm, structure, data), scaling, stein_parameters)
    )


LS = Filler("LS + prior", "prior", lambda _, prior: with_prior(least_squares, prior))
GCO = Filler("GCO + prior", "prior", lambda _, prior: with_prior(gco, prior))
FILLERS = (
    Filler("least trace", "least trace", _of(_least_trace)),
    LS,
    GCO,
    Filler("GCO + log-det", "log-det prior", _of(_log_det)),
)

# --- The report ---------------------------------------------------------------------------------------------

SEEN = "name parameters rank conservative uncertainty_percent rms_um"
COVERAGE = "interval datasets covered_percent standard_error_percent width_um unbounded_percent"
ALSO = "filling uncertainty_percent"


def _tables(_: PriorSettings) -> Mapping[str, TrialTable]:
    """Tabulate models under both truths, scales of the prior, numbers of poses, coverage of intervals."""
    shown = TrialTable("", columns=SEEN, by="filling")
    swept = TrialTable("", by="filling")
    title = "RMS error over the workspace, um"
    return {
        "models": replace(shown, title=f"{title}: linear truth", where={"part": "linear"}),
        "nonlinear": replace(shown, title=f"{title}: MuJoCo's truth", where={"part": "nonlinear"}),
        "scales": replace(
            swept,
            title=f"{title}, by scale of the prior",
            across="scale",
            where={"part": "scale"},
        ),
        "poses": replace(
            swept,
            title=f"{title}, by number of poses",
            across="poses",
            where={"part": "poses"},
        ),
        "coverage": TrialTable(
            "Coverage of 95 % intervals of predicted deflections",
            columns=COVERAGE,
            where={"part": None},
            rows=_covered,
        ),
    }


def _derived(_: PriorSettings, trials: Trials) -> Trials:
    """Put fits and intervals side by side: each row is of one or the other."""
    own = trials.inside("fit").add(**trials.keep("seed", "intervals.").columns)
    whole = {key: np.nan_to_num(own[key]).astype(int) for key in ("parameters", "rank", "poses")}
    return own.add(**whole)


def _covered(own: Trials) -> Iterator[Row]:
    """Count intervals of every kind that hold the truth: of all, with its error over datasets.

    `all_covered` is the share of datasets in which every interval does; the width is that of finite ones.
    """
    for (name, kind), rows in own.groups("intervals.name", "intervals.kind"):
        inside, width = (np.array([*rows[f"intervals.{key}"]]) for key in ("inside", "width_um"))
        by_dataset, finite = inside.mean(axis=1), np.isfinite(width)
        n = len(rows)
        held = 100 * np.array([*rows["intervals.at_levels"]]).reshape(n, -1)
        yield Row(
            interval=name,
            kind=kind,
            confidence=CONFIDENCE,
            covered_percent=100 * inside.mean(),
            standard_error_percent=100 * by_dataset.std(ddof=1) / np.sqrt(n) if n > 1 else None,
            all_covered=(by_dataset == 1).mean(),
            width_um=width[finite].mean() if finite.any() else None,
            unbounded_percent=100 * (1 - finite.mean()),
            datasets=n,
            intervals=inside.size,
            nominal_percent=[100 * level for level in LEVELS[: held.shape[1]]],
            actual_percent=held.mean(axis=0).tolist(),
            actual_error_percent=(held.std(axis=0, ddof=min(1, n - 1)) / np.sqrt(n)).tolist(),
        )


def _cells(_: PriorSettings, __: Trials) -> Mapping[str, Where]:
    """Choose the campaigns with a linear truth."""
    return {"": {"part": "linear"}}


def _figures(found: Report) -> Mapping[str, Figure]:
    """Draw every method with its spread, under both truths."""
    models, bent = (found.tables[name] for name in ("models", "nonlinear"))
    rows = {models.columns[0].cell(row): row for row in models.rows}
    error = replace(KNOWN[ERROR], form=".0f")
    panes = {"linear": "linear truth", "nonlinear": "MuJoCo's non-linear truth"}
    both = [
        Row(
            name=name,
            linear=models.columns[5].value(row),
            nonlinear=next(bent.columns[5].value(r) for r in bent.rows if bent.columns[0].cell(r) == name),
        )
        for name, row in rows.items()
    ]
    known = {m.name: look(m.structure, m.constraint, m.prior, m.filling) for m in Row(found.numbers).models}
    shown = (KNOWN["name"], *(replace(error, key=key) for key in panes))
    table = replace(models, columns=shown, rows=both, looks=known, headline="linear")
    reading = (
        "Filled: with a prior whose compliances are too large, with wrong ratios between axes. "
        "Dotted: Joints-only."
    )
    counted = Row(found.numbers).cells["coverage"]
    return {
        "identifiability.png": forest(table, panes, found.question, reading, JOINTS_ONLY),
        "coverage.png": coverage_figure(counted),
    }


PRESET = Preset(
    name="identifiability",
    page="docs/studies/identifiability.md",
    question="What do the poses of section 6 not determine, and how much does a CAD prior help?",
    how="An arm is read under its payload in 8 poses. Models are judged in 200 other poses. The "
    "compliances of the prior are too large by a factor of two, and their ratios between axes are off by 30 "
    "%. Coverage is over datasets with other draws of noise.",
    options=PriorOptions,
    settings=_settings,
    seeds=(1000, 10),
    row=TrialRow,
    trial=_trial,
    tables=_tables,
    printed="models",
    cells=_cells,
    also=ALSO,
    ours="",
    pairs=(
        ("MGCO56, GCO + prior", "MGCO56"),
        ("MGCO68, GCO + prior", "MGCO68"),
        ("MGCO56, GCO + prior", "MGCO56, LS + prior"),
        ("MGCO68, GCO + prior", "MGCO68, LS + prior"),
    ),
    derived=_derived,
    figures=_figures,
    size=2,
    models="fit.name",
    arms=lambda settings: [find_arm(settings.arm), find_arm(SIX_DOF)],
)
STUDY = PRESET.study()
