"""testbench plan ARM --task TASKS --load KG, or --absolute: the poses to measure, and what they promise."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import typer

from testbench.arm.folder import find_arm
from testbench.errors import BenchError
from testbench.model.load import weight
from testbench.report import terminal
from testbench.report.badge import ratio
from testbench.report.markdown import Markdown, capital, listed
from testbench.report.planned_poses import looks_of_plans, poses_for_terminal, seen
from testbench.report.report import Report, RunRequest, bullets, say, write_run
from testbench.report.schema import Table, TableColumn, columns
from testbench.report.table import Row
from testbench.runs.spread import Spread
from testbench.runs.whole import claim_folder
from testbench.workflows.cell import build_cell
from testbench.workflows.model_names import row_words
from testbench.workflows.options import Force, absolute_alone, of_flag, overload_warnings, takes
from testbench.workflows.plan import plan_absolute, plan_for
from testbench.workflows.plan_input import read_tasks
from testbench.workflows.plan_numbers import CURVE, numbers, write_poses, write_tasks
from testbench.workflows.plan_settings import (
    AbsolutePlanOptions,
    PlanOptions,
    known_before,
    pull_words,
    settings_of,
    structure,
)

COMMAND = "testbench plan"  #: As manifest.json names it.
MAX_ROWS, WORST_TASKS = 40, 5  #: Rows of the plan that the report shows, tasks of the largest errors.
AROUND = (
    TableColumn("name", "model"),
    TableColumn("typical_mm", "expected error, RMS", "mm", none="no bound"),
    TableColumn("worst_mm", "largest", "mm"),
    TableColumn("place", "place of the largest error, m"),
    TableColumn("joints", "joint angles there"),
)
SINGLE = TableColumn("quantity", "quantity"), TableColumn("value", "value", form=",.5g")
FILLED = (
    TableColumn("joint", "joint"),
    TableColumn("unread_percent", "without a reading", "%", ".0f"),
    *columns("poses"),
)
LIMITS = (
    TableColumn("joint", "joint"),
    TableColumn("margin", "distance", form=".1f"),
    TableColumn("unit", "unit"),
)
MEANS = Markdown("What tables, columns and warnings mean: docs/planning.md, *The report*.")
HIDDEN = 0.5  #: Share of the expected error that no load reduces, above which a warning names it.


@dataclass(frozen=True)
class PlanOutputs:
    """Say where the plan goes."""

    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder of the plan.")] = Path("runs/plan")
    force: Force = False


@takes(PlanOptions, AbsolutePlanOptions, PlanOutputs, draws=True)
def command(asked: PlanOptions, absolute: AbsolutePlanOptions, where: PlanOutputs) -> None:
    """Choose the poses, judge them, write the folder of the plan."""
    absolute_alone(absolute)
    if not absolute.absolute and asked.task is None:
        raise BenchError("--task: expected a CSV of tasks, or --absolute")
    folder, out = find_arm(asked.arm), where.out
    given = [folder, *(absolute.given or []), *filter(None, [asked.task, asked.mapping])]
    with claim_folder(out, COMMAND, own=frozenset(), inputs=given, force=where.force):
        cell = replace(build_cell(asked.arm), floor=asked.floor_z)
        settings = settings_of(cell, asked, absolute)
        with of_flag("--model"):
            structure(cell, settings.model)  # refused here, not after the search
        console = terminal.plain_console()
        tasks = asked.task and read_tasks(
            asked.task, cell, weight(cell.vjm, settings.loads_kg[0]), asked.mapping
        )
        for doubt in overload_warnings(cell.arm, (0.0, *settings.loads_kg), settings.pulls_n):
            console.print(f"Warning: {doubt}", soft_wrap=True)
        known = None if tasks else known_before(cell, asked, absolute)
        made = plan_for(cell, settings, tasks) if tasks else plan_absolute(cell, settings, known)
        f, joints = numbers(made), cell.arm.file_joints
        said = report(f)

        def more(place: Path) -> None:
            write_poses(f, joints, place / "plan.csv")
            if tasks:
                write_tasks(f, joints, place / "tasks_expected.csv")

        flags = {"arm": f.arm, **({"task": asked.task.name} if asked.task else {}), **vars(settings)}
        seeds, title = range(f.seed, f.seed + 1), f"{f.arm}, {f.poses} poses"
        left = RunRequest(COMMAND, f.arm, flags, [folder], "plan.png", seeds, more, stem="plan", map=title)
        write_run(out, left, said, seen(made, f))
        console.print(terminal.as_plain(said.title))
        beside = f", {out / 'tasks_expected.csv'}" if tasks else ""
        lines = [
            f"plan       {out / 'plan.csv'}, all {settings.poses} poses; report {out / 'plan.md'}",
            f"numbers    {out / 'plan.json'}{beside}",
            f"figures    {out / 'plan.png'}, {out / 'error_map.png'}",
            *terminal.viewing_lines(out, absolute.given or (), arm=asked.arm),
        ]
        terminal.print_words(
            console, said, [poses_for_terminal(said), said.tables["beside"]], lines, "in plan.md"
        )


def report(f: Row) -> Report:
    """Report a plan from its numbers."""
    where = "over the workspace" if f.absolute else "at the tasks"
    hung = [f"{kg:g} kg" for kg in f.loads_kg]
    loads = " or ".join([*hung, *map(pull_words, f.pulls_n)])
    loads = ", then ".join(["own weight", *hung]) if f.absolute else loads
    tables = {name: table for name, table in _tables(f, where).items() if table.rows}
    unknown = [Markdown("## What the plan does not determine"), bullets(f.hidden)] if f.get("hidden") else []
    return Report(
        scenario="plan",
        question=Markdown("Which poses should be measured?"),
        title=say("Calibration plan: {arm}, {words}, {loads}", f, words=row_words(f.model), loads=loads),
        answer=say(
            f"Expected error {where}: {{expected:.3f}} mm, {_beside_random(f)}. "
            "90 % interval: {p05:.3f} to {p95:.3f} mm.",
            vars(f.error_mm),
        ),
        claims=list(_warnings(f)),
        numbers=f,
        tables=tables,
        body=[*tables, *unknown, MEANS],
    )


def _beside_random(f: Row) -> str:
    """Compare the expected error of the plan with that of random poses."""
    plans = f.random_plans.plans
    least = f.random_plans.median_mm
    expected = f.error_mm.expected
    if least is None:
        return f"where random poses give no bound (median of {plans} plans)"
    times = least / expected
    size = f"{ratio(max(times, 1 / times))}x {'lower' if times >= 1 else 'higher'} than"
    return f"{size} with random poses (median of {plans} plans: {least:.3f} mm)"


def _tables(f: Row, where: str) -> dict[str, Table]:
    """Tabulate the poses, plans beside this one, tasks, the workspace, directions, joints and candidates."""
    rows = [
        Row(r, error_there_mm=Spread(r.expected_error_mm, r.expected_error_p05_mm, r.expected_error_p95_mm))
        for r in (*f.plan[:MAX_ROWS], *f.get("tasks", ()))
    ]
    plan, tasks = rows[: len(f.plan[:MAX_ROWS])], rows[len(f.plan[:MAX_ROWS]) :]
    worst = sorted(tasks, key=lambda row: -float(row.expected_error_mm))[:WORST_TASKS]
    moved = "expected_sag_mm" if f.absolute else "load expected_deflection_mm"
    slid = "travel_mm" if "mm" in f.units else ""
    joints = [
        TableColumn(f"q_shown.{k}", name, unit, ".2f", short=f"q{k + 1}\n{unit}")
        for k, (name, unit) in enumerate(zip(f.joints, f.units, strict=True))
    ]
    placed = "gauges" if f.get("gauges") else "face" if "face" in f.plan[0] else ""
    head = (*columns("run"), *joints, *columns(f"{moved} error_there_mm travel_deg {slid} way {placed}"))
    over = TableColumn("mm", f"expected error {where}", "mm", none="no bound")
    return {
        "beside": Table(
            (TableColumn("what", "plan"), over),
            f.beside,
            "This plan and others",
            looks=looks_of_plans(f.beside),
        ),
        "poses": Table(head, plan, "Poses in the order of measuring", headline="error_there_mm"),
        "tasks": Table(
            columns("task expected_deflection_mm error_there_mm"), worst, "Tasks with the largest errors"
        ),
        "curve": Table(columns(CURVE), f.curve, f"Expected error {where} by the number of poses"),
        "around": Table(AROUND, f.around, "Expected error over the workspace"),
        "rests": Table(SINGLE, f.rests, "Assumptions and numbers of the plan"),
        "limits": Table(LIMITS, f.limits, "Smallest distance of each joint from its limits"),
        "filled": Table(FILLED, f.get("filled", []), "Joint ranges without an earlier reading"),
        "candidates": Table(SINGLE, f.refused, "Candidate poses: feasible, drawn, and refused by reason"),
    }


def _warnings(f: Row) -> Iterator[Markdown]:
    """List what must not be overlooked before anybody measures; `docs/planning.md` says what each means."""
    if f.tracker_m is None and not f.gauges and not f.instruments:
        yield Markdown("**Visibility was not checked**: add `--tracker x,y,z`.")
    if f.blocked:
        yield say(
            "**The straight path collides** on the way to run {runs:list}: add a pose in between.",
            runs=[str(run) for run in f.blocked],
        )
    if not f.surrounded:
        yield Markdown("**No floor is known**: `--floor-z METRES` adds one.")
    if f.pulls_n:
        yield Markdown("**Collisions of a pulling rope were not checked.**")
    yield from () if f.absolute else _of_tasks(f)


def _of_tasks(f: Row) -> Iterator[Markdown]:
    """List what a plan for tasks leaves open."""
    if u := f.unloaded:
        size = "no bound" if u.error_mm is None else f"{u.error_mm:.3f} mm"
        force = (
            ""
            if u.force_N is None
            else f". Expected error at the tasks under ({', '.join(f'{x:.0f}' for x in u.force_N)}) N: {size}"
        )
        yield say(
            "**No load of this plan has a moment about {joints:list}**{force}.", joints=u.joints, force=force
        )
    if u := f.unshown:
        pull = ",".join(f"{x:g}" for x in u.pull_N) if u.pull_N else ""
        yield say(
            "**The tasks have a moment about {joints:list}, the planned loads have none**. "
            + (
                "Add `--pull {pull}`, which loads {turned:list}."
                if pull
                else "No force at the load point can load these joints."
            ),
            u,
            pull=pull,
            turned=u.turned_by_pull,
        )
    if f.directions.hidden_mm > HIDDEN * f.error_mm.expected:
        yield say(
            "**{hidden_mm:.3f} mm of the expected error depends only on the prior**. No pose can reduce it.",
            f.directions,
        )
    for law in f.open_laws:
        by = f" {capital(law.by)} in each pose would determine it for {listed(law.told)}." if law.by else ""
        yield say(
            "**{kind} is not determined** for {joints:list}.{by}",
            law | {"kind": law.kind.capitalize(), "by": by},
        )
    if f.joints_alone_mm <= f.error_mm.expected:
        yield Markdown("**The expected error of Joints-only is no larger here.**")
