"""A real UR10: what explains its readings, and what predicts those that were never fitted."""

import csv
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from testbench.arm.folder import find_arm
from testbench.campaign.rows import MM, UM
from testbench.data.series import Series
from testbench.report.badge import Badge, beside_all
from testbench.report.columns import columns
from testbench.report.report import Report, lines, say
from testbench.report.table import Row, Trials, find, merged
from testbench.studies.calibration_scene import amid_errors
from testbench.studies.real_ur10 import trial
from testbench.studies.real_ur10.joints import TRAINED, effect_rows, joint_rows
from testbench.studies.study import Run, Study
from testbench.trials.spread import middle
from testbench.views import colours
from testbench.views.colours import CHOICE, Look, look
from testbench.views.figure import Figure, forest
from testbench.views.gains import Gain, gained, more
from testbench.views.markdown import Markdown
from testbench.views.scene import Seen
from testbench.views.schema import Table

LASTS = 0.7  #: Correlation above which a joint's error counts as the same: half of what either says.
MEANS = {
    trial.BLOCKS: "blocks_mm",
    trial.TO_C: "a_to_c_mm",
    trial.TO_A: "c_to_a_mm",
    trial.AGAIN: "realigned_mm",
    trial.EVENLY: "evenly_mm",
    trial.PLANNED: "by_plan_mm",
}
"""Where the mean error of a split is in a row of a model."""
PANES = {
    "blocks_mm": "both; blocks of joint space held out",
    "a_to_c_mm": "trained on A, judged on C",
    "c_to_a_mm": "trained on C, judged on A",
}
LOOKS = {
    trial.GEOMETRY: Look(colours.GREY, 0, prior=True),
    trial.JOINTS: Look(colours.JOINTS, 2, prior=True),
    trial.LINKS_LS: Look(colours.LEAST_SQUARES, 1, prior=True),
    trial.LINKS_GCO: look("ALL153", "psd"),
    trial.LINKS_PRIOR: look("ALL153", "psd", prior=True),
    trial.WAVES: Look(colours.JOINTS_PRIOR, 0, prior=True),
    trial.SHARED: Look(colours.JOINTS_PRIOR, 3, prior=True),
    trial.ALL: Look(colours.GCO, 3, prior=True),
    trial.CHOSEN: CHOICE,
}
ERRORS = (
    "name split judged poses draws error.n error.mean_mm error.rms_mm error.p95_mm error.max_mm "
    "error.coverage_95"
)
JOINT = "joint strange_to_A_percent strange_to_C_percent common_deg correlation rms_A_urad rms_C_urad"
OF_MODELS = Markdown(
    "\n".join(f"- {name}: {words}" for name, words in trial.SPLITS.items())
    + "\n\nEvery model has geometry; chosen is what cross-validation keeps. GCO: every block of the "
    "compliances is positive semi-definite; LS: least squares. Links have hardly a prior where none is named."
    "\n\n"
    "![What explains a UR10](real_ur10.png)"
)
OF_JOINTS = Markdown(
    'Modulo a turn. "Far" is more than 2 degrees from every angle that the other series visited. RMS of '
    "periodic errors over the angles that were visited; orders 1 and 2, which mix with geometry, are left "
    "out. Compliances are in report.json; they have the scale of the masses that were assumed."
)
OF_ERRORS = Markdown(
    "Random poses of C train models of orders up to 50: medians over the draws. Other poses of C judge them "
    "in its own frame, A with frame and target by 50 of its poses. Inside 95 %: positions inside "
    "their 95 % ellipsoid."
)
Models = Mapping[str, Row]  #: Rows of models by name.


def report(asked: trial.Settings, seeds: range, trials: Trials) -> Report:
    """The ladder as it is, the numbers of poses over the seeds."""
    cell, series = trial.read(asked.thin)
    ladder, told = trials.where(split=tuple(trial.SPLITS)), ("name", "split", "judged", "poses")
    errors = trials.where(judged=("A", "C")).keep(*told, "error.")
    errors = errors.add(**{"error.n": errors["error.n"].astype(int)})  # some rows have none
    judged = merged(errors.where(split=tuple(trial.SPLITS)), *told)
    models = [_model(name, ladder.where(name=name), judged) for name in asked.models]
    f = Row(
        seed=seeds[0] if len(seeds) == 1 else list(seeds),
        arm=trial.ARM,
        dataset=[_series(one) for one in series],
        models=models,
        ladder=judged,
        by_number=[
            Row(merged(own)[0], draws=len(own))
            for _, own in errors.where(split=trial.DRAW).groups("judged", "name", "poses")
        ],
        joints=joint_rows(cell.arm.joints, series, ladder),
        compliances=[
            Row(trained=by, name=name, urad_per_Nm=[UM * c for c in own["joints"][0]])
            for name in trial.TWO
            for split, by in TRAINED.items()
            if (own := ladder.where(split=split, name=name))
        ],
        effects=effect_rows(cell.arm.joints, ladder.where(split=trial.BOTH, name=trial.SHARED)),
        chosen=merged(ladder.where(name=trial.CHOSEN).keep("split", "kept", "declined"), "split"),
    )
    by_name = {row.name: row for row in models}
    means = columns(f"name parameters conservative {' '.join(MEANS.values())}")
    title = "mean error of positions that were not fitted"
    return Report(
        scenario="real_ur10",
        question=Markdown(
            "What explains the readings of a real UR10, and what predicts those that it never saw?"
        ),
        title=say(
            "{arm}, public laser tracker readings of July and November 2020: {series:list}; mean distances "
            "of positions that were not fitted; seeds only draw the random poses",
            f,
            series=[f"series {one.name} ({one.poses} poses)" for one in f.dataset],
        ),
        answer=lines(_answer(by_name)),
        worst=_worst(f, by_name),
        claims=list(_claims(f, by_name)),
        numbers=f,
        tables={
            "models": Table(means, models, title, headline="blocks_mm", looks=LOOKS),
            "joints": Table(columns(JOINT), f.joints, "the joints and their errors"),
            "effects": Table(columns("what value half_95 unit"), f.effects, "effects that no model has"),
            "errors": Table(
                columns(ERRORS), [*judged, *f.by_number], "every error", headline="error.mean_mm", looks=LOOKS
            ),
        },
        body=["models", OF_MODELS, "joints", OF_JOINTS, "effects", "errors", OF_ERRORS],
        badge=_badge(trials.where(split=trial.BLOCKS, judged=("A", "C"))),
    )


def _badge(rows: Trials) -> Badge | None:
    """Positions of the first trial's held-out blocks: shared joint errors beside all other models.

    What cross-validation chooses is one of them.
    """
    rows = rows.where(seed=rows["seed"][0])
    errors = {
        name: np.linalg.norm(np.concatenate([*map(np.array, own)]).reshape(-1, 3), axis=1)
        for name in rows.values("name")
        if name != trial.CHOSEN
        for own in [rows.where(name=name)["left_um"].tolist()]
    }
    ours = errors.pop(trial.SHARED)  # every model of the ladder has them
    pairs = {name: (ours, own, None) for name, own in errors.items()}
    found = beside_all(trial.SHARED, pairs, "position of held-out blocks")
    return found and replace(found, what="RMS error")  # the tables have means


def _series(series: Series) -> Row:
    """A series of readings: noise of a position along an axis, and the largest distance of two positions."""
    x, own = series.position[:, 0], series.precision
    sigma = series.sigma if own is None else np.sqrt(np.median(3 / np.trace(own, axis1=2, axis2=3)))
    reach = np.linalg.norm(x.max(axis=0) - x.min(axis=0))
    return Row(name=series.name, poses=series.rows, sigma_um=float(UM * sigma), reach_mm=float(MM * reach))


def _model(name: str, own: Trials, judged: Sequence[Row]) -> Row:
    """A model over all splits, and its mean error over all readings that judge it, split by split."""
    gaps = own["duality_gap"][~np.isnan(own["duality_gap"].astype(float))]
    found = Row(
        name=name,
        method=own["method"][0],
        parameters=int(own["parameters"].max()),
        conservative=bool(own["conservative"].all()),
        min_eigenvalue=float(own["min_eigenvalue"].min()),
        duality_gap=float(gaps.max()) if len(gaps) else None,
        paper=None,
    )
    for key, place in MEANS.items():
        errors = [row.error for row in judged if (row.name, row.split) == (name, key)]
        n = sum(one.n for one in errors)
        found[place] = sum(one.n * one.mean_mm for one in errors) / n if errors else None
    return found


def _gain(own: Models, ours: str, theirs: str) -> Gain:
    """Two models in blocks that were held out."""
    return gained(ours, theirs, [own[ours].blocks_mm], [own[theirs].blocks_mm])


def _answer(own: Models) -> Iterator[str]:
    """Joint errors beside joint springs, then beside geometry alone."""
    yield say(
        "Positions that were never fitted, mean: {ours_mm:.3f} mm with periodic joint errors, "
        "{theirs_mm:.3f} mm with joint springs; {it:less}.",
        vars(gain := _gain(own, trial.SHARED, trial.JOINTS)),
        it=gain,
    )
    gain = _gain(own, trial.SHARED, trial.GEOMETRY)
    yield say("Geometry alone leaves {blocks_mm:.3f} mm, {it:more}.", own[trial.GEOMETRY], it=gain)


def _worst(f: Row, own: Models) -> Markdown:
    """Other angles, and a single position."""
    held_out = [row.error.max_mm for row in f.ladder if (row.name, row.split) == (trial.SHARED, trial.BLOCKS)]
    return say(
        "Worst from A to C and back, which share hardly any angle: joint errors {w.a_to_c_mm:.3f} and "
        "{w.c_to_a_mm:.3f} mm, joint springs {s.a_to_c_mm:.3f} and {s.c_to_a_mm:.3f} mm. Single position: "
        "{single:.3f} mm in held-out blocks.",
        w=own[trial.SHARED],
        s=own[trial.JOINTS],
        single=max(held_out),
    )


def _claims(f: Row, own: Models) -> Iterator[Markdown]:
    """What else there is to say, what matters most first."""
    if trial.SHARED in own:
        yield say(
            "Joints share one periodic error, turned: so A predicts C to {s.a_to_c_mm:.3f} mm "
            "({w.a_to_c_mm:.3f} without), C predicts A to {s.c_to_a_mm:.3f} mm ({w.c_to_a_mm:.3f}).",
            s=own[trial.SHARED],
            w=own[trial.WAVES],
        )
        if own[trial.SHARED].by_plan_mm is not None:
            yield say(
                "C and 50 poses of A leave {by_plan_mm:.3f} mm on its others if the plan's criterion chooses "
                "them, {evenly_mm:.3f} mm evenly spaced.",
                own[trial.SHARED],
            )
    if alike := [joint.correlation for joint in f.joints if joint.correlation is not None]:
        lasts = " It lasts." if min(alike) > LASTS else ""
        yield say(
            "Every joint's error by A alone and by C alone, months apart: correlation {least:.2f} to "
            f"{{most:.2f}}.{lasts}",
            least=min(alike),
            most=max(alike),
        )
    springs = [find(f.compliances, name=name, trained=by).urad_per_Nm[2] for name in trial.TWO for by in "AC"]
    elbow = str(f.joints[2].joint).removesuffix("_joint").replace("_", " ")
    yield say(
        "Without joint errors springs are biased: {x[0]:.1f} and {x[1]:.1f} urad/(N m) of the {name} by A "
        "and C, with them {x[2]:.1f} and {x[3]:.1f}.",
        x=springs,
        name=elbow,
    )
    effects = {row.what: row for row in f.effects}
    if fifth := effects.get(f"approach, {f.joints[4].joint}"):
        yield say(
            "By its direction of approach joint 5 differs by {x.value:.0f} +- {x.half_95:.0f} urad; z drifts "
            "by {z.value:.0f} +- {z.half_95:.0f} um in C. No model has that.",
            x=fifth,
            z=effects[f"drift of z, {list(trial.FILES)[-1]}"],
        )
    if trial.ALL in own:
        yield say(
            "Links beside joint errors change {w.blocks_mm:.3f} to {a.blocks_mm:.3f} mm in blocks. Without "
            "joint errors, with hardly a prior, GCO leaves {gco.c_to_a_mm:.3f} mm from C to A, least squares "
            "{ls.c_to_a_mm:.3f} mm.",
            w=own[trial.WAVES],
            a=own[trial.ALL],
            gco=own[trial.LINKS_GCO],
            ls=own[trial.LINKS_LS],
        )


def figures(found: Report) -> dict[str, Figure]:
    """The ladder."""
    gain = _gain({row["name"]: Row(row) for row in found.numbers["models"]}, trial.SHARED, trial.JOINTS)
    ladder = forest(
        found.tables["models"],
        PANES,
        f"Positions of a real UR10 that were never fitted, mean: {middle(gain.ours_mm):.3f} mm with joint "
        f"errors, {middle(gain.theirs_mm):.3f} mm with joint springs, {more(gain)}",
        "Mean error of public readings, series A and C of 2020. Dotted line: joint springs alone.",
        trial.JOINTS,
    )
    return {"real_ur10.png": ladder}


def write(run: Run[trial.Settings]) -> Seen:
    """errors.csv, a line a position: row of its file, joints, reading minus both models in base axes.

    Returns:
        The arm amid its errors, from where each model has the target to the reading.
    """
    cell, series = trial.read(run.settings.thin)
    judged = [one for name, one, _ in trial.split(trial.BLOCKS, series)[1] if name == trial.BLOCKS]
    rows = run.first.where(split=trial.BLOCKS, judged=("A", "C"))
    left = {
        name: np.concatenate([*map(np.array, rows.where(name=name)["left_um"])]).reshape(-1, 3)
        for name in trial.TWO
    }
    q = np.concatenate([one.q for one in judged])
    named = [(one.name, int(row)) for one in judged for row in one.row]
    with (run.folder / "errors.csv").open("w", encoding="utf-8", newline="") as text:
        writer = csv.writer(text, lineterminator="\n")
        vectors = [f"{what}_{x}_um" for what in ("springs", "joint_errors") for x in "xyz"]
        writer.writerow(["series", "run", *(f"{joint.name}_rad" for joint in cell.arm.joints), *vectors])
        numbers = np.hstack([q, *left.values()]).tolist()
        writer.writerows([*name, *own] for name, own in zip(named, numbers, strict=True))
    errors = {name: own / UM for name, own in left.items()}
    return amid_errors(cell, q, [f"{name} {row}" for name, row in named], errors, LOOKS)


STUDY = Study(
    name="real_ur10",
    about="Public readings of a UR10: geometry, springs, links and joint errors, series against series.",
    options=trial.Flags,
    settings=trial.settings,
    seeds=(20, 1),
    arms=lambda _: [find_arm(trial.ARM)],
    row=trial.FitRow,
    trials=trial.trials,
    report=report,
    printed=("models",),
    figures=figures,
    write=write,
    data="errors.csv",
)
