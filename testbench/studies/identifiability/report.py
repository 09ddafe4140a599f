"""What the trials say: methods with and without a prior over the workspace, and how often intervals hold."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from testbench.arm.catalogue import find_arm
from testbench.campaign.baselines import JOINTS, distinct, is_least_squares
from testbench.campaign.campaign import build_cell
from testbench.campaign.campaign_row import Runs, dataset_of
from testbench.campaign.perturbed_prior import SCALE, SHAPE
from testbench.data.write import write_csv
from testbench.report.campaigns import TRUE
from testbench.report.columns import columns
from testbench.report.report import Report, lines, say
from testbench.report.table import Row, Trials, find, merged, paired
from testbench.studies.identifiability.coverage import CONFIDENCE
from testbench.studies.identifiability.trial import Settings
from testbench.studies.study import Run
from testbench.trials.spread import span
from testbench.views.colours import look
from testbench.views.figure import Figure, forest, least, of_seeds
from testbench.views.gains import beside
from testbench.views.markdown import Markdown
from testbench.views.schema import Table, best_of, pivot

VARIED = "MGCO56, GCO + prior"
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
    roots = list(seeds[: asked.campaigns])
    covered = [coverage(own) for (name,), own in trials.inside("intervals").groups("name") if name]
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
        gains=_gains(fits["linear"], models),
        gains_nonlinear=_gains(fits["nonlinear"], nonlinear),
        coverage={row.interval: row for row in covered if row.kind != "family"},
        family_coverage={row.interval: row for row in covered if row.kind == "family"},
        best=_best(models),
        best_without_prior=_best([m for m in models if not m.prior]),
        joints=find(models, name=JOINTS),
        joints_nonlinear=find(nonlinear, name=JOINTS),
        worth=[
            Row(
                name=m.name,
                without_mm=m.workspace.rms_mm,
                with_mm=find(models, name=f"{m.name}, GCO + prior").workspace.rms_mm,
            )
            for m in models
            if (m.constraint, m.filling) == ("psd", "none")
        ],
    )


def _dataset(asked: Settings, trials: Trials) -> Row:
    """What was measured in the first seed; runs, points and poses are those that identify."""
    own = Row({name: cells[0] for name, cells in trials.inside("measured").columns.items()})
    counts = {"runs": own.identification_runs, "points": own.identification_points}
    counts |= {"poses": asked.scenario.identification_poses, "workspace_poses": own.workspace_poses}
    names = ("deflection_min_mm", "deflection_max_mm", "sigma_um")
    return Row({name: own[name] for name in names}, **{name: int(own) for name, own in counts.items()})


def _fits(trials: Trials, part: str) -> Trials:
    """Models of one part, as if there were no others."""
    own = trials.where(part=part)
    found = own.inside("fit").add(seed=own["seed"], x=own["x"])
    return found.add(**{name: found[name].astype(int) for name in ("parameters", "rank")})


def _models(fits: Trials) -> list[Row]:
    """Models over all seeds; the paper has no such campaign."""
    return [Row(row, paper=None) for row in merged(fits.drop("seed", "x"), "name")]


def _swept(fits: Trials, key: str) -> list[Row]:
    """RMS over the workspace of every model over a number of poses or a scale."""
    at = fits["x"].astype(int) if key == "poses" else fits["x"]
    return merged(fits.keep("name", TRUE).add(**{key: at}), "name", key)


def _best(models: Sequence[Row]) -> list[str]:
    """The models of least error over the workspace; of those alike one that is by GCO comes first."""
    own = {m.name: m for m in distinct(models)}
    alike = best_of({name: m.workspace.rms_mm for name, m in own.items()}).names
    return sorted(alike, key=lambda name: own[name].constraint != "psd")


def _gains(fits: Trials, models: Sequence[Row]) -> Row:
    """The best of all models beside least squares without a prior and joints alone; None beside itself."""
    ours = _best(models)[0]
    plain = [m for m in models if is_least_squares(m.structure, m.constraint, prior=m.prior)]
    return Row(
        least_squares=paired(fits, ours, _best(plain)[0], TRUE), joints=paired(fits, ours, JOINTS, TRUE)
    )


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
        yield say("Best over the workspace is {best:list}.", f)
    more = ", {it:more seed}" if joints else ""
    yield say(f"Joint stiffness only {{workspace.rms_mm:~.3f}} mm{more}.", f.joints, it=joints)


def _worst(f: Row) -> Markdown:
    """The best model with non-linear truth."""
    ls = f.gains_nonlinear.least_squares
    own = find(f.nonlinear, name=(f.gains_nonlinear.joints or ls).ours)
    rival = ", least squares {ls:~.3f} mm" if ls else ""
    return say(
        f"Worst with non-linear truth: {{name}} {{workspace.rms_mm:~.3f}} mm{rival}, joint stiffness only "
        "{joints:~.3f} mm. At the worst place of the workspace it errs {workspace.max_mm:~.3f} mm, in the "
        "median seed.",
        own,
        ls=ls and ls.theirs_mm,
        joints=f.joints_nonlinear.workspace.rms_mm,
    )


def _claims(f: Row) -> Iterator[Markdown]:
    """What else there is to say, what matters most first."""
    words = "{name} {without_mm:~.3f} mm without, {with_mm:~.3f} mm with it"
    yield say(
        "Without a prior {name} errs least, {workspace.rms_mm:~.3f} mm. A prior's worth to GCO: {each}.",
        find(f.models, name=f.best_without_prior[0]),
        each=Markdown("; ".join(say(words, w) for w in f.worth[:3])),
    )
    own = [row for row in f.scales if row.name == VARIED]
    yield say(
        "The prior's scale is learnt: {name} errs {rms_mm:~.3f} mm with one {least:g} times too soft, "
        "{most_mm:~.3f} mm with one {most:g} times.",
        own[0].workspace,
        name=VARIED,
        least=own[0].scale,
        most=own[-1].scale,
        most_mm=own[-1].workspace.rms_mm,
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
    gains = {"least squares": f.gains.least_squares, "joint stiffness only": f.gains.joints}
    said = beside(gains) or least({m.name: m.workspace.rms_mm for m in distinct(f.models)}, JOINTS)
    prior = say("a prior {scale:g} times too soft, {shape_percent:g} % wrong in shape", f.prior)
    return {
        "identifiability.png": forest(
            table,
            {TRUE: "linear truth", BENT: "MuJoCo's non-linear truth"},
            f"{f.arm}, RMS over the workspace: {said}",
            f"{of_seeds(f.seed)}. Filled: with {prior}. Dotted: joint stiffness only.",
            JOINTS,
        )
    }


def write(run: Run[Settings]) -> None:
    """dataset.csv of the first seed."""
    cell = build_cell(find_arm(run.settings.arm))
    runs = Runs(**{name: cells[0] for name, cells in run.first.inside("runs").columns.items()})
    write_csv(dataset_of(cell, run.settings.scenario, runs), cell.arm, run.folder / "dataset.csv")
