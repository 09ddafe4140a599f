"""Exports as instruments write them, of known readings, read by the map that is proposed for each."""

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from typing import Any

import numpy as np
import pytest
from run_here import ROOT, do, fine, is_refused
from workbooks import packed, parts

from testbench.arm.folder import find_arm, load_arm
from testbench.errors import InputError
from testbench.files.read_series import read_series

ARM = "kr500_l480"
BEGAN = datetime(2026, 9, 14, 9, 1, 30)
STEP = timedelta(seconds=47)
SHOTS = (-0.01, 0.0, 0.01)  #: What shots of a point are off [mm].


@pytest.fixture(scope="module")
def known(tmp_path_factory):
    """Three targets in 20 poses, under own weight and then under 240 kg, as arrays."""
    file = tmp_path_factory.mktemp("known") / "known.csv"
    flags = ["--poses", 20, "--absolute", "--loads", "240kg", "--tracker", "4,-2,1.5", "--out", file]
    fine("simulate", ARM, *flags)
    [series] = read_series(file, load_arm(find_arm(ARM))).series
    return series


@dataclass(frozen=True)
class Reading:
    """What a row of an export is of."""

    series: Any
    i: int  #: Row of the series: unloaded and loaded in turn.
    m: int  #: Target.
    part: Any  #: Shot, axis or second, where a reading has several rows.
    mark: str  #: Of decimals.

    def number(self, x, digits=4):
        return f"{x:.{digits}f}".replace(".", self.mark)

    @property
    def loaded(self):
        return bool(self.series.wrench[self.i].any())


Columns = Mapping[str, Callable[[Reading], object]]


def text(form):
    """Words with the number of the pose, of the target, and what the reading is of."""
    return lambda r: form.format(pose=r.i // 2 + 1, target=r.m + 1, r=r)


def xyz(form="{}", scale=1e3, digits=4, m=None, later=0) -> Columns:
    """Three columns of a position; of a target that the heading says, of the reading after this one."""

    def cell(r, k):
        shot = r.part if r.part in SHOTS else 0
        return r.number(scale * r.series.position[r.i + later, r.m if m is None else m, k] + shot, digits)

    return {form.format(x): lambda r, k=k: cell(r, k) for k, x in enumerate("XYZ")}


def joints(form, scale=180 / np.pi, digits=5, first=1) -> Columns:
    """Six columns of the joints."""
    return {
        form.format(k + first): lambda r, k=k: r.number(scale * r.series.q[r.i, k], digits) for k in range(6)
    }


def time(form, late=0) -> Callable[[Reading], str]:
    return lambda r: (BEGAN + r.i * STEP + timedelta(seconds=late + (r.part or 0))).strftime(form)


@dataclass(frozen=True)
class Export:
    """Columns of a file and of the robot's log beside it."""

    columns: Columns
    log: Columns | None = None
    between: str = ","
    mark: str = "."
    log_between: str = ","
    log_mark: str = "."
    targets: int = 1
    beside: bool = False  #: Whether the targets are in one row.
    loaded: bool = False  #: Whether loaded readings have rows of their own.
    over: Sequence[Any] = (None,)  #: Rows of a reading.
    log_over: Sequence[Any] = (None,)
    above: str = ""
    sheet: str = ""  #: Of a workbook.

    def write(self, series):
        """The content of both files as bytes, None without a log."""
        ms = range(1 if self.beside else self.targets)
        every = itertools.product(range(0, series.n_rows, 1 if self.loaded else 2), ms, self.over)
        rows = [Reading(series, *at, self.mark) for at in every]
        content = cells(self.columns, rows)
        if self.sheet:
            whole = packed(
                parts({self.sheet: [["Messprotokoll"], *([own(x) for x in row] for row in content)]})
            )
        else:
            whole = (self.above + lines(content, self.between)).encode()
        at = [
            Reading(series, i, 0, part, self.log_mark)
            for i in range(0, series.n_rows, 2)
            for part in self.log_over
        ]
        return whole, self.log and lines(cells(self.log, at), self.log_between).encode()


def cells(columns, rows):
    return [list(columns), *([str(cell(r)) for cell in columns.values()] for r in rows)]


def lines(rows, between):
    return "\n".join(between.join(row) for row in rows) + "\n"


def own(cell):
    """A cell of a workbook: numbers are none of words."""
    try:
        return float(cell)
    except ValueError:
        return cell


def nests(content, log):
    """A nest that is read now and then, which is no pose of the arm."""
    nest, rows = b"A,Drift,NEST1,1500.0,-800.0,120.0\n", content.splitlines(keepends=True)
    return b"".join([*rows[:3], nest, *rows[3:6], nest, *rows[6:]]), log


def headless(content, log):
    return content.partition(b"\n")[2], log


def home(content, log):
    """Rows of a point without joints among the others."""
    rows = content.splitlines(keepends=True)
    return b"".join([*rows[:11], 2 * b"M0,HOME,1500.0,-800.0,120.0,,,,,,\n", *rows[11:]]), log


def slipped(content, log):
    """Rows of the log belong to the names before them, from the sixth on."""
    head, *rows = [line.partition(b",") for line in log.splitlines()]
    own = [row[2] for row in rows]
    own[5:] = [own[-1], *own[5:-1]]
    return content, b"\n".join(
        [b"".join(head), *(b",".join([row[0], x]) for row, x in zip(rows, own, strict=True))]
    )


def in_log(old, new):
    return lambda content, log: (content, log.replace(old, new))


POSE, MARKER = "{pose}", text("P{target}")
PAIR = {"Pose": text(POSE), "Last [kg]": text("240"), **joints("A{} [°]")}
STATES = {"Pose": text("M{pose:02}"), "Marker": MARKER}


def state_by_state(loaded):
    """A row a target and state: no shots, no marker in the states."""
    states = STATES | {"Zustand": lambda r: loaded if r.loaded else "leer"}
    states |= {"Last [kg]": lambda r: 240 * r.loaded, **xyz("{} [mm]")}
    log = {"Pose": text("M{pose:02}"), **joints("A{}")}
    return Export(states, log, ";", ",", ";", ",", targets=3, loaded=True)


EXPORTS = {
    "analyzer_en": Export(  # comments, no units, three targets; joints by the group's name
        {"Collection": text("A"), "Group": text("Pose {pose:02}"), "Point": MARKER, **xyz()},
        {"Group": text("Pose {pose:02}"), **joints("A{}")},
        targets=3,
        above="// Job: cell 4\n// Frame: Instrument::0, units mm\n",
    ),
    "beside": Export({"Name": text("M{pose}"), "Target": text("P1"), **xyz("{} [mm]"), **joints("A{}")}),
    "bare": Export(
        {"Name": text("R{pose:02}"), **xyz()}, {"Name": text("R{pose:02}"), **joints("J{} [deg]")}, ", "
    ),
    "analyzer_de": Export(
        {
            "Sammlung": text("A"),
            "Gruppe": text("Stellung {pose}"),
            **xyz("{} [mm]"),
            **joints("Achse {} [°]"),
        },
        sheet="Messung",
    ),
    "analyzer_fr": Export(  # date and time apart; a log that is 3 s late
        {"Nom": text("pt{pose}"), **xyz("{} (mm)"), "Date": time("%d/%m/%Y"), "Heure": time("%H:%M:%S")},
        {"Date": time("%d/%m/%Y", 3), "Heure": time("%H:%M:%S", 3), **joints("Axe {}")},
        *(";", ",", ";", ","),
    ),
    "polyworks_en": Export(  # a row an axis, the nominal value beside the measured one
        {
            "Object Name": text("point {pose}"),
            "Control": text("{r.part}"),
            "Nom": text("0.0000"),
            "Meas": lambda r: xyz()[r.part](r),
        },
        {"Label": text("point {pose}"), **joints("J{}")},
        over="XYZ",
    ),
    "polyworks_de": Export(  # nominal values that must not be taken
        {"Objekt": text("Punkt {pose}"), **dict.fromkeys(["Soll X", "Soll Y", "Soll Z"], text("1,0"))}
        | {**xyz("Ist {}"), **dict.fromkeys(["Abw X", "Abw Y", "Abw Z"], text("0,0"))},
        {"Punkt": text("Punkt {pose}"), **joints("A{} [°]")},
        *(";", ",", ";", ","),
    ),
    "polyworks_fr": Export(
        {"Objet": text(POSE), **xyz("{} mesurée [mm]"), **joints("Axe {} [deg]")}, None, "\t", ","
    ),
    "polyworks_xlsx": Export(  # metres; the log has radians counted from 0
        {"Name": text("M{pose:03}"), **xyz(scale=1, digits=7)},
        {"name": text("M{pose:03}"), **joints("q{}", 1, 7, first=0)},
        sheet="Data",
    ),
    "leica_en": Export(  # three shots of every point, units in brackets
        {"PointName": text("P{pose:02}"), **xyz("{}[mm]", digits=5)},
        {"PointName": text("P{pose:02}"), **joints("A{}_deg")},
        "   ",
        over=SHOTS,
    ),
    "leica_de": Export(  # by time: the robot's log has a row a second, in another way of writing
        {"PunktNr": text("Pkt{pose}"), **xyz(), "Datum": time("%d.%m.%Y"), "Uhrzeit": time("%H:%M:%S")},
        {"timestamp": time("%Y-%m-%dT%H:%M:%S.250"), **joints("joint{}")},
        *(";", ","),
        log_over=range(-10, 10),
    ),
    "leica_fr": Export(  # metres, and uncertainties of two standard deviations
        {"Point": text(POSE), **xyz("{} [m]", 1, 7)}
        | {
            **dict.fromkeys(["U95 X [µm]", "U95 Y [µm]", "U95 Z [µm]"], text("60,0")),
            **joints("Axe{} [deg]"),
        },
        *(None, ";", ","),
    ),
    "leica_shots": Export(  # the last number of a name counts the shots
        {
            "Point ID": lambda r: f"P{r.i // 2 + 1:02}_{SHOTS.index(r.part) + 1}",
            **xyz(digits=5),
            **joints("J{}"),
        },
        None,
        "\t",
        over=SHOTS,
    ),
    "faro_inches": Export(
        {
            "Name": text("Target-{pose:02}"),
            **xyz("{} (in)", 1 / 0.0254, 6),
            "Time": time("%m/%d/%Y %I:%M:%S %p"),
        },
        {"Target": text("Target-{pose:02}"), **joints("Axis {}")},
        log_between="\t",
    ),
    "faro_de": Export(
        {"Messung": text(POSE), **xyz("P1 {} [mm]", m=0), **xyz("P2 {} [mm]", m=1), **xyz("P3 {} [mm]", m=2)}
        | joints("Achse{}"),
        *(None, ";", ","),
        targets=3,
        beside=True,
    ),
    "api_fr": Export(  # lost targets as a word, loads in a column
        {"Pose": text(POSE)}
        | {x: lambda r, cell=cell: "---" if r.i == 5 else cell(r) for x, cell in xyz().items()}
        | {"Charge [kg]": lambda r: 240 * r.loaded, **joints("Axe {}")},
        *(None, ";", ","),
        loaded=True,
    ),
    "api_en": Export(  # names of pose, target and state
        {"Point": lambda r: f"S{r.i // 2 + 1:02}_P{r.m + 1}_{'loaded' if r.loaded else 'unloaded'}", **xyz()}
        | {"Payload (kg)": lambda r: 240 * r.loaded, **joints("J{}")},
        targets=3,
        loaded=True,
    ),
    "pairs_leer_beladen": Export(  # both readings of a run in a row
        {**PAIR, "Marker": MARKER, **xyz("leer {}"), **xyz("beladen {}", later=1)},
        *(None, ";", ","),
        targets=3,
    ),
    "pairs_before_after": Export(
        PAIR
        | {
            heading: cell
            for m in range(3)
            for state, later in (("before", 0), ("after", 1))
            for heading, cell in xyz(f"P{m + 1} {state} {{}} [mm]", m=m, later=later).items()
        },
        *(None, ";", ","),
        targets=3,
        beside=True,
    ),
    "leer_Last": state_by_state("Last"),
    "leer_schwer": state_by_state("schwer"),
}
EDITED = {
    "nested": ("analyzer_en", nests),
    "nested_beside": ("beside", home),
    "analyzer_bare": ("bare", headless),
    "polyworks_latin": ("polyworks_de", lambda *both: [x.decode().encode("cp1252") for x in both]),
}
"""By another export, and what is changed in it."""


NAME_LESS = {"Name": text("P{pose}"), **xyz(), **joints("A{}")}
WRONG = {
    "10 times too small: centimetres read as millimetres?": replace(
        EXPORTS["beside"], columns={"Name": text(POSE), **xyz(scale=100), **joints("A{}")}
    ),
    "expected shots of one point within 0.002 m": Export(NAME_LESS, targets=3),
    "column Axe 2 [deg]: expected -130": replace(
        EXPORTS["polyworks_fr"],
        columns=EXPORTS["polyworks_fr"].columns
        | {"Axe 2 [deg]": lambda r: r.number(-180 / np.pi * r.series.q[r.i, 1])},
    ),
    "the readings are those of the pose after": ("analyzer_bare", slipped),
    "one reading is 3590 s away; do the clocks agree?": ("leica_de", in_log(b"T09:", b"T10:")),
    "line 3: no row of robot.csv is called 'R03'": ("analyzer_bare", in_log(b"R03", b"R3x")),
}


def made(name, series):
    """The export that a name is of, and its files."""
    kind = (EXPORTS | EDITED | WRONG)[name]
    if isinstance(kind, Export):
        return kind, *kind.write(series)
    export, content, log = made(kind[0], series)
    return export, *kind[1](content, log)


def written(name, known, folder):
    """The files of an export, the flags that it is read with, and its targets."""
    export, content, log = made(name, known)
    file = folder / ("export.xlsx" if export.sheet else "export.txt")
    file.write_bytes(content)
    if log is None:
        return file, [], list(range(export.targets))
    head, *rows = log.splitlines()
    (folder / "robot.csv").write_bytes(b"\n".join([head, *rows[::-1]]))  # newest first
    return file, ["--log", folder / "robot.csv"], list(range(export.targets))


ALIKE = {"pairs_before_after", "leer_schwer"}
"""Exports whose way of pairing another one shows; `make studies` reads them."""
ALONE = [name for name in EXPORTS if name not in dict(EDITED.values())]
"""Those that no edited one holds whole."""


@pytest.mark.parametrize(
    "name",
    [pytest.param(n, marks=[pytest.mark.study] * (n in ALIKE)) for n in (*ALONE, *EDITED)],
)
def test_an_export_is_read_by_the_map_that_is_proposed(name, known, tmp_path):
    file, flags, targets = written(name, known, tmp_path)
    said = fine("data", "map", ARM, file, *flags)
    found = read_series(file, load_arm(find_arm(ARM)), file.with_suffix(".toml"))
    [series] = found.series
    loaded = bool(series.wrench.any())
    rows = np.arange(known.n_rows) if loaded else np.flatnonzero(~known.wrench.any(axis=1))
    rows = np.setdiff1d(rows, [5]) if name == "api_fr" else rows
    if name.startswith("pairs"):  # all unloaded ones, then all loaded ones
        rows = np.r_[rows[::2], rows[1::2]]
        assert "20 runs in 20 poses" in fine("data", "check", ARM, file, "--map", file.with_suffix(".toml"))
    order = [series.markers.index(f"P{m + 1}") for m in targets] if len(targets) > 1 else [0]
    np.testing.assert_allclose(series.q, known.q[rows], atol=3e-7)
    np.testing.assert_allclose(series.position[:, order], known.position[rows][:, targets], atol=2e-7)
    np.testing.assert_allclose(series.wrench, known.wrench[rows] if loaded else 0, atol=1e-6)
    assert f"{series.n_rows} readings" in said
    assert "The median distance of these readings from the nominal arm is" in said
    assert ("no joints for NEST1" in said) is (name == "nested")
    shots = name in ("leica_en", "leica_shots")
    assert ("shots" in said) is shots
    assert any("60 shots are averaged to 20 readings" in note for note in found.notes) is shots
    if name == "leica_fr":
        assert series.sigma == pytest.approx(30e-6)


@pytest.mark.parametrize("said", WRONG)
def test_a_wrong_guess_is_not_silent(said, known, tmp_path):
    file, flags, _ = written(said, known, tmp_path)
    done = do("data", "map", ARM, file, *flags)
    is_refused(done, said)
    assert "They fit the nominal arm" not in done.stdout


def test_targets_side_by_side_are_read_as_by_the_map_that_was_written_by_hand(tmp_path):
    file, arm = ROOT / "docs/maps/spreadsheet.csv", load_arm(find_arm(ARM))
    fine("data", "map", ARM, file, "--out", tmp_path / "map.toml")
    maps = (tmp_path / "map.toml", file.with_suffix(".toml"))
    [found], [expected] = (read_series(file, arm, own).series for own in maps)
    for name in ("q", "wrench", "position", "is_measured"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
    other = tmp_path / "other.csv"
    other.write_text(file.read_text("cp1252").replace("Ziel ", "Kugel_"), "cp1252")
    done = do("data", "map", ARM, other, "--out", tmp_path / "other.toml")
    is_refused(done, "no column looks like a position; ")
    assert '"{marker}_{when}_{axis}" = "{marker} {when} {axis}"' in done.stderr


def test_a_log_is_joined_or_refused_line_by_line(known, tmp_path):
    file, flags, _ = written("leica_de", known, tmp_path)
    fine("data", "map", ARM, file, *flags)
    map_ = file.with_suffix(".toml")
    whole = map_.read_text()
    for old, new, said in (
        (
            "within_s = 1.0",
            "within_s = 0.1",
            "line 2: expected a row of robot.csv within 0.1 s, the near",
        ),
        ('"robot.csv"', '"none.csv"', r"none.csv: cannot be read"),
        ('"Datum"', '"Tag"', r"no column 'Tag' to join by; columns are PunktNr, X"),
        ("[log]", "[log]\nby = 3", r"log.by: unknown key; keys are file, on, to, parts, within_s, rows"),
    ):
        map_.write_text(whole.replace(old, new))
        with pytest.raises(InputError, match=said):
            read_series(file, load_arm(find_arm(ARM)), map_)
