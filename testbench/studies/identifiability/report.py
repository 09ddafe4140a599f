"""What the trials say: methods with and without a prior over the workspace, and how often intervals hold."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from testbench.arm.catalogue import find_arm
from testbench.bench.baselines import JOINTS, distinct, is_least_squares
from testbench.bench.campaign import build_cell, simulate
from testbench.bench.rows import MM, dataset_row
from testbench.bench.wrong_prior import SCALE, SHAPE
from testbench.data.csvfile import write_csv
from testbench.identify.identifiability import describe
from testbench.identify.prior import Strength, cad_prior
from testbench.model.structure import mgco68
from testbench.report.campaigns import TRUE
from testbench.report.columns import columns
from testbench.report.report import Report, lines, say
from testbench.report.table import Row, Trials, aligned, merged, number, paired
from testbench.studies.identifiability.campaigns import SPOILED, SPOILED_BY
from testbench.studies.identifiability.coverage import CONFIDENCE
from testbench.studies.identifiability.trial import Settings
from testbench.studies.study import Run
from testbench.trials.spread import Number, middle, span, spread, wins
from testbench.views.colours import Look, look
from testbench.views.figure import Figure, forest, least, of_seeds, sweeps
from testbench.views.gains import beside
from testbench.views.identifiability.figure import shares
from testbench.views.identifiability.report import seen_report
from testbench.views.markdown import Markdown, as_markdown, listed
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
CHALLENGER = "MGCO56"  #: Without a prior, against joints alone.
SHOWN = "MGCO56, GCO + prior"
DUELS = ((SHOWN, JOINTS), (CHALLENGER, JOINTS), (CHALLENGER, "MLS56"), (SHOWN, "MGCO56, LS + prior"))
"""Against the incumbent, then what the cone does without a prior and with it."""
NO_WORSE = 1.001  #: Ratio of two errors up to which one is no worse: the solvers' digits.
SEEN_AT = Strength(0.3)  #: How firmly the prior is believed where it is asked what the data see.
BANDS = (JOINTS, "MLS56", CHALLENGER, SHOWN)
"""Models whose spread is drawn as a band: all of them would cover one another."""
SHORT = f"name conservative {TRUE} nonlinear.{TRUE}"
MODELS = (
    "name parameters rank conservative uncertainty_percent check.rms_mm check_true.rms_mm "
    f"{TRUE} workspace.max_mm"
)
PAIRS = "ours theirs seeds wins ties ratio check_wins"
COVERAGE = "interval datasets covered_percent standard_error_percent width_um unbounded_percent"
SWEPT = {"poses": "poses", "scales": "scale"}
"""Keys of report.json by what they hold over what is swept."""
OF_MODELS = Markdown(
    "The prior is the arm's CAD model, distorted. The scale of every block, and how firmly it is believed, "
    "are learnt from the readings. LS and GCO see the same prior. Check errors are against readings, noise "
    "included, and against the truth."
)
OF_CHOICE = Markdown(
    "The rule takes the simplest model within one standard error of the least F_M on poses held out. How "
    "firmly a prior is believed is learnt from all readings, those held out among them."
)
OF_COVERAGE = Markdown(
    "The truth is linear where nothing else is said. With a prior of 10 % the truth of every dataset is "
    "drawn from it; the cone hardly binds there. Set-based bounds hold for all deflections at once, and for "
    "every conservative model up to ten times the prior: they are wide.\n\n"
    "Learnt, believed: all links and joints by GCO, another true arm of the family, other poses and another "
    "wrong prior in every dataset. Learnt: the readings say how wrong the prior is, and intervals have "
    "Student tails, as `identify` does by default. Believed: the same prior, uncertain by 30 % whatever the "
    "readings say, and normal intervals. Both count what a linear model leaves out."
)


def report(asked: Settings, seeds: range, trials: Trials) -> Report:
    """Medians and spreads of all campaigns, shares of all datasets."""
    fits = {part: _fits(trials, part) for part in trials.values("part") if part}
    models, nonlinear = (_models(fits[part]) for part in ("linear", "nonlinear"))
    roots, covered = list(seeds[: asked.campaigns]), [*_covered(trials)]
    f = Row(
        seed=roots[0] if len(roots) == 1 else roots,
        arm=asked.scenario.arm,
        payload_kg=asked.scenario.mass,
        noise=asked.scenario.noise,
        truth="linear",
        prior=Row(scale=SCALE, shape_percent=100 * SHAPE),
        **_first_campaign(asked, seeds[0]),
        models=models,
        nonlinear=nonlinear,
        scales=_swept(fits["scale"], "scale"),
        fixed_scale=Row({row.name: row.workspace.rms_mm for row in _models(fits["fixed scale"])}),
        poses=_swept(fits["poses"], "poses"),
        duels=_duels(fits["linear"]),
        duels_nonlinear=_duels(fits["nonlinear"]),
        gains=_gains(fits["linear"], models),
        gains_nonlinear=_gains(fits["nonlinear"], nonlinear),
        beaten=[_beaten(int(x), own) for (x,), own in fits["poses"].groups("x")],
        choice=_choice(fits["choice"]),
        outliers=_outliers(fits),
        never_worse=_never_worse(fits["linear"]),
        coverage={row.interval: row for row in covered if row.kind != "family"},
        family_coverage={row.interval: row for row in covered if row.kind == "family"},
        best=_leaders(models),
        best_without_prior=_leaders([m for m in models if not m.prior]),
        best_nonlinear=_leaders(nonlinear),
        best_nonlinear_without_prior=_leaders([m for m in nonlinear if not m.prior]),
        joints=_named(models, JOINTS),
        joints_nonlinear=_named(nonlinear, JOINTS),
        worth=_worth(models),
    )
    return Report(
        scenario="identifiability",
        question=say("{arm}: what do poses not see, and what is a CAD prior worth?", f),
        title=_title(f),
        answer=lines(_answer(f)),
        worst=_worst(f),
        claims=list(_claims(f)),
        numbers=f,
        tables=_tables(f),
        body=[
            *("models", OF_MODELS, "nonlinear", "duels", "duels_nonlinear", "poses", "scales"),
            *("choice", OF_CHOICE, "coverage", OF_COVERAGE),
            say("## What the data of the first seed see of {structure}", vars(f.seen)),
            Markdown("\n".join(f"- {as_markdown(sentence)}" for sentence in f.seen.sentences)),
        ],
    )


def _fits(trials: Trials, part: str) -> Trials:
    """Models of one part, as if there were no others."""
    own = trials.where(part=part).drop("part", "intervals.")
    found = Trials({name.removeprefix("fit."): cells for name, cells in own.columns.items()})
    return found.add(**{name: found[name].astype(int) for name in ("parameters", "rank")})


def _models(fits: Trials) -> list[Row]:
    """Models over all seeds; the paper has no such campaign."""
    own = fits.drop("seed", "x", "f_m_held_out", "is_recommended", "spoiled", "rejected")
    return [Row(row, paper=None) for row in merged(own, "name")]


def _named(models: Sequence[Row], name: str) -> Row:
    return next(m for m in models if m.name == name)


def _first_campaign(asked: Settings, seed: int) -> Row:
    """What the runs of the first seed see of MGCO68, and their sizes; deflections of all measured runs."""
    cell, scenario = build_cell(find_arm(asked.arm)), asked.scenario
    campaign = simulate(cell, scenario, seed)
    runs = campaign.identification
    dataset = Row(
        vars(dataset_row(campaign.measured)),
        runs=runs.runs,
        points=runs.points,
        poses=scenario.identification_poses,
        workspace_poses=scenario.workspace_poses,
    )
    seen = describe(cell.vjm, mgco68(cell.arm), runs, cad_prior(cell.arm), SEEN_AT)
    return Row(dataset=dataset, seen=seen_report(seen))


def _swept(fits: Trials, key: str) -> list[Row]:
    """RMS over the workspace of every model over a number of poses or a scale."""
    at = fits["x"].astype(int) if key == "poses" else fits["x"]
    return merged(fits.keep("name", TRUE).add(**{key: at}), "name", key)


def _duels(fits: Trials) -> list[Row]:
    """Pairs of models by true errors, seed by seed; none in a single seed."""
    found = []
    for ours, theirs in DUELS:
        a, b = aligned(fits, (ours, theirs), TRUE).T
        found.append(
            Row(
                ours=ours,
                theirs=theirs,
                seeds=len(a),
                wins=wins(a, b),
                ties=len(a) - wins(a, b) - wins(b, a),
                ratio=spread(a / b),
                check_wins=wins(*aligned(fits, (ours, theirs), "check_true.rms_mm").T),
            )
        )
    return [row for row in found if row.seeds > 1]


def _gains(fits: Trials, models: Sequence[Row]) -> Row:
    """The best of all models beside least squares without a prior and joints alone; None beside itself.

    Of those alike one that is by GCO.
    """
    own = {m.name: m for m in distinct(models)}
    best = best_of({name: m.workspace.rms_mm for name, m in own.items()}).names
    ours = sorted(best, key=lambda name: own[name].constraint != "psd")[0]
    plain = {
        name: m.workspace.rms_mm
        for name, m in own.items()
        if is_least_squares(m.structure, m.constraint, prior=m.prior)
    }
    rivals = {"least_squares": best_of(plain).names[0], "joints": JOINTS}
    return Row({name: paired(fits, ours, theirs, TRUE) for name, theirs in rivals.items()})


def _beaten(poses: int, fits: Trials) -> Row:
    """In how many seeds GCO without a prior beats joints alone over the workspace, with so many poses."""
    both = aligned(fits, (CHALLENGER, JOINTS), TRUE)
    return Row(poses=poses, wins=wins(*both.T), seeds=len(both))


def _choice(fits: Trials) -> Row:
    """What cross-validation over poses recommends, by structure; errors are those over the workspace."""
    rows = merged(fits.keep("name", "is_recommended", "f_m_held_out", TRUE), "name")
    most = max(row.is_recommended for row in rows)
    return Row(
        rows=rows,
        recommended=[row.name for row in rows if row.is_recommended == most],
        chosen_workspace_mm=number(fits.where(is_recommended=True)[TRUE]),
        best_workspace_mm=number(aligned(fits, fits.values("name"), TRUE).min(axis=1)),
    )


def _outliers(fits: dict[str, Trials]) -> Row:
    """How many readings are wild, and errors over the workspace without them and by either loss."""
    counts = fits["robust"]
    return Row(
        spoiled_percent=100 * SPOILED,
        off_by_mm=MM * SPOILED_BY,
        spoiled=number(counts["spoiled"]),
        rejected=number(counts["rejected"]),
        **{f"{part}_mm": number(fits[part][TRUE]) for part in ("clean", "plain", "robust")},
    )


def _never_worse(fits: Trials) -> Row:
    """Seed by seed: error of GCO over that of least squares with the same prior, believed as firmly."""
    known, found = fits.pick(np.isfinite(fits["gco_over_ls_at_this_strength"])), Row()
    for (name,), own in known.groups("structure"):
        ratio = own["gco_over_ls_at_this_strength"]
        worse = int((ratio > NO_WORSE).sum())
        found[name] = Row(
            worst_ratio=ratio.max(), best_ratio=ratio.min(), seeds_worse=worse, seeds=len(ratio)
        )
    return found


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
    error = by_dataset.std(ddof=1) / np.sqrt(len(own)) if len(own) > 1 else None
    return Row(
        interval=own["name"][0],
        kind=own["kind"][0],
        confidence=CONFIDENCE,
        covered_percent=100 * inside.mean(),
        standard_error_percent=None if error is None else 100 * error,
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
    """GCO's error over the workspace without a prior, with it, and with the least trace in its metric."""
    errors = {(m.filling, m.structure): m.workspace.rms_mm for m in models if m.constraint == "psd"}
    keys = {"without_mm": "none", "with_mm": "prior", "trace_mm": "least trace"}
    found = [
        Row({key: errors[filling, name] for key, filling in keys.items()}, name=name)
        for filling, name in errors
        if filling == "none" and ("prior", name) in errors
    ]
    return [Row(row, times=middle(row.without_mm) / middle(row.with_mm)) for row in found]


def _tables(f: Row) -> dict[str, Table]:
    """Methods, pairs, poses, scales, the choice of a structure, coverage."""
    told = {m.name for m in (*distinct(f.models), *distinct(f.nonlinear))}
    both = [Row(a, nonlinear=b) for a, b in zip(f.models, f.nonlinear, strict=True) if a.name in told]
    of_pairs, covered = columns(PAIRS), [*f.coverage.values(), *f.family_coverage.values()]
    return {
        "models": Table(columns(MODELS), f.models, looks=_looks(f.models)),
        "nonlinear": Table(columns(MODELS), f.nonlinear, "non-linear truth", looks=_looks(f.nonlinear)),
        "short": Table(columns(SHORT), both, looks=_looks(both)),
        "duels": Table(of_pairs, f.duels, "seed by seed, by true errors"),
        "duels_nonlinear": Table(of_pairs, f.duels_nonlinear, "seed by seed, with non-linear truth"),
        "poses": _over(f, "poses", "RMS over the workspace by number of poses, mm"),
        "scales": _over(f, "scales", "RMS over the workspace by scale of the prior, mm"),
        "choice": Table(
            columns(f"name is_recommended f_m_held_out {TRUE}"),
            f.choice.rows,
            "choice of the structure by cross-validation over poses, with the prior",
        ),
        "coverage": Table(columns(COVERAGE), covered, "coverage of 95 % intervals of predicted deflections"),
    }


def _looks(models: Sequence[Row]) -> dict[str, Look]:
    return {m.name: look(m.structure, m.constraint, m.prior, m.filling) for m in models}


def _over(f: Row, swept: str, title: str) -> Table:
    """A row a model, a column a number of poses or a scale of the prior."""
    name, x, rms = columns(f"name {SWEPT[swept]} {TRUE}")
    return replace(pivot(Table((), f[swept], title), name, x, rms), looks=_looks(f.models))


def _title(f: Row) -> Markdown:
    """What was measured."""
    seeds = (
        f"{len(f.seed)} seeds: median ({span(len(f.seed))})" if isinstance(f.seed, list) else f"seed {f.seed}"
    )
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
    own = _named(f.nonlinear, (f.gains_nonlinear.joints or ls).ours)
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
    without = f.best_without_prior
    yield say(
        "Without a prior the least error is that of {who}: {rms_mm:~.3f} mm.", without, who=without.methods[0]
    )
    if f.worth:
        words = "{name} {without_mm:~.3f} mm without, {with_mm:~.3f} mm with it"
        yield say("What a prior is worth to GCO: {each}.", each="; ".join(say(words, w) for w in f.worth[:3]))
    ratios = [*f.never_worse.values()]
    yield say(
        "With the same prior, believed as firmly, GCO errs {low:.3f} to {high:.3f} times least squares, more "
        "in {worse} of {n} fits.",
        low=min(r.best_ratio for r in ratios),
        high=max(r.worst_ratio for r in ratios),
        worse=sum(r.seeds_worse for r in ratios),
        n=sum(r.seeds for r in ratios),
    )
    yield say(
        "Cross-validation over poses recommends {recommended:list}, which errs {chosen_workspace_mm:~.3f} "
        "mm; the best in hindsight {best_workspace_mm:~.3f} mm.",
        f.choice,
    )
    exact, sets = ([r for r in f.coverage.values() if (r.kind == "set") == bound] for bound in (False, True))
    yield say("Intervals of 95 % hold the true deflection in {held} of the cases.", held=_held(exact))
    yield say(
        "With non-linear truth the best is {best}; without a prior {plain}; joints alone {rms:.3f} mm.",
        best=_who(f.best_nonlinear),
        plain=_who(f.best_nonlinear_without_prior),
        rms=f.joints_nonlinear.workspace.rms_mm,
    )
    yield from _of_models(f)
    if sets:
        yield say(
            "Set-based bounds hold the true deflection in at least {least:.1f} %.",
            least=min(r.covered_percent for r in sets),
        )
    learnt, believed = (
        [r for r in f.family_coverage.values() if r.interval.endswith(how)]
        for how in (": learnt", ": believed")
    )
    yield say(
        "On the family of true arms, a learnt prior with Student tails, the default of `identify`, holds it "
        "in {learnt}; a prior believed to 30 % with normal intervals in {believed}.",
        learnt=_held(learnt),
        believed=_held(believed),
    )


def _held(rows: Sequence[Row]) -> Markdown:
    shares = [row.covered_percent for row in rows]
    return say("{low:.1f} to {high:.1f} %", low=min(shares), high=max(shares))


def _of_models(f: Row) -> Iterator[Markdown]:
    """What no table says of models."""
    if f.beaten[0].seeds > 1:
        yield say(
            "With {poses} poses MGCO56 without a prior beats Joints in {wins} of {seeds} seeds.",
            f.beaten[0],
            poses=", ".join(f"{row.poses}" for row in f.beaten),
            wins=", ".join(f"{row.wins}" for row in f.beaten),
        )
    for m in f.models:
        if m.constraint == "free":
            some = say("{conservative:yes} of the seeds", m)
            where = {True: "every seed", False: "no seed"}.get(m.conservative, some)
            yield say(
                "A conservative model of {structure} that fits as well exists in {where}.", m, where=where
            )
    broken = [m.name for m in f.models if m.conservative is not True and m.constraint != "free"]
    if broken:
        yield say("Not conservative in every seed: {names}.", names="; ".join(broken))
    yield say(
        "With the scale of a prior {scale:g} times too soft believed, MGCO56 errs by {mm:.3f} mm.",
        f.prior,
        mm=f.fixed_scale.MGCO56,
    )
    yield say(
        "{spoiled_percent:g} % of the readings off by {off_by_mm:g} mm: MGCO68 errs by {plain_mm:.3f} mm "
        "with the plain loss, {robust_mm:.3f} mm with the robust one; without outliers by {clean_mm:.3f} mm.",
        f.outliers,
    )


def figures(found: Report) -> dict[str, Figure]:
    """Every method with its spread; the prior's models over poses and over its scale; who decides what."""
    f = Row(found.numbers)
    models = distinct(f.models)
    gains = {"least squares": f.gains.least_squares, "joints alone": f.gains.joints}
    said = beside(gains) or least({m.name: m.workspace.rms_mm for m in models}, JOINTS)
    prior = say("a prior {scale:g} times too soft, {shape_percent:g} % wrong in shape", f.prior)
    where = f"{f.arm}, {f.dataset.poses} poses"
    return {
        "identifiability.png": forest(
            Table(columns(f"name {TRUE}"), models, looks=_looks(models)),
            {TRUE: f"{f.dataset.poses} poses"},
            f"{where}, RMS over the workspace: {said}",
            f"{of_seeds(f.seed)}. Filled: with {prior}. Dotted: joints alone.",
            JOINTS,
        ),
        "poses.png": _drawn(f, "poses", f"Filled and dashed: with {prior}."),
        "prior_scale.png": _drawn(f, "scales", "By GCO: least squares with a prior lies below it."),
        "shares.png": shares(f.seen),
    }


def _drawn(f: Row, swept: str, reading: str) -> Figure:
    """Error of models over what is swept; spreads of some as bands."""
    drawn = {m.name for m in distinct(f.models) if swept == "poses" or m.constraint == "psd"}
    rows = [row for row in f[swept] if row.name in drawn]
    bands = [
        row if row.name in BANDS else Row(row, workspace=Row(rms_mm=middle(row.workspace.rms_mm)))
        for row in rows
    ]
    name, x, rms = columns(f"name {SWEPT[swept]} {TRUE}")
    own = [row for row in rows if row.name == SHOWN]
    said = ", ".join(f"{rms.text(middle(rms.value(row)))} mm at {x.cell(row)}" for row in (own[0], own[-1]))
    return sweeps(
        {"": Table((name, x, rms), bands, looks=_looks(f.models))},
        f"{SHOWN}: {said} {'poses' if swept == 'poses' else 'times softer than the truth'}",
        f"{of_seeds(f.seed)}. Bands: the same of some. {reading}",
    )


def write(run: Run[Settings]) -> None:
    """dataset.csv of the first seed."""
    cell = build_cell(find_arm(run.settings.arm))
    campaign = simulate(cell, run.settings.scenario, run.seeds[0])
    write_csv(campaign.measured, cell.arm, run.folder / "dataset.csv")
