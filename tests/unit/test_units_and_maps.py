"""What a column says in SI units: every unit, every way of writing one, all features of a map together."""

from itertools import product
from pathlib import Path

import numpy as np
import pytest
from workbooks import packed, parts

from testbench.arm.folder import load_arm
from testbench.data.dataset import series_from_runs
from testbench.errors import InputError
from testbench.files.names import OTHER_NAMES, UNITS
from testbench.files.read_pairs import read_export
from testbench.files.read_series import read_series
from testbench.files.table import read_table

ROOT = Path(__file__).parents[2]
ARM = load_arm(ROOT / "models" / "arm_6r")
N = 5
RNG = np.random.default_rng(23)
Q = RNG.uniform(-0.5, 0.5, (N, 6))
P = RNG.uniform(0.5, 3, (N, 3))
SI = {
    **{"m": 1, "cm": 0.01, "mm": 0.001, "um": 1e-6, "in": 0.0254, "mil": 2.54e-5, "ft": 0.3048},
    **{"rad": 1, "mrad": 0.001, "deg": 0.017453292519943295, "gon": 0.015707963267948967},
    **{"mdeg": 1.7453292519943296e-5, "rev": 6.283185307179586},
    **{"arcmin": 2.908882086657216e-4, "arcsec": 4.84813681109536e-6},
    **{"N": 1, "daN": 10, "kN": 1000, "lbf": 4.4482216152605, "kgf": 9.80665, "Nm": 1, "Nmm": 0.001},
    **{"kg": 1, "lb": 0.45359237, "g": 0.001, "t": 1000, "m2": 1, "mm2": 1e-6, "um2": 1e-12},
}
"""How many SI units each is, by definition."""
COLUMN = {"m": "x", "rad": "joint_2", "N": "force_y", "Nm": "moment_z", "kg": "mass", "m2": "position_cov_yy"}
"""A quantity that is counted in multiples of each SI unit."""


def base(**columns):
    """Joints and positions in SI units as columns of texts, with others in their place or beside them."""
    own = {f"joint_{k + 1}_rad": Q[:, k] for k in range(6)} | {f"{x}_m": P[:, k] for k, x in enumerate("xyz")}
    return {name: [*map(repr, np.asarray(column).tolist())] for name, column in own.items()} | columns


def read(folder, columns, toml="", between=",", reader=read_series):
    lines = [between.join(columns), *map(between.join, zip(*columns.values(), strict=True))]
    (folder / "one.csv").write_text("\n".join(lines), encoding="utf-8")
    (folder / "map.toml").write_text(toml)
    return reader(folder / "one.csv", ARM, folder / "map.toml" if toml else None)


def said(found, si):
    """What a file says of the quantity in `COLUMN`, (N,)."""
    [s] = found.series
    return {
        "m": lambda: s.position[:, 0, 0],
        "rad": lambda: s.q[:, 1],
        "N": lambda: s.wrench[:, 1],
        "Nm": lambda: s.wrench[:, 5],
        "kg": lambda: s.wrench[:, 2] / -9.81,
        "m2": lambda: np.linalg.inv(s.precision[:, 0])[:, 1, 1],
    }[si]()


def with_unit(unit, name, factor):
    """A file with one quantity in a unit, and that in SI units."""
    si, values = unit.si, np.array([0.31, 0.47, 0.22, 0.4, 0.13])
    if si == "m2":
        values = 1e-8 * values  # a covariance that an instrument has
    columns = base()
    columns.pop(f"{COLUMN[si]}_{si}", None)
    if si == "N":
        columns |= {f"force_{x}_N": ["0"] * N for x in "xz"}
    if si == "Nm":
        columns |= {f"moment_{x}_Nm": ["0"] * N for x in "xy"} | {f"force_{x}_N": ["0"] * N for x in "xyz"}
    if si == "m2":
        columns |= {f"position_cov_{e}_m2": [v] * N for e, v in {"xx": "1e-8", "zz": "1e-8"}.items()}
        columns |= {f"position_cov_{e}_m2": ["0"] * N for e in ("xy", "xz", "yz")}
    return columns | {name: [*map(repr, (values / factor).tolist())]}, values


@pytest.mark.parametrize("unit", UNITS, ids=lambda unit: unit.name)
def test_a_column_in_any_unit_is_its_factor_times_si_however_the_unit_is_written(tmp_path, unit):
    assert {own.name for own in UNITS} == {*SI}
    other = [name for name, own in OTHER_NAMES.items() if own == unit.name.lower()]
    for name in (unit.name, unit.name.upper(), *other):
        forms = ("{}_{}", "{} [{}]", "{} ({})", "{} / {}", "{} in {}") if name == unit.si else ("{} [{}]",)
        for form in forms:
            columns, values = with_unit(unit, form.format(COLUMN[unit.si], name), SI[unit.name])
            np.testing.assert_allclose(said(read(tmp_path, columns), unit.si), values, rtol=1e-9)
    columns, values = with_unit(unit, "other", SI[unit.name])
    mapped = f'columns."{COLUMN[unit.si]}_{unit.name}" = "other"'
    np.testing.assert_allclose(said(read(tmp_path, columns, mapped), unit.si), values, rtol=1e-9)
    columns, values = with_unit(unit, f"other [{unit.name}]", SI[unit.name])
    mapped = f'columns."{COLUMN[unit.si]}" = "other"'
    np.testing.assert_allclose(said(read(tmp_path, columns, mapped), unit.si), values, rtol=1e-9)


COMBINED = [
    (sign, scale, unit, mark, shots)
    for sign, (scale, mark), (unit, shots) in product((1, -1), ((1, "."), (0.5, ",")), (("mm", 3), ("in", 1)))
]


@pytest.mark.parametrize(("sign", "scale", "unit", "mark", "shots"), COMBINED)
def test_minus_scale_unit_mark_words_and_shots_of_a_map_hold_together(
    tmp_path, sign, scale, unit, mark, shots
):
    """A position, a joint and a mass through all of them; a lost target as a word, shots in rows."""
    off = np.array([[2e-5], [-3e-5], [1e-5]])[:shots] * np.ones(3)
    off = off - off.mean(axis=0)
    factor = sign * scale * SI[unit]
    columns = {name: [] for name in ("N", *(f"J{k}" for k in range(1, 7)), *"XYZ", "kg")}
    for i, shot in product(range(N), range(shots)):
        place = (P[i] + off[shot]) / factor
        cells = [f"n{i}", *(Q[i] / (sign * scale)).tolist(), *place.tolist(), "full" if i % 2 else "0"]
        if i == 3:
            cells[7:10] = ["lost"] * 3
        for name, cell in zip(columns, cells, strict=True):
            columns[name].append(str(cell).replace(".", mark) if isinstance(cell, float) else cell)
    minus = "-" if sign < 0 else ""
    toml = f'file.average = {"true" if shots > 1 else "false"}\nwords.lost = "lost"\nwords."120.5" = "full"\n'
    toml += (
        f'[columns]\npose = "N"\n"joint_{{n}}_rad" = "{minus}J{{n}}"\n"{{axis}}_{unit}" = "{minus}{{axis}}"\n'
    )
    toml += f'mass_kg = "kg"\n[scale]\n"joint_{{n}}_rad" = {scale}\n"{{axis}}_{unit}" = {scale}\n'
    found = read(tmp_path, columns, toml, ";")
    [s] = found.series
    kept = [0, 1, 2, 4]
    np.testing.assert_allclose(s.position[:, 0], P[kept], atol=1e-12)
    np.testing.assert_allclose(s.q, Q[kept], atol=1e-12)
    np.testing.assert_allclose(s.wrench[:, 2], [0, -9.81 * 120.5, 0, 0], rtol=1e-12)
    if shots > 1:
        expected = np.sqrt((off**2).sum() / (3 * (shots - 1)) / shots)
        assert s.sigma == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("counts", [[3, 3, 3, 3, 3], [4, 4, 4, 2, 4], [2, 2, 2, 2, 2]])
def test_scatter_of_shots_has_a_degree_of_freedom_less_for_every_point(tmp_path, counts):
    """Each axis by itself: the pooled variance over shots less points, of a mean over their median number."""
    code = np.repeat(np.arange(N), counts)
    off = 2e-5 * RNG.normal(size=(len(code), 3))
    place = P[code] + off
    columns = {f"joint_{k + 1}_rad": [*map(repr, Q[code, k].tolist())] for k in range(6)}
    columns |= {f"{x}_m": [*map(repr, place[:, k].tolist())] for k, x in enumerate("xyz")}
    found = read(tmp_path, columns, "file.average = true")
    [s] = found.series
    mean = np.array([place[code == i].mean(axis=0) for i in range(N)])
    np.testing.assert_allclose(s.position[:, 0], mean, atol=1e-12)
    variance = ((place - mean[code]) ** 2).sum() / (3 * (len(code) - N))
    assert s.sigma == pytest.approx(np.sqrt(variance / np.median(counts)), rel=1e-6)


def test_words_stand_for_loads_in_columns_of_masses_forces_and_moments(tmp_path):
    """In the column's unit, with its sign and the file's decimal mark."""
    for name, words, unit, got in (
        ("mass_lb", {"100.5": "A", "0": "none"}, "lb", lambda s: s.wrench[:, 2] / -9.81),
        ("force_z_N", {"-150.25": "A", "0": "none"}, "N", lambda s: s.wrench[:, 2]),
        ("moment_y_Nm", {"12.5": "A", "0": "none"}, "Nm", lambda s: s.wrench[:, 4]),
    ):
        value = float(next(iter(words)))
        zero = {f"{k}_{x}_{u}": ["0"] * N for k, u in (("force", "N"), ("moment", "Nm")) for x in "xyz"}
        own = {name: ["A", "none", "A", "none", "7,5"]}
        columns = base() | ({} if unit == "lb" else zero) | own
        columns = {k: [x.replace(".", ",") for x in v] for k, v in columns.items()}
        toml = "".join(f'words."{number}" = "{word}"\n' for number, word in words.items())
        [s] = read(tmp_path, columns, toml, ";").series
        np.testing.assert_allclose(got(s), SI[unit] * np.array([value, 0, value, 0, 7.5]), rtol=1e-12)
        minus = f'{toml}[columns]\n{name} = "-other"\n'
        renamed = {("other" if k == name else k): v for k, v in columns.items()}
        if unit != "lb":
            [s] = read(tmp_path, renamed, minus, ";").series
            np.testing.assert_allclose(got(s), -SI[unit] * np.array([value, 0, value, 0, 7.5]), rtol=1e-12)


@pytest.mark.parametrize(
    "load", [{"mass_kg": "80"}, {"force_z_N": "-70", "force_x_N": "3", "force_y_N": "0"}]
)
@pytest.mark.parametrize("words", [("unloaded", "loaded"), ("leer", "voll")])
def test_no_load_acts_in_rows_that_say_unloaded_whatever_stands_beside(tmp_path, load, words):
    """The same load in both rows of a pose, or a blank one; as pairs and as readings."""
    rows = np.repeat(np.arange(N), 2)
    columns = {name: [column[i] for i in rows] for name, column in base().items()}
    columns |= {"state": [*words] * N} | {name: [value] * 2 * N for name, value in load.items()}
    toml = f'words.before = "{words[0]}"\nwords.after = "{words[1]}"\n'
    expected = np.array([0, 0, -9.81 * 80, 0, 0, 0] if "mass_kg" in load else [3, 0, -70, 0, 0, 0])
    for blank in (False, True):
        own = {
            k: ["" if blank and k in load and i % 2 == 0 else x for i, x in enumerate(v)]
            for k, v in columns.items()
        }
        [s] = read(tmp_path, own, toml).series
        np.testing.assert_array_equal(s.wrench[::2], 0)
        np.testing.assert_allclose(s.wrench[1::2], np.tile(expected, (N, 1)), rtol=1e-12)
        runs = read(tmp_path, own, toml, reader=read_export).data
        np.testing.assert_allclose(runs.wrench, np.tile(expected, (N, 1)), rtol=1e-12)
    own = {k: ["" if k in load and i == 3 else x for i, x in enumerate(v)] for k, v in columns.items()}
    with pytest.raises(InputError, match="finite number in a loaded row"):
        read(tmp_path, own, toml)


def test_a_single_reading_has_half_the_covariance_of_a_deflection(tmp_path):
    """Readings from pairs: of two independent readings of one covariance the difference has both."""
    A = RNG.normal(size=(N, 3, 3))
    C = 1e-9 * (A @ A.swapaxes(1, 2) + np.eye(3))
    entries = {"xx": (0, 0), "xy": (0, 1), "xz": (0, 2), "yy": (1, 1), "yz": (1, 2), "zz": (2, 2)}
    after = P + np.array([0.001, -0.002, 0.003])
    own = {f"joint_{k + 1}_rad": Q[:, k] for k in range(6)} | {"mass_kg": np.full(N, 80.0)}
    own |= {f"{w}_{x}_m": v[:, k] for w, v in (("before", P), ("after", after)) for k, x in enumerate("xyz")}
    own |= {f"deflection_cov_{e}_mm2": 1e6 * C[:, a, b] for e, (a, b) in entries.items()}
    columns = {name: [*map(repr, values.tolist())] for name, values in own.items()}
    columns |= {"run": [*map(str, range(N))], "marker": [ARM.markers[0]] * N}
    data = read(tmp_path, columns, reader=read_export).data
    np.testing.assert_allclose(np.linalg.inv(data.precision[:, 0]), C, rtol=1e-6)
    [direct] = series_from_runs(data, "one", "one")
    [read_too] = read(tmp_path, columns).series
    for s in (direct, read_too):
        np.testing.assert_allclose(np.linalg.inv(s.precision[:N, 0]), C / 2, rtol=1e-6)
        np.testing.assert_allclose(s.precision[N:], s.precision[:N], rtol=1e-12)
    even = {k: v for k, v in columns.items() if not k.startswith("deflection_cov")} | {"sigma_um": ["30"] * N}
    [s] = read(tmp_path, even).series
    assert s.precision is None
    assert s.sigma == pytest.approx(30e-6)


def test_times_of_a_workbook_keep_their_fractions_and_join_the_nearest_row_of_a_log(tmp_path):
    """Serial numbers of a spreadsheet, days since 1899; the log has a row every 0.1 s."""
    day, step = 44000.5, 0.1 / 86400
    at = [day + (3 * i + (0.25, -0.25)[i % 2]) * step for i in range(N)]  # the nearest row before, or after
    head = ["Time", *(f"{x} [m]" for x in "xyz")]
    cells = [[f'<c s="1"><v>{t!r}</v></c>', *P[i].tolist()] for i, t in enumerate(at)]
    (tmp_path / "one.xlsx").write_bytes(packed(parts({"A": [head, *cells]})))
    texts = read_table(tmp_path / "one.xlsx", bool).texts(0)
    assert texts[:2] == ["2020-06-18 12:00:00.025000", "2020-06-18 12:00:00.275000"]
    rows = [
        f"2020-06-18 12:00:{k / 10:06.3f}," + ",".join(map(repr, (Q[k // 3] + k % 3).tolist()))
        for k in range(3 * N)
    ]
    head = ",".join(["Time", *(f"joint_{k}_rad" for k in range(1, 7))])
    (tmp_path / "robot.csv").write_text("\n".join([head, *rows]))
    (tmp_path / "map.toml").write_text('log = { file = "robot.csv", on = ["Time"], within_s = 0.06 }\n')
    [s] = read_series(tmp_path / "one.xlsx", ARM, tmp_path / "map.toml").series
    np.testing.assert_allclose(s.q, Q, atol=1e-12)
