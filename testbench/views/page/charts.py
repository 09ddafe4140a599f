"""What a page draws beside the arm: a number for each run and model, and errors all over the workspace."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from testbench.errors import Array
from testbench.views.colours import Look
from testbench.views.page.scene import Json


@dataclass(frozen=True)
class Line:
    """The numbers of one model."""

    name: str
    look: Look
    values: Array  #: (n,), in the unit of its chart; NaN where there is none.
    ends: tuple[Array, Array] | None = None  #: Lower and upper end of an interval of each, (n,) both.


@dataclass(frozen=True)
class RunChart:
    """A number for each pose of a group of the scene, and each model."""

    title: str  #: What the numbers are, with unit.
    group: int  #: Index of the group in the scene.
    labels: Sequence[str]  #: Of the poses, a few letters each.
    lines: Sequence[Line]
    limit: float | None = None  #: What noise alone stays below in 95 %, in the same unit; NaN: none.
    note: str = ""  #: What else there is to say of them.

    def plain(self) -> Json:
        """As JSON data."""
        return {
            "title": self.title,
            "group": self.group,
            "labels": list(self.labels),
            "lines": [_line(line) for line in self.lines],
            "limit": None if self.limit is None or not np.isfinite(self.limit) else self.limit,
            "note": self.note,
        }


@dataclass(frozen=True)
class PlaceMap:
    """Errors at the tool's places in poses of a group of the scene, one map a model on one colour scale."""

    title: str  #: What the errors are, with unit.
    group: int  #: Index of the group in the scene.
    at: Array  #: Tool positions, (n, 3) [m]; NaN where there is none: not drawn.
    lines: Sequence[Line]
    heading: str = "Where it errs"
    without: str = ""  #: What a ring means, a place without a value.

    def plain(self) -> Json:
        """As JSON data."""
        return {
            "title": self.title,
            "group": self.group,
            "heading": self.heading,
            "without": self.without,
            "at": [
                [round(x, 3) for x in row] if np.isfinite(row).all() else None for row in self.at.tolist()
            ],
            "lines": [_line(line) for line in self.lines],
        }


def _line(line: Line) -> Json:
    found = {"name": line.name, **look_plain(line.look), "values": _short(line.values)}
    return found if line.ends is None else found | {"ends": [_short(end) for end in line.ends]}


def _short(values: Array) -> list[float | None]:
    """Four digits of each."""
    return [float(f"{x:.4g}") if np.isfinite(x) else None for x in values.tolist()]


def look_plain(look: Look) -> Json:
    """Colour, shape and filling of a model's dots."""
    return {"colour": look.hex, "mark": look.mark, "filled": look.prior}
