"""One file a study: strict, closed with its footer in any case, and replaced only by a whole one."""

import contextlib
import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import rerun as rr
import rerun.blueprint as rrb

from testbench.files import versions
from testbench.output.whole import whole_file
from testbench.views.recording.pen import Pen

SCRUB = 10.0  #: How long the timeline that a reader lands on is played [s].


@dataclass(frozen=True)
class Header:
    """What identifies a recording."""

    scenario: str  #: Name of the scenario.
    parameters: str  #: The scenario as JSON.
    seed: int  #: Root of what is drawn.
    scales: Mapping[str, float] = field(default_factory=dict)  #: Magnifications by name [1].


@contextlib.contextmanager
def recording(path: Path, kind: str, header: Header, blueprint: rrb.Blueprint) -> Iterator[Pen]:
    """A stream in memory, closed in any case; without an error it is written to `path`, whole.

    A stream into a file would only print that the disk is full, and leave half of it.

    Args:
        path: The .rrd file.
        kind: Of study, in a word.
        header: What identifies it.
        blueprint: Its layout, embedded.
    """
    strict = rr.strict_mode()
    rr.set_strict_mode(True)  # otherwise a wrong argument only warns, and the data are lost
    words = f"{header.scenario} {header.parameters} {header.seed}"
    application = f"testbench_{kind}_{_digest(blueprint)}"
    digest = hashlib.sha256(words.encode()).hexdigest()[:16]
    try:
        # The stream's own properties hold the time of writing, and its chunks end by the clock: with
        # either equal seeds would differ.
        batches = rr.ChunkBatcherConfig.NEVER()
        stream = rr.RecordingStream(
            application, recording_id=digest, send_properties=False, batcher_config=batches
        )
        try:
            stream.set_log_time_enabled(False)
            stream.set_log_tick_enabled(False)
            memory = stream.memory_recording()
            stream.send_blueprint(blueprint)
            _write_properties(stream, header)
            yield Pen(stream)
            with whole_file(path) as part:
                part.write_bytes(memory.drain_as_bytes())
        finally:
            stream.disconnect()
    finally:
        rr.set_strict_mode(strict)


def _write_properties(stream: rr.RecordingStream, header: Header) -> None:
    stream.send_recording_name(f"{header.scenario}, seed {header.seed}")
    values: dict[str, Any] = {k: v for k, v in vars(header).items() if k != "scales"} | dict(header.scales)
    stream.send_property("study", rr.AnyValues(**values))
    stream.send_property("versions", rr.AnyValues(drop_untyped_nones=True, **versions()))


def layout(*tabs: rrb.Container | rrb.View, timeline: str, places: int) -> rrb.Blueprint:
    """The blueprint of a study: tabs, the first in front, and the timeline that a reader lands on.

    That many places on the timeline are played in SCRUB seconds.
    """
    fps = max(1.0, places / SCRUB)
    return rrb.Blueprint(
        rrb.Tabs(*tabs, active_tab=0),
        rrb.TimePanel(timeline=timeline, state="collapsed", play_state="paused", fps=fps),
        auto_views=False,
        collapse_panels=True,
    )


def _digest(blueprint: rrb.Blueprint) -> str:
    """What tells a layout from any other: names, shares, origins, cameras, axes; not its random ids.

    The viewer keeps one layout an application id: two runs with other titles or axes must not share it.
    """
    return hashlib.sha256("\n".join(_described(blueprint.root_container)).encode()).hexdigest()[:8]


def _described(part: rrb.Container | rrb.View) -> Iterator[str]:
    """Lines about a part of a layout and all within it."""
    if isinstance(part, rrb.Container):
        shares = (part.column_shares, part.row_shares, part.grid_columns)
        yield f"{part.kind!r} {part.name!r} {shares!r}"
        for inner in part.contents:
            yield from _described(inner)
        return
    hidden = sorted(map(repr, part.visualizer_overrides))
    yield f"{part.class_identifier!r} {part.name!r} {part.origin!r} {part.contents!r} {hidden}"
    for name, archetype in sorted(part.properties.items()):
        values = [batch.as_arrow_array().to_pylist() for batch in archetype.as_component_batches()]
        yield f"{name} {values}"
