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
from testbench.output.scratch import whole_file
from testbench.views.recording.pen import Pen

LAYOUTS = {
    "calibration": 2,
    "solver": 1,
    "single_link": 1,
    "sweep": 1,
    "plan": 1,
    "arm": 1,
    "data": 1,
    "planted": 1,
    "absolute": 1,
    "ladder": 1,
    "prediction": 1,
    "compensated": 1,
    "identified": 1,
}
"""Kinds of study, and the version of each one's layout: the viewer keeps a layout an application id."""


@dataclass(frozen=True)
class Header:
    """What identifies a recording."""

    scenario: str  #: Name of the scenario.
    parameters: str  #: The scenario as JSON.
    seed: int  #: Root of what is drawn.
    scales: Mapping[str, float] = field(default_factory=dict)  #: Magnifications by name [1].


@contextlib.contextmanager
def recording(path: Path, kind: str, header: Header, blueprint: rrb.Blueprint) -> Iterator[Pen]:
    """A stream into a part file, closed with its footer in any case; without an error it becomes `path`.

    Args:
        path: The .rrd file.
        kind: Key of LAYOUTS.
        header: What identifies it.
        blueprint: Its layout, embedded.
    """
    strict = rr.strict_mode()
    rr.set_strict_mode(True)  # otherwise a wrong argument only warns, and the data are lost
    words = f"{header.scenario} {header.parameters} {header.seed}"
    application = f"testbench_{kind}_v{LAYOUTS[kind]}"
    digest = hashlib.sha256(words.encode()).hexdigest()[:16]
    try:
        with whole_file(path) as part:
            # The stream's own properties would hold the time of writing: equal seeds would differ.
            stream = rr.RecordingStream(application, recording_id=digest, send_properties=False)
            try:
                stream.set_log_time_enabled(False)
                stream.set_log_tick_enabled(False)
                stream.save(part, default_blueprint=blueprint)
                _write_properties(stream, header)
                yield Pen(stream)
            finally:
                stream.disconnect()
    finally:
        rr.set_strict_mode(strict)


def _write_properties(stream: rr.RecordingStream, header: Header) -> None:
    stream.send_recording_name(f"{header.scenario}, seed {header.seed}")
    values: dict[str, Any] = {k: v for k, v in vars(header).items() if k != "scales"} | dict(header.scales)
    stream.send_property("study", rr.AnyValues(**values))
    stream.send_property("versions", rr.AnyValues(drop_untyped_nones=True, **versions()))


def layout(*tabs: rrb.Container | rrb.View, timeline: str) -> rrb.Blueprint:
    """The blueprint of a study: tabs, the first in front, and the timeline that a reader lands on."""
    return rrb.Blueprint(
        rrb.Tabs(*tabs, active_tab=0),
        rrb.TimePanel(timeline=timeline, state="collapsed", play_state="paused"),
        auto_views=False,
        collapse_panels=True,
    )
