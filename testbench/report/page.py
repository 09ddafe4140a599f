"""The page of a run: one HTML file that opens anywhere, with words, tables, charts, the arm, a map of errors.

The folder page/ beside this module has its template, styles and scripts.
"""

import base64
import functools
import itertools
import json
import math
import re
from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markdown_it import MarkdownIt
from markupsafe import Markup

from testbench.errors import Array
from testbench.plant.shapes import (
    BodyFrames,
    Shape,
    Surface,
    decimate,
    primitive_surface,
    quaternions_from_rotations,
    visual_shapes,
)
from testbench.report.colours import SCALE, Look, hexadecimal
from testbench.report.markdown import ReportWords, as_plain
from testbench.report.scene import ErrorScale, ModelLine, PageContent, PoseGroup, legs, squares, tube_colours
from testbench.report.schema import Table, TableColumn, brackets, looks
from testbench.runs import manifest as files
from testbench.runs.spread import Spread, dotted, inner
from testbench.workflows.model_names import row_words

Json = Mapping[str, object]
FOLDER = Path(__file__).parent / "page"
SCRIPTS = ("tables.js", "charts.js", "raster.js", "scene.js", "maps.js", "page.js")
"""In the order in which they are run."""
BRACKETS = re.compile(r" (?=[(\[])")


def markdown(text: str) -> Markup:
    """Render Markdown as HTML: tags in it are shown as text, pictures are left out."""
    return Markup(_renderer().render(text))


@functools.cache
def _renderer() -> MarkdownIt:
    """Build the renderer once: a report has dozens of texts."""
    return MarkdownIt("commonmark", {"html": False}).enable("table").disable("image")


def grid(table: Table) -> Json:
    """Convert a table to rows of cells, each with its text and the numbers behind it."""
    drawn = [_drawn(column, table) for column in table.columns]
    head = [
        {"title": column.title, "drawn": own, "ratio": column.key == "ratio"}
        for column, own in zip(table.columns, drawn, strict=True)
    ]
    rows = [
        {
            "marked": table.marks(row),
            "cells": [_cell(column, row) for column in table.columns],
        }
        for row in table.rows
    ]
    shown = table.looks or looks(table.rows, table.columns[0])
    return {
        "title": table.title,
        "across": table.across,
        "first": next((k for k, c in enumerate(table.columns) if c.key == table.headline and drawn[k]), -1),
        "head": head,
        "rows": rows,
        "stepwise": table.stepwise,
        "brackets": brackets(table),
        "dots": dotted(c.value(row) for c in itertools.compress(table.columns, drawn) for row in table.rows),
        "looks": {name: look_plain(look) for name, look in shown.items()},
        "words": {name: row_words(name) for name in (table.columns[0].cell(row) for row in table.rows)},
    }


def look_plain(look: Look) -> Json:
    """Convert colour, shape and filling of a model's dots to JSON data."""
    return {"colour": look.hex, "mark": look.mark, "filled": look.prior}


def _drawn(column: TableColumn, table: Table) -> bool:
    """Whether a column can be drawn: numbers, and not all alike."""
    numbers = [_numbers(column.value(row)) for row in table.rows]
    return column.form != "yes" and len({n[0] for n in numbers if n}) > 1


def _cell(column: TableColumn, row: object) -> Json:
    """Its text, and what is drawn: the number or median, its line, a dot a trial; below 20 these alone."""
    value = column.value(row)
    known = column.known(row)
    text = column.cell(row)
    found: dict[str, object] = {"text": f"{text} [{known}]" if known else text}
    if not (numbers := _numbers(value)):
        return found
    found["v"] = numbers[0]
    if len(numbers) > 1 and (line := inner(value)):
        found |= {"low": line[0], "high": line[1]}
    if isinstance(value, Spread) and value.values:
        found |= {"dots": [float(f"{x:.4g}") for x in value.values], "few": value.too_few}
    return found


def unbroken(text: str) -> Markup:
    """Keep the text of a cell together: it breaks before what is in brackets, and nowhere else."""
    parts = BRACKETS.split(text)
    return Markup(" ").join(Markup("<span>{}</span>").format(part) for part in parts)


def _numbers(value: object) -> tuple[float, ...]:
    """A number alone, or a median with its ends; nothing of words, NaN, infinity."""
    found: tuple[float, ...] = ()
    if isinstance(value, Spread):
        found = value.median, *value.ends
    elif isinstance(value, int | float):
        found = (float(value),)
    return found if all(map(math.isfinite, found)) else ()


def embedded(png: Path) -> Markup:
    """Embed a picture as the address of itself."""
    data = base64.b64encode(png.read_bytes()).decode()
    return Markup(f"data:image/png;base64,{data}")


def data(value: object) -> Markup:
    """Write plain data as JSON that cannot end the script element in which it stands."""
    text = json.dumps(value, separators=(",", ":"), allow_nan=False)
    for letter in "<>&\u2028\u2029":
        text = text.replace(letter, f"\\u{ord(letter):04x}")
    return Markup(text)


def fill(**values: object) -> str:
    """Fill the page."""
    style = (FOLDER / "page.css").read_text(encoding="utf-8")
    script = "\n".join((FOLDER / name).read_text(encoding="utf-8") for name in SCRIPTS)
    own = {"style": Markup(style), "script": Markup(script)}
    return _environment().get_template("page.html.j2").render(**values, **own)


@functools.cache
def _environment() -> Environment:
    found = Environment(
        loader=FileSystemLoader(FOLDER),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    found.filters |= {"markdown": markdown, "data": data, "unbroken": unbroken}
    return found


NAME = "report.html"
MARKED, FACTS = ("answer", "worst", "statements"), ("badge", "question", "title")
"""Blocks of Markdown, and those that are text."""
MICRO = 1e4  #: Places are written as whole tenths of a millimetre, turns as whole parts of ten thousand.
TRIANGLES = 500  #: Of a mesh at most: an arm turns smoothly on a phone.


def write_page(folder: Path, scenario: str, words: ReportWords, page: PageContent) -> None:
    """Write report.html of a run, from its words, what is drawn, and the pictures in its folder.

    Args:
        folder: The folder.
        scenario: Name of the study or command.
        words: Words of the report.
        page: What the page draws.
    """
    pictures = [{"name": png.name, "data": embedded(png)} for png in sorted(folder.glob("*.png"))]
    text = fill(
        scenario=scenario,
        words={name: words.block(name) for name in MARKED}
        | {name: as_plain(words.block(name)) for name in FACTS},
        rest=words.block("body"),
        drawn=seen_plain(page),
        pictures=pictures,
        others=[name for name in (*files.inside(folder), "manifest.json") if name != NAME],
        versions=files.versions(),
    )
    (folder / NAME).write_text(text, encoding="utf-8")


def seen_plain(page: PageContent) -> Json:
    """Convert all that is drawn to JSON data."""
    scene = page.scene and {
        "title": " ".join(filter(None, [page.scene.title, page.scene.tube_words])),
        "solids": [_solid(shape) for shape in visual_shapes(page.scene.cell.room)],
        "groups": [_group(pose_group, page.scene.tube_scale) for pose_group in page.scene.groups],
    }
    parts = {"map": _map(page), "runs": plain(page.runs), "tables": [grid(table) for table in page.tables]}
    return {"scene": scene, **parts, "ramp": SCALE}


def _map(page: PageContent) -> Json | None:
    """The map, with the places in its lines of the two whose difference is drawn."""
    if page.map is None:
        return None
    both = page.map.difference
    lines = list(page.map.lines)
    return {**plain(page.map), "difference": both and [lines.index(model_line) for model_line in both]}


def _group(pose_group: PoseGroup, scale: ErrorScale | None) -> Json:
    found = plain(replace(pose_group, near=None))
    for layer, own in zip(pose_group.layers, found["layers"], strict=True):
        if layer.kind == "tubes":
            own["colours"] = [hexadecimal(tuple(map(int, each))) for each in tube_colours(layer, scale)]
        if layer.kind == "trackers":
            own["legs"] = _whole(legs(layer.at[0]))
        if layer.kind == "faces":
            own["squares"] = _whole(squares(layer))
    return found if pose_group.near is None else {**found, "near": _near(pose_group.near)}


def plain(value: Any) -> Any:
    """Convert what is drawn to JSON data, by the names of its fields; null is what is no number.

    Numbers of a line have four digits, places of a map are in whole millimetres, all that moves in `MICRO`;
    what a look has stands beside what is drawn so.
    """
    if isinstance(value, BodyFrames):
        return frames_plain(value)
    if isinstance(value, Look):
        return look_plain(value)
    if is_dataclass(value):
        found = {own.name: plain(getattr(value, own.name)) for own in fields(value)}
        colour = {"colour": hexadecimal(found["colour"])} if "colour" in found else {}
        colour |= {"words": row_words(value.name)} if isinstance(value, ModelLine) else {}
        return found | found.pop("look", {}) | colour
    if isinstance(value, np.ndarray) and value.ndim == 3:
        return [_whole(row) for row in value]
    if isinstance(value, np.ndarray) and value.ndim == 2:
        return [[round(x, 3) for x in row] if np.isfinite(row).all() else None for row in value.tolist()]
    if isinstance(value, np.ndarray):
        return [float(f"{x:.4g}") if np.isfinite(x) else None for x in value.tolist()]
    if isinstance(value, list | tuple):
        return [plain(own) for own in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value


def _near(points: Array) -> Json:
    """What is in view, and the angles of the eye across its two longest extents, from above or beyond."""
    middle = points.mean(axis=0)
    axis = np.linalg.svd(points - middle)[2][2]
    beyond = middle + np.array([0, 0, np.abs(points).max()])
    axis = axis if axis @ beyond > 0 else -axis
    yaw, pitch = np.arctan2(axis[1], axis[0]), np.arcsin(np.clip(axis[2], -1, 1))
    return {"at": points.round(3).tolist(), "yaw": round(float(yaw), 3), "pitch": round(float(pitch), 3)}


def frames_plain(frames: BodyFrames) -> list[list[int | None]]:
    """Convert frames by pose: of every body its origin and its turn as a quaternion, x, y, z, w."""
    turns = quaternions_from_rotations(frames.rotations)
    return [_whole(row) for row in np.concatenate([frames.positions, turns], axis=2)]


def _whole(numbers: Array) -> list[int | None]:
    """Numbers as whole parts of ten thousand, row by row; null where there is none."""
    scaled = np.rint(MICRO * np.ravel(numbers))
    if np.isfinite(scaled).all():
        return [*map(int, scaled.tolist())]
    return [int(x) if math.isfinite(x) else None for x in scaled.tolist()]


def _solid(shape: Shape) -> Json:
    vertices, faces = solid(shape)
    brightness = float(shape.rgba[:3] @ [0.299, 0.587, 0.114])
    return {
        "body": shape.body,
        "v": _whole(vertices),
        "f": faces.ravel().tolist(),
        "bright": round(brightness, 3),
    }


def solid(shape: Shape) -> Surface:
    """Make a shape a closed surface in its body's axes, its triangles counter-clockwise from outside.

    Of a mesh they are few, and corners that differ in their normals alone are one.
    """
    if shape.mesh is None:
        corners, faces = primitive_surface(shape.kind, shape.half_sizes)
        return shape.centre + corners @ shape.rotation.T, faces
    places, inverse = np.unique(shape.mesh.vertices, axis=0, return_inverse=True)
    thin, faces = decimate(places, inverse.ravel()[shape.mesh.faces], TRIANGLES)
    return shape.centre + thin @ shape.rotation.T, faces
