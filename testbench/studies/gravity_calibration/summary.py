"""The report of all seeds: medians and spreads of every model, and which is best where."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

from testbench.bench.baselines import JOINTS, distinct, duels, gain
from testbench.bench.campaign import Truth
from testbench.bench.default import DEFAULT
from testbench.bench.error_places import ErrorPlaces, error_places
from testbench.bench.truths import CALLED, FAMILY
from testbench.identify import Constraint
from testbench.studies.gravity_calibration.gains import Gains, Worst, gains, worst
from testbench.studies.gravity_calibration.trial import NAME, Judged, Measured, ModelRow, Settings
from testbench.studies.paper import SECTION_6
from testbench.studies.study import Trials
from testbench.trials.duel import Duel
from testbench.trials.spread import Number, Share, grouped, merge, middle, spread
from testbench.views.schema import Column, Table, best_of, pivot

PAPERS_ARM = "kr500_l480"
DUELS = (
    (DEFAULT, JOINTS),
    (DEFAULT, f"{JOINTS} + prior"),
    ("MGCO56", JOINTS),
    ("MGCO56", "MLS56"),
    ("MGCO56 + prior", "MLS56 + prior"),
)
"""What the default does beside joints alone, and the cone without a prior and with it."""
ALIKE = 1e-6  #: Relative difference of check errors below which two models predict alike.


@dataclass(frozen=True)
class ModelReport(Judged):
    """A model over all seeds, and the paper's known numbers for it."""

    #: Error over the workspace of the best least squares without prior over its own, seed by seed.
    times_less: Number = None
    paper: Mapping[str, float] | None = None


@dataclass(frozen=True)
class Winner:
    """The best models of one method over the workspace; baselines are no method of their own."""

    constraint: Constraint  #: What the method asks of the blocks.
    prior: bool  #: Whether a prior fills what the data cannot see.
    names: tuple[str, ...]  #: The best; several where nothing tells them apart.
    rms_mm: Number  #: RMS error over the workspace of the first.


@dataclass(frozen=True)
class ByArm:
    """A model with one true arm."""

    name: str  #: Of the model.
    true_arm: str
    seeds: int  #: With this arm.
    workspace_mm: Number  #: RMS error over the workspace, against the truth.


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
    true_arm: str  #: Name of the true arm, "family" for several in turn.
    true_arm_is: str  #: The same in few words.
    template_is_true: Share  #: Whether the beam template holds the true compliances exactly.
    models: list[ModelReport]
    duels: list[Duel]  #: Empty with one seed.
    winners: list[Winner]
    recommended: str
    take: str  #: The default of `identify`; where that is not among the models, what is recommended.
    gains: Gains
    worst: Worst | None  #: None with one true arm, or no model to take.
    by_arm: list[ByArm]  #: Empty with one true arm.
    check_best: tuple[str, ...]  #: Conservative models of least true error at the check poses.
    twins: list[tuple[str, str]]
    map: ErrorPlaces  #: Errors pose by pose over the workspace, in the first seed.


def summary(asked: Settings, seeds: range, trials: Trials[ModelRow]) -> GravityReport:
    """Medians and spreads of every model; with one seed its numbers."""
    found = [row for _, rows in trials for row in rows]
    by_name = grouped(found, lambda row: row.name)
    scenario = asked.scenario
    known = SECTION_6 if scenario.arm == PAPERS_ARM else {}
    models = [_model(rows, known.get(name)) for name, rows in by_name.items()]
    best_of_methods, best = winners(models), recommended(models)
    told = {m.name for m in distinct(models)}
    least = leaders(best_of_methods)
    models = beside(models, by_name, least[0])
    first, take = next(iter(by_name.values())), DEFAULT if DEFAULT in by_name else best
    arms = sorted({row.true_arm for row in first}, key=list(CALLED).index)
    return GravityReport(
        scenario=NAME,
        seed=seeds[0] if len(seeds) == 1 else list(seeds),
        arm=scenario.arm,
        payload_kg=scenario.mass,
        truth=scenario.truth,
        noise=scenario.noise,
        dataset=merge([row.measured for row in first]),
        true_arm=arms[0] if len(arms) == 1 else FAMILY,
        true_arm_is=("in turn " if len(arms) > 1 else "") + ", ".join(CALLED[arm] for arm in arms),
        template_is_true=merge([row.template_is_true for row in first]),
        models=models,
        duels=duels(by_name, [(best, JOINTS), *DUELS]),
        winners=best_of_methods,
        recommended=best,
        take=take,
        gains=gains(by_name, take, best, least),
        worst=worst(by_name, arms, (take, JOINTS, least[0])),
        by_arm=by_arm(by_name, arms),
        check_best=best_of({m.name: m.check_true.rms_mm for m in models if m.conservative is True}).names,
        twins=twins(models),
        map=error_map([row for row in found if row.name in told], compared(by_name, least[0], take)),
    )


def _model(rows: Sequence[ModelRow], paper: Mapping[str, float] | None) -> ModelReport:
    fields = vars(merge([replace(row, places=None, place_mm=None) for row in rows]))
    for key in ("measured", "true_arm", "template_is_true", "places", "place_mm"):
        del fields[key]
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


def compared(names: Collection[str], least_squares: str, take: str) -> list[str]:
    """What every picture shows: the best of least squares, the incumbent, and last what wins in words."""
    return [name for name in dict.fromkeys((least_squares, JOINTS, take)) if name in names]


def error_map(rows: Sequence[ModelRow], names: Sequence[str]) -> ErrorPlaces:
    """Errors of the first seed pose by pose, ordered by those models that are compared."""
    kept = {row.name: (row.places, row.place_mm) for row in rows if row.places and row.place_mm}
    at = next(places for places, _ in kept.values())
    return error_places(at, {name: mm for name, (_, mm) in kept.items()}, names)


def recommended(models: Sequence[ModelReport]) -> str:
    """The conservative model of least error over the workspace; of those alike the one of fewest unknowns.

    Of those again one that is conservative by construction. Empty where none is conservative.
    """
    held = {m.name: m for m in models if m.conservative is True}
    alike = [held[name] for name in best_of({n: m.workspace.rms_mm for n, m in held.items()}).names]
    order = sorted(alike, key=lambda m: (m.parameters, m.constraint != "psd"))
    return order[0].name if order else ""


def leaders(found: Sequence[Winner]) -> tuple[str, str, str]:
    """The best of least squares, of least squares with the prior, and of GCO without; empty for none."""
    names = {(w.constraint, w.prior): w.names[0] for w in found}
    return names.get(("none", False), ""), names.get(("none", True), ""), names.get(("psd", False), "")


def beside(
    models: Sequence[ModelReport], by_name: Mapping[str, Sequence[ModelRow]], least_squares: str
) -> list[ModelReport]:
    """The models, each beside the best least squares without prior."""
    found = {m.name: gain(by_name, m.name, least_squares) for m in models}
    return [replace(m, times_less=g.times) if (g := found[m.name]) else m for m in models]


def by_arm(by_name: Mapping[str, Sequence[ModelRow]], arms: Sequence[str]) -> list[ByArm]:
    """Every model with every true arm; nothing with one arm."""
    return [
        ByArm(name, arm, len(own), spread([middle(row.workspace.rms_mm) for row in own]))
        for name, rows in by_name.items()
        for arm in arms
        if len(arms) > 1 and (own := [row for row in rows if row.true_arm == arm])
    ]


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
    Column("times_less", "times less than LS", form=".2f", short="times\nless\nthan\nLS"),
)
"""The table of section 6; what is not against the readings is against the true deflection."""
SHORT = (
    "name", "parameters", "rank", "conservative",
    "identification.rms_mm", "check.rms_mm", "workspace.rms_mm", "times_less",
)  # fmt: skip
RECORDED = ("name", "conservative", "workspace.rms_mm", "times_less")
DRAWN = ("name", "workspace.rms_mm", "check_true.rms_mm")
"""What a terminal of 80 columns has room for, what a recording says first, and what it draws."""
TRUE_ARM = Column("true_arm", "true arm", called=CALLED)
BY_ARM = Column("workspace_mm", "RMS workspace, true", "mm", exact=True)
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
    best_first = sorted(told, key=lambda m: middle(m.workspace.rms_mm))
    drawn = tuple(next(c for c in COLUMNS if c.key == key) for key in DRAWN)
    marked = report.take
    names = [m.name for m in told]
    arms = Table((), [row for row in report.by_arm if row.name in names], bold=marked)
    return {
        "models": Table(COLUMNS, report.models, bold=marked),
        "short": Table(short, told, bold=marked, headline="workspace.rms_mm"),
        "recorded": Table(recorded, best_first, bold=marked),
        "errors": Table(drawn, told, bold=report.take),
        "fits": Table(FITS, report.models),
        "by_arm": pivot(arms, COLUMNS[0], TRUE_ARM, BY_ARM),
    }
