"""Section 5.2: the illustrative 6R arm, full poses; the paper's models under two truths, and the order m."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Literal

import numpy as np
import typer
from scipy.special import chdtri

from testbench.arm.folder import find_arm
from testbench.identify.method import gco, paper_gco
from testbench.report import badge
from testbench.report.figure import Figure, forest
from testbench.report.report import Report, say
from testbench.report.scene import PageContent
from testbench.report.schema import Table, best_of, columns
from testbench.report.table import Row, Trials, aligned, merged
from testbench.runs.spread import wins
from testbench.studies import campaigns
from testbench.studies.campaign.trial import Fits, TrialCase, fitted
from testbench.studies.campaigns import NOT_OF_A_MODEL, CampaignRow, campaign_rows
from testbench.studies.paper.factorised import every_order
from testbench.studies.paper.verdicts import (
    SECTION_5_2,
    comparison,
    nearly,
    number,
    statement_row,
    verdict_table,
)
from testbench.studies.run import READ, headline, warnings
from testbench.studies.study import ArmFlag, Run, Study, calibration_scene, plain_models, write_runs
from testbench.workflows.campaign import Campaign, FullPose, Truth, simulate_full_pose
from testbench.workflows.cell import Cell, build_cell
from testbench.workflows.model_names import EQUAL_FIT
from testbench.workflows.models import JOINTS_ONLY, Model, named_models
from testbench.workflows.own_estimator import Models
from testbench.workflows.rows import MM, UM

MODELS = ("MLS56", "MLS32", "MGCO147", "MGCO69", "MGCO56")  #: The models of Table I, in the paper's order.
TRUTHS: tuple[Truth, ...] = ("linear", "nonlinear")
TUBES = "tubes"  #: The true arm: links as the folder has them.
CLOSE = 0.05  #: Share by which two errors may differ and still be nearly the same.
ORDER_MODELS = ("MGCO69", "MGCO56")
ERROR = "check_true.p95_mm"  #: What models are judged by.
BENT = f"nonlinear.{ERROR}"
EQUAL = 1e-7  #: Share of F_M by which GCO may exceed least squares and still fit as well.
SHORT = f"name conservative check.p95_mm {ERROR} {BENT}"
TABLE_II = (
    f"name parameters rank conservative f_m f_m_floor check.p95_mm {ERROR} {BENT} "
    "check.max_relative_percent check_true.max_relative_percent"
)
ORDER = f"name m f_m f_m_over_optimum {ERROR}"
CELLS = columns("check.p95_mm check.max_relative_percent")  #: Of Table II, that the paper's text gives.
TIES = "truth seeds free also_conservative fits_as_well"
PANES = {
    ERROR: "linear truth, as in the paper",
    "check.p95_mm": "the same, against readings",
    BENT: "MuJoCo's non-linear truth",
}
ORDER_SEEDS, QUICK_ORDER_SEEDS = 20, 1
ORDER_STARTS, QUICK_ORDER_STARTS = 5, 2


@dataclass(frozen=True)
class SixDofOptions:
    """Hold the flags of the study."""

    arm: ArmFlag = "arm_6r"
    per: Annotated[
        Literal["deflection", "reading"],
        typer.Option(help="Whether the noise of 25 um and 250 urad is that of a deflection or of a reading."),
    ] = "deflection"


@dataclass(frozen=True, kw_only=True)
class SixDofSettings(SixDofOptions):
    """Describe what is tried."""

    scenario: FullPose  #: What is measured; its truth is replaced by each in turn.
    first: int  #: The first seed.
    ordered: int  #: Seeds, from the first, in which the order m is studied too.
    starts: int  #: Local solves of every order m: below 6 there are local minima that are not global.
    magnification: float = 10.0  #: Of the drawn deflections [1].


@dataclass(frozen=True)
class SixDofRow(CampaignRow):
    """Hold one fit: of a model under one truth, or of one order m. Errors are of the check runs."""

    truth: Truth = "linear"  #: Kind of truth.
    m: int = 0  #: Order of the vector space of Eq. (16); 0 where the model's own method was used.
    f_m_over_optimum: float | None = None  #: F_M, the best of some local solves, over the least possible.


def _settings(options: SixDofOptions, quick: bool, seeds: range) -> SixDofSettings:
    """Make the settings of the flags."""
    share = math.sqrt(2) if options.per == "deflection" else 1.0
    scenario = FullPose(
        arm=find_arm(options.arm).resolve().name,
        sigma=25e-6 / share,
        sigma_rotation=250e-6 / share,
        least=9e-3,
        most=41e-3,
    )
    return SixDofSettings(
        **vars(options),
        scenario=scenario,
        first=seeds[0],
        ordered=min(len(seeds), QUICK_ORDER_SEEDS if quick else ORDER_SEEDS),
        starts=QUICK_ORDER_STARTS if quick else ORDER_STARTS,
    )


def models(cell: Cell) -> list[Model]:
    """List the models of Table I, what restrains least squares, and the incumbent; GCO is the paper's."""
    every = plain_models(cell, (*MODELS, JOINTS_ONLY))
    return [replace(model, estimator=paper_gco) if model.estimator == gco else model for model in every]


def _trial(cell: Cell, asked: SixDofSettings, seed: int, own: Models) -> Iterator[SixDofRow]:
    """Make the rows of a seed: all models under two truths, and in the first seeds every order m."""
    every = [*models(cell), *own(cell, None)]
    for truth in TRUTHS:
        campaign = simulate_full_pose(cell, asked.scenario.model_copy(update={"truth": truth}), seed)
        case, linear = TrialCase(campaign.identification, campaign.truth, {}), truth == "linear"
        fits = fitted(cell, every, [case])
        for row in campaign_rows(cell, campaign, fits, TUBES, placed=linear and seed == asked.first):
            yield SixDofRow(**vars(row), truth=truth)
        if linear and seed < asked.first + asked.ordered:
            for name in ORDER_MODELS:
                yield from _orders(cell, campaign, name, asked.starts)


def _orders(cell: Cell, campaign: Campaign, name: str, starts: int) -> Iterator[SixDofRow]:
    """F_M and check error of every order m of one model."""
    [model] = named_models(cell, [name])
    best = paper_gco(cell.vjm, model.structure, campaign.identification).f_m
    estimates = every_order(cell, model.structure, campaign.identification, starts, campaign.seed)
    orders = {str(m): [estimate] for m, estimate in enumerate(estimates, start=1)}
    fits = Fits(orders, dict.fromkeys(orders, 0.0))
    for row, estimate in zip(
        campaign_rows(cell, campaign, fits, TUBES, placed=False), estimates, strict=True
    ):
        found = {**vars(row), "name": name, "m": int(row.name)}
        yield SixDofRow(**found, f_m_over_optimum=estimate.f_m / best)


def _report(asked: SixDofSettings, seeds: range, trials: Trials) -> Report:
    """Report medians and spreads of every model and order under both truths, and the paper's statements."""
    straight = trials.where(m=0, truth=TRUTHS[0])
    f = Row(
        seed=campaigns.seeds_of(seeds),
        arm=asked.scenario.arm,
        noise=asked.scenario.noise,
        noise_per=asked.per,
        truth="linear",
        **_found(asked, trials),
    )
    own = badge.of_models(straight, f.models, _model_in_question(f.models), ERROR)
    f["map"] = campaigns.error_map(
        straight, badge.drawn(own, straight["name"], *campaigns.user_estimators(f.models))
    )
    short = Table(columns(SHORT, paper=False), f.models, headline=ERROR)
    return Report(
        scenario=STUDY.name,
        question=say("{arm} under any load: which stiffness model predicts its deflection best?", f),
        title=say(
            "{arm}: {dataset.runs} runs in {dataset.poses} poses, full pose read with "
            "{dataset.sigma_um:.3g} um and {dataset.sigma_urad:.3g} urad a reading; {dataset.check_runs} "
            "check runs; {seeds}",
            f,
            seeds=campaigns.seeds_label(f.seed),
        ),
        answer=headline(own, short),
        claims=warnings(trials.where(m=0)),
        numbers=f,
        tables={
            "short": short,
            "models": Table(columns(TABLE_II), f.models),
            "claims": verdict_table(f.claims),
            "ties": Table(columns(TIES), f.ties, "Conservative by a choice among equal fits"),
            "order": Table(columns(ORDER), [*f.order.MGCO69, *f.order.MGCO56], "The order m, Eq. (20)"),
        },
        body=["models", "claims", "ties", "order", READ],
        badge=own,
    )


def _found(asked: SixDofSettings, trials: Trials) -> Row:
    """Numbers of the models, of the orders m, and the paper's statements."""
    scenario = asked.scenario
    fits, searched = trials.where(m=0).drop("m", "f_m_over_optimum"), trials.pick(trials["m"] > 0)
    straight, bent = (fits.where(truth=truth) for truth in TRUTHS)
    models, others = (merged(own.drop(*NOT_OF_A_MODEL), "name") for own in (straight, bent))
    orders = merged(searched.drop(*NOT_OF_A_MODEL), "name", "m")
    by_name = {m.name: Row(m, paper=SECTION_5_2.get(m.name)) for m in models}
    table_i = [by_name[name] for name in MODELS]
    only_gco = all(m.conservative is (m.constraint == "psd") for m in table_i)
    return Row(
        dataset=Row(
            campaigns.dataset(straight, scenario.poses),
            sigma_urad=UM * scenario.sigma_rotation,
            noise_p95_mm=MM * math.sqrt(2 * chdtri(3, 0.05)) * scenario.sigma,  # of a read deflection
        ),
        models=[Row(m, nonlinear=other) for m, other in zip(by_name.values(), others, strict=True)],
        order=Row(
            {name: [row for row in orders if row.name == name] for name in ORDER_MODELS},
            seeds=searched.values("seed"),
        ),
        ties=[_tie(straight), _tie(bent)],
        claims=[
            statement_row("only the GCO models are conservative (Table I)", only_gco, only_gco),
            *(row for m in table_i for row in _cells(m)),
            *_comparisons(straight, bent),
        ],
    )


def _model_in_question(models: Sequence[Row]) -> str:
    """Name the best GCO model if nothing is clearly better, else the best of all.

    The completed model is none of them: its fit and its predictions are those of MLS56.
    """

    def best(rows: Sequence[Row]) -> list[str]:
        return best_of({m.name: m.check_true.p95_mm for m in rows if m.name != EQUAL_FIT}, CLOSE)

    first, ours = best(models), best([m for m in models if m.constraint == "psd"])[0]
    return ours if ours in first else first[0]


def _comparisons(straight: Trials, bent: Trials) -> Iterator[Row]:
    """The paper's statements on two errors, by errors without noise on the same data."""
    errors = dict(zip(MODELS, aligned(straight, MODELS, ERROR).T, strict=True))
    ours = errors["MGCO56"]
    mls32 = errors["MLS32"]
    mls56 = errors["MLS56"]
    others, seeds = np.min([errors[name] for name in MODELS if name != "MGCO56"], axis=0), len(ours)
    yield comparison("MGCO56 is the best model", wins(ours, others), wins(others, ours), seeds)
    yield comparison("MLS56 does worse than MLS32", wins(mls32, mls56), wins(mls56, mls32), seeds)
    near = int((np.abs(ours / mls32 - 1) <= CLOSE).sum())
    yield nearly(f"MGCO56 and MLS32 are nearly the same: within {100 * CLOSE:g} %", near, seeds)
    enough = int((aligned(bent, ("MGCO56",), ERROR)[:, 0] <= (1 + CLOSE) * ours).sum())
    yield nearly(f"a linear model is enough: MGCO56 errs at most {100 * CLOSE:g} % more", enough, seeds)


def _cells(m: Row) -> Iterator[Row]:
    """The cells of Table II that the paper's text gives of a model."""
    for column in CELLS:
        if known := column.known_value(m):
            what = "95 % error, mm" if column.unit == "mm" else "largest relative error, %"
            yield number(f"{m.name}: {what}", column.value(m), known)


def _tie(trials: Trials) -> Row:
    """In how many seeds MLS56 is not conservative only because it takes another of several equal fits."""
    mls56 = trials.where(name="MLS56")
    f_m, ours = aligned(trials, ("MLS56", "MGCO56"), "f_m").T
    return Row(
        truth=str(trials["truth"][0]),
        seeds=len(f_m),
        free=int(mls56["parameters"][0] - mls56["rank"][0]),
        also_conservative=int(trials.where(name=EQUAL_FIT)["conservative"].sum()),
        fits_as_well=int((ours <= (1 + EQUAL) * f_m).sum()),
    )


def _figures(found: Report) -> dict[str, Figure]:
    """Draw the errors of every model under both truths."""
    reading = "Errors of 95 % of the check runs. Dotted: Joints-only; diamonds: the paper's."
    table = found.led(Table(columns(TABLE_II), Row(found.numbers).models))
    title = f"{found.numbers['arm']}, section 5.2: errors of the check runs"
    return {"six_dof_arm.png": forest(table, PANES, title, reading, JOINTS_ONLY)}


def _write(run: Run[SixDofSettings]) -> PageContent:
    """Write dataset.csv of the first seed, linear truth; return what the page draws."""
    asked = run.settings
    cell = build_cell(find_arm(asked.arm))
    write_runs(run, cell, asked.scenario.poses)
    return calibration_scene(run, cell, asked.scenario, asked.scenario.poses)


STUDY = Study(
    name="six_dof_arm",
    about="Identify the models of Table I and two baselines from 108 runs, and check them on 120 others.",
    options=SixDofOptions,
    settings=_settings,
    seeds=(100, 5),
    row=SixDofRow,
    trial=_trial,
    report=_report,
    printed=("short",),
    figures=_figures,
    write=_write,
    models="name",
)
