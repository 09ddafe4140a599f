"""How the tests read a recording back: from its file, by the viewer's own tools."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
from rerun.chunk import RrdReader

NAMES = [f"ViewBlueprint:{key}" for key in ("space_origin", "class_identifier", "display_name")]


def chunks_of(file):
    return list(RrdReader(file).stream())


def columns(chunks, path):
    """All components of an entity by name, as lists of lists; on several timelines, those of the last one."""
    found = {}
    for chunk in chunks:
        if chunk.entity_path == path:
            batch = chunk.to_record_batch()
            names = [name for name in batch.schema.names if name != "log_time"]  # of the blueprint
            found |= {name: batch.column(name).to_pylist() for name in names}
    return found


def on(chunks, timeline):
    """The chunks of a timeline, and the static ones."""
    return [c for c in chunks if c.is_static or timeline in c.timeline_names]


def series(chunks, path, timeline="typical_first"):
    """Scalars of an entity along a timeline from 1 on, NaN where there is none; at 0 one stands once more."""
    data = columns(on(chunks, timeline), path)
    rows = sorted(zip(data[timeline], data["Scalars:scalars"], strict=True))
    return [v[0] if v else np.nan for at, v in rows if at > 0]


def document(chunks, path):
    return columns(chunks, path)["TextDocument:text"][0][0]


def documents(chunks, path):
    """Texts of an entity in the order of the timeline on which a reader lands."""
    data = columns(chunks, path)
    return [text for _, [text] in sorted(zip(data["typical_first"], data["TextDocument:text"], strict=True))]


def rgb(colours):
    """Red, green and blue of packed colours, 0 to 255 each."""
    return [(c >> 24, c >> 16 & 255, c >> 8 & 255) for c in colours]


def layout(file):
    """All entities of the embedded blueprint by path."""
    reader = RrdReader(file)
    (blueprint,) = reader.blueprints()
    stream = list(reader.stream(store=blueprint))
    return {chunk.entity_path: columns(stream, chunk.entity_path) for chunk in stream}


def views(file):
    """Origin, class and name of every view of the embedded blueprint."""
    found = [data for data in layout(file).values() if NAMES[0] in data]
    return [tuple(data[key][0][0] for key in NAMES) for data in found]


def panes(file):
    """Number of views in each tab."""
    entities = layout(file)
    contents = {
        path.strip("/"): data["ContainerBlueprint:contents"][0]
        for path, data in entities.items()
        if "ContainerBlueprint:contents" in data
    }
    inner = {child for children in contents.values() for child in children}
    (root,) = set(contents) - inner

    def count(path):
        return sum(map(count, contents[path])) if path in contents else 1

    return [count(child) for child in contents[root]]


def rerun(*args):
    """Exit code and output of the viewer's own tool; `python -m rerun_cli` would lose the exit code."""
    command = [str(Path(sys.executable).with_name("rerun")), "rrd", *map(str, args)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
    return done.returncode, done.stdout + done.stderr


BUDGET, TABS = 1_500_000, 4  #: Most bytes, and tabs: a question each.


def sound(file, answer):
    """A whole recording of modest size that says its answer, units in its titles, data in every view.

    Returns:
        Its chunks.
    """
    assert "1 file verified without error" in rerun("verify", file)[1]
    assert file.stat().st_size < BUDGET
    chunks = chunks_of(file)
    landed = on(chunks, "typical_first")
    for origin, kind, name in views(file):
        assert [c for c in landed if f"{c.entity_path}/".startswith(f"/{origin}/")], (origin, name)
        assert kind != "TimeSeries" or re.search(r"\((mm|um|urad|deg)[,)]", name), name
    assert max(panes(file)) <= 8
    assert len(panes(file)) <= TABS
    assert not [
        chunk for chunk in chunks if any("Image" in name for name in chunk.to_record_batch().schema.names)
    ]
    assert {name for chunk in chunks for name in chunk.timeline_names} <= {"typical_first"}
    assert answer in document(chunks, "/summary")
    return chunks
