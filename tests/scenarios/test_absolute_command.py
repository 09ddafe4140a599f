"""testbench simulate --absolute: files of readings that are read back as they were simulated."""

import numpy as np
import pytest
from run_here import fine

from testbench.files.read_series import read_series
from testbench.plant.disturbance import Disturbances, GearErrors, GeometryErrors
from testbench.workflows.absolute_campaign import AbsoluteCampaign, simulate_series

FLAGS = ("--poses", 15, "--series", 2, "--geometry-mm", 0.5, "--gear-urad", 20, "--sigma-um", 10, "--seed", 7)
ASKED = AbsoluteCampaign(
    series=2,
    poses=15,
    disturbances=Disturbances(
        own_weight=True, geometry=GeometryErrors(0.5e-3, 0.5e-3), gear_errors=GearErrors(sigma=20e-6)
    ),
    sigma=1e-5,
    sigma_rotation=1e-5,
)
LOADED = ("--loads", "100,300"), 45, {"masses": (0.0, 100.0, 300.0), "targets": 3}
TURNED = ("--orientations", "--tracker", "5,1,1"), 15, {"orientations": True, "trackers": ((5.0, 1.0, 1.0),)}


@pytest.mark.parametrize(("flags", "rows", "asked"), [LOADED, TURNED])
def test_files_of_a_simulation_are_read_back_as_it_was(kr500, flags, rows, asked, tmp_path):
    said = fine("simulate", "kr500_l480", "--absolute", *FLAGS, *flags, "--out", tmp_path / "new" / "ur.csv")
    expected, _ = simulate_series(kr500, ASKED.model_copy(update=asked), 7)
    for k, own in enumerate(expected, 1):
        path = tmp_path / "new" / f"ur_{k}.csv"
        assert f"{path}: {rows} rows in 15 poses, targets P1" in said
        [found] = read_series(path, kr500.arm).series
        assert found.name == found.frame == found.mount == f"ur_{k}"
        for name in ("markers", "pose_id", "q", "wrench", "position", "sigma", "sigma_rotation"):
            np.testing.assert_array_equal(getattr(found, name), getattr(own, name), err_msg=name)
        if own.rotation is not None:
            np.testing.assert_allclose(found.rotation, own.rotation, rtol=0, atol=1e-14)
