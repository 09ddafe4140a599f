"""Section 6 in simulation: a heavy arm under a hung weight, three markers, LS against GCO."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from testbench.arm.folder import find_arm
from testbench.plant.true_arms import FAMILY_NAME, true_arm_of_seed
from testbench.report.badge import drawn, ratios_of
from testbench.report.colours import look_of
from testbench.report.figure import Figure, forest, ranked
from testbench.report.figures_fit import compliance_figure, eigenvalue_figure, residual_figure
from testbench.report.report import Report, say
from testbench.report.scene import PageContent
from testbench.report.schema import true_arm_label
from testbench.report.table import Row, Trials, merged
from testbench.studies import campaigns
from testbench.studies.campaign.report import PAIRS, Preset, TrialTable
from testbench.studies.campaign.trial import Fits, TrialCase, fitted
from testbench.studies.campaigns import NOT_OF_A_MODEL, TRUE, CampaignRow, campaign_rows, distinct, told
from testbench.studies.paper import SECTION_6
from testbench.studies.study import (
    CampaignOptions,
    Run,
    as_in_paper,
    calibration_scene,
    plain_models,
    without_cone,
    write_runs,
)
from testbench.workflows.campaign import Campaign, Scenario, draw_poses, simulate_at, true_cell
from testbench.workflows.cell import Cell, build_cell
from testbench.workflows.model_names import IN_PAPER
from testbench.workflows.models import DEFAULT, JOINTS_ONLY, Model, named_models, with_priors, wrong_prior
from testbench.workflows.own_estimator import Models

QUICK_WORKSPACE = 40
WITHOUT_PRIOR = (JOINTS_ONLY, "MLS32", "MLS56", "MGCO47", "MGCO56", "MGCO68")
"""The incumbent and the paper's models; beside MLS56 stands what is conservative and fits as well."""
WITH_PRIOR = (JOINTS_ONLY, "MLS56", "MGCO56", "MGCO68", "ALL153")
"""Models that are fitted with a prior, which learns from the readings how wrong it is."""


Options = CampaignOptions  #: Flags of the study.


@dataclass(frozen=True)
class CalibrationSettings:
    """Describe what is tried."""

    arm: str  #: Folder or name of the arm.
    scenario: Scenario  #: The campaign.
    true_arm: str = FAMILY_NAME  #: A name of `FAMILY_TRUE_ARMS`, or all of them in turn.
    first: int = 1  #: The first seed: its errors are kept pose by pose.
    magnification: float = 50.0  #: Of the drawn deflections [1].


def settings(options: CampaignOptions, quick: bool, seeds: range) -> CalibrationSettings:
    """Make the settings of the flags.

    Args:
        options: Flags of the command line.
        quick: Whether the run is a small one.
        seeds: Seeds of the trials.

    Returns:
        The settings.
    """
    scenario = options.scenario(QUICK_WORKSPACE if quick else 200)
    return CalibrationSettings(options.arm, scenario, options.true_arm, seeds[0])


def _trial(cell: Cell, asked: CalibrationSettings, seed: int, own: Models) -> list[CampaignRow]:
    """Make the rows of a seed, one per model; the user's estimators are the last."""
    true, campaign = calibrate(cell, asked, seed)
    fits = results(true, campaign, own(true, wrong_prior(true, seed)))
    arm = true_arm_of_seed(asked.true_arm, seed)
    return campaign_rows(true, campaign, fits, arm, placed=seed == asked.first)


def calibrate(cell: Cell, asked: CalibrationSettings, seed: int) -> tuple[Cell, Campaign]:
    """Simulate the campaign of a seed's true arm.

    Args:
        cell: The arm with its model and its truth.
        asked: Settings of the study.
        seed: Seed of the trial.

    Returns:
        The cell with that arm, and its campaign.
    """
    true = true_cell(cell, true_arm_of_seed(asked.true_arm, seed), seed)
    return true, simulate_at(true, asked.scenario, seed, draw_poses(cell, asked.scenario, seed))


def results(cell: Cell, campaign: Campaign, more: Sequence[Model] = ()) -> Fits:
    """Identify baselines, the paper's models, structures with a prior, and more models.

    Args:
        cell: The arm with its model and its truth.
        campaign: The simulated campaign.
        more: Other models.

    Returns:
        Their fits.
    """
    structures = [*named_models(cell, WITH_PRIOR), without_cone(cell)]
    filled = with_priors(cell.arm, structures, wrong_prior(cell, campaign.seed))
    plain = plain_models(cell, WITHOUT_PRIOR)
    case = TrialCase(campaign.identification, campaign.truth, {})
    return fitted(cell, [*plain, *as_in_paper(plain), *filled, *more], [case])


# --- The report ---------------------------------------------------------------------------------------------

PAPERS_ARM = "kr500_l480"
PAPER = SECTION_6 | {f"{name}{IN_PAPER}": cells for name, cells in SECTION_6.items()}
PANES = {
    TRUE: "workspace, truth",
    "ratio": "ratio to the default",
    "check.rms_mm": "check poses, readings",
}
"""Columns that are drawn, where it matters first."""
FIGURE_5, METHODS_BESIDE = ("MGCO68", "MLS32"), ("MLS56", "MGCO56", DEFAULT)
"""Models of the paper's figure of residuals; one of least squares beside one of GCO and the default."""
SHORT = f"name meaning conservative {TRUE}"
MODELS = (
    "name parameters rank conservative status f_m f_m_floor identification.rms_mm check.rms_mm "
    f"check_true.rms_mm check.max_mm check.max_relative_percent {TRUE}"
)


def _tables(asked: CalibrationSettings) -> Mapping[str, TrialTable]:
    """Tabulate every model, those that differ in short, and by true arm."""
    whole = _models(PAPER if asked.scenario.arm == PAPERS_ARM else {})
    return {
        "short": TrialTable("", columns=SHORT, rows=lambda trials: told(_models({})(trials))),
        "models": TrialTable("", columns=MODELS, rows=whole),
        "by_arm": TrialTable(
            "RMS error over the workspace by true arm, mm",
            across="true_arm",
            value=TRUE,
            rows=lambda trials: campaigns.by_arm(trials, TRUE),
        ),
    }


def _models(paper: Mapping[str, Mapping[str, float]]) -> Callable[[Trials], Sequence[Row]]:
    """Make rows of all that is known of a model, with the paper's numbers."""

    def rows(trials: Trials) -> list[Row]:
        every = merged(trials.drop(*NOT_OF_A_MODEL), "name")
        return [Row(model, paper=paper.get(model.name)) for model in every]

    return rows


def _report(asked: CalibrationSettings, seeds: range, trials: Trials) -> Report:
    """Report as every campaign does; beside it what was measured, and where models are worst."""
    report, scenario = PRESET.report(asked, seeds, trials), asked.scenario
    models = distinct(report.numbers["models"])
    best = campaigns.best(models, "none", prior=False)
    compared = drawn(report.badge, trials["name"], *campaigns.user_estimators(models), best)
    errors = campaigns.error_map(trials.where(name={m.name for m in models}), compared)
    measured = {"payload_kg": scenario.mass, "truth": scenario.truth, "noise": scenario.noise}
    numbers = Row(
        report.numbers,
        seed=campaigns.seeds_of(seeds),
        arm=scenario.arm,
        **measured,
        dataset=campaigns.dataset(trials),
        map=errors,
        over=ratios_of(trials, report.numbers["ours"], TRUE),
        details=campaigns.details(trials, (*FIGURE_5, *METHODS_BESIDE), DEFAULT),
    )
    body = [*(name for name in report.body if name != "short"), "worst"]
    title = say(
        "{arm} under {payload_kg:g} kg: markers move {dataset.deflection_min_mm:~.2f} to "
        "{dataset.deflection_max_mm:~.2f} mm; tracker noise {dataset.sigma_um:~g} um. "
        "True arm: {true}. {how}",
        numbers,
        true=true_arm_label(asked.true_arm),
        how=report.title,
    )
    shown = {**report.tables, "worst": campaigns.worst_places(errors)}
    return replace(report, title=title, numbers=numbers, tables=shown, body=body)


def _figures(found: Report) -> Mapping[str, Figure]:
    """Draw errors of every model, what is left of the readings, and what is not conservative."""
    f, whole = Row(found.numbers), found.tables["models"]
    there = {m.name for m in distinct(f.models)}
    table = replace(whole, rows=[row for row in whole.rows if whole.columns[0].cell(row) in there])
    reading = "RMS errors. Filled: prior; dotted: Joints-only; grey diamonds: the paper. "
    reading += "Ratios: 95 % intervals."
    drawn = {"models.png": forest(ranked(table, TRUE, f.over), PANES, found.question, reading, JOINTS_ONLY)}
    if f.details:
        known = {m.name: look_of(m) for m in f.models}
        drawn["eigenvalues.png"] = eigenvalue_figure(f.details, known, METHODS_BESIDE)
        drawn["residuals.png"] = residual_figure(f.details, known, FIGURE_5, METHODS_BESIDE)
        if f.details.get("compliances"):
            drawn["compliance.png"] = compliance_figure(f.details.compliances, DEFAULT, "true arm")
    return drawn


def _write(run: Run[CalibrationSettings]) -> PageContent:
    """Write dataset.csv of the first seed; what the page draws."""
    settings, seed = run.settings, run.seeds[0]
    cell = build_cell(find_arm(settings.arm))
    write_runs(run, cell)
    true = true_cell(cell, true_arm_of_seed(settings.true_arm, seed), seed)
    return calibration_scene(run, true, settings.scenario, settings.scenario.identification_poses)


PRESET = Preset(
    name="gravity_calibration",
    page="docs/studies/gravity_calibration.md",
    question="Which stiffness model best predicts how an arm sags under a hung weight?",
    how="Three markers: 8 poses for identification, 3 for checking. Models are judged over the workspace.",
    options=Options,
    settings=settings,
    seeds=(1, 10_000),
    row=CampaignRow,
    trial=_trial,
    tables=_tables,
    printed="short",
    cells=lambda *_: {"": {}},  # all trials are of one cell
    listed="models",
    value=TRUE,
    pairs=(*PAIRS, ("MGCO68", JOINTS_ONLY), (DEFAULT, "MGCO68 + prior")),
    figures=_figures,
    size=4,
)
STUDY = replace(PRESET.study(), report=_report, write=_write)
