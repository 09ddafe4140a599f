"""What every layout draws with: things that stand still, and rows on timelines."""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from rerun.components import MarkerShape

from testbench.errors import Array
from testbench.views.recording.style import Colour

MARKDOWN = "text/markdown"


@dataclass(frozen=True)
class Line:
    """A line of a plot."""

    path: str  #: Its entity, the unit in its name.
    name: str  #: In the legend, unit included.
    colour: Colour  #: Of its role.
    width: float = 3.0  #: In ui points.
    shape: MarkerShape | None = None  #: Of the points on it; None for none.
    size: float | None = 4.0  #: Of the points; None where every row has its own.


@dataclass(frozen=True)
class Pen:
    """A recording that is being written, and the times of the rows that go into it."""

    stream: rr.RecordingStream
    times: tuple[rr.TimeColumn, ...] = ()

    def on(self, *times: rr.TimeColumn) -> "Pen":
        """The same on other timelines."""
        return replace(self, times=times)

    def still(self, path: str, *what: rr.AsComponents) -> None:
        """What does not change, or the looks of what does."""
        self.stream.log(path, *what, static=True)

    def documents(self, documents: Mapping[str, str]) -> None:
        """Markdown that does not change, by path."""
        for path, text in documents.items():
            self.still(path, rr.TextDocument(text, media_type=MARKDOWN))

    def names(self, path: str, at: Array, texts: Sequence[str], colours: Colour | Sequence[Colour]) -> None:
        """Texts that stand still at places (n, 2) or (n, 3)."""
        points = rr.Points2D if np.shape(at)[1] == 2 else rr.Points3D
        self.still(path, points(at, labels=texts, colors=colours, radii=0.0, show_labels=True))

    def rows(self, path: str, columns: Iterable[rr.ComponentColumn]) -> None:
        """A row a time."""
        self.stream.send_columns(path, self.times, columns)

    def texts(self, path: str, texts: Sequence[str]) -> None:
        """Markdown, one a time."""
        self.rows(path, rr.TextDocument.columns(text=texts, media_type=[MARKDOWN] * len(texts)))

    def label(self, path: str, at: Array, texts: Sequence[str], colour: Colour) -> None:
        """A text a time, at places (times, 3) [m]."""
        self.still(path, rr.Points3D.from_fields(colors=colour, radii=0.0, show_labels=True))
        self.rows(path, rr.Points3D.columns(positions=at, labels=texts).partition([1] * len(at)))

    def points(self, path: str, positions: Array) -> None:
        """Several points a time, (times, m, 3) [m]."""
        columns = rr.Points3D.columns(positions=positions.reshape(-1, 3))
        self.rows(path, columns.partition([positions.shape[1]] * len(positions)))

    def arrows(self, path: str, origins: Array, vectors: Array) -> None:
        """Several arrows a time, each (times, m, 3) [m]."""
        columns = rr.Arrows3D.columns(origins=origins.reshape(-1, 3), vectors=vectors.reshape(-1, 3))
        self.rows(path, columns.partition([origins.shape[1]] * len(origins)))

    def line(self, line: Line, values: Array, sizes: Array | None = None) -> None:
        """A line of a plot: its looks, and its values on these times."""
        self.looks(line)
        self.values(line, values, sizes)

    def looks(self, line: Line) -> None:
        """How a line of a plot is drawn."""
        self.still(line.path, rr.SeriesLines(colors=line.colour, widths=line.width, names=line.name))
        if line.shape is not None:
            dots = rr.SeriesPoints(
                colors=line.colour, markers=line.shape, names=line.name, marker_sizes=line.size
            )
            self.still(line.path, dots)

    def values(self, line: Line, values: Array, sizes: Array | None = None) -> None:
        """A value a time, (times,), NaN for none, and where it is not everywhere the same a size."""
        known = np.isfinite(values)
        columns = [*rr.Scalars.columns(scalars=values[known]).partition(known.astype(int))]
        if sizes is not None:  # in one chunk: of two the viewer pairs rows wrongly on an unsorted timeline
            columns += rr.SeriesPoints.columns(marker_sizes=sizes)
        self.rows(line.path, columns)


def snake(title: str) -> str:
    """A title as a path."""
    return re.sub(r"\W+", "_", title.lower()).strip("_")


def text_view(origin: str, name: str) -> rrb.TextDocumentView:
    """The view of a document."""
    return rrb.TextDocumentView(origin=origin, name=name)
