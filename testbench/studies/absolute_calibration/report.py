"""What the trials say: error by number of poses, what hides behind what, what a mixed campaign gains."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from testbench.arm.catalogue import find_arm
from testbench.bench.absolute import Calibrated
from testbench.bench.campaign import build_cell
from testbench.bench.rows import UM
from testbench.commands.calibrate import seen
from testbench.commands.calibrate_numbers import left_of
from testbench.data.series_csv import write_series
from testbench.errors import Array
from testbench.identify.absolute.fit import explain
from testbench.report.columns import columns
from testbench.report.report import Report, lines, say
from testbench.report.table import Row, Trials, find, number, paired
from testbench.studies.absolute_calibration.figure import curves
from testbench.studies.absolute_calibration.settings import (
    ABSOLUTE,
    ALL,
    BY_POSES,
    CAMPAIGN,
    CHOSEN,
    GEARS,
    GEOMETRY,
    HIDING,
    INCUMBENT,
    JOINTS_ONLY,
    LINKS,
    MIXED,
    MODELS,
    NAME,
    NO_GEARS,
    REAL,
    TRUE_ARMS,
    Settings,
)
from testbench.studies.absolute_calibration.trial import Asked, measure
from testbench.studies.study import Run
from testbench.trials.spread import spread
from testbench.views.figure import Figure
from testbench.views.markdown import Markdown, counted
from testbench.views.page.page import Seen
from testbench.views.schema import Table, pivot

PARTS = ("positions", "geometry", "joint_errors", "joints", "entries")  #: Of what should lie in its interval.
INSIDE = " ".join(f"inside.{part}_percent" for part in PARTS)
BY_NUMBER = f"name arm poses trials error_mm over_optimum {INSIDE}"
HIDDEN = (
    "name arm true_arm error_mm bias_2_percent off_2_percent bias_3_percent off_3_percent geometry_off "
    f"{INSIDE.rpartition(' ')[0]} gears_kept_percent links_kept_percent"
)
CAMPAIGNS = "campaign arm poses readings name error_mm loaded_mm off_2_percent off_3_percent"
READING = Markdown(
    "![absolute_calibration](absolute_calibration.png)\n\n"
    "A fit of everything has what the true arm has. What cross-validation chooses may lack the links: their "
    "bending is then in the springs of the joints, whose intervals do not count it. The noise-only optimum "
    "knows how large geometric errors, joint errors and noise are, which orders there are, and compliances "
    "to 30 % of the truth."
)
OF_INTERVALS = Markdown(
    "Inside: shares over all numbers of all trials. Joint errors: coefficients of the orders that the arm "
    "has. Joint compliances: with the link before, about the joint's axis. Entries of C are inside less "
    "often: readings tell few of them, and the prior that fills the others is wrong. Geometric errors that "
    "readings cannot tell one from another have the interval of their learnt prior; they are counted."
)
OF_HIDING = Markdown(
    "c2, c3: compliance of joint 2 and 3 with the link before. Geometry off: RMS error along the "
    "combinations of geometric errors that the fit of everything knows to 0.1 mm or mrad. True arms: "
    + "; ".join(f"{name}: {true.words}" for name, true in TRUE_ARMS.items())
    + "."
)
OF_CAMPAIGNS = Markdown(
    "A pair is a pose read unloaded and under the payload; absolute readings are under own weight alone."
)


def report(asked: Settings, seeds: range, trials: Trials) -> Report:
    """By arm, true arm, campaign, number of poses and model."""
    real = trials.where(true_arm=REAL)
    alone = real.where(campaign=ABSOLUTE, name=BY_POSES)
    featured = trials.where(campaign=ABSOLUTE, poses=asked.featured, name=HIDING)
    campaigns = real.where(readings=asked.featured, name=CAMPAIGN)
    arms = [arm for arm in asked.arms if arm in trials.values("arm")]
    f = Row(
        seed=list(seeds) if len(seeds) > 1 else seeds[0],
        trials=len(seeds),
        arms=arms,
        featured=asked.featured,
        true_arms={name: true.words for name, true in TRUE_ARMS.items()},
        gains=[_gains(arm, alone.where(arm=arm, poses=asked.featured)) for arm in arms],
        models=_rows(asked, alone, "poses"),
        hiding=_rows(asked, featured, "true_arm"),
        campaigns=_rows(asked, campaigns, "campaign"),
        dataset=Row(runs=asked.featured, points=asked.featured, sigma_um=UM * TRUE_ARMS[REAL].sigma),
    )
    tables = _tables(f)
    body = [READING, *(f"poses, {arm}" for arm in arms), "models", OF_INTERVALS, "hiding", OF_HIDING]
    return Report(
        scenario=NAME,
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
            "Worst under the payload, which was not read: {own}.",
            "{arm} {chosen.loaded_mm:~.3f} mm, joint springs {springs.loaded_mm:~.3f} mm",
        ),
        claims=[_each(f, *claim) for claim in CLAIMS],
        numbers=f,
        tables=tables,
        body=[*body, "campaigns", OF_CAMPAIGNS],
    )


def _rows(asked: Settings, trials: Trials, second: str) -> list[Row]:
    """A row by arm, then by a second column as it comes, then by model."""
    by = ("arm", second, "name")
    rows = [_told(Row(zip(by, key, strict=True)), own) for key, own in trials.groups(*by)]
    places = {"arm": asked.arms, second: trials.values(second), "name": [*MODELS]}
    return sorted(rows, key=lambda row: [places[name].index(row[name]) for name in by])


def _gains(arm: str, own: Trials) -> Row:
    """What cross-validation chooses on one arm from the featured poses, trial by trial."""
    springs, geometry = (paired(own, CHOSEN, theirs, "error_mm") for theirs in (INCUMBENT, GEOMETRY))
    return Row(arm=arm, springs=springs, geometry=geometry)


def _inside(own: Trials) -> Row:
    """How many numbers lie in their 95 % intervals, over all trials; None where the model has none."""
    found = Row()
    for part in PARTS:
        count, inside = (np.nansum(own[f"{part}.{name}"].astype(float)) for name in ("of", "inside"))
        found[f"{part}_percent"] = 100 * inside / count if count else None
    return found


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _told(key: Row, own: Trials) -> Row:
    """What a model makes of some true arms and a campaign, over their trials."""
    found = Row(key, trials=len(own), inside=_inside(own))
    found |= {name: number(own[name]) for name in ("poses", "readings")}
    for name in ("error_mm", "loaded_mm", "optimum_mm", "geometry_off"):
        found[name] = None if np.isnan(own[name]).any() else spread(own[name])
    found["over_optimum"] = _rms(own["error_mm"] / own["optimum_mm"])
    for name, part in (("gears", GEARS), ("links", LINKS)):
        share = 100 * np.mean([part in kept for kept in own["kept"]])
        found[f"{name}_kept_percent"] = share if key.name == CHOSEN else None
    off = 100 * np.array([cells[1:3] for cells in own["compliance_off"]])
    for joint, shares in zip((2, 3), off.T, strict=False):  # none of a rigid arm
        found[f"bias_{joint}_percent"] = float(np.median(shares))
        found[f"off_{joint}_percent"] = _rms(shares)
    return found


def _tables(f: Row) -> dict[str, Table]:
    """Errors by number of poses and arm, intervals, what hides, campaigns."""
    name, arm, poses, error = columns("name arm poses error_mm")
    featured = [row for row in f.models if row.poses == f.featured]
    title = f"RMS error where nothing was measured, {f.featured} poses, own weight, mm"
    by_poses = {
        own: Table((), [row for row in f.models if row.arm == own], f"error by number of poses, {own}, mm")
        for own in f.arms
    }
    return {
        "short": pivot(Table((), featured, title), name, arm, error),
        **{
            f"poses, {own}": pivot(table, name, replace(poses, unit="poses"), error)
            for own, table in by_poses.items()
        },
        "models": Table(columns(BY_NUMBER), f.models, "Intervals"),
        "hiding": Table(columns(HIDDEN), f.hiding, f"Which errors hide behind which, {f.featured} poses"),
        "campaigns": Table(columns(CAMPAIGNS), f.campaigns, f"Campaigns of {f.featured} readings"),
    }


def _answer(f: Row) -> Iterator[str]:
    """What cross-validation chooses beside joint springs, arm by arm."""
    for gain in f.gains:
        yield say(
            "On {arm}, {n} poses: the model chosen by cross-validation errs {it.ours_mm:~.3f} mm, joint "
            "springs {it.theirs_mm:~.3f} mm, {it:less}.",
            gain,
            n=f.featured,
            it=gain.springs,
        )


def _each(f: Row, sentence: str, part: str) -> Markdown:
    """A sentence whose {own} is said of every arm, of its rows by name."""
    own = [say(part, _of_arm(f, arm)) for arm in f.arms]
    return say(sentence, n=f.featured, own=Markdown("; ".join(own)))


def _of_arm(f: Row, arm: str) -> Row:
    """Rows that sentences speak of, from the featured poses."""
    by_poses = {"geometry": GEOMETRY, "springs": INCUMBENT, "chosen": CHOSEN}
    hidden = {
        "unseen": (NO_GEARS, INCUMBENT),
        "stiff": (JOINTS_ONLY, INCUMBENT),
        "without": (NO_GEARS, CHOSEN),
    }
    return Row(
        {key: find(f.models, arm=arm, poses=f.featured, name=name) for key, name in by_poses.items()},
        arm=arm,
        alone=find(f.campaigns, arm=arm, campaign=ABSOLUTE, name=ALL),
        mixed=find(f.campaigns, arm=arm, campaign=MIXED, name=ALL),
        **{key: find(f.hiding, arm=arm, true_arm=true, name=name) for key, (true, name) in hidden.items()},
    )


CLAIMS = (
    ("Geometry alone errs {own}.", "{geometry.error_mm:~.3f} mm on {arm}"),
    ("The error over the least that noise allows is {own}.", "{chosen.over_optimum:.2f} times on {arm}"),
    (
        "Inside their 95 % intervals lie {own}.",
        "{chosen.inside.positions_percent:.0f} % of positions, {chosen.inside.joints_percent:.0f} % of joint "
        "compliances ({arm})",
    ),
    (
        "Joint errors that a model lacks hide in its springs: joint 2's compliance is {own}.",
        "{stiff.off_2_percent:.0f} % off on {arm}",
    ),
    (
        "{n} readings, under the payload, absolute alone and mixed with loaded pairs: {own}.",
        "{alone.loaded_mm:~.3f} and {mixed.loaded_mm:~.3f} mm ({arm})",
    ),
    (
        "Arms without joint errors: cross-validation keeps them in {own}.",
        "{without.gears_kept_percent:.0f} % of the trials ({arm})",
    ),
    (
        "Links that a model lacks hide in its springs, too: joint 2's compliance is {own} (medians).",
        "{unseen.bias_2_percent:+.0f} % off on {arm}",
    ),
)
"""What else there is to say, what matters most first: a sentence, and what it says of every arm."""


def figures(found: Report) -> dict[str, Figure]:
    """Error by number of poses, what hides behind what, and what a mixed campaign gains."""
    return {"absolute_calibration.png": curves(Row(found.numbers))}


def write(run: Run[Settings]) -> Seen:
    """dataset.csv: the campaign of the first trial; what is drawn: how cross-validation explains it."""
    seed = run.seeds[0]
    cell = build_cell(find_arm(run.settings.arm_of(seed)))
    own = measure(cell, Asked(REAL, ABSOLUTE, run.settings.featured), seed)
    write_series(run.folder / "dataset.csv", cell.arm, own.series)
    found = Calibrated(explain(own.gathered, MODELS[CHOSEN]), own.series, ())
    return seen(cell, found, left_of(found))
