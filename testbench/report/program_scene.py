"""Pictures of an arm under load: along a program before and after correction, and in the poses of a file."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from testbench.correct.newton import equilibrium
from testbench.errors import Array, Ids
from testbench.model.load import Load
from testbench.model.vjm import add_law_deflections
from testbench.plant.shapes import BodyFrames, elastic_frames, rigid_frames
from testbench.report import scene as draw
from testbench.report.colours import GCO, MEASURED, NOMINAL, TASK, Look
from testbench.report.report import Report
from testbench.report.scene import loads, on_tool
from testbench.report.table import Row
from testbench.workflows.cell import Cell
from testbench.workflows.program import CorrectedProgram, Predicted, direction_words
from testbench.workflows.program_numbers import predicted_bending
from testbench.workflows.rows import MM

if TYPE_CHECKING:
    from testbench.report.figure import Figure

STIFFNESS = "stiffness.png"  #: Figure of the ellipsoids.
BEFORE, CORRECTED = "uncorrected program", "corrected program"
WITHIN, EXPECTED, AFTER = f"{BEFORE}, 95 %", f"{BEFORE}, expected", f"{CORRECTED}, 95 %"
LOOKS = dict.fromkeys((EXPECTED, WITHIN), Look(MEASURED, 1, prior=True)) | {AFTER: Look(GCO, 0, prior=True)}
ERROR_LENGTH, MIN_ERROR_LENGTH = 0.15, 0.3  #: Most errors over the path's size [1], its least [m].
MOVED = 0.15  #: Length of most deflections over the reach [1].
TOOL = Look(GCO, 0, prior=True)


def program_figures(
    picture: str, force: float, said: Report, page: draw.PageContent
) -> Mapping[str, "Figure"]:
    """Draw the figures of a corrected program or of a prediction.

    Args:
        picture: Name of the picture of the run.
        force: Force of the ellipsoids [N].
        said: Report of the run.
        page: Content of its page.

    Returns:
        Figures by the names of their files.
    """
    from testbench.report.run_figure import overview, stiffness_figure  # here: it imports matplotlib

    rows = Row(said.numbers).ellipsoids
    return {picture: overview(said, page), STIFFNESS: stiffness_figure(rows, force)}


def draw_correction(cell: Cell, corrected_program: CorrectedProgram, said: Report) -> draw.PageContent:
    """Draw the path, where loads draw the tool off it, and the arm that does so.

    Args:
        cell: The arm with its model and its truth.
        corrected_program: The corrected program.
        said: Its report.

    Returns:
        The content.
    """
    points, tolerance = said.numbers["rows"], said.numbers["tolerance"]
    some = draw.largest_and_even(
        np.linalg.norm(corrected_program.found.error_before, axis=1), np.arange(len(points)), far=1
    )
    rows = [points[k] for k in some]
    bounded = any(row.most_mm is not None for row in rows)  # bound beside bound: a residual is no success
    keys = {WITHIN: "before_most_mm"} if bounded else {EXPECTED: "before_mm"}
    errors = [
        draw.ModelLine(name, LOOKS[name], np.array([row[key] for row in rows], dtype=float))
        for name, key in (keys | {AFTER: "most_mm"}).items()
    ]
    note, labels = draw.of_all(len(some), len(points), "points"), [row.label for row in rows]
    off, limit = "How far the loaded tool is off at each point (mm)", tolerance and tolerance.mm
    runs = [draw.RunChart(off, 0, "point", labels, errors, limit, note, limit_is="tolerance")]
    scale, groups = _path(cell, corrected_program, rows, some, [line.values for line in errors])
    stretch, net = draw.ellipsoid_layer(said.numbers["ellipsoids"], said.numbers["ellipsoid_force_n"])
    groups[0] = replace(groups[0], layers=[*groups[0].layers, net])  # from near it would hide the path
    title = f"Errors of the path and bending of the arm x {scale:g}. Ellipsoids x {stretch:g}."
    return draw.PageContent(draw.Scene(cell, title, groups), runs=runs)


def _path(
    cell: Cell, corrected_program: CorrectedProgram, rows: Sequence[Row], some: Ids, sizes: Sequence[Array]
) -> tuple[float, list[draw.PoseGroup]]:
    """The arm along its program, and from near the path before and after; how much is magnified.

    Args:
        cell: The arm.
        corrected_program: The corrected program.
        rows: What is said of the points.
        some: Which they are.
        sizes: Errors before and after that colour both paths, (points,) each [mm]; NaN where there is none.
    """
    compensated, q = corrected_program.found, corrected_program.found.programmed_q[some]
    asked = compensated.target.position[some]
    size = max(MIN_ERROR_LENGTH, float(np.linalg.norm(np.ptp(asked, axis=0))))
    M = draw.arrow_scale(compensated.error_before[some], ERROR_LENGTH * size)
    off, back = (asked + M * metres[some] for metres in (compensated.error_before, compensated.error_after))
    force = np.sum([load.wrench[some, :3] for load in corrected_program.loads], axis=0)
    before, after = (
        draw.Layer(name, colour, "tubes", x[None, :-1], x[None, 1:], values=np.fmax(mm[:-1], mm[1:]))
        for name, colour, x, mm in zip(
            (BEFORE, f"{CORRECTED}, by the model"), (MEASURED, GCO), (off, back), sizes, strict=True
        )
    )
    path = draw.Layer("intended path", TASK, "lines", asked[None, :-1], asked[None, 1:])
    half = M * np.where(
        np.isfinite(compensated.error_half_width[some]), compensated.error_half_width[some], np.nan
    )
    spans = half[:, None, :] * np.eye(3)  # along each axis of the world
    low, high = ((back[:, None] + side * spans).reshape(1, -1, 3) for side in (-1, 1))
    spread = draw.Layer("where it may be, 95 %", (150, 205, 190), "lines", low, high)
    drawn_off = draw.Layer("offset of the tool", MEASURED, "arrows", asked[:, None], off[:, None])
    tool = draw.Layer("intended tool position", TASK, "dots", asked[:, None])
    left = [spread, path, after]
    for verdict, colour in (("pass", GCO), ("fail", MEASURED)):
        if judged := [k for k, row in enumerate(rows) if row.verdict == verdict]:
            name, at = f"{CORRECTED}, points that {verdict}", asked[None, judged]
            left.append(draw.Layer(name, colour, "specks" if verdict == "pass" else "dots", at))
    whole = draw.PoseGroup(
        name="Whole arm",
        names=[f"Point {row.label}, line {row.line}" for row in rows],
        words=[_of_point(row) for row in rows],
        rigid=rigid_frames(cell.room, q),
        bent=elastic_frames(cell.plant, q, M * predicted_bending(corrected_program, some)),
        layers=[path, before, after, tool, *loads(off, force, cell.vjm.reach)],
        first=int(np.argmax([row.before_mm for row in rows])),
        ordered=True,
        fixed=True,
    )
    around = asked.mean(axis=0) + MIN_ERROR_LENGTH / 2 * np.vstack([np.eye(3), -np.eye(3)])
    inset = replace(whole, bent=None, near=np.vstack([asked, off, back, around]))
    insets = (
        (BEFORE, [path, before, drawn_off, *_largest(off, sizes[0])]),
        (CORRECTED, [*left, *_largest(back, sizes[1])]),
    )
    return M, [
        whole,
        *(replace(inset, name=f"{name.capitalize()}, from near", layers=layers) for name, layers in insets),
    ]


def _largest(at: Array, mm: Array) -> list[draw.Layer]:
    """The largest error of a path, (points, 3) [m], written beside it."""
    if not np.isfinite(mm).any():
        return []
    k = int(np.nanargmax(mm))
    return [draw.Layer("largest error", MEASURED, "dots", at[None, [k]], labels=[f"at most {mm[k]:.3f} mm"])]


def _of_point(row: Row) -> str:
    """What the page says of a point that it shows."""
    bound = "without a bound" if row.half_95_mm is None else f"within {row.half_95_mm:.3f} mm (95 %)"
    after = f"left as it is: {row.reason}" if row.reason else f"corrected {bound}"
    judged = f" Tolerance: {row.verdict}." if row.verdict else ""
    return f"{row.before_mm:.3f} mm off as programmed; {after}.{judged}"


def draw_prediction(made: Predicted, ellipsoids: Sequence[Row]) -> draw.PageContent:
    """Draw the arm bent by its loads in the poses of the file, and where it is soft.

    Args:
        made: The prediction.
        ellipsoids: See `workflows.program_numbers`.

    Returns:
        The content.
    """
    some = draw.largest_and_even(
        made.found.deflection_length[:, 0], np.arange(len(made.found.deflection_length))
    )
    reach = made.cell.vjm.reach
    field = made.map
    M = draw.arrow_scale(made.found.deflection[some, :1], MOVED * reach)
    G, net = draw.ellipsoid_layer(ellipsoids, field.force)
    title = f"Deflections x {M:g}. Green lines and ellipsoids: how far {field.force:,.0f} N move the loaded "
    title += f"tool, x {G:g}."
    poses = _poses(made, some, M, G)
    poses = replace(poses, layers=[*poses.layers, net])
    size, half = MM * made.found.deflection_length[some, 0], MM * made.found.largest_half_width[some, 0]
    half = np.where(np.isfinite(half), half, np.nan)
    tool = draw.ModelLine("tool", TOOL, size, (np.maximum(size - half, 0), size + half))
    labels = [made.asked.labels[k] for k in some]
    moves = "How far the tool moves in each pose, 95 % intervals (mm)"
    note = draw.of_all(len(some), len(made.asked.q), "poses")
    where = f"How far {field.force:,.0f} N in the worst direction move the tool (mm)"
    soft = draw.ModelLine("tool", TOOL, MM * field.worst)
    return draw.PageContent(
        scene=draw.Scene(made.cell, title, [poses, _places(made, G)]),
        map=draw.PlaceMap(where, 1, field.position, [soft], heading="Where the arm is soft"),
        runs=[draw.RunChart(moves, 0, "pose", labels, [tool], note=note)],
    )


def _poses(made: Predicted, some: Ids, M: float, G: float) -> draw.PoseGroup:
    """The poses of the file, bent by what acts there."""
    prediction = made.found
    state = made.model.state
    q = made.asked.q[some]
    tool = made.stiffness
    theta = (
        equilibrium(state, q, [load.select(some) for load in made.asked.loads]).theta
        - equilibrium(state, q).theta
    )
    start = prediction.position[some] - prediction.deflection[some]
    end = start + M * prediction.deflection[some]
    ways = G * made.map.force * (tool.displacement_per_force[some][:, None] * tool.principal_axes[some])
    ways = ways.transpose(0, 2, 1)  # a row an axis
    bent = elastic_frames(made.cell.plant, q, M * add_law_deflections(state.vjm, theta))
    acting = [layer for load in made.asked.loads for layer in _acting(made.cell, bent, load.select(some))]
    words = []
    for k in some:
        bound = _bound(MM * prediction.largest_half_width[k, 0])
        joints = made.model.arm.pose_text(made.asked.q[k])
        words.append(
            f"The tool moves {MM * prediction.deflection_length[k, 0]:.3f} mm, {bound}. "
            f"{made.map.force:,.0f} N move it up to "
            f"{MM * made.map.force * tool.displacement_per_force[k, 0]:.3f} mm, "
            f"{direction_words(tool.softest_direction[k])}. Joints at {joints}."
        )
    return draw.PoseGroup(
        name="Poses of the file",
        names=[f"Pose {made.asked.labels[k]}" for k in some],
        words=words,
        rigid=rigid_frames(made.cell.room, q),
        bent=bent,
        layers=[
            *acting,
            draw.Layer("tool and markers, unloaded", NOMINAL, "dots", start),
            draw.Layer("deflection", MEASURED, "arrows", start, end),
            draw.Layer(
                "semi-axes of the ellipsoid in this pose", GCO, "lines", end[:, :1] - ways, end[:, :1] + ways
            ),
        ],
        first=int(prediction.deflection_length[some, 0].argmax()),
    )


def _acting(cell: Cell, bent: BodyFrames, load: Load) -> list[draw.Layer]:
    """A load on the bent arm."""
    return loads(on_tool(cell, bent, load.point), load.wrench[:, :3], cell.vjm.reach)


def _bound(half: float) -> str:
    return f"± {half:.3f} mm" if np.isfinite(half) else "not determined by the data"


def _places(made: Predicted, G: float) -> draw.PoseGroup:
    """The arm all over the workspace, and how far a force moves it in its softest direction, magnified."""
    field = made.map
    way: Array = (G * field.worst[:, None] * field.direction)[:, None]
    at = field.position[:, None]
    sizes = zip(MM * field.worst, MM * field.half.max(axis=1), field.direction, field.q, strict=True)
    words = [
        f"{field.force:,.0f} N {direction_words(direction)} move the tool {size:.3f} mm, {_bound(half)}. "
        f"Joints at {made.model.arm.pose_text(q)}."
        for size, half, direction, q in sizes
    ]
    way_of = draw.Layer("softest direction", GCO, "lines", at - way, at + way)
    return draw.workspace(made.cell, field.q, words, [way_of])
