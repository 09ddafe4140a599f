"""What `testbench predict` writes, says and draws: where loads bring the tool, how sure, how stiff it is."""

import csv
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from testbench.arm.folder import Joint
from testbench.campaign.program import Predicted, direction_words, extrapolated
from testbench.campaign.rows import MM
from testbench.campaign.workspace_errors import Meaning, bounded_mm, error_places, places_at
from testbench.correct.rest import rest
from testbench.data.formula import as_cell
from testbench.errors import Array, Ids
from testbench.identify.posterior import CONFIDENCE
from testbench.model.vjm import turns
from testbench.plant.shapes import elastic_frames, rigid_frames
from testbench.report.columns import columns
from testbench.report.leave import Asked, leave
from testbench.report.report import Report, say
from testbench.report.table import Row, finite
from testbench.views.colours import GCO, MEASURED, NOMINAL, Look
from testbench.views.markdown import Markdown, capital, ended
from testbench.views.scene import (
    Layer,
    Line,
    PlaceMap,
    Poses,
    RunChart,
    Scene,
    Seen,
    arrow_scale,
    of_all,
    picked,
    workspace,
)
from testbench.views.schema import Table

COMMAND = "testbench predict"  #: As manifest.json names it.
PICTURE, TABLE = "predict.png", "predictions.csv"
WORST, FEW = 14, 5  #: Poses that the report lists, and those of the terminal.
POSES = (
    "pose deflection_mm half_words deflections_mm.0 deflections_mm.1 deflections_mm.2 turn_mrad "
    "stiffness_n_per_um.0 softest"
)
MOVED_BY, HALF_WIDTH = "moved by the force", "half width, 95 %"  #: What a map tells of a place.
MOVED, GIVE = 0.15, 0.25  #: Length of most deflections and of most ways by a force over the reach [1].
TOOL = Look(GCO, 0, prior=True)


def write(made: Predicted, said: Report, flags: Mapping[str, object], out: Path) -> None:
    """All poses, report, picture, recording, page and manifest.json; InputError when that fails."""
    arm, name = [made.model.arm.rigid.parent], made.asked.path.name
    more = partial(write_predictions, made)
    leave(out, Asked(COMMAND, name, flags, arm, PICTURE, more=more), said, seen(made))


def prediction_columns(joints: Sequence[Joint]) -> list[str]:
    """The header of predictions.csv, in order; docs/formats.md says what each holds."""
    names = ["pose", "line", "point", *(joint.column for joint in joints)]
    names += [f"{axis}_m" for axis in "xyz"]
    names += [f"{what}_{axis}_m" for what in ("position_half_95", "deflection", "half_95") for axis in "xyz"]
    names += [f"rotation_{axis}_rad" for axis in "xyz"]
    return [*names, *(f"stiffness_{k}_N_per_m" for k in (1, 2, 3)), *(f"softest_{axis}" for axis in "xyz")]


def write_predictions(made: Predicted, folder: Path) -> None:
    """predictions.csv: all poses and points; what nothing has seen, and what does not give, is blank."""
    found, tool = made.found, made.stiffness
    of_tool = np.hstack([found.turn, tool.principal, tool.softest])
    parts = (found.position, found.position_half, found.deflection, found.half)
    names = [as_cell(name) for name in made.names]
    with (folder / TABLE).open("w", encoding="utf-8", newline="") as file:
        rows = csv.writer(file, lineterminator="\n")
        arm = made.model.arm
        rows.writerow(prediction_columns(arm.file_joints))
        for k, label in enumerate(made.asked.labels):
            first = [as_cell(label), str(made.asked.line[k])]
            joints, last = [*map(repr, arm.to_file(made.asked.q[k]).tolist())], _cells(of_tool[k])
            for m, name in enumerate(names):
                own = _cells(*(values[k, m] for values in parts))
                rows.writerow([*first, name, *joints, *own, *last])


def _cells(*values: Array) -> list[str]:
    """Ten digits of each, blank where infinite."""
    return [f"{x:.10g}" if np.isfinite(x) else "" for part in values for x in part.tolist()]


def report(made: Predicted) -> Report:
    """What there is to say of a prediction."""
    f = _numbers(made)
    first, one = f.worst[0], f.poses == 1
    moves = "{moved}" if one else "up to {moved}, in pose {pose} of {poses:,}"
    where = "" if one else " in pose {softest.pose}"
    title = "The pose" if one else "Poses that move most"
    return Report(
        scenario="predict",
        question=say("Where does the tool of {arm} go under {loads}, and how stiff is it?", f),
        title=say("Deflection under load: {arm}, {poses:counted pose} of {file}", f),
        answer=say(
            f"Under {{loads}} the tool moves {moves}. It is softest {{softest.softest}}{where}: "
            "{softest.stiffness_n_per_um[0]:.3g} N/um, so that {map.force_n:,.0f} N in that direction move "
            "it by {push}.",
            f,
            pose=first.pose,
            moved=_sure(first.deflection_mm, first.half_mm),
            push=_sure(f.softest.push_mm, f.softest.push_half_mm),
        ),
        worst=say(
            "Worst over the workspace: {force_n:,.0f} N move the tool by {moved}. There, at {at_m:place}, it "
            "is softest {softest}, joints at {joints}.",
            f.map,
            moved=_sure(f.map.worst_mm, f.map.half_mm),
        ),
        claims=list(_claims(f)),
        numbers=f,
        tables={"worst": Table(columns(POSES), f.worst, title, headline="deflection_mm")},
        body=["worst", _about_poses(f), _about_model(f)],
    )


def _numbers(made: Predicted) -> Row:
    """All numbers but those of every pose, which are in predictions.csv."""
    found, size = made.found, MM * made.found.size
    about, extent = made.model.about, made.extent
    return Row(
        arm=made.model.arm.name,
        absolute=made.model.absolute,
        method=about.method,
        file=made.asked.path.name,
        loads=made.asked.words or "no load",
        poses=len(size),
        linear=made.linear,
        confidence_percent=100 * CONFIDENCE,
        least_mm=float(size[:, 0].min()),
        median_mm=float(np.median(size[:, 0])),
        most_mm=float(size[:, 0].max()),
        unseen_percent=float(100 * np.isinf(found.half).any(axis=2).mean()),
        other_off_mm=float(MM * found.apart.max()),
        position_half_mm=finite(MM * np.median(found.position_half[:, 0].max(axis=1))),
        force_n=extent.force,
        moment_nm=extent.moment,
        force_ratio=finite(extent.force_ratio),
        moment_ratio=finite(extent.moment_ratio),
        extrapolated=extrapolated(extent),
        doubts=about.doubts,
        notes=made.asked.notes,
        softest=_pose(made, int(made.stiffness.give[:, 0].argmax())),
        worst=[_pose(made, int(k)) for k in made.worst_first[:WORST]],
        map=_map(made),
    )


def _pose(made: Predicted, k: int) -> Row:
    """How far its loads move the tool in a pose, by its number from 0, and how stiff the tool is there.

    None where the data of the model see nothing, or where nothing gives. Half widths are the widest along x,
    y, z. `push_mm` is how far the force of the map moves the loaded tool in its softest direction; its half
    width is that of this force.
    """
    found, asked, direction = made.found, made.asked, made.stiffness.softest[k]
    half = finite(MM * found.widest[k, 0])
    return Row(
        pose=asked.labels[k],
        line=int(asked.line[k]),
        joints=made.model.arm.words(asked.q[k]),
        tool_m=found.position[k, 0].tolist(),
        deflection_mm=float(MM * found.size[k, 0]),
        deflections_mm=(MM * found.deflection[k, 0]).tolist(),
        half_mm=half,
        half_words="not seen" if half is None else f"{half:.3f}",
        halves_mm=[finite(x) for x in MM * found.half[k, 0]],
        turn_mrad=float(1e3 * np.linalg.norm(found.turn[k])),
        stiffness_n_per_um=[finite(x) for x in 1e-6 * made.stiffness.principal[k]],
        softest=direction_words(direction),
        softest_direction=direction.tolist(),
        push_mm=float(MM * made.map.force * made.stiffness.give[k, 0]),
        push_half_mm=finite(MM * made.push_half(k)),
    )


def _map(made: Predicted) -> Row:
    """The worst deflection under a force in any direction, over poses of the workspace, the softest first."""
    found = made.map
    worst: Array = MM * found.worst
    at = places_at(made.model.arm, found.q, found.position, found.worst)
    values = {MOVED_BY: bounded_mm(found.worst), HALF_WIDTH: bounded_mm(found.half.max(axis=1))}
    words = f"of the tool by {found.force:,.0f} N in the worst direction, and its half width, 95 %"
    return Row(
        force_n=found.force,
        places=len(worst),
        median_mm=float(np.median(worst)),
        p95_mm=float(np.percentile(worst, 95)),
        worst_mm=float(worst[0]),
        half_mm=finite(MM * found.half[0].max()),
        unseen_percent=float(100 * np.isinf(found.half).any(axis=1).mean()),
        at_m=found.position[0].tolist(),
        joints=made.model.arm.words(found.q[0]),
        softest=direction_words(found.direction[0]),
        errors=error_places(at, values, [MOVED_BY], Meaning("movement", words, "median")),
    )


def _sure(value: float, half: float | None) -> Markdown:
    """A number [mm] with its interval, and what that is worth."""
    if half is None:
        return say("{value:.3f} mm, which the data do not determine", value=value)
    hardly = ", which the data hardly determine" if 2 * half > value else ""
    return say(f"{{value:.3f}} mm +- {{half:.3f}} mm{hardly}", value=value, half=half)


def _claims(f: Row) -> Iterator[Markdown]:
    for text in (*f.notes, *f.extrapolated):
        yield say("**{text}**.", text=capital(text))
    yield say(
        "**{force_n:,.0f} N in the worst direction** move the tool by {median_mm:.3f} mm (median) over "
        "{places:counted pose} of the workspace.",
        f.map,
    )
    if f.unseen_percent:
        yield say("**Not seen**: {unseen_percent:.0f} % of the deflections have no interval.", f)
    if f.map.unseen_percent:
        yield say(
            "**Not seen**: in {unseen_percent:.0f} % of these poses a force in some direction; there the "
            "tool may be softer than is said.",
            f.map,
        )
    way = "Eq. (6); the equilibrium of Eq. (7)" if f.linear else "the equilibrium of Eq. (7); Eq. (6)"
    yield say(f"By {way} would change the tool's deflection by up to {{other_off_mm:.3f}} mm.", f)
    for text in f.doubts:
        yield say("Doubt of the model: {text}", text=ended(text))


def _about_poses(f: Row) -> Markdown:
    every = f"; all {f.poses:,} poses and all points are in {TABLE}" if f.poses > len(f.worst) else ""
    return say(
        f"The tool's origin, loaded less unloaded, the largest first{every}. +- is the widest of x, y, z. "
        "*Softest*: the least stiffness of the loaded tool against a force at its origin."
    )


def _about_model(f: Row) -> Markdown:
    """What the positions are, how large the loads are for it, its doubts."""
    known = "those of the arm as drawn, with its sag: the model knows no errors of geometry"
    if f.absolute:
        known = "the calibrated ones, of the tool's origin +- {position_half_mm:.3f} mm (median)"
    loads = "Loads reach {force_n:,.0f} N and {moment_nm:,.0f} N m about the tool's origin"
    if f.force_ratio is not None:
        loads += "; {force_ratio:.2f} times the largest force that the model was identified under"
    if f.moment_ratio is not None:
        loads += ", {moment_ratio:.2f} times the largest moment"
    return Markdown(f"## Model\n\n{say(f'{{method}}. Positions are {known}. {loads}.', f)}")


def seen(made: Predicted) -> Seen:
    """The arm bent by its loads in the poses of the file, and where it is soft."""
    some = picked(made.found.size[:, 0], np.arange(len(made.found.size)))
    reach, field = made.cell.vjm.reach, made.map
    M = arrow_scale(made.found.deflection[some, :1], MOVED * reach)
    G = arrow_scale(field.force * made.stiffness.give[some, :1] * made.stiffness.softest[some], GIVE * reach)
    title = f"Deflections x {M:g}; green: how far {field.force:,.0f} N move the loaded tool, x {G:g}."
    size, half = MM * made.found.size[some, 0], MM * made.found.widest[some, 0]
    half = np.where(np.isfinite(half), half, np.nan)
    tool = Line("tool", TOOL, size, (np.maximum(size - half, 0), size + half))
    note = of_all(len(some), len(made.asked.q), "poses")
    labels = [made.asked.labels[k] for k in some]
    moves = "How far the tool moves in each pose, 95 % intervals (mm)"
    chart = RunChart(moves, 0, "pose", labels, [tool], note=note)
    where = f"How far {field.force:,.0f} N in the worst direction move the tool (mm)"
    soft = Line("tool", TOOL, MM * field.worst)
    return Seen(
        scene=Scene(made.cell, title, [_asked(made, some, M, G), _places(made)]),
        map=PlaceMap(where, 1, field.position, [soft], heading="Where it is soft"),
        runs=[chart],
    )


def printed(said: Report) -> Table:
    """The first poses, for a terminal."""
    table = said.tables["worst"]
    own = tuple(column for column in table.columns if column.key != "turn_mrad")
    return replace(table, columns=own, rows=table.rows[:FEW])


def _asked(made: Predicted, some: Ids, M: float, G: float) -> Poses:
    """The poses of the file, bent by what acts there."""
    found, state, q = made.found, made.model.state, made.asked.q[some]
    theta = rest(state, q, [load.of(some) for load in made.asked.loads]).theta - rest(state, q).theta
    theta = turns(state.vjm, theta)
    deflection = found.deflection[some]
    start = found.position[some] - deflection
    end = start + M * deflection
    ways = G * made.map.force * (made.stiffness.give[some][:, None] * made.stiffness.axes[some])
    ways = ways.transpose(0, 2, 1)  # a row an axis
    return Poses(
        name="Poses of the file",
        names=[f"Pose {made.asked.labels[k]}" for k in some],
        words=[_said(made, int(k)) for k in some],
        rigid=rigid_frames(made.cell.room, q),
        bent=elastic_frames(made.cell.plant, q, M * theta),
        layers=[
            Layer("tool and markers, unloaded", NOMINAL, "dots", start),
            Layer("deflection", MEASURED, "arrows", start, end),
            Layer("where a force moves it", GCO, "lines", end[:, :1] - ways, end[:, :1] + ways),
        ],
        first=int(found.size[some, 0].argmax()),
    )


def _said(made: Predicted, k: int) -> str:
    size, half = MM * made.found.size[k, 0], MM * made.found.widest[k, 0]
    push = MM * made.map.force * made.stiffness.give[k, 0]
    return (
        f"The tool moves {size:.3f} mm, {_bound(half)}. {made.map.force:,.0f} N move it up to {push:.3f} mm, "
        f"{direction_words(made.stiffness.softest[k])}. {made.model.arm.words(made.asked.q[k])}."
    )


def _bound(half: float) -> str:
    return f"+- {half:.3f} mm" if np.isfinite(half) else "not determined by the data"


def _places(made: Predicted) -> Poses:
    """The arm all over the workspace, and its softest direction there."""
    field, reach = made.map, made.cell.vjm.reach
    way: Array = field.worst[:, None] * field.direction
    way = (way * arrow_scale(way, GIVE * reach))[:, None]
    at = field.position[:, None]
    sizes = zip(MM * field.worst, MM * field.half.max(axis=1), field.direction, field.q, strict=True)
    words = [
        f"{field.force:,.0f} N {direction_words(direction)} move the tool {size:.3f} mm, {_bound(half)}. "
        f"{made.model.arm.words(q)}."
        for size, half, direction, q in sizes
    ]
    way_of = Layer("softest direction", GCO, "lines", at - way, at + way)
    return workspace(made.cell, field.q, words, [way_of])
