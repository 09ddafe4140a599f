"""FIGAROH's side of benchmarks/figaroh.py, in a venv of its own: calibrate by fit.csv, judge by the others.

As a script, `python -P benchmarks/figaroh_peer.py FOLDER`: writes peer.json there, mean distances in mm.
"""

import json
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pinocchio as pin
from figaroh.calibration.base_calibration import BaseCalibration
from figaroh.calibration.calibration_tools import calc_updated_fkm, estimate_frames_closed_form, load_data
from scipy.optimize import least_squares

FRAME = ("base_", "pEE")  #: Begin names of what belongs to a series, not to the arm.


def main(folder: Path) -> None:
    """Calibrate all geometry, then judge; of another series frame and marker are fitted anew."""
    model = pin.buildModelFromUrdf(str(folder / "robot.urdf"))
    robot = SimpleNamespace(model=model, data=model.createData(), q0=pin.neutral(model))
    own = BaseCalibration(robot, str(folder / "config.yaml"))
    own.calib_config |= {"known_baseframe": False, "known_tipframe": False}
    own.initialize()
    found = own.solve(enable_logging=False).x
    names = own.calib_config["param_name"]
    of_series = [k for k, name in enumerate(names) if name.startswith(FRAME)]

    def off(x: object, q: object, read: object) -> np.ndarray:
        return np.asarray(calc_updated_fkm(model, robot.data, x, q, own.calib_config) - read)

    def judge(x: object, file: str) -> float:
        read, q = load_data(str(folder / file), model, own.calib_config)
        return 1e3 * float(np.linalg.norm(off(x, q, read).reshape(3, -1), axis=0).mean())

    read, q = load_data(str(folder / "a_frame.csv"), model, own.calib_config)
    guess = estimate_frames_closed_form(model, robot.data, q, read, own.calib_config)
    again = np.array([guess.get(name, x) for name, x in zip(names, found, strict=True)])

    def of_frame(x: object) -> np.ndarray:
        again[of_series] = x
        return off(again, q, read)

    again[of_series] = least_squares(of_frame, again[of_series], method="lm").x
    said = {"c_mm": judge(found, "rest.csv"), "a_mm": judge(again, "a_rest.csv"), "parameters": len(names)}
    (folder / "peer.json").write_text(json.dumps(said))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
