"""Words, tables and data as HTML that runs nothing of a stranger's: all text is escaped, no tag is let in."""

import base64
import functools
import json
import math
import re
from collections.abc import Mapping
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markdown_it import MarkdownIt
from markupsafe import Markup

from testbench.trials.spread import Spread
from testbench.views.colours import Look
from testbench.views.schema import Column, Table, brackets, looks

Json = Mapping[str, object]
FOLDER = Path(__file__).parent
SCRIPTS = ("tables.js", "charts.js", "raster.js", "scene.js", "maps.js", "page.js")
"""In the order in which they are run."""
BRACKETS = re.compile(r" (?=[(\[])")


def markdown(text: str) -> Markup:
    """Markdown as HTML: tags in it are shown as text, pictures are left out."""
    found = MarkdownIt("commonmark", {"html": False}).enable("table").disable("image")
    return Markup(found.render(text))


def grid(table: Table) -> Json:
    """A table as rows of cells, each with its text and the numbers behind it."""
    drawn = [_drawn(column, table) for column in table.columns]
    head = [{"title": column.title, "drawn": own} for column, own in zip(table.columns, drawn, strict=True)]
    rows = [
        {
            "marked": table.bold == table.columns[0].cell(row),
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
        "brackets": brackets(table),
        "looks": {name: look_plain(own) for name, own in shown.items()},
    }


def look_plain(look: Look) -> Json:
    """Colour, shape and filling of a model's dots."""
    return {"colour": look.hex, "mark": look.mark, "filled": look.prior}


def _drawn(column: Column, table: Table) -> bool:
    """Whether a column can be drawn: numbers, and not all alike."""
    numbers = [_numbers(column.value(row)) for row in table.rows]
    return column.form != "yes" and len({n[0] for n in numbers if n}) > 1


def _cell(column: Column, row: object) -> Json:
    numbers = _numbers(column.value(row))
    known = column.known(row)
    text = column.cell(row)
    keys = dict(zip(("v", "low", "high"), numbers, strict=False))
    return {"text": f"{text} [{known}]" if known else text, **keys}


def unbroken(text: str) -> Markup:
    """The text of a cell: it breaks before what is in brackets, and nowhere else."""
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
    """A picture as the address of itself."""
    data = base64.b64encode(png.read_bytes()).decode()
    return Markup(f"data:image/png;base64,{data}")


def data(value: object) -> Markup:
    """Plain data as JSON that cannot end the script element in which it stands."""
    text = json.dumps(value, separators=(",", ":"), allow_nan=False)
    for letter in "<>&\u2028\u2029":
        text = text.replace(letter, f"\\u{ord(letter):04x}")
    return Markup(text)


def fill(**values: object) -> str:
    """The page."""
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
