"""Recordings looked at as a reader does: every tab on every timeline, pane by pane, in one viewer.

Every view is taken by itself, as the viewer cuts it out of its window.
Every pane must hold what tells it from an empty one: letters, colours of data, bodies. An empty chart has
axes too, an empty text the word "(empty)", an empty world a floor. An arm without transforms collapses at
its foot and still fills its pane: that is told from the file.
"""

import io
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path
from typing import Any

import headless
import numpy as np
import pytest
from PIL import Image
from rerun.chunk import RrdReader
from rerun.experimental import ViewerClient

from testbench.errors import Array, BenchError

SIZE = "1280x720"
LINE = (53, 52, 52)  #: Colour of the lines that divide the viewer's window.
PATIENCE, LOOKS = 20.0, 6
"""How long [s] and how often a blank pane is looked at again: data come in pieces. Both must be over: a
busy machine takes seconds for a picture."""
SEEN: set[tuple[int, str]] = set()  #: Recordings that a viewer has had.
Place = tuple[str, int]


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
        seen = (id(client), store)
        assert seen not in SEEN, f"{store} was looked at before: the viewer would show that again"
        SEEN.add(seen)
        self.client = client
        self.blueprint = client.get_blueprint("recording").blueprint
        self.timelines = {t.name: (t.start, t.end) for t in headless.shown(client).timelines}
        self.moving: dict[str, set[str]] = {}  # timelines on which an entity changes
        for chunk in RrdReader(file).stream():
            if not chunk.is_static:
                self.moving.setdefault(chunk.entity_path, set()).update(chunk.timeline_names)

    def faults(self) -> list[str]:
        """Panes that are blank somewhere, and what the viewer complains of."""
        [tabbed] = [c for c in map(container, self.blueprint.values()) if c.get("container_kind") == "Tabs"]
        tabs = listed(tabbed["contents"])
        found = [f"{pane} on opening" for view in views(self.blueprint, tabs[0]) for pane in self.blank(view)]
        for tab in tabs:
            tabbed["active_tab"] = tab
            self.client.set_blueprint(self.blueprint, "recording")
            for (timeline, at), shown in self.places(tab).items():
                self.client.set_time(timeline, sequence=at, play_state="paused")
                found += [f"{pane} on {timeline} at {at}" for view in shown for pane in self.blank(view)]
        reports = [(view.name, r.summary) for view in self.client.get_state().views for r in view.reports]
        return found + [f"{name}: {said}" for name, said in reports]

    def places(self, tab: str) -> dict[Place, list[str]]:
        """Where the views of a tab are looked at.

        A view that changes: first, middle and last of the timelines on which it does, one of the others;
        a view that never does: one place of all.
        """
        found: dict[Place, list[str]] = {}
        for view in views(self.blueprint, tab):
            changes = self.changes(view)
            for timeline, (a, b) in list(self.timelines.items())[: None if changes else 1]:
                for at in sorted({a, (a + b) // 2, b} if timeline in changes else {a}):
                    found.setdefault((timeline, at), []).append(view)
        return found

    def changes(self, view: str) -> set[str]:
        """Timelines on which a view changes."""
        origin = self.blueprint[f"/{view}"]["ViewBlueprint"]["space_origin"].strip("/")
        query = listed(self.blueprint[f"/{view}/ViewContents"]["ViewContents"]["query"])
        roots = [line.lstrip("+ ").replace("$origin", f"/{origin}").removesuffix("/**") for line in query]
        return set[str]().union(
            *(own for path, own in self.moving.items() if any(f"{path}/".startswith(f"{r}/") for r in roots))
        )

    def blank(self, view: str) -> list[str]:
        """The name of a view of the tab in front, when it has too little in it."""
        own = self.blueprint[f"/{view}"]["ViewBlueprint"]
        mark, least = MARKS.get(own["class_identifier"], OTHERS)
        end = time.monotonic() + PATIENCE
        for look in count(1):
            has = mark(self.pane(view))
            if has >= least:
                return []
            if look >= LOOKS and time.monotonic() > end:
                return [f"{own['display_name']!r}: {has} of {least} {mark.__name__}"]

    def pane(self, view: str) -> Array:
        """The picture of a view, without its title; where it is not in front yet, of nothing."""
        return picture(self.client, Path(view).name)


def picture(client: ViewerClient, view: str | None = None) -> Array:
    """Colours of the window or of a view in it, (rows, columns, 3); black where there is none yet."""
    try:
        png = client.take_screenshot(view)
    except ConnectionError:  # as the viewer says that the view is not in front, or that it is too busy
        return np.zeros((1, 2, 3), np.int16)
    with Image.open(io.BytesIO(png)) as opened:
        return np.asarray(opened.convert("RGB")).astype(np.int16)


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


@contextmanager
def window() -> Iterator[ViewerClient]:
    """A viewer without a window, past its messages of the start."""
    try:
        headless.software_driver()
    except BenchError as missing:
        pytest.skip(str(missing))
    with headless.windowless(SIZE) as client:
        headless.wait(lambda: uncovered(client), 4 * headless.LOAD, "messages of the start do not fade")
        yield client


def uncovered(client: ViewerClient) -> bool:
    """Whether a dividing line goes all through the window: messages of the start hang over the first one."""
    return bool(((picture(client) == LINE).all(axis=2).mean(axis=1) > 0.97).any())


@pytest.fixture(scope="session")
def viewer() -> Iterator[ViewerClient]:
    """One viewer for all tests."""
    with window() as client:
        yield client


@pytest.fixture(scope="session")
def blank_panes(viewer: ViewerClient) -> Callable[[Path], list[str]]:
    """What is wrong with the panes of a recording: those that are blank, and arms that collapse.

    What a viewer that has shown others makes blank counts only where a new one does so too.
    """

    def looked(file: Path) -> list[str]:
        try:
            found = Looked(viewer, file).faults()
        finally:
            viewer.close("all")
        if found:
            with window() as fresh:
                found = Looked(fresh, file).faults()
        return collapsing(file) + found

    return looked
