"""What absolute readings tell of an arm: which errors hide behind which, how many poses, what a mix gains."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from testbench.arm.folder import find_arm
from testbench.campaign.campaign import build_cell
from testbench.campaign.rows import UM
from testbench.errors import Array
from testbench.report.badge import of_rivals
from testbench.report.columns import columns
from testbench.report.report import Report, lines, say
from testbench.report.table import Row, Trials, find, number, paired
from testbench.studies.absolute_calibration import trial as s
from testbench.studies.calibration_scene import amid_errors
from testbench.studies.study import Run, Study
from testbench.trials.spread import span, spread
from testbench.views import colours
from testbench.views.colours import CHOICE, Look, look
from testbench.views.figure import Figure, forest, sweeps
from testbench.views.gains import beside
from testbench.views.markdown import Markdown, counted, listed
from testbench.views.scene import Seen
from testbench.views.schema import Table, pivot

BY = ("arm", "true_arm", "campaign", "poses", "name")  #: What a row of the report is of.
PARTS = ("positions", "geometry", "joint_errors", "joints", "entries")  #: Of what should lie in its interval.
INSIDE = " ".join(f"inside.{part}_percent" for part in PARTS)
BY_NUMBER = f"name arm poses trials error_mm over_optimum {INSIDE}"
CASES = (
    "name arm true_arm campaign poses error_mm loaded_mm bias_2_percent off_2_percent bias_3_percent "
    "off_3_percent geometry_off inside.joints_percent gears_kept_percent links_kept_percent"
)
OPTIMUM = "noise-only optimum"
LOOKS = {
    s.GEOMETRY: Look(colours.GREY, 0, prior=False),
    s.INCUMBENT: Look(colours.JOINTS, 1, prior=False),
    s.WITH_GEARS: Look(colours.JOINTS_PRIOR, 2, prior=False),
    s.WITH_LINKS: look("ALL153", "psd", prior=True),
    s.ALL_LS: Look(colours.LEAST_SQUARES, 3, prior=True),
    s.ALL: Look(colours.GCO, 4, prior=True),
    s.CHOSEN: CHOICE,
    OPTIMUM: Look(colours.TASK, 0, prior=True),
}
OF_MODELS = Markdown(
    "![absolute_calibration](absolute_calibration.png)\n\n"
    "A fit of everything has what the true arm has. Cross-validation may drop the links: their bending is "
    "then in the springs of the joints, whose intervals do not count it. The noise-only optimum knows how "
    "large geometric errors, joint errors and noise are, which orders there are, and compliances to 30 % of "
    "the truth. Inside: shares over all numbers of all trials; joint compliances with the link before. "
    "Entries of C are inside less often: readings tell few of them, and the wrong prior fills the others."
)
OF_CASES = Markdown(
    "c2, c3: compliance of joint 2 and 3 with the link before. Geometry off: RMS error along the "
    "combinations of geometric errors that the fit of everything knows to 0.1 mm or mrad. A pair is a pose "
    "read unloaded and under the payload. True arms: "
    + "; ".join(f"{name}: {words}" for name, (words, _) in s.TRUE_ARMS.items())
    + "."
)


def report(asked: s.Settings, seeds: range, trials: Trials) -> Report:
    """By arm, true arm, campaign, number of poses and model."""
    arms = [arm for arm in asked.arms if arm in trials.values("arm")]
    places = {name: trials.values(name) for name in BY} | {"arm": arms, "name": [*s.MODELS]}
    rows = [_merged(Row(zip(BY, key, strict=True)), own) for key, own in trials.groups(*BY)]
    f = Row(
        seed=list(seeds) if len(seeds) > 1 else seeds[0],
        trials=len(seeds),
        arms=arms,
        featured=asked.featured,
        true_arms={name: words for name, (words, _) in s.TRUE_ARMS.items()},
        gains=[_gains(arm, _featured(trials, asked.featured).where(arm=arm)) for arm in arms],
        models=sorted(rows, key=lambda row: [places[name].index(row[name]) for name in BY]),
        dataset=Row(runs=asked.featured, points=asked.featured, sigma_um=UM * s.TRUE_ARMS[s.REAL][1].sigma),
    )
    return Report(
        scenario=s.NAME,
        question=Markdown(
            "What do absolute readings tell of an arm: which errors hide behind which, how many poses are "
            "enough, what do loaded pairs add?"
        ),
        title=say(
            "{trials} of {arms:list} in turn, each another true arm of the family with errors of geometry "
            "and of the joints, measured absolutely by a tracker somewhere, {dataset.sigma_um:g} um, with a "
            "prior of compliances wrong by a factor of 2 and 30 % axis by axis. Errors are RMS distances "
            "from true positions in poses that were never measured.",
            f | {"trials": counted(len(seeds), "trial")},
        ),
        answer=lines(_answer(f)),
        worst=_each(
            f,
            "Worst trials under the payload, which was not read: {own}.",
            "{arm} {chosen.loaded_mm:most .3f} mm, joint springs {springs.loaded_mm:most .3f} mm",
        ),
        claims=[_each(f, *claim) for claim in CLAIMS],
        numbers=f,
        tables=_tables(f),
        body=["short", "models", OF_MODELS, "cases", OF_CASES],
        badge=of_rivals(
            _featured(trials, asked.featured),
            s.CHOSEN,
            [s.INCUMBENT, s.GEOMETRY],
            "error_mm",
            f"trial of {listed(arms)}",
        ),
    )


def _featured(trials: Trials, poses: int) -> Trials:
    """What answers: real arms, measured absolutely in the featured poses."""
    return trials.where(poses=poses, true_arm=s.REAL, campaign=s.ABSOLUTE)


def _gains(arm: str, own: Trials) -> Row:
    """What cross-validation chooses on one arm from the featured poses, trial by trial."""
    springs, geometry = (paired(own, s.CHOSEN, theirs, "error_mm") for theirs in (s.INCUMBENT, s.GEOMETRY))
    return Row(arm=arm, springs=springs, geometry=geometry)


def _merged(key: Row, own: Trials) -> Row:
    """What a model makes of some true arms and a campaign, over their trials."""
    found = Row(key, trials=len(own), inside=Row())
    found["readings"] = number(own["readings"])
    for name in ("error_mm", "loaded_mm", "optimum_mm", "geometry_off"):
        found[name] = None if np.isnan(own[name]).any() else spread(own[name])
    known = found.optimum_mm is not None
    found["over_optimum"] = _rms(own["error_mm"] / own["optimum_mm"]) if known else None
    for part in PARTS:
        count, inside = (np.nansum(own[f"{part}.{name}"].astype(float)) for name in ("of", "inside"))
        found.inside[f"{part}_percent"] = 100 * inside / count if count else None
    for name, part in (("gears", s.GEARS), ("links", s.LINKS)):
        share = 100 * np.mean([part in kept for kept in own["kept"]])
        found[f"{name}_kept_percent"] = share if key.name == s.CHOSEN else None
    off = 100 * np.array([cells[1:3] for cells in own["compliance_off"]])
    for joint, shares in zip((2, 3), off.T, strict=False):  # none of a rigid arm
        found[f"bias_{joint}_percent"] = float(np.median(shares))
        found[f"off_{joint}_percent"] = _rms(shares)
    return found


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _by_poses(f: Row) -> list[Row]:
    """Rows of real arms that were measured absolutely, by number of poses."""
    alike = (s.REAL, s.ABSOLUTE)
    return [row for row in f.models if (row.true_arm, row.campaign) == alike and row.name in s.BY_POSES]


def _tables(f: Row) -> dict[str, Table]:
    """Errors from the featured poses, by number of poses with intervals, and by true arm and campaign."""
    name, arm, error = columns("name arm error_mm")
    own = _by_poses(f)
    featured = [row for row in own if row.poses == f.featured]
    title = f"RMS error where nothing was measured, {f.featured} poses, own weight, mm"
    cases = [row for row in f.models if row.readings == f.featured and row.name in s.HIDING]
    return {
        "short": replace(pivot(Table((), featured, title), name, arm, error), looks=LOOKS),
        "models": Table(columns(BY_NUMBER), own, "Intervals", looks=LOOKS),
        "cases": Table(columns(CASES), cases, f"True arms and campaigns, {f.featured} readings", looks=LOOKS),
    }


def _answer(f: Row) -> Iterator[str]:
    """What cross-validation chooses beside joint springs, arm by arm."""
    for gain in f.gains:
        yield say(
            "On {arm}, {n} poses: chosen by cross-validation {it.ours_mm:~.3f} mm, joint springs "
            "{it.theirs_mm:~.3f} mm, {it:less trial}.",
            gain,
            n=f.featured,
            it=gain.springs,
        )


CLAIMS = (
    (
        "Errors that a model lacks hide in its springs. Joint 2's compliance is off, without joint errors "
        "(RMS) and without links (median): {own}.",
        "{stiff.off_2_percent:.0f} % and {unseen.bias_2_percent:+.0f} % ({arm})",
    ),
    ("The error over the least that noise allows is {own}.", "{chosen.over_optimum:.2f} times on {arm}"),
    (
        "{n} readings, under the payload, absolute alone and mixed with loaded pairs: {own}.",
        "{alone.loaded_mm:~.3f} and {mixed.loaded_mm:~.3f} mm ({arm})",
    ),
    (
        "Inside their 95 % intervals lie {own}.",
        "{chosen.inside.positions_percent:.0f} % of positions, {chosen.inside.joints_percent:.0f} % of joint "
        "compliances ({arm})",
    ),
)
"""What else there is to say, what matters most first: a sentence, and what it says of every arm."""


def _each(f: Row, sentence: str, part: str) -> Markdown:
    """A sentence whose {own} is said of every arm, of its rows by name."""
    own = [say(part, _of_arm(f, arm)) for arm in f.arms]
    return say(sentence, n=f.featured, own=Markdown("; ".join(own)))


def _of_arm(f: Row, arm: str) -> Row:
    """Rows that sentences speak of, from the featured poses or as many readings."""

    def of(name: str, true_arm: str = s.REAL, campaign: str = s.ABSOLUTE) -> Row:
        rows = [row for row in f.models if row.readings == f.featured]
        return find(rows, arm=arm, name=name, true_arm=true_arm, campaign=campaign)

    return Row(
        arm=arm,
        springs=of(s.INCUMBENT),
        chosen=of(s.CHOSEN),
        alone=of(s.ALL),
        mixed=of(s.ALL, campaign=s.MIXED),
        unseen=of(s.INCUMBENT, s.NO_GEARS),
        stiff=of(s.INCUMBENT, s.JOINTS_ONLY),
    )


def figures(found: Report) -> dict[str, Figure]:
    """Error by number of poses of every arm; of one number the errors alone."""
    f, short = Row(found.numbers), found.tables["short"]
    gains = "; ".join(f"{g.arm} {beside({'joint springs': g.springs})}" for g in f.gains)
    answer = f"{f.featured} poses, error where nothing was measured: {gains}"
    noise = f"{f.dataset.sigma_um:g} um a reading"
    reading = f"RMS errors under own weight, {noise}, medians of {f.trials} trials, arms in turn"
    own = _by_poses(f)
    if len({row.poses for row in own}) == 1:
        name, *arms = short.columns
        error = [replace(column, heading="RMS error", unit="mm") for column in arms]
        titles, short = {own.key: own.heading for own in arms}, replace(short, columns=(name, *error))
        return {f"{s.NAME}.png": forest(short, titles, answer, f"{reading}.")}
    best = [Row(row, name=OPTIMUM, error_mm=row.optimum_mm) for row in own if row.name == s.ALL]
    drawn = {name: LOOKS[name] for name in (s.INCUMBENT, s.ALL, s.CHOSEN, OPTIMUM)}
    panes = {
        arm: Table(
            columns("name poses error_mm"), [row for row in (*own, *best) if row.arm == arm], looks=drawn
        )
        for arm in f.arms
    }
    return {f"{s.NAME}.png": sweeps(panes, answer, f"{reading}; bands: {span(f.trials)}.")}


def seen(run: Run[s.Settings]) -> Seen:
    """The first trial's arm amid the errors of joint springs and of what cross-validation chose."""
    cell, rows = build_cell(find_arm(run.settings.arm_of(run.seeds[0]))), run.first
    rows = rows.pick(np.array([own is not None for own in rows["q_rad"]]))
    q = np.reshape(rows["q_rad"][0], (-1, cell.arm.n_joints))
    off = {
        name: np.reshape(own, (len(q), -1, 3))[:, 0] / UM
        for name, own in zip(rows["name"], rows["off_um"], strict=True)
    }
    return amid_errors(cell, q, [str(k + 1) for k in range(len(q))], off, LOOKS)


STUDY = Study(
    name=s.NAME,
    about="Calibrate simulated arms by absolute readings: what hides, how many poses, what loaded pairs add.",
    options=s.Options,
    settings=s.settings,
    seeds=(100, s.QUICK),
    arms=lambda asked: [find_arm(name) for name in asked.arms],
    row=s.FitRow,
    trials=s.trials,
    report=report,
    printed=("short",),
    figures=figures,
    write=seen,
)
