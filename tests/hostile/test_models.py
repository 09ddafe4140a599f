"""Folders of models that a stranger forged: `predict` refuses what no model can say."""

import contextlib
import io
import shutil
import zipfile
from pathlib import Path

import numpy as np
import pytest

from testbench.errors import InputError
from testbench.workflows.arm_models import _read_arrays


@pytest.fixture(scope="module")
def model(attack, stock, tmp_path_factory):
    folder = tmp_path_factory.mktemp("models") / "lab"
    shutil.copytree(stock, folder)
    words = "identify arm data.csv --no-intervals --model MGCO56 --out model"
    assert attack(folder, *words.split()).code == 0
    return folder


def test_a_forged_posterior_of_more_rows_than_fit_in_memory_is_refused(attack, model, tmp_path):
    lab = Path(shutil.copytree(model, tmp_path / "lab"))
    posterior = lab / "model" / "posterior.npz"
    with np.load(posterior) as old:
        np.savez_compressed(posterior, **{**old, "root": np.zeros((700_000, 56))})
    attack(lab, "predict", "model", "poses.csv", "--out", "out").refused("model/", "bytes when unpacked")


@pytest.mark.parametrize("rest", ["[" * 10**6, "9" * 10**6 + "}", "\0" * 2**25])
def test_what_stands_beside_a_urdf_is_replaced_whatever_it_holds(attack, model, tmp_path, rest):
    lab = Path(shutil.copytree(model, tmp_path / "lab"))
    (lab / "o.json").write_text('{"format": 1, "kind": "what a URDF cannot hold", "a": ' + rest)
    attack(lab, "export", "model", "--urdf", "o.urdf").done("o.json", "o.urdf")


@pytest.mark.parametrize("method", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_LZMA])
def test_a_damaged_posterior_is_read_or_refused_whatever_numpy_and_zipfile_raise(tmp_path, rng, method):
    head = "{'descr': '<f8', 'fortran_order': False, 'shape': (1,), }\n"
    for _ in range(150):
        text, raw = bytearray(head.encode()), io.BytesIO()
        text[rng.integers(len(text))] = rng.choice(list(b"'()[]{},:01L-.T \n\\"))
        with zipfile.ZipFile(raw, "w", method) as packed:
            packed.writestr("root.npy", b"\x93NUMPY\1\0" + len(text).to_bytes(2, "little") + text + bytes(8))
        damaged = bytearray(raw.getvalue())
        damaged[rng.integers(len(damaged))] = rng.integers(256)
        (tmp_path / "posterior.npz").write_bytes(damaged)
        with contextlib.suppress(InputError):
            _read_arrays(tmp_path / "posterior.npz")
