"""Preset `identifiability`: what the data cannot see, what a prior is worth, how often intervals hold."""

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from testbench.arm.folder import find_arm
from testbench.report.colours import look
from testbench.report.figure import Figure, forest
from testbench.report.figures_fit import coverage_figure
from testbench.report.report import Report
from testbench.report.schema import KNOWN
from testbench.report.table import Row, Trials
from testbench.studies.campaign import priors
from testbench.studies.campaign.coverage import CONFIDENCE, LEVELS
from testbench.studies.campaign.priors import SIX_DOF, PriorOptions, PriorSettings, TrialRow
from testbench.studies.campaign.report import ERROR, Preset, TrialTable, Where
from testbench.workflows.models import JOINTS

SEEN = "name parameters rank conservative uncertainty_percent rms_um"
COVERAGE = "interval datasets covered_percent standard_error_percent width_um unbounded_percent"
ALSO = "filling uncertainty_percent"


def tables(_: PriorSettings) -> Mapping[str, TrialTable]:
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
            rows=coverage,
        ),
    }


def _derived(_: PriorSettings, trials: Trials) -> Trials:
    """Put fits and intervals side by side: each row is of one or the other."""
    own = trials.inside("fit").add(**trials.keep("seed", "intervals.").columns)
    whole = {key: np.nan_to_num(own[key]).astype(int) for key in ("parameters", "rank", "poses")}
    return own.add(**whole)


def coverage(own: Trials) -> Iterator[Row]:
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


def figures(found: Report) -> Mapping[str, Figure]:
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
    reading = "Filled: with a prior that is too soft and wrong in shape. Dotted: Joints-only."
    counted = Row(found.numbers).cells["coverage"]
    return {
        "identifiability.png": forest(table, panes, found.question, reading, JOINTS),
        "coverage.png": coverage_figure(counted),
    }


PRESET = Preset(
    name="identifiability",
    page="docs/studies/identifiability.md",
    question="What do the poses of section 6 not determine, and how much does a CAD prior help?",
    how="An arm is read under its payload in 8 poses. Models are judged in 200 other poses. The prior is "
    "twice too soft and 30 % wrong in shape. Coverage is over datasets with other draws of noise.",
    options=PriorOptions,
    settings=priors.settings,
    seeds=(1000, 10),
    row=TrialRow,
    trial=priors.trial,
    tables=tables,
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
    figures=figures,
    size=2,
    models="fit.name",
    arms=lambda settings: [find_arm(settings.arm), find_arm(SIX_DOF)],
)
STUDY = PRESET.study()
