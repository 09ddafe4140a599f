"""Recordings looked at as a reader does: every tab on every timeline, pane by pane, in one viewer.

Every pane must hold what tells it from an empty one: letters, colours of data, bodies. An empty chart has
axes too, an empty text the word "(empty)", an empty world a floor. An arm without transforms collapses at
its foot and still fills its pane: that is told from the file.
"""

import io
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from rerun.chunk import RrdReader
from rerun.experimental import ViewerClient

from testbench.errors import Array, BenchError
from testbench.views.recording import headless

SIZE = "1280x720"
LINE = (53, 52, 52)  #: Colour of what divides the viewer's window, and panes.
TABS, TITLE, EDGE = 30, 28, 4
"""Heights of the tabs and of a pane's title, and what is left out around a pane [pixel]."""
PATIENCE = 10.0  #: Longest wait for data that come in pieces [s].
SEEN: set[str] = set()  #: Recordings that the viewer has had.
Place = tuple[str, int]


class Strange(Exception):
    """A picture that is not what the layout says."""


def letters(picture: Array) -> int:
    """Edges: some 40 a letter."""
    return int((np.abs(np.diff(picture, axis=1)).max(axis=2) > 24).sum())


def lit(picture: Array) -> int:
    """Pixels that are brighter than the floor."""
    return int((picture.max(axis=2) > 100).sum())


def coloured(picture: Array) -> int:
    """Pixels that are not grey: of lines, bars, cells."""
    return int((picture.max(axis=2) - picture.min(axis=2) > 30).sum())


MARKS = {"TextDocument": (letters, 600), "3D": (lit, 500)}
OTHERS = (coloured, 100)
"""What a pane has at least, by its class."""


class Looked:
    """A recording in the viewer."""

    def __init__(self, client: ViewerClient, file: Path) -> None:
        headless.show(client, file)
        store = headless.shown(client).store_id
        assert store not in SEEN, f"{store} was looked at before: the viewer would show that again"
        SEEN.add(store)
        self.client = client
        self.blueprint = client.get_blueprint("recording").blueprint
        self.timelines = {t.name: (t.start, t.end) for t in headless.shown(client).timelines}
        self.last = ("", b"")  # tab and picture
        self.moving: dict[str, set[str]] = {}  # timelines on which an entity changes
        for chunk in RrdReader(file).stream():
            if not chunk.is_static:
                self.moving.setdefault(chunk.entity_path, set()).update(chunk.timeline_names)

    def faults(self) -> list[str]:
        """Panes that are blank somewhere, and what the viewer complains of."""
        [tabbed] = [c for c in map(container, self.blueprint.values()) if c.get("container_kind") == "Tabs"]
        tabs = listed(tabbed["contents"])
        found = [f"{pane} on opening" for pane in self.blank(tabs[0])]
        for tab in tabs:
            tabbed["active_tab"] = tab
            self.client.set_blueprint(self.blueprint, "recording")
            for timeline, at in self.places(tab):
                self.client.set_time(timeline, sequence=at, play_state="paused")
                found += [f"{pane} on {timeline} at {at}" for pane in self.blank(tab)]
        reports = [(view.name, r.summary) for view in self.client.get_state().views for r in view.reports]
        return found + [f"{name}: {said}" for name, said in reports]

    def places(self, tab: str) -> list[Place]:
        """First, middle and last of the timelines on which a tab changes, one of the others."""
        changes = set[str]().union(*(self.changes(view) for view in views(self.blueprint, tab)))
        if not changes:
            [(timeline, (first, _)), *_] = self.timelines.items()
            return [(timeline, first)]
        spans = {t: {a, (a + b) // 2, b} if t in changes else {a} for t, (a, b) in self.timelines.items()}
        return [(timeline, at) for timeline, span in spans.items() for at in sorted(span)]

    def changes(self, view: str) -> set[str]:
        """Timelines on which a view changes."""
        origin = self.blueprint[f"/{view}"]["ViewBlueprint"]["space_origin"].strip("/")
        query = listed(self.blueprint[f"/{view}/ViewContents"]["ViewContents"]["query"])
        roots = [line.lstrip("+ ").replace("$origin", f"/{origin}").removesuffix("/**") for line in query]
        return set[str]().union(
            *(own for path, own in self.moving.items() if any(f"{path}/".startswith(f"{r}/") for r in roots))
        )

    def blank(self, tab: str) -> list[str]:
        """Names of the panes of the tab in front that have too little in them."""
        end = time.monotonic() + PATIENCE
        while True:
            try:
                panes = cut(self.blueprint, tab, self.front(tab))
                found = [name for view, part in panes for name in self.empty(view, part)]
            except Strange as error:  # the tab is not there yet
                found = [str(error)]
            if not found or time.monotonic() > end:
                return found

    def front(self, tab: str) -> Array:
        """The picture of the tab in front, less its name: a view alone in its tab has no title of its own."""
        png = self.client.take_screenshot()
        if tab != self.last[0] and png == self.last[1]:  # its name is not lit yet
            raise Strange("expected another tab")
        self.last = (tab, png)
        with Image.open(io.BytesIO(png)) as opened:
            picture = np.asarray(opened.convert("RGB")).astype(int)
        bars = rules(picture, 0)
        if len(bars) < 2:
            raise Strange("expected the viewer's bars above and below")
        alone = tab in views(self.blueprint, tab)
        return picture[bars[0] + TABS - alone * TITLE : bars[-1]]

    def empty(self, view: str, part: Array) -> list[str]:
        """The name of a view that has too little in its part of the picture."""
        own = self.blueprint[f"/{view}"]["ViewBlueprint"]
        mark, least = MARKS.get(own["class_identifier"], OTHERS)
        has = mark(part[EDGE:-EDGE, EDGE:-EDGE])
        return [f"{own['display_name']!r}: {has} of {least} {mark.__name__}"] if has < least else []


def collapsing(file: Path) -> list[str]:
    """Bodies that stand at their origin on some timeline: without a transform there, or from its start on."""
    starts: dict[str, dict[str, int]] = {}
    first: dict[str, int] = {}
    still = set()
    for chunk in RrdReader(file).stream():
        batch = chunk.to_record_batch()
        begins = {t: min(batch.column(t).cast("int64").to_pylist()) for t in chunk.timeline_names}
        first |= {t: min(at, first.get(t, at)) for t, at in begins.items()}
        if any(name.startswith("Transform3D:") for name in batch.schema.names):
            own = starts.setdefault(chunk.entity_path, {})
            own |= {t: min(at, own.get(t, at)) for t, at in begins.items()}
            still |= {chunk.entity_path} if chunk.is_static else set()
    return [
        f"{path} on {timeline}"
        for path, own in starts.items()
        for timeline, at in first.items()
        if path not in still and own.get(timeline, at + 1) > at
    ]


def rules(picture: Array, axis: int) -> Array:
    """Rows (axis 0) or columns that a dividing line fills."""
    return np.flatnonzero((picture == LINE).all(axis=2).mean(axis=1 - axis) > 0.97)


def cut(blueprint: dict[str, Any], path: str, picture: Array) -> Iterator[tuple[str, Array]]:
    """Every view under a container, and its part of the picture without its title."""
    own = container(blueprint[f"/{path}"])
    if not own:
        yield path, picture[TITLE:]
        return
    inner, kind = listed(own["contents"]), own["container_kind"]
    if kind == "Grid":
        counts = [len(rules(picture, axis)) + 1 for axis in (0, 1)]
        if counts[0] * counts[1] < len(inner):
            raise Strange(f"expected {len(inner)} panes in a grid of {counts}")
        rows = parts(picture, 0, [1] * counts[0])
        cells = [cell for row in rows for cell in parts(row, 1, [1] * counts[1])]
    else:
        axis = int(kind == "Horizontal")
        cells = parts(picture, axis, [spans(blueprint, child, axis) for child in inner])
    for child, cell in zip(inner, cells, strict=False):  # the last row of a grid may have room left
        yield from cut(blueprint, child, cell)


def spans(blueprint: dict[str, Any], path: str, axis: int) -> int:
    """How many parts a container has along an axis whose lines go all through it."""
    return 1 + len(marks(blueprint, path, axis))


def marks(blueprint: dict[str, Any], path: str, axis: int) -> set[float]:
    """Where lines go all through a container, across an axis, in shares of its length."""
    own = container(blueprint[f"/{path}"])
    if not own:
        return set()
    inner, kind = listed(own["contents"]), own["container_kind"]
    if kind == "Grid":
        count = own["grid_columns"] if axis else -(-len(inner) // own["grid_columns"])
        return {round(k / count, 3) for k in range(1, count)}
    found = [marks(blueprint, child, axis) for child in inner]
    if kind != ("Vertical", "Horizontal")[axis]:
        return set.intersection(*found)
    shares = np.array(own.get(("row_shares", "col_shares")[axis]) or [1.0] * len(inner))
    ends = np.cumsum(shares) / shares.sum()
    starts = [0.0, *ends[:-1]]
    within = {a + (b - a) * at for a, b, own in zip(starts, ends, found, strict=True) for at in own}
    return {round(at, 3) for at in {*ends[:-1], *within}}


def parts(picture: Array, axis: int, sizes: Sequence[int]) -> list[Array]:
    """A picture cut along its dividing lines, so many parts of one line each together."""
    lines = rules(picture, axis)
    if len(lines) != sum(sizes) - 1:
        raise Strange(f"expected {sum(sizes)} panes side by side, got {len(lines) + 1}")
    first, *others = np.split(picture, lines[np.cumsum(sizes)[:-1] - 1], axis)
    return [first, *(part[1:] if axis == 0 else part[:, 1:] for part in others)]


def views(blueprint: dict[str, Any], path: str) -> list[str]:
    """Every view under a container, or the view itself."""
    inner = listed(container(blueprint[f"/{path}"]).get("contents", []))
    return [view for child in inner for view in views(blueprint, child)] or [path]


def container(entity: dict[str, Any]) -> dict[str, Any]:
    """What an entity of a layout says of its panes."""
    found: dict[str, Any] = entity.get("ContainerBlueprint", {})
    return found


def listed(things: str | list[str]) -> list[str]:
    """Of a list with one thing in it the viewer gives that."""
    return [things] if isinstance(things, str) else things


@pytest.fixture(scope="session")
def viewer() -> Iterator[ViewerClient]:
    """One viewer without a window for all tests."""
    try:
        headless.software_driver()
    except BenchError as missing:
        pytest.skip(str(missing))
    with headless.windowless(SIZE) as client:
        headless.settled(client)  # its messages of the start fade
        yield client


@pytest.fixture(scope="session")
def blank_panes(viewer: ViewerClient) -> Callable[[Path], list[str]]:
    """What is wrong with the panes of a recording: those that are blank, and arms that collapse."""

    def looked(file: Path) -> list[str]:
        try:
            return collapsing(file) + Looked(viewer, file).faults()
        finally:
            viewer.close("all")

    return looked
