"""Exports as strangers would bring them: each is read to its last digit, or refused in a line that says why.

The folder `samples` has the files, and `samples.csv` what each holds: readings of one target ("points"), of
three ("targets"), of one target without and with 100 kg in turn ("loads"), of unloaded and loaded readings
as pairs ("pairs"; "plan" by our own names of columns), of gauges ("gauges") or of a draw-wire ("wires"),
all of the joints and places in `readings.csv`. A file that is refused has the words that must be in the
line, one that is read may have words of a warning or guess: several with | between.
"""

import csv
from pathlib import Path

import numpy as np
import pytest
from workbooks import packed, parts

from testbench.arm.folder import find_arm, load_arm
from testbench.errors import InputError
from testbench.files.propose_map import map_text, propose
from testbench.files.read_pairs import read_export
from testbench.files.read_series import read_series
from testbench.files.table import read_table

ARM = load_arm(find_arm("kr500_l480"))
FOLDER = Path(__file__).parent / "samples"
READINGS = read_table(FOLDER / "readings.csv", bool)
NUMBERS = np.column_stack([READINGS.numbers(k) for k in range(1, len(READINGS.names))])
Q = np.radians(NUMBERS[:, :6])
X = 1e-3 * NUMBERS[:, 6:15].reshape(-1, 3, 3)  #: Places of three targets [m].
RISE = 1e-3 * NUMBERS[:, 15:]  #: Travels of their gauges along +Z [m].
DOWN = 1e-3 * np.array([0.25, -0.5, -3.0])  #: How far every target moves under load [m].
WEIGHT = 100 * 9.81  #: [N]
TARGETS = ("P1", "P2", "P3")
with (FOLDER / "samples.csv").open(encoding="utf-8", newline="") as table:
    SAMPLES = list(csv.DictReader(table))


def cell(text):
    """A cell of a workbook: numbers are none of words."""
    try:
        return float(text)
    except ValueError:
        return text or None


def brought(name, folder):
    """The file of a sample in a folder; sheets that are written as text as a workbook."""
    name, _, sheet = name.partition("#")
    sample, file = FOLDER / name, folder / name.replace(".sheets", ".xlsx")
    if sample.suffix == ".sheets":
        sheets = dict(part.split("]\n", 1) for part in sample.read_text()[1:].split("\n["))
        rows = {
            key: [[*map(cell, line.split("\t"))] for line in own.splitlines()] for key, own in sheets.items()
        }
        file.write_bytes(packed(parts(rows)))
    else:
        file.write_bytes(sample.read_bytes())
    return folder / f"{file.name}#{sheet}" if sheet else file


def read(sample, folder):
    """What a sample holds, by the map that is proposed; what that says."""
    file = brought(sample["file"], folder)
    if sample["holds"] == "plan":
        export = read_export(file, ARM)
        return export.data, export.notes
    log, loaded = ((sample[key] and brought(sample[key], folder)) or None for key in ("log", "loaded"))
    entries = propose(file, ARM, log, folder, loaded=loaded).entries
    (map_ := folder / "map.toml").write_text(map_text(entries))
    why = [own.why for own in entries]
    if sample["holds"] in ("points", "targets", "loads"):
        export = read_series(file, ARM, map_)
        [series] = export.series
        return series, [*export.notes, *why]
    has_load = any(own.key.startswith(("mass", "force")) for own in entries)
    export = read_export(file, ARM, map_, load=None if has_load else 100)
    return export.data, [*export.notes, *why]


def check(holds, found):
    """The readings are those of the table, with their last digit."""
    if holds == "loads":
        np.testing.assert_allclose(found.q, np.repeat(Q, 2, axis=0), rtol=0, atol=1e-9)
        places = np.stack([X[:, 0], X[:, 0] + DOWN], axis=1).reshape(-1, 3)
        np.testing.assert_allclose(found.position[:, 0], places, rtol=0, atol=1e-9)
        np.testing.assert_allclose(found.wrench[:, 2], np.tile([0, -WEIGHT], len(Q)), rtol=0, atol=1e-9)
        return
    times = 2 if holds == "pairs twice" else 1
    np.testing.assert_allclose(found.q, np.tile(Q, (times, 1)), rtol=0, atol=6e-10)  # of 9 digits in radians
    if holds == "points":
        np.testing.assert_allclose(found.position[:, 0], X[:, 0], rtol=0, atol=1e-9)
        return
    order = [found.markers.index(marker) for marker in TARGETS] if len(found.markers) > 1 else [0]
    if holds == "targets":
        np.testing.assert_allclose(found.position[:, order], X, rtol=0, atol=1e-12)
        return
    np.testing.assert_allclose(found.wrench[:, 2], -WEIGHT, rtol=0, atol=1e-9)
    if holds in ("pairs", "pairs twice", "plan"):
        places = np.tile(X[:, : len(order)], (times, 1, 1))
        np.testing.assert_allclose(found.before[:, order], places, rtol=0, atol=1e-12)
        np.testing.assert_allclose(found.after[:, order], places + DOWN, rtol=0, atol=1e-12)
        return
    assert found.is_line_reading.all()
    travel = np.einsum("rmi,rmi->rm", found.deflection, found.line_direction)[:, order]
    if holds == "gauges":
        up = found.line_direction[:, order, 2]
        np.testing.assert_allclose(np.abs(up), 1, rtol=0, atol=1e-12)
        travel *= up
    np.testing.assert_allclose(travel, RISE[:, : len(order)], rtol=0, atol=1e-12)


@pytest.mark.parametrize("sample", SAMPLES, ids=lambda own: f"{own['file']} {own['log']}")
def test_a_sample_is_read_to_its_last_digit_or_refused_in_a_line_that_says_why(sample, tmp_path):
    if sample["refused"]:
        with pytest.raises(InputError) as refused:
            read(sample, tmp_path)
        said = str(refused.value)
    else:
        found, notes = read(sample, tmp_path)
        check(sample["holds"], found)
        said = "\n".join(notes)
    for words in (sample["refused"] or sample["says"]).split("|"):
        assert words in said
