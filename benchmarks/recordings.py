"""Recordings: time and size of one of two hundred runs and two hundred places."""

import tempfile
from pathlib import Path

import numpy as np
from measure import MODELS, Row, at_most, interleave, spread

from testbench.plant.shapes import body_origins, elastic_frames, rigid_frames
from testbench.report.colours import MEASURED, look
from testbench.report.markdown import Markdown
from testbench.report.recording.run import write_run
from testbench.report.recording.stream import RecordingHeader
from testbench.report.report import Report
from testbench.report.scene import Layer, ModelLine, PageContent, PlaceMap, PoseGroup, RunChart, Scene
from testbench.workflows.cell import Cell, build_cell, clear_poses

RUNS, REPEATS = 200, 5
MEBIBYTE = 2**20
SAID = Markdown("It is written.")
LOOKS = {name: look(name, "psd" if "GCO" in name else "none") for name in ("MLS32", "MGCO56", "Joints")}


def _poses(cell: Cell, name: str, rng: np.random.Generator) -> PoseGroup:
    """Poses with a ghost, markers and an arrow a model and marker."""
    q = clear_poses(cell, None, RUNS, rng)
    theta = 0.01 * rng.standard_normal((RUNS, cell.arm.n_theta))
    rigid, bent = rigid_frames(cell.room, q), elastic_frames(cell.plant, q, theta)
    at = body_origins(cell.room, cell.arm.markers, bent)
    arrows = [
        Layer(model, own.colour, "arrows", at, at + rng.normal(scale=0.1, size=at.shape))
        for model, own in LOOKS.items()
    ]
    names = [f"{name} {k}" for k in range(RUNS)]
    words = [f"Joints at {cell.arm.pose_text(own)}." for own in q]
    return PoseGroup(name, names, words, rigid, bent, [Layer("markers", MEASURED, "dots", at), *arrows])


def logging_two_hundred_poses() -> list[Row]:
    """Seconds and bytes of one recording: three models and markers, every run in a pose of its own."""
    cell, rng = build_cell(MODELS / "kr500_l480"), np.random.default_rng(1)
    groups = [_poses(cell, name, rng) for name in ("Places", "Runs")]
    lines = [ModelLine(name, own, rng.random(RUNS)) for name, own in LOOKS.items()]
    seen = PageContent(
        Scene(cell, "Deflections x 50.", groups),
        PlaceMap("Error (mm)", 0, groups[0].rigid.positions[:, -1], lines),
        [RunChart("Left (mm)", 1, "pose", groups[1].names, lines)],
    )
    words, header = (
        Report("recordings", SAID, SAID, {}, {}, [], answer=SAID),
        RecordingHeader("recordings", "{}", 1),
    )
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "recording.rrd"
        [times] = interleave(REPEATS, lambda: write_run(path, header, words, seen, {}))
        size = path.stat().st_size / MEBIBYTE
    what = f"{RUNS} runs, {RUNS} places, {len(LOOKS)} models, {len(cell.arm.markers)} markers"
    seconds = f"{spread(times, digits=2)} s: {what}"
    return [
        at_most("(e) logging a calibration", np.median(times), "s", 1, seconds),
        at_most("(e) its file", size, "MiB", 2, what),
    ]
