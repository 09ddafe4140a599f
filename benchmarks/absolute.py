"""Calibration by 10,000 absolute poses: time beside what LAPACK needs for the same equations, and memory.

As a script, `python benchmarks/absolute.py POSES`, it calibrates once and prints its memory as JSON.
"""

import json
import resource
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
from measure import Row, at_most, note
from scipy.linalg.lapack import dgeqrf

from testbench.identify.absolute.fit import CalibrationOptions, calibrate
from testbench.identify.prior import cad_prior
from testbench.workflows.absolute_campaign import AbsoluteCampaign, simulate_series
from testbench.workflows.cell import build_cell

ARM, SEED = "kr500_l480", 3
FEW, MANY = 2500, 10_000
ORDERS = 60  #: 720 unknowns of six joints, beside 30 of geometry, 153 compliances and 12 of frame and mount.
EVERYTHING = frozenset({"joint springs", "joint errors", "links"})
REFERENCE_ROWS = 6000


def measured(poses: int) -> dict[str, float]:
    """Seconds, unknowns and memory of one calibration; what its data weigh is in the base."""
    cell = build_cell(ARM)
    series, _ = simulate_series(cell, AbsoluteCampaign(poses=poses, orientations=True), seed=SEED)
    base = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    start = time.perf_counter()
    found = calibrate(
        cell.vjm, series, cad_prior(cell.arm), CalibrationOptions(max_order=ORDERS, used_errors=EVERYTHING)
    )
    seconds = time.perf_counter() - start
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return {"seconds": seconds, "unknowns": len(found.active_unknowns.columns), "megabytes": peak - base}


def calibrating_by_absolute_poses() -> list[Row]:
    """The rows of time and memory; each calibration is a process of its own."""
    few, many = (_alone(poses) for poses in (FEW, MANY))
    rows = np.asfortranarray(
        np.random.default_rng(0).standard_normal((REFERENCE_ROWS, int(many["unknowns"])))
    )
    start = time.perf_counter()
    dgeqrf(rows)
    reference = (time.perf_counter() - start) * 6 * MANY / REFERENCE_ROWS
    return [
        at_most(
            f"(l) calibrating by {MANY} poses, {int(many['unknowns'])} unknowns",
            many["seconds"],
            "s",
            20,
            f"{many['seconds'] / reference:.1f} times LAPACK's dgeqrf of as many rows and columns",
        ),
        note(f"    the same of {FEW} poses", few["seconds"], "s", ""),
        at_most(
            f"(l) growth of memory from {FEW} to {MANY} poses",
            many["megabytes"] - few["megabytes"],
            "MB",
            60,
            f"{few['megabytes']:.0f} and {many['megabytes']:.0f} MB beside the readings",
        ),
    ]


def _alone(poses: int) -> dict[str, float]:
    command = [sys.executable, str(Path(__file__).resolve()), str(poses)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return dict(json.loads(done.stdout))


if __name__ == "__main__":
    print(json.dumps(measured(int(sys.argv[1]))))
