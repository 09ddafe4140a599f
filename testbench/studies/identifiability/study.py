"""What the data cannot see, what a prior is worth, and how often intervals hold."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from testbench.arm.folder import find_arm
from testbench.campaign.models import JOINTS
from testbench.campaign.perturbed_prior import SCALE, SHAPE
from testbench.report.badge import of_models
from testbench.report.campaigns import distinct
from testbench.report.columns import columns
from testbench.report.report import Report, lines, say
from testbench.report.table import Row, Trials, find
from testbench.studies.factorial import compare
from testbench.studies.factorial.compare import RMS
from testbench.studies.identifiability import trial
from testbench.studies.identifiability.coverage import CONFIDENCE
from testbench.studies.identifiability.trial import Options, Settings, TrialRow
from testbench.studies.study import Study
from testbench.trials.spread import span
from testbench.views.colours import look
from testbench.views.figure import Figure, forest
from testbench.views.markdown import Markdown, counted
from testbench.views.schema import Table, best_of

VARIED = {"structure": "MGCO56", "constraint": "psd", "filling": "prior"}
"""Whose error by the prior's scale is said."""
BENT = replace(RMS, key="nonlinear.rms_um", heading="non-linear truth", short="non-linear\num")
ALSO = ("filling", "parameters", "rank", "uncertainty_percent")
COVERAGE = "interval datasets covered_percent standard_error_percent width_um unbounded_percent"
READING = Markdown(
    "The prior is the arm's CAD model, distorted. The scale of every block, and how firmly it is believed, "
    "are learnt from the readings. LS and GCO see the same prior."
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
    f, linear, worst = _numbers(asked, seeds, trials)
    return Report(
        scenario=STUDY.name,
        question=say("{arm}: what do poses not see, and what is a CAD prior worth?", f),
        title=say(
            "{arm} under {payload_kg:g} kg: {it.identification_runs} runs in {it.identification_poses} "
            "poses, sigma {dataset.sigma_um:g} um, {n}. The prior is {prior.scale:g} times too soft and "
            "{prior.shape_percent:g} % wrong in shape. RMS errors in {it.workspace_poses} poses never "
            "measured: medians ({ends}).",
            f,
            it=asked.scenario,
            n=counted(f.trials, "seed"),
            ends=span(f.trials),
        ),
        answer=lines(["Over the workspace:", *compare.beside_rivals(f.gains, "seed")]),
        worst=lines(
            [
                "With non-linear truth:",
                *compare.beside_rivals(f.gains_nonlinear),
                say(
                    "{name} errs {max_um:most .0f} um at the worst place of the worst trial.",
                    find(f.nonlinear, name=worst),
                ),
            ]
        ),
        claims=list(_claims(f)),
        numbers=f,
        tables=_tables(f),
        body=["models", READING, "poses", "coverage", OF_COVERAGE],
        badge=of_models(linear, distinct(f.models), f.best[0], compare.ERROR),
    )


def _numbers(asked: Settings, seeds: range, trials: Trials) -> tuple[Row, Trials, str]:
    """The report's numbers, the fits of the linear truth, and the best model with the other one."""
    roots = seeds[: asked.campaigns]
    fits = trials.inside("fit").add(seed=trials["seed"]).pick(trials["intervals.name"] == None)  # noqa: E711
    fits = _whole(fits, "parameters", "rank")
    linear, bent, scales, poses = (fits.where(part=p) for p in ("linear", "nonlinear", "scale", "poses"))
    models, nonlinear = (compare.contract(compare.cells(own, also=ALSO)) for own in (linear, bent))
    covered = [coverage(own) for (name,), own in trials.inside("intervals").groups("name") if name]
    best, worst = _best(models), _best(nonlinear)[0]
    numbers = Row(
        compare.head(roots, fits),
        arm=asked.scenario.arm,
        payload_kg=asked.scenario.mass,
        truth="linear",
        prior=Row(scale=SCALE, shape_percent=100 * SHAPE),
        models=models,
        nonlinear=nonlinear,
        scales=compare.cells(scales, "scale", also=ALSO),
        poses=compare.cells(_whole(poses, "poses"), "poses", also=ALSO),
        gains=compare.gains(linear, distinct(models), best[0]),
        gains_nonlinear=compare.gains(bent, distinct(nonlinear), worst),
        coverage={row.interval: row for row in covered if row.kind not in ("learnt", "believed")},
        family_coverage={row.interval: row for row in covered if row.kind in ("learnt", "believed")},
        best=best,
        worth=[
            Row(
                name=m.name,
                without_um=m.rms_um,
                with_um=find(models, **VARIED | {"structure": m.structure}).rms_um,
            )
            for m in models
            if (m.constraint, m.filling) == ("psd", "none")
        ],
    )
    return numbers, linear, worst


def _whole(trials: Trials, *names: str) -> Trials:
    """The same with these columns as integers: other rows have none."""
    return trials.add(**{name: trials[name].astype(int) for name in names})


def _best(models: Sequence[Row]) -> list[str]:
    """The models of least error over the workspace; of those alike one that is by GCO comes first."""
    own = {m.name: m for m in distinct(models)}
    alike = best_of({name: m.rms_um for name, m in own.items()}).names
    return sorted(alike, key=lambda name: own[name].constraint != "psd")


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
    told = {m.name for m in (*distinct(f.models), *distinct(f.nonlinear))}
    both = [Row(a, nonlinear=b) for a, b in zip(f.models, f.nonlinear, strict=True) if a.name in told]
    name, *seen = columns("name parameters rank conservative uncertainty_percent")
    models = Table((name, *seen, RMS, BENT), both, headline=RMS.key, looks=looks)
    covered = [*f.coverage.values(), *f.family_coverage.values()]
    title = "RMS error over the workspace by number of poses, um"
    return {
        "models": models,
        "poses": replace(compare.errors(f.poses, "name", "poses", title), looks=looks),
        "coverage": Table(columns(COVERAGE), covered, "coverage of 95 % intervals of predicted deflections"),
    }


def _claims(f: Row) -> Iterator[Markdown]:
    """What else there is to say, what matters most first."""
    words = "{name} {without_um:~.0f} um without, {with_um:~.0f} um with it"
    plain = [m for m in f.models if not m.prior]
    yield say(
        "Without a prior {name} errs least, {rms_um:~.0f} um. A prior's worth to GCO: {each}.",
        find(plain, name=_best(plain)[0]),
        each=Markdown("; ".join(say(words, w) for w in f.worth[:3])),
    )
    own = [row for row in f.scales if all(row[key] == value for key, value in VARIED.items())]
    yield say(
        "The prior's scale is learnt: {name} errs {rms_um:~.0f} um with one {stiff:g} times too stiff, "
        "{most.rms_um:~.0f} um with one {most.scale:g} times too soft.",
        own[0],
        stiff=1 / own[0].scale,
        most=own[-1],
    )
    every = [*f.coverage.values(), *f.family_coverage.values()]
    yield say(
        "Intervals of 95 % hold the true deflection in {held} of the cases. On the family of true arms they "
        "do in {learnt} with a learnt prior, in {believed} with one believed.",
        held=_held(every, "linearised", "bootstrap", "posterior"),
        learnt=_held(every, "learnt"),
        believed=_held(every, "believed"),
    )


def _held(rows: Sequence[Row], *kinds: str) -> Markdown:
    shares = [row.covered_percent for row in rows if row.kind in kinds]
    return say("{low:.1f} to {high:.1f} %", low=min(shares), high=max(shares))


def figures(found: Report) -> dict[str, Figure]:
    """Every method with its spread, under both truths."""
    f, table = Row(found.numbers), found.tables["models"]
    prior = say("a prior {scale:g} times too soft, {shape_percent:g} % wrong in shape", f.prior)
    return {
        "identifiability.png": forest(
            table,
            {RMS.key: "linear truth", BENT.key: "MuJoCo's non-linear truth"},
            f"{f.arm}, RMS over the workspace: {compare.gains_told(f.gains)}",
            f"Filled: with {prior}. Dotted: joint stiffness only.",
            JOINTS,
        )
    }


STUDY = Study(
    name="identifiability",
    about="Identify with and without a prior, and judge in 200 poses that were never measured.",
    options=Options,
    settings=trial.settings,
    seeds=(1000, 10),
    arms=lambda asked: [find_arm(asked.arm), find_arm(trial.SIX_DOF)],
    row=TrialRow,
    trials=trial.trials,
    report=report,
    printed=("models",),
    figures=figures,
    size=2,
    models="fit.name",
)
