"""The recording of any run, made of what its page draws: arms in poses, charts, maps, figures, words.

Every group of poses has a tab. All are on three timelines: `typical_first`, where a reader lands, then the
worst; `worst_first`; and `pose` in the order of the page.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from testbench.errors import Array, Ids
from testbench.report.colours import (
    GCO,
    GREY,
    JOINTS,
    JOINTS_PRIOR,
    LEAST_SQUARES,
    LEAST_SQUARES_PRIOR,
    LOAD,
    MEASURED,
    NOMINAL,
    TASK,
    Colour,
)
from testbench.report.markdown import ReportWords, as_markdown, grid
from testbench.report.recording.stream import Pen, RecordingHeader, layout, recording, snake, text_view
from testbench.report.recording.world import (
    SIDE,
    frame,
    map_tab,
    orbit,
    reach,
    write_arm,
    write_layer,
    write_map,
)
from testbench.report.scene import (
    Layer,
    ModelLine,
    PageContent,
    PoseGroup,
    RunChart,
    Scene,
    charts_of,
    sorting_numbers,
)
from testbench.workflows.cell import Cell

TYPICAL, WORST, POSE = "typical_first", "worst_first", "pose"
"""Timelines: the one that a reader lands on, the sorted one, and the order of the page, from 1."""
HUES: Mapping[str, Colour] = {
    "sky blue": NOMINAL,
    "rust": MEASURED,
    "purple": LOAD,
    "grey": GREY,
    "olive": TASK,
    "orange": LEAST_SQUARES,
    "green": GCO,
    "bright green": (8, 162, 14),
    "blue": JOINTS,
    "indigo": JOINTS_PRIOR,
    "pink": LEAST_SQUARES_PRIOR,
    "vermillion": (213, 94, 0),
    "salmon": (210, 116, 98),
    "teal": (0, 161, 154),
    "slate": (120, 150, 154),
    "grey-teal": (100, 136, 128),
    "dark slate": (99, 106, 125),
    "grey-green": (132, 150, 119),
    "dark grey-green": (88, 116, 109),
    "yellow-green": (122, 151, 6),
    "dark yellow-green": (93, 112, 12),
    "brown": (166, 118, 29),
    "grey-brown": (107, 107, 100),
    "maroon": (150, 86, 92),
    "sand": (157, 131, 83),
    "steel blue": (103, 130, 159),
    "pale green": (150, 205, 190),
}
"""Colours by name."""
STEEP = 0.8  #: How steeply a path is looked down on, over how far the eye is ahead and aside [1].
VIEW_MARGIN = 0.16  #: Room around what is in view, over its size [1].


@dataclass(frozen=True)
class _Group:
    """A group of poses, and where its parts are in the recording."""

    poses: PoseGroup
    name: str  #: Of its entities.
    arm: str  #: Root of its arm's bodies; groups of the same poses share one.
    charts: Sequence[RunChart]  #: Its map as one, where it has no other.

    @property
    def leads(self) -> list[Array]:
        """Numbers of lines that are largest in the worst pose, (poses,) each."""
        return sorting_numbers(self.poses, self.charts)

    @property
    def rank(self) -> Ids:
        """Place of every pose in worst_first, (poses,): by the last line that is largest at the first."""
        count, first, leads = len(self.poses.names), self.poses.first, self.leads
        order = np.argsort(-leads[-1], kind="stable") if leads else np.roll(np.arange(count), -first)
        found = np.empty(count, dtype=int)
        found[order] = np.arange(count)
        return found

    @property
    def typical(self) -> Ids:
        """Place of every pose in typical_first, (poses,): what is shown first, then the worst first."""
        found, first = self.rank.copy(), self.poses.first
        found[found < found[first]] += 1
        found[first] = 0
        return found

    @property
    def size(self) -> float:
        """Of what is in view [m]."""
        near = self.poses.near
        return reach(self.poses.rigid) if near is None else float(np.linalg.norm(np.ptp(near, axis=0)))

    def path(self, chart: RunChart, *line: str) -> str:
        """Where a chart or a line of it is."""
        return "/".join(["charts", self.name, snake(chart.title), *map(snake, line)])


def write_run(
    path: Path, header: RecordingHeader, words: ReportWords, page: PageContent, figures: Mapping[str, Path]
) -> None:
    """Write a run for the Rerun viewer; an existing file is replaced only by a whole one."""
    if page.map and not any(np.isfinite(line.values).any() for line in page.map.lines):
        page = replace(page, map=None)  # nowhere is there a bound
    groups = _groups(page)
    tabs = [_tab(page.scene, group, first=group is groups[0]) for group in groups] if page.scene else []
    names, arm, body, size = _around_map(page, groups)
    where = [map_tab(page.map, arm, body, size)] if page.map else []
    pictures: list[rrb.Container | rrb.View] = [
        rrb.Spatial2DView(origin=f"figure/{snake(name)}", name=name) for name in figures
    ]
    if pictures and not tabs:
        pictures[0] = _beside(pictures[0], name="Overview")
    lead = [] if tabs or pictures else [text_view("summary", "Summary")]
    front, back = (tabs, pictures) if tabs else (pictures, [])
    views = [*lead, *front, *where, *back, text_view("tables", "Tables")]
    places = len(groups[0].poses.names) if groups else 1
    documents = {"summary": summary(words), "tables": _tables(words, page)}
    titles = [own.title for own in (page.scene, page.map, *page.runs) if own]
    with recording(
        path, header, layout(*views, timeline=TYPICAL, places=places), [*documents.values(), *titles]
    ) as pen:
        pen.documents(documents)
        if page.scene:
            _write_scene(pen, page.scene.cell, groups)
        if page.map:
            write_map(pen, page.map, names, size)
        for name, png in figures.items():
            pen.still(f"figure/{snake(name)}", rr.EncodedImage(path=png))


def summary(words: ReportWords) -> str:
    """What a recording says first."""
    badge = words.block("badge")
    head = [f"## **{badge}**" if badge else "", f"### {words.block('question')}"]
    head += [f"#### **{words.block('answer')}**" if words.block("answer") else ""]
    return "\n\n".join(filter(None, [*head, *map(words.block, ("worst", "statements"))]))


def _tables(words: ReportWords, page: PageContent) -> str:
    """What stands below the first sentences, and tables of the page that are not among it."""
    rest = words.block("body")
    others = [(table.title, grid(table)) for table in page.tables if table.rows]
    parts = [f"### {as_markdown(title)}\n\n{text}" for title, text in others if text not in rest]
    return "\n\n".join([rest, *parts])


def _groups(page: PageContent) -> list[_Group]:
    """Groups of the scene with their names; those of the same poses have one arm and one set of charts."""
    arms: dict[int, str] = {}
    groups: list[_Group] = []
    every = page.scene.groups if page.scene else ()
    for k, poses in enumerate(every):
        arm = arms.setdefault(id(poses.rigid), f"arm_{k}" if k else "arm")
        groups.append(_Group(poses, snake(poses.name), arm, charts_of(page, k)))
    return groups


def _around_map(page: PageContent, groups: Sequence[_Group]) -> tuple[Sequence[str], str, Array, float]:
    """Names of the places of the map, the arm beside them, its points (n, 3) [m], size of all that [m]."""
    if page.map and groups:
        group = groups[page.map.group]
        return group.poses.names, group.arm, group.poses.rigid.positions[0, 1:], group.size
    at = page.map.at if page.map else np.zeros((1, 3))
    size = float(np.nanmax(np.linalg.norm(at, axis=1)))
    return [f"place {k}" for k in range(1, len(at) + 1)], "", np.zeros((1, 3)), size


def _write_scene(pen: Pen, cell: Cell, groups: Sequence[_Group]) -> None:
    """Arms, layers, words and charts of every group."""
    drawn: set[str] = set()
    for group in groups:
        times = {TYPICAL: group.typical, WORST: group.rank, POSE: 1 + np.arange(len(group.poses.names))}
        rows = pen.on(*(rr.TimeColumn(name, sequence=at) for name, at in times.items()))
        if group.arm not in drawn:
            drawn.add(group.arm)
            bent = next((g.poses.bent for g in groups if g.arm == group.arm and g.poses.bent), None)
            write_arm(rows, cell, group.arm, group.poses.rigid, bent)
        pairs = zip(group.poses.names, group.poses.words, strict=True)
        key = _colours(group.poses.layers)
        texts = [f"**{as_markdown(name)}** {as_markdown(text)}\n\n{key}" for name, text in pairs]
        rows.texts(f"here/{group.name}", texts)
        for layer in group.poses.layers:
            write_layer(rows, f"world/{group.name}/{snake(layer.name)}", layer, group.size)
        for chart in group.charts:
            for line in chart.lines:
                _write_line(rows, group.path(chart, line.name), line, lead=line is chart.lines[-1])
            if chart.limit is not None and np.isfinite(chart.limit):
                level = np.full(len(group.poses.names), chart.limit)
                rows.line(group.path(chart, chart.limit_is), chart.limit_is, None, level)


def _colours(layers: Sequence[Layer]) -> str:
    """What each colour is, in words."""
    named = [(_hue(layer.colour), layer) for layer in layers if layer.shown]
    return "; ".join(f"{hue} {layer.kind}: {as_markdown(layer.name)}" for hue, layer in named)


def _hue(colour: Colour) -> str:
    """The nearest colour that has a name."""
    apart = {name: sum((a - b) ** 2 for a, b in zip(own, colour, strict=False)) for name, own in HUES.items()}
    return min(apart, key=apart.__getitem__)


def _write_line(rows: Pen, path: str, line: ModelLine, *, lead: bool) -> None:
    """A number a pose with its interval; what is not known leaves a gap."""
    rows.line(path, line.name, line.look, line.values, lead=lead)
    for name, values in zip(("lower", "upper"), line.ends or (), strict=False):
        if np.isfinite(values).any():
            rows.line(f"{path}_{name}", f"{line.name}, {name} end", None, values)


def _tab(scene: Scene, group: _Group, *, first: bool) -> rrb.Container:
    """The arm and what is shown; at the right of the first tab the summary, and the group's charts."""
    charts = [
        rrb.TimeSeriesView(
            origin=group.path(chart),
            name=f"{chart.title}, by {chart.across}{_order(group)}",
            axis_x=_beyond(len(group.poses.names)),
            axis_y=_from_zero(chart),
            plot_legend=rrb.PlotLegend(rrb.Corner2D.RightTop),
        )
        for chart in group.charts
    ]
    bodies = [f"+ $origin/{group.arm}/**", f"+ $origin/{group.arm}_deflected/**"]
    world = rrb.Spatial3DView(
        origin="world",
        name=f"{group.poses.name} (m): {scene.title}",
        contents=[f"+ $origin/{group.name}/**", *(bodies if group.poses.near is None else [])],
        eye_controls=orbit(*_eye(group)),
        overrides={
            f"world/{group.name}/{snake(layer.name)}": rrb.EntityBehavior(visible=False)
            for layer in group.poses.layers
            if not layer.shown
        },
    )
    here = text_view(f"here/{group.name}", "What is shown")
    main = rrb.Vertical(world, here, row_shares=[6, 1], name=group.poses.name)
    return _beside(main, *charts, name=group.poses.name, summary=first)


def _order(group: _Group) -> str:
    """In which order the timeline that a reader lands on has a group's poses."""
    return ", a typical one, then the worst first" if group.leads else ", in order"


def _from_zero(chart: RunChart) -> rrb.archetypes.ScalarAxis:
    """All numbers and ends of intervals, from 0: a difference looks as large as it is."""
    parts = [own for line in chart.lines for own in (line.values, *(line.ends or ()))]
    every = np.concatenate([*parts, np.ravel(chart.limit if chart.limit is not None else [])])
    every = every[np.isfinite(every)]
    low, high = min(every.min(initial=0.0), 0.0), every.max(initial=0.0)
    return rrb.archetypes.ScalarAxis(range=(float(low), float(low + 1.05 * (high - low) or 1.0)))


def _beyond(count: int) -> rrb.archetypes.TimeAxis:
    """All places of the timelines, from 0 and from 1, with room at both ends."""
    low, high = (rr.TimeRangeBoundary.absolute(seq=at) for at in (-1 - count // 50, 1 + count + count // 50))
    return rrb.archetypes.TimeAxis(view_range=rr.TimeRange(low, high))


def _beside(
    main: rrb.Container | rrb.View, *charts: rrb.View, name: str, summary: bool = True
) -> rrb.Container:
    """A view and beside it the summary and charts."""
    words = [text_view("summary", "Summary")] if summary else []
    right = [*words, *charts]
    if not right:
        return rrb.Horizontal(main, name=name)
    shares = [*[4] * len(words), *[3] * len(charts)]
    return rrb.Horizontal(main, rrb.Vertical(*right, row_shares=shares), column_shares=[3, 2], name=name)


def _eye(group: _Group) -> tuple[Array, Array]:
    """Eye and target: all that is near, or the arm in the pose shown first and all that moves there."""
    poses, k = group.poses, group.poses.first
    points = poses.near
    if points is None:
        moved = [layer.at[min(k, len(layer.at) - 1)] for layer in poses.layers if layer.kind != "specks"]
        bent = [] if poses.bent is None else [poses.bent.positions[k, 1:]]
        points = np.vstack([poses.rigid.positions[k, 1:], *bent, *moved])
        points = points[np.isfinite(points).all(axis=1)]
    tool = poses.rigid.positions[k, -1, :2]
    if poses.near is not None:  # from the broad side
        along = np.linalg.svd(points[:, :2] - points[:, :2].mean(axis=0))[2][0]
        across = np.array([-along[1], along[0]])
        across = across if across @ tool > 0 else -across
        turn = np.arctan2(SIDE[1], SIDE[0])
        tool = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]) @ across
    above = SIDE[2] if poses.near is None else STEEP
    return frame(points, np.full(len(points), VIEW_MARGIN * group.size), tool, above=above)
