"""What the trials say: methods with and without a prior over the workspace, and how often intervals hold."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from testbench.arm.catalogue import find_arm
from testbench.bench.baselines import JOINTS, distinct, is_least_squares
from testbench.bench.campaign import build_cell
from testbench.bench.campaign_row import Runs, dataset_of
from testbench.bench.wrong_prior import SCALE, SHAPE
from testbench.data.csvfile import write_csv
from testbench.report.campaigns import TRUE
from testbench.report.columns import columns
from testbench.report.report import Report, lines, say
from testbench.report.table import Row, Trials, aligned, find, merged, nested, paired
from testbench.studies.identifiability.coverage import CONFIDENCE
from testbench.studies.identifiability.trial import Settings
from testbench.studies.study import Run
from testbench.trials.spread import Number, span, spread, wins
from testbench.views.colours import look
from testbench.views.figure import Figure, forest, least, of_seeds
from testbench.views.gains import beside
from testbench.views.markdown import Markdown, listed
from testbench.views.schema import Table, best_of, pivot

METHODS = {
    ("none", "none"): "least squares",
    ("free", "none"): "conservative least squares of equal fit",
    ("none", "prior"): "least squares with prior",
    ("psd", "none"): "GCO",
    ("psd", "least trace"): "GCO of least trace",
    ("psd", "prior"): "GCO with prior",
    ("psd", "log-det prior"): "GCO with log-det prior",
}
"""In words, by constraint and what fills the directions that the data do not see."""
SHOWN = "MGCO56, GCO + prior"
DUELS = ((SHOWN, JOINTS), ("MGCO56", JOINTS), ("MGCO56", "MLS56"), (SHOWN, "MGCO56, LS + prior"))
"""Against the incumbent, then what the cone does without a prior and with it."""
BENT = f"nonlinear.{TRUE}"
SHORT = f"name conservative {TRUE} {BENT}"
MODELS = f"name parameters rank conservative uncertainty_percent check.rms_mm check_true.rms_mm {TRUE} {BENT}"
COVERAGE = "interval datasets covered_percent standard_error_percent width_um unbounded_percent"
READING = Markdown(
    "The prior is the arm's CAD model, distorted. The scale of every block, and how firmly it is believed, "
    "are learnt from the readings. LS and GCO see the same prior. Check errors are against readings, noise "
    "included, and against the truth."
)
OF_COVERAGE = Markdown(
    "The truth is linear where nothing else is said. With a prior of 10 % the truth of every dataset is "
    "drawn from it. Set-based bounds hold for all deflections at once, and for every conservative model up "
    "to ten times the prior: they are wide. Learnt, believed: all links and joints by GCO, another true arm "
    "of the family, other poses and another wrong prior in every dataset. Learnt: the readings say how wrong "
    "the prior is, and intervals have Student tails, as `identify` does by default. Believed: the same "
    "prior, uncertain by 30 % whatever the readings say, and normal intervals."
)


def report(asked: Settings, seeds: range, trials: Trials) -> Report:
    """Medians and spreads of all campaigns, shares of all datasets."""
    f = _numbers(asked, seeds, trials)
    return Report(
        scenario="identifiability",
        question=say("{arm}: what do poses not see, and what is a CAD prior worth?", f),
        title=_title(f),
        answer=lines(_answer(f)),
        worst=_worst(f),
        claims=list(_claims(f)),
        numbers=f,
        tables=_tables(f),
        body=["models", READING, "poses", "coverage", OF_COVERAGE],
    )


def _numbers(asked: Settings, seeds: range, trials: Trials) -> Row:
    fits = {part: _fits(trials, part) for part in ("linear", "nonlinear", "scale", "poses")}
    models, nonlinear = (_models(fits[part]) for part in ("linear", "nonlinear"))
    roots, covered = list(seeds[: asked.campaigns]), [*_covered(trials)]
    return Row(
        seed=roots[0] if len(roots) == 1 else roots,
        arm=asked.scenario.arm,
        payload_kg=asked.scenario.mass,
        noise=asked.scenario.noise,
        truth="linear",
        prior=Row(scale=SCALE, shape_percent=100 * SHAPE),
        dataset=_dataset(asked, trials),
        models=models,
        nonlinear=nonlinear,
        scales=_swept(fits["scale"], "scale"),
        poses=_swept(fits["poses"], "poses"),
        duels=_duels(fits["linear"]),
        duels_nonlinear=_duels(fits["nonlinear"]),
        gains=_gains(fits["linear"], models),
        gains_nonlinear=_gains(fits["nonlinear"], nonlinear),
        beaten=[_beaten(int(x), own) for (x,), own in fits["poses"].groups("x")],
        coverage={row.interval: row for row in covered if row.kind != "family"},
        family_coverage={row.interval: row for row in covered if row.kind == "family"},
        best=_leaders(models),
        best_without_prior=_leaders([m for m in models if not m.prior]),
        best_nonlinear=_leaders(nonlinear),
        joints=find(models, name=JOINTS),
        joints_nonlinear=find(nonlinear, name=JOINTS),
        worth=_worth(models),
    )


def _dataset(asked: Settings, trials: Trials) -> Row:
    """What was measured in the first seed; runs, points and poses are those that identify."""
    own = nested({name: cells[0] for name, cells in trials.keep("measured.").columns.items()}).measured
    counts = {"runs": own.identification_runs, "points": own.identification_points}
    counts |= {"poses": asked.scenario.identification_poses, "workspace_poses": own.workspace_poses}
    names = ("deflection_min_mm", "deflection_max_mm", "sigma_um")
    return Row({name: own[name] for name in names}, **{name: int(own) for name, own in counts.items()})


def _fits(trials: Trials, part: str) -> Trials:
    """Models of one part, as if there were no others."""
    own = trials.where(part=part).drop("part", "intervals.", "measured.", "runs.")
    found = Trials({name.removeprefix("fit."): cells for name, cells in own.columns.items()})
    return found.add(**{name: found[name].astype(int) for name in ("parameters", "rank")})


def _models(fits: Trials) -> list[Row]:
    """Models over all seeds; the paper has no such campaign."""
    return [Row(row, paper=None) for row in merged(fits.drop("seed", "x"), "name")]


def _swept(fits: Trials, key: str) -> list[Row]:
    """RMS over the workspace of every model over a number of poses or a scale."""
    at = fits["x"].astype(int) if key == "poses" else fits["x"]
    return merged(fits.keep("name", TRUE).add(**{key: at}), "name", key)


def _duels(fits: Trials) -> list[Row]:
    """Pairs of models by true errors, seed by seed; none in a single seed."""
    found = []
    for ours, theirs in DUELS:
        a, b = aligned(fits, (ours, theirs), TRUE).T
        pair = Row(ours=ours, theirs=theirs, seeds=len(a), wins=wins(a, b))
        found.append(Row(pair, ties=len(a) - wins(a, b) - wins(b, a), ratio=spread(a / b)))
    return [row for row in found if row.seeds > 1]


def _gains(fits: Trials, models: Sequence[Row]) -> Row:
    """The best of all models beside least squares without a prior and joints alone; None beside itself.

    Of those alike one that is by GCO.
    """
    own = {m.name: m for m in distinct(models)}
    best = best_of({name: m.workspace.rms_mm for name, m in own.items()}).names
    ours = sorted(best, key=lambda name: own[name].constraint != "psd")[0]
    plain = [m for m in own.values() if is_least_squares(m.structure, m.constraint, prior=m.prior)]
    theirs = best_of({m.name: m.workspace.rms_mm for m in plain}).names[0]
    return Row(least_squares=paired(fits, ours, theirs, TRUE), joints=paired(fits, ours, JOINTS, TRUE))


def _beaten(poses: int, fits: Trials) -> Row:
    """In how many seeds GCO without a prior beats joints alone over the workspace, with so many poses."""
    both = aligned(fits, ("MGCO56", JOINTS), TRUE)
    return Row(poses=poses, wins=wins(*both.T), seeds=len(both))


def _covered(trials: Trials) -> Iterator[Row]:
    """Every kind of interval."""
    own = trials.keep("intervals.")
    every = Trials({name.removeprefix("intervals."): cells for name, cells in own.columns.items()})
    yield from (coverage(one) for (name,), one in every.groups("name") if name)


def coverage(own: Trials) -> Row:
    """Shares of intervals of one kind that hold the truth: of all, with its error over datasets.

    `all_covered` is the share of datasets in which every interval does; the width is that of finite ones.
    """
    inside, width = (np.array([*own[name]]) for name in ("inside", "width_um"))
    by_dataset, finite = inside.mean(axis=1), np.isfinite(width)
    error = 100 * by_dataset.std(ddof=1) / np.sqrt(len(own)) if len(own) > 1 else None
    return Row(
        interval=own["name"][0],
        kind=own["kind"][0],
        confidence=CONFIDENCE,
        covered_percent=100 * inside.mean(),
        standard_error_percent=error,
        all_covered=(by_dataset == 1).mean(),
        width_um=width[finite].mean() if finite.any() else None,
        unbounded_percent=100 * (1 - finite.mean()),
        datasets=len(own),
        intervals=inside.size,
    )


def _leaders(models: Sequence[Row]) -> Row:
    """Methods of least error over the workspace, each with its best structures; several are alike."""
    methods: dict[tuple[str, str], dict[str, Number]] = {}
    for m in distinct(models):
        methods.setdefault((m.constraint, m.filling), {})[m.structure] = m.workspace.rms_mm
    found = {}
    for method, errors in methods.items():
        names = best_of(errors).names
        found[f"{METHODS[method]} ({listed([*names])})"] = errors[names[0]]
    best = best_of(found).names
    return Row(methods=best, rms_mm=found[best[0]])


def _worth(models: Sequence[Row]) -> list[Row]:
    """GCO's error over the workspace without a prior and with it."""
    errors = {(m.filling, m.structure): m.workspace.rms_mm for m in models if m.constraint == "psd"}
    return [
        Row(name=name, without_mm=errors[filling, name], with_mm=errors["prior", name])
        for filling, name in errors
        if filling == "none" and ("prior", name) in errors
    ]


def _tables(f: Row) -> dict[str, Table]:
    """Models under both truths, the number of poses, coverage."""
    looks = {m.name: look(m.structure, m.constraint, m.prior, m.filling) for m in f.models}
    both = [Row(a, nonlinear=b) for a, b in zip(f.models, f.nonlinear, strict=True)]
    told = {m.name for m in (*distinct(f.models), *distinct(f.nonlinear))}
    name, x, rms = columns(f"name poses {TRUE}")
    poses = Table((), f.poses, "RMS over the workspace by number of poses, mm")
    covered = [*f.coverage.values(), *f.family_coverage.values()]
    return {
        "short": Table(columns(SHORT), [m for m in both if m.name in told], headline=TRUE, looks=looks),
        "models": Table(columns(MODELS), both, looks=looks),
        "poses": replace(pivot(poses, name, x, rms), looks=looks),
        "coverage": Table(columns(COVERAGE), covered, "coverage of 95 % intervals of predicted deflections"),
    }


def _title(f: Row) -> Markdown:
    """What was measured."""
    several = isinstance(f.seed, list)
    seeds = f"{len(f.seed)} seeds: median ({span(len(f.seed))})" if several else f"seed {f.seed}"
    return say(
        "{arm} under {payload_kg:g} kg: {dataset.runs} runs in {dataset.poses} poses, sigma "
        "{dataset.sigma_um:g} um. The prior is {prior.scale:g} times too soft and {prior.shape_percent:g} % "
        "wrong in shape. Errors are RMS, against the truth in {dataset.workspace_poses} poses never "
        f"measured; {seeds}",
        f,
    )


def _answer(f: Row) -> Iterator[Markdown]:
    """What the best model gains beside least squares, or that this is the best, and beside joints alone."""
    ls, joints = f.gains.least_squares, f.gains.joints
    if ls:
        yield say(
            "RMS workspace error: {ours} {ours_mm:~.3f} mm, least squares {theirs_mm:~.3f} mm; "
            "{it:less seed}.",
            vars(ls),
            it=ls,
        )
    else:
        yield say("Best over the workspace is {best}.", best=_who(f.best))
    more = ", {it:more seed}" if joints else ""
    yield say(f"Joints alone {{workspace.rms_mm:~.3f}} mm{more}.", f.joints, it=joints)


def _who(best: Row) -> Markdown:
    """Who is best, and how far off."""
    alike = " (alike)" if len(best.methods) > 1 else ""
    return say(f"{{methods:list}}{alike}, {{rms_mm:.3f}} mm", best | {"methods": [*best.methods]})


def _worst(f: Row) -> Markdown:
    """The best model with non-linear truth."""
    ls = f.gains_nonlinear.least_squares
    own = find(f.nonlinear, name=(f.gains_nonlinear.joints or ls).ours)
    rival = ", least squares {ls:~.3f} mm" if ls else ""
    return say(
        f"Worst with non-linear truth: {{name}} {{workspace.rms_mm:~.3f}} mm{rival}, joints alone "
        "{joints:~.3f} mm. At the worst place of the workspace it errs {workspace.max_mm:~.3f} mm, in the "
        "median seed.",
        own,
        ls=ls and ls.theirs_mm,
        joints=f.joints_nonlinear.workspace.rms_mm,
    )


def _claims(f: Row) -> Iterator[Markdown]:
    """What else there is to say, what matters most first."""
    without, words = f.best_without_prior, "{name} {without_mm:~.3f} mm without, {with_mm:~.3f} mm with it"
    yield say(
        "Without a prior the least error is that of {who}: {rms_mm:~.3f} mm. What a prior is worth to GCO: "
        "{each}.",
        without,
        who=without.methods[0],
        each=Markdown("; ".join(say(words, w) for w in f.worth[:3])),
    )
    if f.beaten[0].seeds > 1:
        yield say(
            "With {poses} poses MGCO56 without a prior beats Joints in {wins} of {seeds} seeds.",
            f.beaten[0],
            poses=", ".join(f"{row.poses}" for row in f.beaten),
            wins=", ".join(f"{row.wins}" for row in f.beaten),
        )
    exact = [row for row in f.coverage.values() if row.kind != "set"]
    learnt, believed = (
        [r for r in f.family_coverage.values() if r.interval.endswith(how)] for how in ("learnt", "believed")
    )
    yield say(
        "Intervals of 95 % hold the true deflection in {held} of the cases. On the family of true arms they "
        "do in {learnt} with a learnt prior, in {believed} with one believed.",
        held=_held(exact),
        learnt=_held(learnt),
        believed=_held(believed),
    )


def _held(rows: Sequence[Row]) -> Markdown:
    shares = [row.covered_percent for row in rows]
    return say("{low:.1f} to {high:.1f} %", low=min(shares), high=max(shares))


def figures(found: Report) -> dict[str, Figure]:
    """Every method with its spread, under both truths."""
    f, table = Row(found.numbers), found.tables["short"]
    gains = {"least squares": f.gains.least_squares, "joints alone": f.gains.joints}
    said = beside(gains) or least({m.name: m.workspace.rms_mm for m in distinct(f.models)}, JOINTS)
    prior = say("a prior {scale:g} times too soft, {shape_percent:g} % wrong in shape", f.prior)
    return {
        "identifiability.png": forest(
            table,
            {TRUE: "linear truth", BENT: "MuJoCo's non-linear truth"},
            f"{f.arm}, RMS over the workspace: {said}",
            f"{of_seeds(f.seed)}. Filled: with {prior}. Dotted: joints alone.",
            JOINTS,
        )
    }


def write(run: Run[Settings]) -> None:
    """dataset.csv of the first seed."""
    cell = build_cell(find_arm(run.settings.arm))
    row = nested({name: cells[0] for name, cells in run.first.keep("runs.").columns.items()}).runs
    write_csv(dataset_of(cell, run.settings.scenario, Runs(**row)), cell.arm, run.folder / "dataset.csv")
