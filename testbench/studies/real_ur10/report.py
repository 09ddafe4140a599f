"""What the ladder and all draws of poses say, and which positions were foretold how well."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from testbench.bench.rows import MM, UM
from testbench.data.series import Series
from testbench.report.columns import columns
from testbench.report.report import Report, lines, say
from testbench.report.table import Row, Trials, merged
from testbench.studies.real_ur10.figure import LOOKS, joint_errors, named, number_of_poses, spectra
from testbench.studies.real_ur10.joints import TRAINED, compliances, joint_reports
from testbench.studies.real_ur10.ladder import (
    ALL,
    CHOSEN,
    GEOMETRY,
    JOINTS,
    LADDER,
    LINKS_GCO,
    LINKS_LS,
    LINKS_PRIOR,
    TWO,
    WAVES,
)
from testbench.studies.real_ur10.prototype import known
from testbench.studies.real_ur10.readings import ARM, SPLITS, read
from testbench.studies.real_ur10.trial import LadderRow, Settings
from testbench.trials.gain import Gain, gained
from testbench.trials.spread import middle
from testbench.views.figure import Figure, forest
from testbench.views.gains import more
from testbench.views.markdown import Markdown
from testbench.views.schema import Table, pivot

ALIKE = 0.7  #: Correlation above which a joint's error counts as the same: half of what either says.
MEANS = {
    "blocks": "blocks_mm",
    "A to C": "a_to_c_mm",
    "C to A": "c_to_a_mm",
    "blocks, realigned": "realigned_mm",
}
"""Where the mean error of a split is in a row of `means`."""
PANES = {
    "blocks_mm": "both; blocks of joint space held out",
    "a_to_c_mm": "trained on A, judged on C",
    "c_to_a_mm": "trained on C, judged on A",
}
ERRORS = "error.mean_mm {} error.p95_mm error.p99_mm error.max_mm error.inside_95_percent"
WHERE = "low_A_deg high_A_deg low_C_deg high_C_deg strange_to_A_percent strange_to_C_percent"
TABLES = {
    "short": ("means", "mean error of positions that were not fitted", f"name {' '.join(MEANS.values())}"),
    "models": ("models", "", "name words parameters conservative min_eigenvalue duality_gap"),
    "joints": ("joints", "Where the joints were", f"joint {WHERE}"),
    "waves": (
        "joints",
        "The joints' errors",
        "joint rms_A_urad rms_C_urad rms_both_urad common_deg correlation",
    ),
    "numbers": ("by_number", "How many poses", f"judged name poses draws {ERRORS.format('')}"),
    "ladder": (
        "ladder",
        "Every number of the ladder",
        f"name split judged poses error.n {ERRORS.format('error.rms_mm')}",
    ),
    "known": ("known", "Beside a prototype", "name trained judged prototype_mm here_mm"),
}
"""Key of the rows in report.json, title and columns."""
Means = Mapping[str, Row]  #: Of `_means`, by model.
OF_SPLITS = Markdown("\n".join(f"- {name}: {words}" for name, words in SPLITS.items()))
OF_MODELS = Markdown(
    "Conservative: every block of the compliances is positive semi-definite, in all splits.\n\n"
    "![What explains a UR10](real_ur10.png)"
)
OF_JOINTS = Markdown(
    'Modulo a turn. "Far" is more than 2 degrees from every angle that the other series visited: there the '
    "other series says nothing of a joint's error."
)
OF_WAVES = Markdown(
    "Curves of periodic errors, orders 1 and 2 left out, which mix with geometry; RMS over the angles that "
    "were visited.\n\n![Joint errors](joint_errors.png)\n\n![Spectra](spectra.png)"
)
OF_SPRINGS = Markdown(
    "The load is the arm's own weight, so compliances have the scale of the masses that were assumed. A "
    "joint's axis that its own weight does not load tells nothing of its spring."
)
OF_NUMBERS = Markdown(
    "Random poses of C train; C is judged in its own frame by poses that did not, A with frame and target by "
    "50 of its poses; periodic errors up to order 50. Medians over the draws (5 % to 95 %)."
)
OF_ERRORS = Markdown('"Inside 95 %": share of positions inside their 95 % ellipsoid.')
OF_KNOWN = Markdown(
    "Numbers of this project's own prototype on the same robot; its series B and D are not in the package, "
    "so the first rows cannot be repeated here. No other open ladder of one real arm is known to us."
)


def report(asked: Settings, seeds: range, trials: Trials) -> Report:
    """The ladder as it is, the numbers of poses over the seeds."""
    readings, ladder = read(asked.thin), asked.ladder
    judged = [
        Row(
            {name: getattr(row, name) for name in ("name", "split", "judged", "poses")},
            error=Row(vars(row.error)),
        )
        for row in ladder
        if row.error
    ]
    numbers = [
        Row(merged(own.drop("seed"))[0], draws=len(own))
        for _, own in trials.groups("judged", "name", "poses")
    ]
    f = Row(
        seed=seeds[0] if len(seeds) == 1 else list(seeds),
        arm=ARM,
        dataset=[_series(one) for one in readings.series],
        models=[_model(name, ladder) for name in asked.models],
        means=[_means(name, judged) for name in asked.models],
        ladder=judged,
        by_number=numbers,
        joints=joint_reports(readings.cell.arm.joints, readings.series, ladder),
        compliances=compliances(ladder),
        chosen=[
            Row(
                trained=TRAINED.get(row.split, f"half of the {row.split}"),
                kept=row.kept,
                declined=row.declined,
            )
            for row in ladder
            if row.name == CHOSEN.name and row.judged is None
        ],
        known=known(numbers),
    )
    own = {row.name: row for row in f.means}
    return Report(
        scenario="real_ur10",
        question=Markdown(
            "What explains the readings of a real UR10, and what foretells those that it never saw?"
        ),
        title=_title(f),
        answer=lines(_answer(own)),
        worst=_worst(f, own),
        claims=list(_claims(f, own)),
        numbers=f,
        tables=_tables(f),
        body=[
            *("short", OF_SPLITS, "models", OF_MODELS, "joints", OF_JOINTS, "waves", OF_WAVES),
            *("compliances", OF_SPRINGS, "numbers", OF_NUMBERS, "ladder", OF_ERRORS, "known", OF_KNOWN),
        ],
    )


def _tables(f: Row) -> dict[str, Table]:
    springs = [
        Row(joint=joint.joint, fit=f"{one.name}, {one.trained}", urad_per_Nm=one.urad_per_Nm[k])
        for k, joint in enumerate(f.joints)
        for one in f.compliances
    ]
    title = "Joint compliances by model and what trained it, urad/(N m)"
    found = {
        name: Table(columns(keys), f[rows], title, looks=LOOKS if keys.startswith("name ") else {})
        for name, (rows, title, keys) in TABLES.items()
    }
    return found | {
        "short": replace(found["short"], headline="blocks_mm"),
        "compliances": pivot(Table((), springs, title), *columns("joint fit urad_per_Nm")),
    }


def _series(series: Series) -> Row:
    """A series of readings: noise of a position along an axis, and the largest distance of two positions."""
    x, own = series.position[:, 0], series.precision
    sigma = series.sigma if own is None else np.sqrt(np.median(3 / np.trace(own, axis1=2, axis2=3)))
    reach = np.linalg.norm(x.max(axis=0) - x.min(axis=0))
    return Row(name=series.name, poses=series.rows, sigma_um=float(UM * sigma), reach_mm=float(MM * reach))


def _model(name: str, ladder: Sequence[LadderRow]) -> Row:
    """A model of the ladder, over all splits."""
    own = [row for row in ladder if row.name == name and row.judged is None]
    return Row(
        name=name,
        words=next(model.words for model in LADDER if model.name == name),
        method=own[0].method,
        parameters=max(row.parameters for row in own),
        conservative=all(row.conservative for row in own),
        min_eigenvalue=min(row.min_eigenvalue for row in own),
        duality_gap=max((row.duality_gap for row in own if row.duality_gap is not None), default=None),
        paper=None,
    )


def _means(name: str, judged: Sequence[Row]) -> Row:
    """Mean error of a model over all readings that judge it, by split."""
    found = Row(name=name)
    for key, place in MEANS.items():
        own = [row.error for row in judged if (row.name, row.split) == (name, key)]
        n = sum(one.n for one in own)
        found[place] = sum(one.n * one.mean_mm for one in own) / n if own else None
    return found


def _title(f: Row) -> Markdown:
    """What was read."""
    series = [say("series {name} with {poses} poses", one) for one in f.dataset]
    seeds = f"{len(f.seed)} seeds draw" if isinstance(f.seed, list) else f"seed {f.seed} draws"
    return say(
        "{arm}, public laser tracker readings: {series}; mean distances of positions that were not fitted; "
        "{seeds} which poses train in the curve over their number, and nothing else",
        f,
        series=Markdown(", ".join(series)),
        seeds=seeds,
    )


def _gain(own: Means, ours: str, theirs: str) -> Gain:
    """Two models in blocks that were held out."""
    return gained(ours, theirs, *([own[name].blocks_mm] for name in (ours, theirs)))


def _answer(own: Means) -> Iterator[str]:
    """Joint errors beside joint springs, then beside geometry alone."""
    waves, springs = own[WAVES.name], own[JOINTS.name]
    yield say(
        "Positions that were never fitted, mean: {waves:.3f} mm with periodic joint errors, {springs:.3f} mm "
        "with joint springs; {gain:less}.",
        waves=waves.blocks_mm,
        springs=springs.blocks_mm,
        gain=_gain(own, WAVES.name, JOINTS.name),
    )
    yield say(
        "Geometry alone leaves {blocks_mm:.3f} mm, {gain:more}.",
        own[GEOMETRY.name],
        gain=_gain(own, WAVES.name, GEOMETRY.name),
    )


def _worst(f: Row, own: Means) -> Markdown:
    """Other angles, and a single position."""
    return say(
        "Worst from A to C and back, which share hardly any angle: joint errors {w.a_to_c_mm:.3f} and "
        "{w.c_to_a_mm:.3f} mm, joint springs {s.a_to_c_mm:.3f} and {s.c_to_a_mm:.3f} mm. Single position: "
        "{single:.3f} mm in held-out blocks.",
        w=own[WAVES.name],
        s=own[JOINTS.name],
        single=max(row.error.max_mm for row in f.ladder if (row.name, row.split) == (WAVES.name, "blocks")),
    )


def _sized(model: Row, than: Row) -> Markdown:
    """By how much one errs less, or more, than another in every split."""
    words = []
    for key, where in (
        ("blocks_mm", "in blocks"),
        ("a_to_c_mm", "from A to C"),
        ("c_to_a_mm", "from C to A"),
    ):
        share = 100 * (model[key] / than[key] - 1)
        words.append(f"{abs(share):.0f} % {'less' if share < 0 else 'more'} {where}")
    return Markdown(", ".join(words))


def _claims(f: Row, own: Means) -> Iterator[Markdown]:
    """What else there is to say, what matters most first."""
    springs, waves = own[JOINTS.name], own[WAVES.name]
    yield say("Joint errors over joint springs: {sized}.", sized=_sized(waves, springs))
    yield say("Joint springs over geometry alone: {sized}.", sized=_sized(springs, own[GEOMETRY.name]))
    if alike := [joint.correlation for joint in f.joints if joint.correlation is not None]:
        lasts = " It is the joint's own, and it lasts." if min(alike) > ALIKE else ""
        yield say(
            "Every joint's error by A alone and by C alone, months apart: correlation {least:.2f} to "
            f"{{most:.2f}}.{lasts}",
            least=min(alike),
            most=max(alike),
        )
    yield _biased(f)
    yield say(
        "A model knows a joint's error only where the joint was turned. {strange_to_A_percent:.0f} % of C's "
        "poses are more than 2 degrees from all poses of A in {name}.",
        f.joints[0],
        name=named(f.joints[0]),
    )
    if LINKS_PRIOR.name in own:
        yield from _links(own)
    for kept in dict.fromkeys(one.kept for one in f.chosen):
        alike = [one for one in f.chosen if one.kept == kept]
        declined = " and declines {declined:list}" if alike[0].declined else ""
        yield say(
            f"Cross-validation keeps {{kept:list}}{declined}, trained on {{trained:list}}.",
            alike[0],
            trained=[one.trained for one in alike],
        )


def _biased(f: Row) -> Markdown:
    """The elbow's spring by either series, without joint errors and with them."""
    a, b, c, d = (
        one.urad_per_Nm[2]
        for model in TWO
        for one in f.compliances
        if one.name == model.name and one.trained in "AC"
    )
    return say(
        "Without joint errors springs are biased: {a:.1f} and {b:.1f} urad/(N m) of the {name} by A and by "
        "C, with them {c:.1f} and {d:.1f}.",
        a=a,
        b=b,
        c=c,
        d=d,
        name=named(f.joints[2]),
    )


def _links(own: Means) -> Iterator[Markdown]:
    """What 6x6 links add, and to what."""
    waves, every = own[WAVES.name], own[ALL.name]
    yield say(
        "Links instead, GCO with a learnt prior over joint springs: {sized}. With hardly a prior GCO leaves "
        "{gco.c_to_a_mm:.3f} mm from C to A, least squares {ls.c_to_a_mm:.3f} mm.",
        sized=_sized(own[LINKS_PRIOR.name], own[JOINTS.name]),
        gco=own[LINKS_GCO.name],
        ls=own[LINKS_LS.name],
    )
    yield say("Links beside joint errors: {sized}.", sized=_sized(every, waves))


def figures(found: Report) -> dict[str, Figure]:
    """The ladder, the number of poses, and what every joint does."""
    f = Row(found.numbers)
    own = {row.name: row for row in f.means}
    gain = _gain(own, WAVES.name, JOINTS.name)
    series = " and ".join(f"{one.name} ({one.poses} poses)" for one in f.dataset)
    made = {
        "real_ur10.png": forest(
            found.tables["short"],
            PANES,
            f"Positions of a real UR10 that were never fitted, mean: {middle(gain.ours_mm):.3f} mm with "
            f"joint errors, {middle(gain.theirs_mm):.3f} mm with joint springs, {more(gain)}",
            f"Mean error. Public readings, series {series}, of July and November 2020. Dotted line: joint "
            "springs alone.",
            JOINTS.name,
        ),
        "joint_errors.png": joint_errors(f.joints),
        "spectra.png": spectra(f.joints),
    }
    if len({row.poses for row in f.by_number}) > 1:
        made["number_of_poses.png"] = number_of_poses(f.by_number)
    return made
