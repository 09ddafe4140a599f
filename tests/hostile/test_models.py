"""Folders of models that a stranger forged: `predict` refuses what no model can say."""

import contextlib
import io
import json
import shutil
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from testbench.errors import InputError
from testbench.workflows.arm_models import _read_arrays

Change = Callable[[dict], object]


@pytest.fixture(scope="module")
def model(attack, stock, tmp_path_factory):
    folder = tmp_path_factory.mktemp("models") / "lab"
    shutil.copytree(stock, folder)
    words = "identify arm data.csv --no-intervals --model MGCO56 --out model"
    assert attack(folder, *words.split()).code == 0
    return folder


def says(*place: str, value: object) -> Change:
    def change(document: dict) -> None:
        *first, last = place
        for key in first:
            document = document[key]
        document[last] = value

    return change


FORGED = {
    "an arm of a long name": (says("arm", value="x" * 5_000_000), "arm: String should have at most 255"),
    "an arm of a name that no XML holds": (says("arm", value="a\0b"), "arm: String should match pattern"),
    "a name that fills pages": (says("name", value="x" * 10**6), "name: String should have at most"),
    "masses of 1e300 kg": (says("weights", "mass_kg", value=[1e300] * 8), "weights.mass_kg.0: Input should"),
    "a constant of 1e308": (says("theta_0", value=[1e308]), "theta_0.0: Input should"),
    "a method that fills pages": (says("about", "method", value="x" * 10**6), "about.method: String should"),
    "more rows than fit in memory": ({"root": np.zeros((700_000, 56))}, "bytes when unpacked"),
    "100,000 doubts": (says("about", "doubts", value=["?"] * 10**5), "about.doubts: List should have at"),
}


@pytest.mark.parametrize("name", FORGED)
def test_a_forged_document_or_posterior_is_refused(attack, model, tmp_path, name):
    forged, said = FORGED[name]
    change, arrays = (dict, forged) if isinstance(forged, dict) else (forged, {})
    lab = Path(shutil.copytree(model, tmp_path / "lab"))
    file, posterior = lab / "model" / "model.json", lab / "model" / "posterior.npz"
    document = json.loads(file.read_text())
    change(document)
    with np.load(posterior) as old:
        np.savez_compressed(posterior, **{**old, **arrays})
    file.write_text(json.dumps(document))
    attack(lab, "predict", "model", "poses.csv", "--out", "out").refused("model/", said)


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
