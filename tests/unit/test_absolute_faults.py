"""Faults planted in absolute readings of simulated arms: each is found, named and mended where it can be."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from testbench.bench.absolute_settings import AbsoluteCampaign
from testbench.bench.absolute_truth import simulate_series
from testbench.bench.campaign import build_cell
from testbench.data.series import select_rows
from testbench.identify.absolute.fit import Options, calibrate
from testbench.identify.prior import cad_prior

ONLY = Options(only=frozenset({"joint springs"}))
ROWS = 60


@pytest.fixture(scope="module")
def ur10():
    """A robot of some hundredths of a millimetre of noise and tenths of what the first fit leaves open."""
    return build_cell("ur10")


def read(cell, seed=1, **asked):
    """One series of a true arm with typical errors, poses and orientations."""
    return simulate_series(cell, AbsoluteCampaign(**{"poses": ROWS, "orientations": True} | asked), seed)[0]


def calibrated(cell, *series, options=ONLY):
    return calibrate(cell.vjm, series, cad_prior(cell.arm), options)


def position_only(series):
    return replace(series, rotation=None, sigma_rotation=None)


def target_moved(series, k, move, turn=(0, 0, 0)):
    """The mount moved and turned on the tool from place k on, in its own axes."""
    R, behind = series.rotation, np.arange(series.rows) >= k
    d, W = np.asarray(move), Rotation.from_rotvec(turn).as_matrix()
    position = series.position + behind[:, None, None] * (R @ d)[:, None]
    return replace(series, position=position, rotation=np.where(behind[:, None, None], R @ W, R))


def tracker_moved(series, k, move, turn=(0, 0, 0)):
    """The tracker moved and turned about its own origin from place k on."""
    behind, W = np.arange(series.rows) >= k, Rotation.from_rotvec(turn).as_matrix()
    position = np.where(behind[:, None, None], series.position @ W.T + move, series.position)
    rotation = np.where(behind[:, None, None], W @ series.rotation, series.rotation)
    return replace(series, position=position, rotation=rotation)


@pytest.mark.parametrize("order", ["random", "joint 1 rises", "loaded after a while"])
def test_nothing_moves_in_sound_series(ur10, order):
    """Also where poses or loads change along with time, and the model's own errors with them."""
    for seed in range(2):
        masses = (0.0, 5.0) if order == "loaded after a while" else (0.0,)
        (one,) = read(ur10, seed, masses=masses)
        late = one.q[:, 0] if order == "joint 1 rises" else np.linalg.norm(one.wrench, axis=1)
        sorted_rows = select_rows(one, np.argsort(late, kind="stable"))
        assert not calibrated(ur10, replace(sorted_rows, row=one.row)).notes


FAULTS = {
    "target by 1 mm": (9, "target", lambda s, k: target_moved(s, k, (0, 0.6e-3, 0.8e-3))),
    "target by 1 mrad": (25, "target", lambda s, k: target_moved(s, k, (0, 0, 0), (0, 6e-4, 8e-4))),
    "target by 90 degrees": (
        30,
        "target",
        lambda s, k: target_moved(s, k, (0.05, 0, 0.1), (0, 0, np.pi / 2)),
    ),
    "tracker by 1 mm": (51, "tracker", lambda s, k: tracker_moved(s, k, (6e-4, 0, 8e-4))),
    "tracker by 1 mrad": (12, "tracker", lambda s, k: tracker_moved(s, k, (0, 0, 0), (0, 6e-4, 8e-4))),
    "tracker by metres": (32, "tracker", lambda s, k: tracker_moved(s, k, (3, 0.4, 0), (0, 0, 0.3))),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_what_moved_in_mid_series_is_found_at_its_row_and_parted(ur10, fault):
    """Readings are numbered from 1: the first behind the step has the number k + 1."""
    k, what, plant = FAULTS[fault]
    (one,) = read(ur10)
    moved = plant(one, k)
    moved = position_only(moved) if "mm" in fault else moved
    found = calibrated(ur10, moved)
    assert len(found.notes) == 1
    assert f"the {what} moved" in found.notes[0]
    assert f"between rows {k} and {k + 1}:" in found.notes[0]
    assert [part.rows for part in found.series] == [k, ROWS - k]
    assert found.noise.open_position < 2e-4  # tenths of what the step would leave


def test_two_moves_are_two(ur10):
    """Of the target first, of the tracker then."""
    (one,) = read(ur10, poses=2 * ROWS)
    found = calibrated(ur10, tracker_moved(target_moved(one, 40, (0, 0, 2e-3)), 80, (0, 2e-3, 0)))
    assert [part.rows for part in found.series] == [40, 40, 40]
    said = {note.split(" mm")[0] for note in found.notes}
    assert said == {"series 1: the target moved by 2", "series 1 from row 41: the tracker moved by 2"}
