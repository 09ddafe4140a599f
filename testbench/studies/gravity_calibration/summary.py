"""The report of all seeds: medians and spreads of every model, and which is best where."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from testbench.bench.baselines import JOINTS, distinct, duels
from testbench.bench.campaign import Truth
from testbench.identify import Constraint
from testbench.studies.gravity_calibration.trial import NAME, Judged, Measured, ModelRow, Settings
from testbench.studies.paper import SECTION_6
from testbench.studies.study import Trials
from testbench.trials.duel import Duel
from testbench.trials.spread import Number, grouped, merge, middle
from testbench.views.schema import Column, Table, best_of

PAPERS_ARM = "kr500_l480"
DUELS = (
    ("MGCO56", JOINTS),
    ("MGCO56", "MLS56"),
    ("MGCO56 + prior", "MLS56 + prior"),
    ("MGCO56 + prior", f"{JOINTS} + prior"),
)
"""What the cone does without a prior and with it, and what links do beside joints."""
ALIKE = 1e-6  #: Relative difference of check errors below which two models predict alike.


@dataclass(frozen=True)
class ModelReport(Judged):
    """A model over all seeds, and the paper's known numbers for it."""

    paper: Mapping[str, float] | None = None


@dataclass(frozen=True)
class Winner:
    """The best models of one method over the workspace; baselines are no method of their own."""

    constraint: Constraint  #: What the method asks of the blocks.
    prior: bool  #: Whether a prior fills what the data cannot see.
    names: tuple[str, ...]  #: The best; several where nothing tells them apart.
    rms_mm: Number  #: RMS error over the workspace of the first.


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
    template_is_true: bool  #: Whether the beam template holds the true compliances exactly.
    models: list[ModelReport]
    duels: list[Duel]  #: Empty with one seed.
    winners: list[Winner]
    recommended: str
    check_best: tuple[str, ...]  #: Conservative models of least true error at the check poses.
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
        template_is_true=next(iter(by_name.values()))[0].template_is_true,
        models=models,
        duels=duels(by_name, [(recommended(models), JOINTS), *DUELS]),
        winners=winners(models),
        recommended=recommended(models),
        check_best=best_of({m.name: m.check_true.rms_mm for m in models if m.conservative is True}).names,
        twins=twins(models),
    )


def _model(rows: Sequence[ModelRow], paper: Mapping[str, float] | None) -> ModelReport:
    fields = vars(merge(rows))
    del fields["measured"], fields["template_is_true"]
    solved = sum(row.status == "solved" for row in rows)
    if 0 < solved < len(rows):
        fields["status"] = f"solved in {solved} of {len(rows)} seeds"
    return ModelReport(**fields, paper=paper)


def winners(models: Sequence[ModelReport]) -> list[Winner]:
    """The best of each method over the workspace, the method of least error first."""
    found = []
    paper = [m for m in models if m.structure != JOINTS and m.constraint != "free"]
    for (constraint, prior), own in grouped(paper, lambda m: (m.constraint, m.prior)).items():
        errors = {m.name: m.workspace.rms_mm for m in own}
        names = best_of(errors).names
        found.append(Winner(constraint, prior, names, errors[names[0]]))
    return sorted(found, key=lambda w: middle(w.rms_mm))


def recommended(models: Sequence[ModelReport]) -> str:
    """The conservative model of least error over the workspace; of those alike the one of fewest unknowns.

    Of those again one that is conservative by construction. Empty where none is conservative.
    """
    held = {m.name: m for m in models if m.conservative is True}
    alike = [held[name] for name in best_of({n: m.workspace.rms_mm for n, m in held.items()}).names]
    order = sorted(alike, key=lambda m: (m.parameters, m.constraint != "psd"))
    return order[0].name if order else ""


def twins(models: Sequence[ModelReport]) -> list[tuple[str, str]]:
    """Pairs of models whose check errors are the same."""
    own = distinct(models)
    return [
        (a.name, b.name)
        for k, a in enumerate(own)
        for b in own[k + 1 :]
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
    Column(
        "check.rms_mm", "RMS check, readings", "mm", paper="check_rms_mm", short="RMS\ncheck\nread-\nings\nmm"
    ),
    Column("check_true.rms_mm", "RMS check, true", "mm"),
    Column("check.p95_mm", "95 % check, readings", "mm"),
    Column("check.max_mm", "max check, readings", "mm", paper="check_max_mm"),
    Column("check.max_relative_percent", "max rel.", "%", ".2f", paper="check_max_relative_percent"),
    Column("workspace.rms_mm", "RMS workspace, true", "mm", short="RMS\nwork-\nspace\ntrue\nmm"),
)
"""The table of section 6; what is not against the readings is against the true deflection."""
SHORT = (
    "name", "parameters", "rank", "conservative",
    "identification.rms_mm", "check.rms_mm", "check_true.rms_mm", "workspace.rms_mm",
)  # fmt: skip
RECORDED = ("name", "conservative", "check_true.rms_mm", "workspace.rms_mm")
DRAWN = ("name", "check.rms_mm", "check_true.rms_mm", "workspace.rms_mm")
"""What a terminal of 80 columns has room for, what a recording says first, and what it draws."""
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
    short = tuple(replace(c, paper="") for c in COLUMNS if c.key in SHORT)
    told = distinct(report.models)
    drawn = tuple(c for c in COLUMNS if c.key in DRAWN)
    marked = report.recommended
    return {
        "models": Table(COLUMNS, report.models, bold=marked),
        "short": Table(short, told, bold=marked),
        "recorded": Table(recorded, told, bold=marked),
        "errors": Table(drawn, told, bold=marked),
        "fits": Table(FITS, report.models),
    }
