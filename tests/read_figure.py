"""How the tests read a figure back: what stands in its axes, left in the words of its picture."""

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PathCollection
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse, Rectangle
from PIL import Image, PngImagePlugin


def leave(figure: Figure, file: Path, picture: Image.Image) -> None:
    """Write what a figure shows into the words of a small picture."""
    words = " ".join(f"{figure.get_suptitle()} {figure.get_supxlabel()}".split())
    about = PngImagePlugin.PngInfo()
    about.add_text(
        "figure", json.dumps({"words": words, "axes": [_axes(axes) for axes in figure.axes]}), zip=True
    )
    picture.save(file, "PNG", pnginfo=about)


def _read(file: Path) -> dict[str, Any]:
    with Image.open(file) as picture:
        picture.load()
        return dict(json.loads(picture.text["figure"]))


def words_of(file: Path) -> str:
    """Title and caption of a figure."""
    return str(_read(file)["words"])


def axes_of(file: Path) -> list[SimpleNamespace]:
    """What every axes of a figure shows; of those without title, ticks and data too, such as keys."""
    return [SimpleNamespace(**own) for own in _read(file)["axes"]]


def named(file: Path, title: str) -> SimpleNamespace:
    """The axes whose title begins so."""
    [found] = [own for own in axes_of(file) if own.title.startswith(title)]
    return found


def _axes(axes: Axes) -> dict[str, object]:
    lines = [
        (str(own.get_label()), own.get_marker(), to_hex(own.get_color()), *map(_plain, own.get_xydata().T))
        for own in axes.lines
    ]
    dots = [own for own in axes.collections if isinstance(own, PathCollection)]
    strokes = [own for own in axes.collections if isinstance(own, LineCollection)]
    bars = [own for own in axes.patches if isinstance(own, Rectangle)]
    rings = [own for own in axes.patches if isinstance(own, Ellipse)]
    return {
        "title": axes.get_title() or axes.get_title("left"),
        "labels": (axes.get_xlabel(), axes.get_ylabel()),
        "limits": (axes.get_xlim(), axes.get_ylim()),
        "ticks": [[text.get_text() for text in axis.get_ticklabels()] for axis in (axes.xaxis, axes.yaxis)],
        "lines": lines,  #: Label, marker, colour, x, y.
        "dots": [(_plain(own.get_offsets()), _plain(own.get_array())) for own in dots],
        "strokes": [[_plain(part) for part in own.get_segments()] for own in strokes],
        "bars": [(*own.get_bbox().bounds, to_hex(own.get_facecolor())) for own in bars],
        "rings": [(*own.center, own.width, own.height, own.angle) for own in rings],
        "texts": [text.get_text() for text in axes.texts],
    }


def _plain(numbers: object) -> object:
    """Numbers as lists; NaN where they are masked."""
    return None if numbers is None else np.ma.filled(np.ma.asarray(numbers, dtype=float), np.nan).tolist()
