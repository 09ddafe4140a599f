"""What the ladder and all draws of poses say, and which positions were foretold how well."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from testbench.campaign.rows import MM, UM
from testbench.data.series import Series
from testbench.report.columns import columns
from testbench.report.report import Report, lines, say
from testbench.report.table import Row, Trials, merged
from testbench.studies.real_ur10 import trial
from testbench.studies.real_ur10.joints import compliances, joint_rows
from testbench.trials.spread import middle
from testbench.views import colours
from testbench.views.colours import CHOICE, Look, look
from testbench.views.figure import Figure, forest
from testbench.views.gains import Gain, gained, more
from testbench.views.markdown import Markdown
from testbench.views.schema import Table

LASTS = 0.7  #: Correlation above which a joint's error counts as the same: half of what either says.
MEANS = {
    trial.BLOCKS: "blocks_mm",
    trial.TO_C: "a_to_c_mm",
    trial.TO_A: "c_to_a_mm",
    trial.AGAIN: "realigned_mm",
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
    trial.ALL: Look(colours.GCO, 3, prior=True),
    trial.CHOSEN: CHOICE,
}
ERRORS = "name split judged poses draws error.n error.mean_mm error.rms_mm error.p95_mm error.p99_mm"
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
    "in its own frame, A with frame and target by 50 of its poses. Inside 95 %: share of positions inside "
    "their 95 % ellipsoid."
)
Models = Mapping[str, Row]  #: Rows of models by name.


def report(asked: trial.Settings, seeds: range, trials: Trials) -> Report:
    """The ladder as it is, the numbers of poses over the seeds."""
    cell, series = trial.read(asked.thin)
    ladder, draws = trials.where(split=tuple(trial.SPLITS)), trials.where(split=trial.DRAW)
    told = ("name", "split", "judged", "poses")
    judged = merged(ladder.where(judged=("A", "C")).keep(*told, "error."), *told)
    models = [_model(name, ladder.where(name=name), judged) for name in asked.models]
    f = Row(
        seed=seeds[0] if len(seeds) == 1 else list(seeds),
        arm=trial.ARM,
        dataset=[_series(one) for one in series],
        models=models,
        ladder=judged,
        by_number=[
            Row(merged(own.keep(*told, "error."))[0], draws=len(own))
            for _, own in draws.groups("judged", "name", "poses")
        ],
        joints=joint_rows(cell.arm.joints, series, ladder),
        compliances=compliances(ladder),
        chosen=merged(ladder.where(name=trial.CHOSEN).keep("split", "kept", "declined"), "split"),
    )
    own = {row.name: row for row in models}
    return Report(
        scenario="real_ur10",
        question=Markdown(
            "What explains the readings of a real UR10, and what foretells those that it never saw?"
        ),
        title=say(
            "{arm}, public laser tracker readings of July and November 2020: {series:list}; mean distances "
            "of positions that were not fitted; seeds only draw the random poses",
            f,
            series=[f"series {one.name} ({one.poses} poses)" for one in f.dataset],
        ),
        answer=lines(_answer(own)),
        worst=_worst(f, own),
        claims=list(_claims(f, own)),
        numbers=f,
        tables={
            "models": Table(
                columns(f"name parameters conservative {' '.join(MEANS.values())}"),
                models,
                "mean error of positions that were not fitted",
                headline="blocks_mm",
                looks=LOOKS,
            ),
            "joints": Table(columns(JOINT), f.joints, "the joints and their errors"),
            "errors": Table(
                columns(f"{ERRORS} error.max_mm error.inside_95_percent"),
                [*judged, *f.by_number],
                "every error",
                headline="error.mean_mm",
                looks=LOOKS,
            ),
        },
        body=["models", OF_MODELS, "joints", OF_JOINTS, "errors", OF_ERRORS],
    )


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
    return gained(ours, theirs, *([own[name].blocks_mm] for name in (ours, theirs)))


def _answer(own: Models) -> Iterator[str]:
    """Joint errors beside joint springs, then beside geometry alone."""
    yield say(
        "Positions that were never fitted, mean: {ours_mm:.3f} mm with periodic joint errors, "
        "{theirs_mm:.3f} mm with joint springs; {it:less}.",
        vars(gain := _gain(own, trial.WAVES, trial.JOINTS)),
        it=gain,
    )
    gain = _gain(own, trial.WAVES, trial.GEOMETRY)
    yield say("Geometry alone leaves {blocks_mm:.3f} mm, {it:more}.", own[trial.GEOMETRY], it=gain)


def _worst(f: Row, own: Models) -> Markdown:
    """Other angles, and a single position."""
    return say(
        "Worst from A to C and back, which share hardly any angle: joint errors {w.a_to_c_mm:.3f} and "
        "{w.c_to_a_mm:.3f} mm, joint springs {s.a_to_c_mm:.3f} and {s.c_to_a_mm:.3f} mm. Single position: "
        "{single:.3f} mm in held-out blocks.",
        w=own[trial.WAVES],
        s=own[trial.JOINTS],
        single=max(
            row.error.max_mm for row in f.ladder if (row.name, row.split) == (trial.WAVES, trial.BLOCKS)
        ),
    )


def _claims(f: Row, own: Models) -> Iterator[Markdown]:
    """What else there is to say, what matters most first."""
    if alike := [joint.correlation for joint in f.joints if joint.correlation is not None]:
        lasts = " It is the joint's own, and it lasts." if min(alike) > LASTS else ""
        yield say(
            "Every joint's error by A alone and by C alone, months apart: correlation {least:.2f} to "
            f"{{most:.2f}}.{lasts}",
            least=min(alike),
            most=max(alike),
        )
    springs = [
        one.urad_per_Nm[2]
        for name in trial.TWO
        for one in f.compliances
        if one.name == name and one.trained in "AC"
    ]
    yield say(
        "Without joint errors springs are biased: {x[0]:.1f} and {x[1]:.1f} urad/(N m) of the {name} by A "
        "and C, with them {x[2]:.1f} and {x[3]:.1f}.",
        x=springs,
        name=_named(f.joints[2]),
    )
    yield say(
        "A model knows a joint's error only where the joint was turned. {strange_to_A_percent:.0f} % of C's "
        "poses are more than 2 degrees from all poses of A in {name}.",
        f.joints[0],
        name=_named(f.joints[0]),
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


def _named(joint: Row) -> str:
    """What a joint is called: shoulder pan."""
    return str(joint.joint).removesuffix("_joint").replace("_", " ")


def figures(found: Report) -> dict[str, Figure]:
    """The ladder."""
    f = found.numbers
    gain = _gain({row["name"]: Row(row) for row in f["models"]}, trial.WAVES, trial.JOINTS)
    ladder = forest(
        found.tables["models"],
        PANES,
        f"Positions of a real UR10 that were never fitted, mean: {middle(gain.ours_mm):.3f} mm with joint "
        f"errors, {middle(gain.theirs_mm):.3f} mm with joint springs, {more(gain)}",
        "Mean error of public readings, series A and C of 2020. Dotted line: joint springs alone.",
        trial.JOINTS,
    )
    return {"real_ur10.png": ladder}
