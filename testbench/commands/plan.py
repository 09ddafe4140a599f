"""What `testbench plan` writes and says: the poses to measure, in their order, and what they promise."""

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from testbench.arm.folder import Arm
from testbench.campaign.plan import Planned
from testbench.campaign.plan_settings import pull_words
from testbench.campaign.predicted_error import Unloaded
from testbench.commands.plan_drawn import seen, write_poses, write_tasks
from testbench.commands.plan_numbers import CURVE, spread_rows
from testbench.report.columns import columns
from testbench.report.leave import Asked, leave
from testbench.report.report import Report, bullets, lines, say
from testbench.report.table import Row
from testbench.views.markdown import Markdown, listed
from testbench.views.schema import Column, Table

COMMAND = "testbench plan"  #: As manifest.json names it.
MOST_ROWS = 40  #: Rows of the plan that are shown; plan.csv has all of them.
MANY = 6  #: With more joints, or pulls, a terminal of 80 columns has no decimals and no travel.
WORST = 5  #: Tasks that are shown, those of the largest errors.
HIDDEN = 0.5  #: Share of the expected error that no load reduces, above which that is said aloud.
NOTHING = "Nothing: of every quantity the readings leave less than half of its prior variance."


def write(made: Planned, said: Report, arm: Path, task: Path | None, out: Path) -> None:
    """The folder of a plan; InputError when it cannot be written."""
    f, joints, asked = Row(said.numbers), made.cell.arm.file_joints, vars(made.settings)
    flags = {"arm": made.cell.arm.name, **({"task": task.name} if task else {}), **asked}

    def more(folder: Path) -> None:
        write_poses(f, joints, folder / "plan.csv")
        if task:
            write_tasks(f, joints, folder / "tasks_expected.csv")

    seeds, title = range(f.seed, f.seed + 1), f"{f.arm}, {f.poses} poses"
    own = Asked(COMMAND, f.arm, flags, [arm], "plan.png", seeds, more, stem="plan", map=title)
    leave(out, own, said, seen(made, said))


def report(f: Row, arm: Arm) -> Report:
    """What there is to say of a plan of an arm, from its `numbers`."""
    absolute = f.absolute
    middle = [Markdown("## What stays unknown"), bullets(f.hidden or [NOTHING])] if absolute else ["tasks"]
    if f.given:
        middle = []
    rests = bullets([*(_of_absolute(f) if absolute else _of_pairs(f)), *_of_both(f)])
    after = [Markdown("## What this rests on"), rests]
    return Report(
        scenario="plan",
        question=Markdown("Which poses to read absolutely?" if absolute else "Which poses to measure?"),
        title=_title(f),
        answer=lines(_answer(f)),
        worst=_worst(f, arm),
        claims=[*_warnings(f), *(_absolute_claims(f) if absolute else _claims(f))],
        numbers=f,
        tables=_tables(f),
        body=["poses", _about_poses(f), *middle, "curve", *after],
    )


def _title(f: Row) -> Markdown:
    masses = [f"{kg:g} kg" for kg in f.loads_kg]
    if f.absolute:
        loads = ", then ".join(["own weight", *masses])
        return say("Plan of absolute readings: {arm}, {model}, {loads}", f, loads=loads)
    loads = " or ".join([*masses, *map(pull_words, f.pulls_n)])
    return say("Calibration plan: {arm}, {model}, {loads}", f, loads=loads)


def _answer(f: Row) -> Iterator[str]:
    what, where = ("position error", "over the workspace") if f.absolute else ("error", "at the tasks")
    alone = "; joint stiffness only leaves {joints_alone_mm:.3f} mm"
    if f.absolute:
        alone = "" if f.given else "; with joint errors beyond order {orders}, up to {all:.3f} mm"
    yield say(
        f"{{poses:counted pose}} {'leaves' if f.poses == 1 else 'leave'} an expected {what} of "
        f"{{error_mm.expected:.3f}} mm {where} (90 %: {{error_mm.p05:.3f}} to {{error_mm.p95:.3f}}){alone}.",
        f,
        all=math.hypot(f.error_mm.expected, f.beyond_mm) if f.absolute else 0.0,
    )
    if u := f.get("unloaded"):
        yield _unloaded(u, f.error_mm.expected)
    chance, own = f.random_plans, f.random_plans.get("planned_mm", f.error_mm.expected)
    certified = "" if f.given else "; this plan is at least {percent} % efficient{by}"
    same = math.isclose(own, f.error_mm.expected, rel_tol=0.01)
    median = "The median of {plans} random plans leaves {median}"
    if not same:
        median = "Were the arm {model} alone: {own:.3f} mm, the median of {plans} random plans {median}"
    yield say(
        f"{median}{certified}.",
        f,
        own=own,
        plans=chance.plans,
        median=_bound(chance.median_mm),
        percent=math.floor(100 * f.certificate.efficiency),
        by="" if f.criterion == ("I" if f.absolute else "test") else f" by criterion {f.criterion}",
    )


def _unloaded(u: Unloaded, expected_mm: float) -> Markdown:
    """Which joints no load of the plan turns, and what that costs beside the error at the tasks."""
    depends = "what depends on {it} rests on the prior alone"
    if u.force_N is not None:
        axis = int(np.argmax(np.abs(u.force_N)))
        force = f"a force of {abs(u.force_N[axis]):g} N along {'xyz'[axis]}"
        known = "without a bound" if u.error_mm is None else f"to {u.error_mm:.3f} mm"
        depends = f"{force} at the tasks, which turns {{it}}, is predicted {known}, not {expected_mm:.3f} mm"
    return say(
        f"No load of this plan turns {{joints:list}}: {depends}.",
        joints=u.joints,
        it="it" if len(u.joints) == 1 else "them",
    )


def _bound(mm: float | None) -> str:
    return "no bound" if mm is None else f"{mm:.3f} mm"


def _worst(f: Row, arm: Arm) -> Markdown:
    if f.absolute:
        worst = f.map.worst[f.map.compared[-1]]
        where = (
            "Worst over the workspace at {position_m:place}: {error_mm:.3f} mm expected. Joints at {joints}."
        )
        return say(where, vars(worst))
    row = _worst_tasks(f)[0]
    return say(
        "Worst in task {task}, tool at {tool_m:place}: {expected_error_mm:.3f} mm expected of "
        "{expected_deflection_mm:.2f} mm. Joints at {joints}.",
        row,
        joints=arm.words(arm.from_shown(np.array(row.q_shown))),
    )


def _worst_tasks(f: Row) -> list[Row]:
    return sorted(f.tasks, key=lambda row: -float(row.expected_error_mm))


def _warnings(f: Row) -> Iterator[Markdown]:
    """What must not be overlooked before anybody measures."""
    if f.tracker_m is None:
        yield say("**Visibility was NOT checked**: no `--tracker x,y,z` was given.")
    if f.blocked:
        runs = listed([str(run) for run in f.blocked])
        word = "run" if len(f.blocked) == 1 else "runs"
        yield say(f"**The straight way collides** before {word} {runs}: go via a pose in between.")
    if not f.surrounded:
        yield say(
            "**No floor**: rigid.xml has none, so poses below the mount are not refused. "
            "`--floor-z METRES` adds one."
        )


def _claims(f: Row) -> Iterator[Markdown]:
    """What else there is to say of a plan for tasks."""
    a, hidden = f.advice, f.directions.hidden_mm
    if u := f.unshown:
        pull = ",".join(f"{x:g}" for x in u.pull_N or ())
        turned = (
            f"`--pull {pull}` would turn {{turned:list}}." if pull else "No force at the load point does."
        )
        yield say(
            "**No load turns {joints:list}**, the tasks do: of {error:.3f} mm expected there {hidden:.3f} mm "
            f"stay open, whatever is measured. {turned}",
            joints=u.joints,
            turned=u.turned_by_pull,
            error=f.error_mm.expected,
            hidden=hidden,
        )
    elif hidden > HIDDEN * f.error_mm.expected:
        yield say(
            "**{hidden:.3f} mm of the error rest on the prior alone**, whatever is measured: these loads do "
            "not show all directions in which the tasks' loads move the arm.",
            hidden=hidden,
        )
    for law in f.open_laws:
        kind, joints = law.kind.capitalize(), law.joints
        every = "all joints" if len(joints) == len(f.joints) else listed(joints)
        told = "No reading examined tells it."
        if law.by is not None:
            told = f"One more reading in every pose tells that of {{told:list}}: {law.by}."
            told += " No reading examined tells that of {never:list}." if law.never else ""
        yield say(f"**{kind} of {{every}} stays mostly open.** {told}", vars(law), every=every)
    if f.pulls_n:
        yield say(
            "**No rope was checked**: a pull is a force at the load point in world axes. In every pose the "
            "weight would hang clear."
        )
    if f.joints_alone_mm <= f.error_mm.expected:
        yield say("**Joint stiffness only is no worse here.**")
    reach = "{fewest:counted pose} {reach} {target_mm:g} mm at the tasks."
    if a.fewest is None:
        reach = "No plan of up to {examined_up_to} poses reaches {target_mm:g} mm at the tasks."
    more = "From {enough} on, {more} more bring less than {little_percent:g} %."
    if a.enough is None:
        more = "Up to {examined_up_to} poses, {more} more always bring {little_percent:g} % or more."
    yield say(f"{reach} {more}", a, reach="reaches" if a.fewest == 1 else "reach")
    yield say(
        "A deflection along an axis at the tasks is known to +- {half_width_95_mm:.3f} mm (95 %, median).", f
    )


def _absolute_claims(f: Row) -> Iterator[Markdown]:
    if f.given:
        ranges = [f"{row.joint} {row.unread_percent:.0f} % ({row.poses})" for row in f.filled]
        yield say(
            "Expected now: {before_mm:.3f} mm, frame and target fitted. Not read yet, and poses of the plan "
            "that go there: {ranges:list}.",
            f,
            ranges=ranges,
        )
        return
    own, chance = (math.hypot(mm, f.beyond_mm) for mm in (f.error_mm.expected, f.random_plans.median_mm))
    yield say(
        "What joints do beyond order {orders} adds {beyond_mm:.3f} mm at the targets, of which a calibration "
        "of more orders finds a part. With all of it: {own:.3f} mm, from random poses {chance:.3f} mm.",
        f,
        own=own,
        chance=chance,
    )


def _tables(f: Row) -> dict[str, Table]:
    """The poses, the worst tasks, errors by the number of poses."""
    absolute = f.absolute
    moved = "expected_sag_mm" if absolute else "load expected_deflection_mm"
    slid = "travel_mm" if "mm" in f.units else ""
    first, last = columns("run"), columns(f"{moved} error_there_mm travel_deg {slid} way")
    joints = [
        Column(f"q_shown.{k}", name, unit, ".2f", short=f"q{k + 1}\n{unit}")
        for k, (name, unit) in enumerate(zip(f.joints, f.units, strict=True))
    ]
    cut = f": the first {MOST_ROWS}, all are in plan.csv" if len(f.plan) > MOST_ROWS else ""
    where = "over the workspace" if absolute else "at the tasks"
    random = f"beside {f.random_plans.plans} random plans"
    curve = f"How many poses: expected error {where}, each pose the best next one, {random}"
    rows, title = spread_rows(f.plan[:MOST_ROWS]), f"Poses in the order of measuring{cut}"
    found = {
        "poses": Table((*first, *joints, *last), rows, title, headline="error_there_mm"),
        "curve": Table(columns(CURVE), f.curve, curve),
    }
    if not absolute:
        title = f"Tasks of the largest errors: {min(WORST, len(f.tasks))} of {len(f.tasks)}"
        own = columns("task expected_deflection_mm error_there_mm")
        found["tasks"] = Table(own, spread_rows(_worst_tasks(f)[:WORST]), title)
    return found


def printed(said: Report) -> Table:
    """The poses for a terminal, joints in one cell; many of them, or pulls, without decimals and travel."""
    table, f = said.tables["poses"], Row(said.numbers)
    many = len(f.joints) > MANY or bool(f.pulls_n)
    left = {"expected_deflection_mm", "travel_mm", "way" * (not many), "travel_deg" * many}
    first, *others = (c for c in table.columns if c.key not in left and not c.key.startswith("q_shown"))
    own = [
        replace(column, exact=True, heading="error") if column.key == "error_there_mm" else column
        for column in others
    ]
    units = ", ".join(dict.fromkeys(f.units))
    joints = Column("q_told", f"q1 to q{len(f.joints)}", units, short=f"q1 to q{len(f.joints)}\n{units}")
    form = "5.0f" if many else "6.1f"
    told = Column("q_shown", "")
    rows = [
        {**own, "q_told": " ".join(format(q, form) for q in told.value(own))}
        for own in table.rows
        if isinstance(own, Row)
    ]
    return replace(table, columns=(first, joints, *own), rows=rows, title="")


def _about_poses(f: Row) -> Markdown:
    """How to measure, and what the columns are."""
    hang = "hang the weight or pull" if f.pulls_n else "hang the weight"
    how, moved = f"{hang}, read again, take the load off", "*Deflection* is RMS over the markers"
    what = "of predicting it after identification"
    if f.absolute:
        how = ", ".join(f"hang {kg:g} kg, read again" for kg in f.loads_kg)
        moved = "*Sag* is RMS over the targets"
        what = "of the targets' positions after calibration"
    return say(
        f"In each pose: {', '.join(filter(None, ['read all targets', how]))}. {moved}, by the prior. The "
        f"error there is that {what}. *Travel* is that of the joint that moves farthest. *Way*: clear where "
        "all joints can go straight without a weight, via where they cannot."
    )


def _of_pairs(f: Row) -> Iterator[Markdown]:
    """What a plan for tasks rests on."""
    prior = "No prior: what these loads do not show stays unknown, and other loads may move it."
    counts = "{unknowns} unknowns: these loads can show {shown} directions, the plan sees {seen}"
    if f.prior is not None:
        prior = (
            "Prior: {prior}, {uncertainty_percent:g} % uncertain, its common scale left to the data. Were it "
            "twice as uncertain: {error_if_prior_twice_as_uncertain_mm.expected:.3f} mm in place of "
            "{error_mm.expected:.3f}."
        )
        counts += (
            "; in {outweighed} of them the readings say more than the prior. The prior leaves "
            "{prior_share_percent:.0f} % of the mean square error at the tasks, noise the rest"
        )
    yield say(prior, f)
    yield say(f"{counts}.", f.directions)
    tried = "for all links and joints with the prior; what {model} leaves out counts as links of any shape."
    if f.whole_arm and f.prior is not None:
        tried = "on arms that bend, with links off any tube, and with one link or the joints ten times off."
    yield say(
        "The promise is for arms of which every link and joint gives, within {within_percent:g} % of the "
        f"folder. Intervals were tried {tried}",
        f,
    )
    parts = [f"{name} {_bound(f.map.typical_mm(name))}" for name in f.map.worst]
    yield say("Over the workspace, under the first load, it promises {parts:list} (RMS).", parts=parts)
    yield say("Efficiency, random poses and further poses are counted as if the arm were {model} alone.", f)


def _of_absolute(f: Row) -> Iterator[Markdown]:
    """What a plan of absolute readings rests on."""
    if f.given:
        yield say(
            "Expected beforehand: what {given:list} leave of geometry, joint errors and compliances. Frame "
            "and target are new. Each pose is the best next one of those examined.",
            f,
        )
        return
    yield say(
        "Expected beforehand, one standard deviation: {geometry_mm:g} mm and mrad an error of geometry, "
        "{gear_urad:g} urad a coefficient of a joint's periodic errors up to order 30, compliances "
        "{uncertainty_percent:g} % around {prior}, their common scale left to the data.",
        f,
    )
    yield say("Joint errors beyond order {orders} are noise of a pose, common to its readings.", f)


def _of_both(f: Row) -> Iterator[Markdown]:
    """Noise, efficiency, limits, collisions, candidates."""
    turns = ", and as many urad about one" if f.get("orientations") else ""
    yield say(
        f"White noise of {{sigma_um:g}} um on every reading along every axis{turns}. The model is linear: "
        "measure two or three further poses and check on them.",
        f,
    )
    if not f.get("given"):
        yield say(
            "No choice of {poses} among the {examined:,} examined can be better than {times:.3f} times this "
            "plan by criterion {criterion}.",
            f,
            examined=f.certificate.examined,
            times=1 / f.certificate.efficiency,
        )
    margins = [f"{n} {x:.1f} {u}" for n, x, u in zip(f.joints, f.margins, f.units, strict=True)]
    yield say("From their limits the joints stay at least {margins:list}.", margins=margins)
    own = f.candidates
    counts = sorted(((k, n) for k, n in own.rejected.items() if n), key=lambda entry: -entry[1])
    wanted = "" if own.found == f.candidates_wanted else f" of {f.candidates_wanted:,} wanted"
    yield say(
        "{found:counted feasible pose}{wanted} of {drawn:,} drawn evenly over the joint limits. Refused: "
        "{refused}.",
        own,
        wanted=wanted,
        refused=", ".join(f"{reason} {n:,}" for reason, n in counts) or "none",
    )
    yield say("Collisions are those of the shapes in rigid.xml and of a hung weight: no cables, no fixtures.")
