"""Absolute readings in every notation that laboratories publish, read with a map of a few lines."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from testbench.arm.folder import load_arm
from testbench.data.series import Series
from testbench.data.series_csv import write_series
from testbench.data.series_export import SeriesExport, read_series
from testbench.errors import BenchError

ROOT = Path(__file__).parents[2]
ARM = load_arm(ROOT / "models" / "arm_6r")
KR500 = load_arm(ROOT / "models" / "kr500_l480")
N = 7
RNG = np.random.default_rng(11)
Q = 0.9 * RNG.uniform(*ARM.limits, (N, 6))
P = RNG.uniform(-3, 3, (N, 3))
R = Rotation.random(N, random_state=3)
JOINTS = [f"joint_{k}_rad" for k in range(1, 7)]
XYZ = ["x_mm", "y_mm", "z_mm"]
SAME_PLACE = 1e-12  #: Rounding of a number written in full [m].


def read(folder: Path, columns: dict[str, list], toml: str = "", arm=ARM, name="one") -> SeriesExport:
    lines = [",".join(columns), *(",".join(map(str, row)) for row in zip(*columns.values(), strict=True))]
    (folder / f"{name}.csv").write_text("\n".join(lines), encoding="utf-8")
    (folder / "map.toml").write_text(toml)
    return read_series(folder / f"{name}.csv", arm, folder / "map.toml" if toml else None)


def table(names: list[str], values) -> dict[str, list]:
    return dict(zip(names, np.asarray(values).T.tolist(), strict=True))


PLAIN = table(JOINTS, Q) | table(XYZ, 1e3 * P)


def check_alike(a: Series, b: Series, tolerance: float = 1e-9) -> None:
    """Equal in all that a file holds; matrices of rotation and precision relative to their size."""
    for name in a.__dataclass_fields__:
        x, y = getattr(a, name), getattr(b, name)
        if isinstance(x, np.ndarray):
            np.testing.assert_allclose(y, x, rtol=tolerance, atol=tolerance, err_msg=name)
        elif isinstance(x, float):
            assert y == pytest.approx(x, rel=1e-12), name
        else:
            assert x == y, name


NOTATIONS = {
    f"{kind} {axes}": axes for kind in ("intrinsic", "extrinsic") for axes in ("xyz", "zyx", "zyz", "xzy")
}


@pytest.mark.parametrize("notation", NOTATIONS)
def test_euler_angles_in_any_order_are_the_rotation_that_scipy_makes_of_them(tmp_path, notation):
    kind, axes = notation.split()
    angles = R.as_euler(axes.upper() if kind == "intrinsic" else axes, degrees=True)
    own = table(["first", "second", "third"], angles)
    toml = f'[series]\nrotation = "{notation}"\n[columns]\nrotation_1_deg = "first"\n'
    toml += 'rotation_2_deg = "second"\nrotation_3_deg = "third"\n'
    [s] = read(tmp_path, PLAIN | own, toml).series
    np.testing.assert_allclose(s.rotation, R.as_matrix(), atol=1e-12)
    if len(set(axes)) == 3:  # the same named by their axes
        named = dict(zip((f"r{x}" for x in axes), own.values(), strict=True))
        toml = f'[series]\nrotation = "{notation}"\n[columns]\n"rotation_{{axis}}_deg" = "r{{axis}}"\n'
        [s] = read(tmp_path, PLAIN | named, toml).series
        np.testing.assert_allclose(s.rotation, R.as_matrix(), atol=1e-12)


def test_quaternions_matrices_and_vectors_are_the_same_rotations(tmp_path):
    quat = R.as_quat().round(6)  # x, y, z, w, rounded as files have them
    for own in (
        table(["qx", "qy", "qz", "qw"], quat),
        table([f"rotation_{i}{j}" for i in "123" for j in "123"], R.as_matrix().reshape(N, 9)),
        table([f"rotation_{x}_rad" for x in "xyz"], R.as_rotvec()),
    ):
        [s] = read(tmp_path, PLAIN | own).series
        np.testing.assert_allclose(s.rotation, R.as_matrix(), atol=3e-6)
        np.testing.assert_allclose(
            s.rotation @ s.rotation.swapaxes(1, 2), np.tile(np.eye(3), (N, 1, 1)), atol=1e-12
        )


def full(**changes) -> Series:
    """A series with everything: two markers, one lost in a row, loads, torques, covariances."""
    A = RNG.normal(size=(N, 3, 3, 3))
    C = 1e-10 * (A @ A.swapaxes(2, 3) + np.eye(3))
    precision = np.linalg.inv(C)
    precision = (precision + precision.swapaxes(2, 3)) / 2
    precision[2, 1] = 0
    position = RNG.uniform(-3, 3, (N, 3, 3))
    position[2, 1] = 0
    wrench = RNG.normal(size=(N, 6))
    wrench[::2] = 0
    rotation = R.as_matrix()
    rotation[4] = np.nan
    every = Series(
        name="whole A",
        markers=KR500.markers,
        frame="cell",
        target="mount",
        row=np.arange(N) * 3 + 5,
        pose=np.array([4, 4, 7, 8, 8, 9, 2]),
        q=0.9 * RNG.uniform(*KR500.limits, (N, 6)),
        wrench=wrench,
        point=RNG.normal(size=(N, 3)),
        position=position,
        sigma=31e-6,
        precision=precision,
        rotation=rotation,
        sigma_rotation=2e-4,
        torque=RNG.normal(size=(N, 6)),
        temperature=RNG.uniform(20, 25, N),
        time=np.arange(N) * 40.0,
    )
    return replace(every, **changes)


def test_what_we_write_is_read_back(tmp_path):
    """One series, two that share a frame, and the least there is."""
    path = tmp_path / "whole.csv"
    first, second = full(), full(name="whole B", target="another", rotation=None, sigma_rotation=None)
    write_series(path, KR500, (first, second))
    back = read_series(path, KR500).series
    for a, b in zip((first, second), back, strict=True):
        check_alike(a, b)
    one = read(tmp_path, PLAIN).series[0]
    write_series(tmp_path / "one.csv", ARM, one, decimals=7)
    assert "series" not in (tmp_path / "one.csv").read_text()
    check_alike(one, replace(read_series(tmp_path / "one.csv", ARM).series[0]), tolerance=6e-8)
    with pytest.raises(BenchError, match="markers"):
        write_series(path, ARM, replace(one, markers=("unknown",)))
