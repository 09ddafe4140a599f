"""The recording of any run, made of what its page draws: arms in poses, charts, maps, figures, words.

Every group of poses has a tab. All are on both timelines: `worst_first`, and `pose` in the order of the page.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from testbench.bench.campaign import Cell
from testbench.data.dataset import Ids
from testbench.errors import Array
from testbench.plant.shapes import Frames
from testbench.views.markdown import Told, as_markdown, grid
from testbench.views.page.charts import Line, PlaceMap, RunChart
from testbench.views.page.page import Seen
from testbench.views.page.scene import Layer, Poses, Scene
from testbench.views.recording.arm import orbit, reach, write_frames, write_shapes
from testbench.views.recording.camera import frame
from testbench.views.recording.error_map import key_view, write_balls, write_key
from testbench.views.recording.pen import Line as Plotted
from testbench.views.recording.pen import Pen, snake, text_view
from testbench.views.recording.stream import Header, layout, recording
from testbench.views.recording.style import (
    GCO,
    LEAST_SQUARES,
    LOAD,
    MEASURED,
    NOISE,
    NOMINAL,
    TASK,
    Colour,
    drawn,
)
from testbench.views.scale import Scale, scale_of
from testbench.views.schema import show

WORST, POSE = "worst_first", "pose"
"""Timelines: the one that a reader lands on, and the order of the page, from 1."""
THICK = {"dots": 0.008, "specks": 0.004, "arrows": 0.004, "lines": 0.0025}
"""Radius of what is drawn over the size of what is in view [1]."""
HUES: Mapping[str, Colour] = {
    "sky blue": NOMINAL,
    "vermillion": MEASURED,
    "purple": LOAD,
    "grey": NOISE,
    "olive": TASK,
    "orange": LEAST_SQUARES,
    "green": GCO,
    "blue": (52, 98, 232),
    "red": (190, 58, 80),
    "brown": (154, 89, 16),
    "teal": (0, 161, 154),
    "pale green": (150, 205, 190),
}
"""Colours by name."""
NEAR = 0.16  #: Room around what is in view, over its size [1].
MAPS = 3  #: Maps side by side at most.
BALL = 0.02  #: Radius of the largest ball of a map over the size of what is in view [1].


@dataclass(frozen=True)
class _Group:
    """A group of poses, and where its parts are in the recording."""

    poses: Poses
    name: str  #: Of its entities.
    arm: str  #: Root of its arm's bodies; groups of the same poses share one.
    charts: Sequence[RunChart]

    @property
    def rank(self) -> Ids:
        """Place of every pose in worst_first, (poses,): by the last line that is largest at the first."""
        count, first = len(self.poses.names), self.poses.first
        sizes = [np.nan_to_num(line.values, nan=-np.inf) for chart in self.charts for line in chart.lines]
        leads = [own for own in sizes if len(own) == count and own[first] == own.max()]
        order = np.argsort(-leads[-1], kind="stable") if leads else np.roll(np.arange(count), -first)
        found = np.empty(count, dtype=int)
        found[order] = np.arange(count)
        return found

    @property
    def size(self) -> float:
        """Of what is in view [m]."""
        near = self.poses.near
        return reach(self.poses.rigid) if near is None else float(np.linalg.norm(np.ptp(near, axis=0)))


def write_run(path: Path, header: Header, words: Told, seen: Seen, figures: Mapping[str, Path]) -> None:
    """Write a run for the Rerun viewer; an existing file is replaced only by a whole one.

    Args:
        path: The .rrd file.
        header: What identifies it.
        words: Of the report.
        seen: What the page draws.
        figures: PNGs by title, a tab each.
    """
    groups = _groups(seen)
    tabs = [_tab(seen.scene, own) for own in groups] if seen.scene else []
    if seen.map and not any(np.isfinite(line.values).any() for line in seen.map.lines):
        seen = replace(seen, map=None)  # nowhere is there a bound
    where = [_map_tab(seen.map, groups[seen.map.group])] if seen.map else []
    pictures: list[rrb.Container | rrb.View] = [
        rrb.Spatial2DView(origin=f"figure/{snake(name)}", name=name) for name in figures
    ]
    if pictures and not tabs:
        pictures[0] = _beside(pictures[0], name="Overview")
    lead = [] if tabs or pictures else [text_view("summary", "Summary")]
    views = [*lead, *tabs, *where, *pictures, text_view("tables", "Tables")]
    places = len(groups[0].poses.names) if groups else 1
    with recording(path, "run", header, layout(*views, timeline=WORST, places=places)) as pen:
        pen.documents({"summary": summary(words), "tables": _tables(words, seen)})
        if seen.scene:
            _write_scene(pen, seen.scene.cell, groups)
        if seen.map:
            _write_map(pen, seen.map, groups[seen.map.group])
        for name, png in figures.items():
            pen.still(f"figure/{snake(name)}", rr.EncodedImage(path=png))


def summary(words: Told) -> str:
    """What a recording says first."""
    head = [f"### {words.block('question')}", f"#### **{words.block('answer')}**", *words.worst_lines()]
    return "\n\n".join([*head, words.block("statements")])


def _tables(words: Told, seen: Seen) -> str:
    """What stands below the first sentences, and tables of the page that are not among it."""
    rest = words.rest()
    others = [(table.title, grid(table)) for table in seen.tables if table.rows]
    parts = [f"### {as_markdown(title)}\n\n{text}" for title, text in others if text not in rest]
    return "\n\n".join([rest, *parts])


def _groups(seen: Seen) -> list[_Group]:
    """Groups of the scene with their names; those of the same poses have one arm."""
    arms: dict[int, str] = {}
    found = []
    for k, poses in enumerate(seen.scene.groups if seen.scene else ()):
        arm = arms.setdefault(id(poses.rigid), f"arm_{k}" if k else "arm")
        same = [
            j for j, other in enumerate(seen.scene.groups if seen.scene else ()) if other.rigid is poses.rigid
        ]
        charts = [chart for chart in seen.runs if chart.group in same and len(chart.labels) > 1]
        found.append(_Group(poses, snake(poses.name), arm, charts))
    return found


def _write_scene(pen: Pen, cell: Cell, groups: Sequence[_Group]) -> None:
    """Arms, layers, words and charts of every group."""
    drawn_arms: set[str] = set()
    for own in groups:
        order = 1 + np.arange(len(own.poses.names))
        times = {WORST: own.rank, POSE: order}
        rows = pen.on(*(rr.TimeColumn(name, sequence=at) for name, at in times.items()))
        if own.arm not in drawn_arms:
            drawn_arms.add(own.arm)
            bent = next((g.poses.bent for g in groups if g.arm == own.arm and g.poses.bent), None)
            moving = _moving(own.poses.rigid, bent)
            write_shapes(pen, cell, moving, root=own.arm)
            write_frames(rows, cell, own.poses.rigid, own.arm, range(own.poses.rigid.positions.shape[1]))
            if bent is not None:
                write_frames(rows, cell, bent, f"{own.arm}_deflected", moving)
        pairs = zip(own.poses.names, own.poses.words, strict=True)
        key = _colours(own.poses.layers)
        texts = [f"**{as_markdown(name)}** {as_markdown(text)}\n\n{key}" for name, text in pairs]
        rows.texts(f"here/{own.name}", texts)
        for layer in own.poses.layers:
            _write_layer(rows, f"world/{own.name}/{snake(layer.name)}", layer, own.size)
        for chart in own.charts:
            for line in chart.lines:
                _write_line(rows, _path(own, chart, line.name), line)


def _colours(layers: Sequence[Layer]) -> str:
    """What each colour is, in words."""
    named = [(_hue(layer.colour), layer) for layer in layers if layer.shown]
    return "; ".join(f"{hue} {layer.kind}: {as_markdown(layer.name)}" for hue, layer in named)


def _hue(colour: Colour) -> str:
    """The nearest colour that has a name."""
    apart = {name: sum((a - b) ** 2 for a, b in zip(own, colour, strict=False)) for name, own in HUES.items()}
    return min(apart, key=apart.__getitem__)


def _moving(rigid: Frames, bent: Frames | None) -> list[int]:
    """Bodies that are seen to move: a ghost of another would flicker through its surface."""
    if bent is None:
        return []
    shift = np.linalg.norm(bent.positions - rigid.positions, axis=2).max(axis=0)
    return np.flatnonzero(shift > 0.005 * reach(rigid)).tolist()


def _write_layer(rows: Pen, path: str, layer: Layer, size: float) -> None:
    """Dots, arrows or lines in every pose, those that are there; what stands still once."""
    ends = layer.at if layer.to is None else layer.to
    known = np.isfinite(layer.at).all(axis=2) & np.isfinite(ends).all(axis=2)
    counts, at, to = known.sum(axis=1), layer.at[known], ends[known]
    look = {"colors": layer.colour, "radii": THICK[layer.kind] * size}
    kind, parts = _parts(layer.kind, at, to)
    if len(counts) == len(rows.times[0].as_arrow_array()):
        rows.still(path, kind.from_fields(**look))
        rows.rows(path, kind.columns(**parts).partition(counts))
    else:
        rows.still(path, kind.from_fields(**look, **parts))
    _write_names(rows, f"{path}_names", layer)


def _write_names(rows: Pen, path: str, layer: Layer) -> None:
    """What stands beside dots or where arrows and lines begin, in every pose."""
    named = [k for k, text in enumerate(layer.labels) if text]
    if not named:
        return
    texts, poses = [layer.labels[k] for k in named], len(layer.at)
    if poses == 1:
        rows.names(path, layer.at[0, named], texts, layer.colour)
        return
    rows.still(path, rr.Points3D.from_fields(colors=layer.colour, radii=0.0, show_labels=True))
    names = rr.Points3D.columns(positions=layer.at[:, named].reshape(-1, 3), labels=texts * poses)
    rows.rows(path, names.partition([len(named)] * poses))


def _parts(kind: str, at: Array, to: Array) -> tuple[Any, dict[str, Array]]:
    """What draws a kind of layer, and its parts: where they begin (n, 3) and end (n, 3) [m]."""
    if kind == "arrows":
        return rr.Arrows3D, {"origins": at, "vectors": to - at}
    if kind == "lines":
        return rr.LineStrips3D, {"strips": np.stack([at, to], axis=1)}
    return rr.Points3D, {"positions": at}


def _write_line(rows: Pen, path: str, line: Line) -> None:
    """A number a pose with its interval; what is not known leaves a gap."""
    look = drawn(line.look)
    rows.line(Plotted(path, line.name, look.colour, 2.0, look.shape, 4.0), line.values)
    for name, values in zip(("lower", "upper"), line.ends or (), strict=False):
        if np.isfinite(values).any():
            rows.line(Plotted(f"{path}_{name}", f"{line.name}, {name} end", NOISE, 1.0), values)


def _path(own: _Group, chart: RunChart, name: str) -> str:
    return f"charts/{own.name}/{snake(chart.title)}/{snake(name)}"


def _tab(scene: Scene | None, own: _Group) -> rrb.Container:
    """The arm at the left, at the right the summary, what is shown, and charts."""
    assert scene is not None  # there is a group
    charts = [
        rrb.TimeSeriesView(
            origin=f"charts/{own.name}/{snake(chart.title)}", name=f"{chart.title}, worst first"
        )
        for chart in own.charts
    ]
    bodies = (
        [] if own.poses.near is not None else [f"+ $origin/{own.arm}/**", f"+ $origin/{own.arm}_deflected/**"]
    )
    world = rrb.Spatial3DView(
        origin="world",
        name=f"{own.poses.name} (m): {scene.title}",
        contents=[f"+ $origin/{own.name}/**", *bodies],
        eye_controls=orbit(*_eye(own)),
        overrides={
            f"world/{own.name}/{snake(layer.name)}": rrb.EntityBehavior(visible=False)
            for layer in own.poses.layers
            if not layer.shown
        },
    )
    here = text_view(f"here/{own.name}", "What is shown")
    return _beside(rrb.Vertical(world, here, row_shares=[6, 1]), *charts, name=own.poses.name)


def _beside(main: rrb.Container | rrb.View, *charts: rrb.View, name: str) -> rrb.Container:
    """A view and beside it the summary and charts."""
    words = text_view("summary", "Summary")
    right = rrb.Vertical(words, *charts, row_shares=[4, *[3] * len(charts)]) if charts else words
    return rrb.Horizontal(main, right, column_shares=[3, 2], name=name)


def _eye(own: _Group) -> tuple[Array, Array]:
    """Eye and target: all that is near, or the arm in its worst pose and all that moves there."""
    poses, k = own.poses, int(own.rank.argmin())
    points = poses.near
    if points is None:
        moved = [layer.at[min(k, len(layer.at) - 1)] for layer in poses.layers if layer.kind != "specks"]
        bent = [] if poses.bent is None else [poses.bent.positions[k, 1:]]
        points = np.vstack([poses.rigid.positions[k, 1:], *bent, *moved])
        points = points[np.isfinite(points).all(axis=1)]
    tool = poses.rigid.positions[k, -1, :2]
    return frame(points, np.full(len(points), NEAR * own.size), tool)


def _write_map(pen: Pen, found: PlaceMap, group: _Group) -> None:
    """A map a line of one colour scale, its key, and in words where each is largest."""
    scale, size = _scale(found), group.size
    for line in found.lines[:MAPS]:
        known = np.isfinite(line.values) & np.isfinite(found.at).all(axis=1)
        path = f"world/map/{snake(line.name)}"
        write_balls(pen, path, found.at[known], scale.shares(line.values[known]), BALL * size)
    write_key(pen, "map_key_mm", scale)
    pen.documents({"map_words": f"**{found.heading}.** {found.title}"})


def _scale(found: PlaceMap) -> Scale:
    return scale_of(*(line.values for line in found.lines[:MAPS]))


def _map_tab(found: PlaceMap, group: _Group) -> rrb.Container:
    """The maps side by side with the arm of their group."""
    eye = orbit(*_map_eye(found, group))
    views = [
        rrb.Spatial3DView(
            origin="world",
            name=f"{line.name}: {_typical(line.values)}, axes (m)",
            contents=[f"+ $origin/map/{snake(line.name)}", f"+ $origin/{group.arm}/**"],
            eye_controls=eye,
        )
        for line in found.lines[:MAPS]
    ]
    below = rrb.Horizontal(
        text_view("map_words", found.heading), text_view(f"here/{group.name}", "What is shown")
    )
    parts = rrb.Horizontal(*views), key_view("map_key_mm", _scale(found)), below
    return rrb.Vertical(*parts, row_shares=[11, 2, 3], name=found.heading)


def _typical(values: Array) -> str:
    known = values[np.isfinite(values)]
    return (
        f"median {show(float(np.median(known)))}, largest {show(float(known.max()))} mm"
        if known.size
        else "none"
    )


def _map_eye(found: PlaceMap, group: _Group) -> tuple[Array, Array]:
    points = np.vstack([found.at[np.isfinite(found.at).all(axis=1)], group.poses.rigid.positions[0, 1:]])
    radii = np.full(len(points), NEAR * group.size)
    return frame(points, radii, found.at[0, :2], aspect=1.1)
