"""The report of all trials: medians and spreads of every fit, and how often intervals hold the truth."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from testbench.arm.catalogue import find_arm
from testbench.bench.baselines import JOINTS, duel, duels
from testbench.bench.campaign import build_cell, simulate
from testbench.bench.rows import MM, DatasetRow, dataset_row
from testbench.bench.wrong_prior import SCALE, SHAPE
from testbench.identify.identifiability import describe
from testbench.identify.prior import Strength, cad_prior
from testbench.model.structure import mgco68
from testbench.studies.identifiability.campaigns import SPOILED, SPOILED_BY, CampaignRow, Part
from testbench.studies.identifiability.coverage import CONFIDENCE, Covered, Kind
from testbench.studies.identifiability.methods import ModelRow
from testbench.studies.identifiability.trial import NAME, Settings, TrialRow
from testbench.studies.identifiability.verdict import Gains, Leaders, Worth, gains, leaders, worth
from testbench.studies.study import Rows
from testbench.trials.duel import Duel
from testbench.trials.spread import Number, Share, grouped, merge, middle
from testbench.views.identifiability.report import Seen, seen_report

CHALLENGER = "MGCO56"  #: Without a prior, against joints alone.
DUELS = (
    ("MGCO56, GCO + prior", JOINTS),
    (CHALLENGER, JOINTS),
    (CHALLENGER, "MLS56"),
    ("MGCO56, GCO + prior", "MGCO56, LS + prior"),
)
"""Against the incumbent, then what the cone does without a prior and with it."""
NO_WORSE = 1.001  #: Ratio of two errors up to which one is no worse: the solvers' digits.
SEEN_AT = Strength(0.3)  #: How firmly the prior is believed where it is asked what the data see.


@dataclass(frozen=True)
class PriorReport:
    """How wrong the prior is."""

    scale: float
    shape_percent: float


@dataclass(frozen=True)
class Measured(DatasetRow):
    """What is identified from; deflections are those of all measured runs of the first seed."""

    poses: int
    workspace_poses: int


@dataclass(frozen=True)
class ModelReport(ModelRow):
    """A model over all seeds; the paper has no such campaign."""

    paper: None = None


@dataclass(frozen=True)
class Choice:
    """What cross-validation over poses recommends, by structure; errors are those over the workspace."""

    recommended: tuple[str, ...]
    chosen: Mapping[str, Share]
    held_out_f_m: Mapping[str, Number]
    workspace_mm: Mapping[str, Number]
    chosen_workspace_mm: Number
    best_workspace_mm: Number


@dataclass(frozen=True)
class Outliers:
    """How many readings are wild, and errors over the workspace without them and by either loss."""

    spoiled_percent: float
    off_by_mm: float
    spoiled: Number
    rejected: Number
    clean_mm: Number
    plain_mm: Number
    robust_mm: Number


@dataclass(frozen=True)
class Ratio:
    """Seed by seed: error of GCO over that of least squares with the same prior, believed as firmly."""

    worst_ratio: float
    best_ratio: float
    seeds_worse: int
    seeds: int


@dataclass(frozen=True)
class Coverage:
    """Shares of intervals that hold the truth: of all, with its error over datasets, and of one deflection.

    `all_covered` is the share of datasets in which every interval does; the width is that of finite ones.
    """

    name: str
    kind: Kind
    confidence: float
    covered: float
    standard_error: float | None
    all_covered: float
    width_um: float | None
    unbounded: float
    datasets: int
    intervals: int


@dataclass(frozen=True)
class Verdict:
    """What follows from the models of the report."""

    best: Leaders
    best_without_prior: Leaders
    best_nonlinear: Leaders
    best_nonlinear_without_prior: Leaders
    joints: ModelReport
    joints_nonlinear: ModelReport
    worth: list[Worth]


@dataclass(frozen=True)
class Beaten:
    """In how many seeds a model without a prior beats joints alone over the workspace, with so many poses."""

    poses: int
    wins: int
    seeds: int


@dataclass(frozen=True)
class IdentifiabilityReport(Verdict):
    """report.json."""

    scenario: str
    seed: int | list[int]
    arm: str
    payload_kg: float
    noise: bool
    truth: Literal["linear"]
    prior: PriorReport
    dataset: Measured
    models: list[ModelReport]
    nonlinear: list[ModelReport]
    scales: list[Mapping[str, Number]]
    fixed_scale: Mapping[str, Number]
    poses: list[Mapping[str, Number]]
    duels: list[Duel]  #: Linear truth.
    duels_nonlinear: list[Duel]
    gains: Gains  #: Linear truth.
    gains_nonlinear: Gains
    beaten: list[Beaten]  #: By MGCO56, linear truth.
    choice: Choice
    outliers: Outliers
    never_worse: Mapping[str, Ratio]
    seen: Seen
    coverage: Mapping[str, Coverage]
    family_coverage: Mapping[str, Coverage]


def summary(asked: Settings, seeds: range, trials: Rows[TrialRow]) -> IdentifiabilityReport:
    """Medians and spreads of all campaigns, shares of all datasets."""
    rows = [row for _, own in trials for row in own]
    part = grouped([row.campaign for row in rows if row.campaign], lambda row: row.part)
    drawn = grouped([row.intervals for row in rows if row.intervals], lambda row: row.name)
    shares = {name: covered(own) for name, own in drawn.items()}
    roots = list(seeds[: asked.campaigns])
    models, nonlinear = _models(part["linear"]), _models(part["nonlinear"])
    dataset, seen = _first_campaign(asked, seeds[0])
    return IdentifiabilityReport(
        scenario=NAME,
        seed=roots[0] if len(roots) == 1 else roots,
        arm=asked.scenario.arm,
        payload_kg=asked.scenario.mass,
        noise=asked.scenario.noise,
        truth="linear",
        prior=PriorReport(SCALE, 100 * SHAPE),
        dataset=dataset,
        seen=seen,
        models=models,
        nonlinear=nonlinear,
        scales=_swept(part["scale"], "scale"),
        fixed_scale=_errors(part["fixed scale"]),
        poses=_swept(part["poses"], "poses"),
        duels=_duels(part["linear"]),
        duels_nonlinear=_duels(part["nonlinear"]),
        gains=gains(models, _by_name(part["linear"])),
        gains_nonlinear=gains(nonlinear, _by_name(part["nonlinear"])),
        beaten=_beaten(part["poses"]),
        choice=_choice(part["choice"]),
        outliers=_outliers(part),
        never_worse=_never_worse(part["linear"]),
        coverage={name: row for name, row in shares.items() if row.kind != "family"},
        family_coverage={name: row for name, row in shares.items() if row.kind == "family"},
        **vars(verdict(models, nonlinear)),
    )


def _first_campaign(asked: Settings, seed: int) -> tuple[Measured, Seen]:
    """What the runs of the first seed see of MGCO68, and their sizes."""
    cell, scenario = build_cell(find_arm(asked.arm)), asked.scenario
    campaign = simulate(cell, scenario, seed)
    runs = campaign.identification
    of_all = vars(dataset_row(campaign.measured)) | {"runs": runs.runs, "points": runs.points}
    poses = scenario.identification_poses
    dataset = Measured(**of_all, poses=poses, workspace_poses=scenario.workspace_poses)
    seen = describe(cell.vjm, mgco68(cell.arm), runs, cad_prior(cell.arm), SEEN_AT)
    return dataset, seen_report(seen)


def verdict(models: Sequence[ModelReport], nonlinear: Sequence[ModelReport]) -> Verdict:
    """Who is best under both truths, and what a prior is worth."""
    return Verdict(
        best=leaders(models),
        best_without_prior=leaders(m for m in models if not m.prior),
        best_nonlinear=leaders(nonlinear),
        best_nonlinear_without_prior=leaders(m for m in nonlinear if not m.prior),
        joints=next(m for m in models if m.name == JOINTS),
        joints_nonlinear=next(m for m in nonlinear if m.name == JOINTS),
        worth=worth(models),
    )


def _models(rows: Iterable[CampaignRow]) -> list[ModelReport]:
    by_name = _by_name(rows)
    return [ModelReport(**vars(merge(fits))) for fits in by_name.values()]


def _by_name(rows: Iterable[CampaignRow]) -> dict[str, list[ModelRow]]:
    return grouped([row.fit for row in rows], lambda fit: fit.name)


def _errors(rows: Iterable[CampaignRow]) -> dict[str, Number]:
    """RMS over the workspace by name [mm]."""
    by_name = _by_name(rows)
    return {name: merge([fit.workspace.rms_mm for fit in fits]) for name, fits in by_name.items()}


def _swept(rows: Iterable[CampaignRow], key: str) -> list[Mapping[str, Number]]:
    return [{key: x, **_errors(own)} for x, own in grouped(rows, lambda row: row.x).items()]


def _duels(rows: Iterable[CampaignRow]) -> list[Duel]:
    return duels(_by_name(rows), DUELS)


def _beaten(rows: Iterable[CampaignRow]) -> list[Beaten]:
    found = []
    for poses, own in grouped(rows, lambda row: row.x).items():
        d = duel(*(_named(own, name) for name in (CHALLENGER, JOINTS)))
        found.append(Beaten(int(poses or 0), d.workspace, d.seeds))
    return found


def _named(rows: Iterable[CampaignRow], name: str) -> list[ModelRow]:
    return [row.fit for row in rows if row.fit.name == name]


def _choice(rows: Sequence[CampaignRow]) -> Choice:
    by_name = grouped(rows, lambda row: row.fit.name)
    errors = np.array([[middle(row.fit.workspace.rms_mm) for row in own] for own in by_name.values()])
    chosen = {name: merge([row.chosen is True for row in own]) for name, own in by_name.items()}
    return Choice(
        recommended=tuple(name for name, share in chosen.items() if share == max(chosen.values())),
        chosen=chosen,
        held_out_f_m={name: merge([row.held_out_f_m for row in own]) for name, own in by_name.items()},
        workspace_mm=_errors(rows),
        chosen_workspace_mm=merge([row.fit.workspace.rms_mm for row in rows if row.chosen]),
        best_workspace_mm=merge(errors.min(axis=0).tolist()),
    )


def _outliers(part: Mapping[Part, Sequence[CampaignRow]]) -> Outliers:
    clean, plain, robust = (
        merge([row.fit.workspace.rms_mm for row in rows])
        for rows in (part["clean"], part["plain"], part["robust"])
    )
    return Outliers(
        spoiled_percent=100 * SPOILED,
        off_by_mm=MM * SPOILED_BY,
        spoiled=merge([row.spoiled for row in part["robust"]]),
        rejected=merge([row.rejected for row in part["robust"]]),
        clean_mm=clean,
        plain_mm=plain,
        robust_mm=robust,
    )


def _never_worse(rows: Iterable[CampaignRow]) -> dict[str, Ratio]:
    known = [row.fit for row in rows if row.fit.gco_over_ls_at_this_strength is not None]
    found = {}
    for name, fits in grouped(known, lambda fit: fit.structure).items():
        ratios = [middle(fit.gco_over_ls_at_this_strength) for fit in fits]
        worse = sum(ratio > NO_WORSE for ratio in ratios)
        found[name] = Ratio(max(ratios), min(ratios), worse, len(ratios))
    return found


def covered(rows: Sequence[Covered]) -> Coverage:
    """Shares over datasets and deflections of one kind of interval."""
    inside, width = np.array([row.inside for row in rows]), np.array([row.width_um for row in rows])
    by_dataset, finite = inside.mean(axis=1), np.isfinite(width)
    several = len(rows) > 1
    return Coverage(
        name=rows[0].name,
        kind=rows[0].kind,
        confidence=CONFIDENCE,
        covered=float(inside.mean()),
        standard_error=float(by_dataset.std(ddof=1) / np.sqrt(len(rows))) if several else None,
        all_covered=float((by_dataset == 1).mean()),
        width_um=float(width[finite].mean()) if finite.any() else None,
        unbounded=float(1 - finite.mean()),
        datasets=len(rows),
        intervals=int(inside.size),
    )
