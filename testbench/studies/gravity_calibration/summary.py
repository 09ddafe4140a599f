"""The report of all seeds: medians and spreads of every model, and which is best where."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from testbench.bench.campaign import Truth
from testbench.identify import Constraint
from testbench.studies.gravity_calibration.trial import NAME, Judged, Measured, ModelRow, Settings
from testbench.studies.paper import SECTION_6
from testbench.studies.study import Trials
from testbench.trials.spread import Number, grouped, merge, middle, wins
from testbench.views.schema import Column, Table, best_of

PAPERS_ARM = "kr500_l480"
ALIKE = 1e-6  #: Relative difference of check errors below which two models predict alike.


@dataclass(frozen=True)
class ModelReport(Judged):
    """A model over all seeds, and the paper's known numbers for it."""

    paper: Mapping[str, float] | None = None


@dataclass(frozen=True)
class Paired:
    """In how many seeds the best conservative model without prior beats the best least squares."""

    conservative: str
    least_squares: str
    check: int
    workspace: int
    seeds: int


@dataclass(frozen=True)
class Winner:
    """The best models of one method over the workspace."""

    constraint: Constraint  #: What the method asks of the blocks.
    prior: bool  #: Whether a prior fills what the data cannot see.
    names: tuple[str, ...]  #: The best; several where nothing tells them apart.
    rms_mm: Number  #: RMS error over the workspace of the first.
    times: float  #: Least-squares' error over it.


@dataclass(frozen=True)
class GravityReport:
    """report.json."""

    scenario: str
    seed: int | list[int]
    arm: str
    payload_kg: float
    truth: Truth
    noise: bool
    dataset: Measured
    models: list[ModelReport]
    paired: Paired | None
    winners: list[Winner]
    recommended: str
    check_best: tuple[str, ...]
    twins: list[tuple[str, str]]


def summary(asked: Settings, seeds: range, trials: Trials[ModelRow]) -> GravityReport:
    """Medians and spreads of every model; with one seed its numbers."""
    by_name = grouped([row for _, rows in trials for row in rows], lambda row: row.name)
    scenario = asked.scenario
    known = SECTION_6 if scenario.arm == PAPERS_ARM else {}
    models = [_model(rows, known.get(name)) for name, rows in by_name.items()]
    return GravityReport(
        scenario=NAME,
        seed=seeds[0] if len(seeds) == 1 else list(seeds),
        arm=scenario.arm,
        payload_kg=scenario.payload,
        truth=scenario.truth,
        noise=scenario.noise,
        dataset=merge([row.measured for row in next(iter(by_name.values()))]),
        models=models,
        paired=_paired(models, by_name) if len(seeds) > 1 else None,
        winners=winners(models),
        recommended=recommended(models),
        check_best=best_of({m.name: m.check.rms_mm for m in models if m.conservative is True}).names,
        twins=twins(models),
    )


def _model(rows: Sequence[ModelRow], paper: Mapping[str, float] | None) -> ModelReport:
    fields = vars(merge(rows))
    del fields["measured"]
    solved = sum(row.status == "solved" for row in rows)
    if 0 < solved < len(rows):
        fields["status"] = f"solved in {solved} of {len(rows)} seeds"
    return ModelReport(**fields, paper=paper)


def _paired(models: Sequence[ModelReport], by_name: Mapping[str, Sequence[ModelRow]]) -> Paired | None:
    plain = [m for m in models if not m.prior]
    ours = best_of({m.name: m.check.rms_mm for m in plain if m.conservative is True}, 0.0).names
    theirs = best_of({m.name: m.check.rms_mm for m in plain if m.constraint == "none"}, 0.0).names
    if not ours or not theirs:
        return None
    check, workspace = (
        [[middle(getattr(row, where).rms_mm) for row in by_name[name]] for name in (ours[0], theirs[0])]
        for where in ("check", "workspace")
    )
    return Paired(
        conservative=ours[0],
        least_squares=theirs[0],
        check=wins(*check),
        workspace=wins(*workspace),
        seeds=len(check[0]),
    )


def winners(models: Sequence[ModelReport]) -> list[Winner]:
    """The best of each method over the workspace, the method of least error first."""
    found = []
    by_method = grouped(models, lambda m: (m.constraint, m.prior))
    plain = [m for m in models if m.constraint == "none" and not m.prior]
    ls = best_of({m.name: m.workspace.rms_mm for m in plain}).value
    for (constraint, prior), own in by_method.items():
        errors = {m.name: m.workspace.rms_mm for m in own}
        best = best_of(errors)
        found.append(Winner(constraint, prior, best.names, errors[best.names[0]], ls / best.value))
    return sorted(found, key=lambda w: middle(w.rms_mm))


def recommended(models: Sequence[ModelReport]) -> str:
    """The conservative model of least error over the workspace; of those alike the one of fewest unknowns.

    Among equals a model that is conservative by construction goes first. Empty where none is conservative.
    """
    held = {m.name: m for m in models if m.conservative is True}
    alike = [held[name] for name in best_of({n: m.workspace.rms_mm for n, m in held.items()}).names]
    order = sorted(alike, key=lambda m: (m.constraint != "psd", m.parameters))
    return order[0].name if order else ""


def twins(models: Sequence[ModelReport]) -> list[tuple[str, str]]:
    """Pairs of models whose check errors are the same."""
    return [
        (a.name, b.name)
        for k, a in enumerate(models)
        for b in models[k + 1 :]
        if abs(middle(a.check.rms_mm) - middle(b.check.rms_mm)) < ALIKE * middle(a.check.rms_mm)
    ]


COLUMNS = (
    Column("name", "model"),
    Column("parameters", "unknowns", form="d", short="un-\nknowns"),
    Column("rank", "seen", form=".0f", exact=True),
    Column("conservative", "conservative", form="yes", short="conser-\nvative"),
    Column("f_m", "F_M", form=".2f"),
    Column("f_m_floor", "floor", form=".2f", exact=True),
    Column("identification.rms_mm", "RMS fit", "mm", paper="identification_rms_mm"),
    Column("check.rms_mm", "RMS check", "mm", paper="check_rms_mm"),
    Column("check.p95_mm", "95 % check", "mm"),
    Column("check.max_mm", "max check", "mm", paper="check_max_mm"),
    Column("check.max_relative_percent", "max rel.", "%", ".2f", paper="check_max_relative_percent"),
    Column("workspace.rms_mm", "RMS workspace", "mm", short="RMS\nwork-\nspace\nmm"),
)
"""The table of section 6: at check poses errors against readings, over the workspace against the truth."""
RECORDED = ("name", "conservative", "check.rms_mm", "workspace.rms_mm")
WIDE = ("check.p95_mm", "check.max_relative_percent", "f_m_floor")
"""What a recording has room for, and what a terminal of 80 columns has none for."""
FITS = (
    Column("name", "model"),
    Column("method", "method"),
    Column("status", "status"),
    Column("duality_gap", "duality gap", form=".1e"),
    Column("f_m_excess_bound", "trace weight costs at most", form=".1e"),
    Column("min_eigenvalue", "smallest eigenvalue", form=".1e"),
    Column("solve_seconds", "time", "s"),
    *(
        Column(f"residuals.{group}.{key}", f"{heading}, {group}", unit, form)
        for group in ("identification", "check")
        for key, heading, unit, form in (
            ("mean_um", "residual mean", "um", ".1f"),
            ("std_um", "residual standard deviation", "um", ".1f"),
            ("lilliefors_p", "Lilliefors p", "", ".2f"),
        )
    ),
)


def tables(report: GravityReport) -> dict[str, Table]:
    """The models, in full and for 80 columns, and what is said of their fits."""
    recorded = tuple(replace(c, exact=True) for c in COLUMNS if c.key in RECORDED)
    errors = (COLUMNS[0], *(c for c in COLUMNS if c.unit == "mm"))
    marked = report.recommended
    return {
        "models": Table(COLUMNS, report.models, bold=marked),
        "short": Table(tuple(c for c in COLUMNS if c.key not in WIDE), report.models, bold=marked),
        "recorded": Table(recorded, report.models, bold=marked),
        "errors": Table(errors, report.models, bold=marked),
        "fits": Table(FITS, report.models),
    }
