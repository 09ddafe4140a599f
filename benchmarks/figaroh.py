"""FIGAROH 1.0.2 beside `testbench calibrate` on the public UR10 readings: `python benchmarks/figaroh.py`.

Both get positions alone of the same 400 evenly spaced poses of series C, and are judged by the rest of C and
by A, of which 50 poses tell frame and marker. FIGAROH fits all geometry; so do we in a row of ours. It is
installed by requirements-peer.lock into a venv of its own below --out, from the index that pip is set up for.
"""

import json
import subprocess
import sys
import venv
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
import numpy.typing as npt
import typer
from threadpoolctl import threadpool_limits

import testbench as tb
from testbench.arm.folder import Arm
from testbench.data.dataset import Series, select_rows
from testbench.files.export import draft_new
from testbench.identify.absolute.fit import CalibrationOptions, calibrate
from testbench.identify.posterior import elastic_state
from testbench.model.load import read_body_masses
from testbench.model.vjm import Vjm
from testbench.runs import command
from testbench.runs import manifest as files
from testbench.workflows.absolute import evenly_spaced_rows, position_errors
from testbench.workflows.cell import build_cell

ROOT = Path(__file__).resolve().parents[1]
READINGS = ROOT / "models" / "ur10" / "readings"
FIT, FRAME = 400, 50  #: Poses that calibrate, and that tell the frame of A.
CONFIG = """schema_version: "1.0"
robot: {{name: ur10}}
tasks:
  calibration:
    enabled: true
    kinematics: {{base_frame: universe, tool_frame: {tool}}}
    joints: {{active_joints: [{joints}]}}
    parameters: {{calibration_level: full_params}}
    measurements: {{markers: [{{measurable_dof: [true, true, true, false, false, false]}}]}}
    data: {{source_file: {file}, number_of_samples: {poses}}}
"""
OURS = {
    "testbench, all geometry": CalibrationOptions(used_errors=frozenset()),
    "testbench": CalibrationOptions(),
}
app = typer.Typer(add_completion=False)


@app.command()
def main(out: Annotated[Path, typer.Option(help="Folder of results.")] = Path("runs/figaroh")) -> int:
    """Calibrate by both and print mean distances of readings that were not fitted."""
    cell = build_cell("ur10")
    c, a = (_read(name, cell.arm) for name in ("series_C.csv", "series_A_every_8th.csv"))
    fit = evenly_spaced_rows(c, FIT)
    (data := out.resolve() / "data").mkdir(parents=True, exist_ok=True)
    _write(data, cell.vjm, (c, fit), (a, evenly_spaced_rows(a, FRAME)))
    rows = {"FIGAROH, all geometry": _peer(out.resolve(), data)}
    with threadpool_limits(1):
        for name, options in OURS.items():
            found = calibrate(cell.vjm, (select_rows(c, fit),), tb.cad_prior(cell.arm), options)
            judged = position_errors(found.model(), [select_rows(c, _others(c, fit))], None)
            rows[name] = {
                "c_mm": judged.mean_mm,
                "a_mm": position_errors(found.model(), [a], FRAME).mean_mm,
            }
    files.write_json(rows, out / "figaroh.json")
    print(f"mean error after {len(fit)} poses of C, mm: rest of C, then A")
    for name, row in rows.items():
        print(f"{name:24} {row['c_mm']:.3f} {row['a_mm']:.3f}")
    return 0


def _read(name: str, arm: Arm) -> Series:
    """Positions alone."""
    [series] = tb.read_series(READINGS / name, arm).series
    return replace(series, rotation=None, sigma_rotation=None)


def _others(series: Series, rows: npt.NDArray[np.int_]) -> npt.NDArray[np.int_]:
    return np.setdiff1d(np.arange(series.n_rows), rows)


def _write(data: Path, vjm: Vjm, *parts: tuple[Series, npt.NDArray[np.int_]]) -> None:
    """The arm as drawn, the readings and the settings, as FIGAROH reads them."""
    arm = vjm.arm
    rigid = elastic_state(vjm, np.zeros((vjm.n_theta, vjm.n_theta)), read_body_masses(arm))
    (data / "robot.urdf").write_text(draft_new(rigid).text)
    names = [joint.name for joint in arm.joints]
    for (series, rows), kinds in zip(parts, (("fit", "rest"), ("a_frame", "a_rest")), strict=True):
        for own, kind in zip((rows, _others(series, rows)), kinds, strict=True):
            table = np.column_stack([series.position[own, 0], series.q[own]])
            head = ",".join(("x1", "y1", "z1", *names))
            np.savetxt(data / f"{kind}.csv", table, delimiter=",", header=head, comments="")
    settings = CONFIG.format(tool=arm.tool, joints=", ".join(names), file=data / "fit.csv", poses=FIT)
    (data / "config.yaml").write_text(settings)


def _peer(out: Path, data: Path) -> dict[str, float]:
    """What FIGAROH finds, in a venv made where there is none."""
    python, lock = out / "venv" / "bin" / "python", ROOT / "requirements-peer.lock"
    done = out / "venv" / lock.name
    if not done.is_file() or done.read_bytes() != lock.read_bytes():
        venv.create(out / "venv", clear=True, with_pip=True)
        install = ["-m", "pip", "install", "-q", "--require-hashes", "--no-deps", "-r", str(lock)]
        subprocess.run([python, *install], check=True)
        done.write_bytes(lock.read_bytes())
    script = Path(__file__).with_name("figaroh_peer.py")
    # -P: this file is called as the package
    subprocess.run([python, "-P", script, data], check=True, stdout=subprocess.DEVNULL, cwd=out)
    return dict(json.loads((data / "peer.json").read_text()))


if __name__ == "__main__":
    sys.exit(command.run(app))
