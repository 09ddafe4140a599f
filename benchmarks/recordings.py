"""Recordings: time and size of a calibration of two hundred runs and two hundred places."""

import tempfile
import time
from pathlib import Path

import numpy as np
from measure import MODELS, Row, at_most, interleave, spread

from testbench.bench.campaign import Scenario, build_cell, simulate
from testbench.bench.error_places import error_places, kept_mm, places_of
from testbench.bench.judged import identify
from testbench.bench.models import named_models
from testbench.bench.rows import fit_row
from testbench.model.poses import WorkArea
from testbench.report.report import Report
from testbench.views.markdown import Markdown
from testbench.views.page.calibration import calibration_seen
from testbench.views.recording.run import write_run
from testbench.views.recording.stream import Header

POSES, CHECK_POSES, PLACES = 140, 60, 200
REPEATS = 5
MEBIBYTE = 2**20
ANYWHERE = WorkArea((-4.0, -4.0, 0.8), (4.0, 4.0, 4.0))


def logging_two_hundred_poses() -> list[Row]:
    """Seconds and bytes of one recording: five models, three markers, every run in a pose of its own."""
    cell = build_cell(MODELS / "kr500_l480")
    scenario = Scenario(
        arm="kr500_l480",
        station=ANYWHERE,
        identification_poses=POSES,
        check_poses=CHECK_POSES,
        identification_runs=POSES,
        check_runs=CHECK_POSES,
        workspace_poses=PLACES,
    )
    campaign = simulate(cell, scenario, 1)
    results = identify(cell, campaign, named_models(cell), time.perf_counter)
    errors = {result.model.name: kept_mm(result.places) for result in results}
    found = error_places(places_of(cell, campaign.truth), errors, ("MLS32", "MGCO56"))
    rows = [fit_row(result.model.name, result.estimate, result.seconds) for result in results]
    header, said = Header("recordings", scenario.model_dump_json(), 1), Markdown("It is written.")
    words = Report("recordings", said, said, said, {}, {}, [])

    def write() -> None:
        write_run(path, header, words, calibration_seen((cell, campaign, results), rows, found, 50), {})

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "recording.rrd"
        [times] = interleave(REPEATS, write)
        size = path.stat().st_size / MEBIBYTE
    what = (
        f"{POSES + CHECK_POSES} runs, {PLACES} places, {len(results)} models, {len(cell.arm.markers)} markers"
    )
    return [
        at_most(
            "(e) logging a calibration", np.median(times), "s", 1, f"{spread(times, digits=2)} s: {what}"
        ),
        at_most("(e) its file", size, "MiB", 2, what),
    ]
