"""Exports as instruments write them, of known readings, read by the map that is proposed for each."""

from datetime import datetime, timedelta

import numpy as np
import pytest
from run_here import here
from workbooks import packed, parts

from testbench.arm.folder import find_arm, load_arm
from testbench.cli.program import program
from testbench.data.read_series import read_series
from testbench.errors import InputError

ARM = "kr500_l480"
BEGAN = datetime(2026, 9, 14, 9, 1, 30)
STEP = timedelta(seconds=47)
JOINTS = range(6)


def run(*args):
    return here(program([args[0]]), *map(str, args))


@pytest.fixture(scope="module")
def known(tmp_path_factory):
    """Three targets in 20 poses, under own weight and then under 240 kg, as arrays."""
    file = tmp_path_factory.mktemp("known") / "known.csv"
    flags = ["--poses", 20, "--absolute", "--loads", "240kg", "--tracker", "4,-2,1.5", "--out", file]
    done = run("simulate", ARM, *flags)
    assert done.returncode == 0, done.stderr
    [series] = read_series(file, load_arm(find_arm(ARM))).series
    return series


class Cells:
    """What a file says of the unloaded readings, or of all: numbers as its country writes them."""

    def __init__(self, series, mark=".", loaded=False):
        self.series, self.mark = series, mark
        kept = np.arange(series.rows) if loaded else np.flatnonzero(~series.wrench.any(axis=1))
        self.rows = kept.tolist()

    def number(self, value, digits=4):
        return f"{value:.{digits}f}".replace(".", self.mark)

    def joints(self, i, scale=180 / np.pi, digits=5):
        return [self.number(scale * q, digits) for q in self.series.q[i]]

    def place(self, i, m=0, scale=1e3, digits=4):
        return [self.number(scale * x, digits) for x in self.series.position[i, m]]

    def time(self, i, form, late=0.0):
        return (BEGAN + i * STEP + timedelta(seconds=late)).strftime(form)


def table(rows, between=","):
    return "\n".join(between.join(map(str, row)) for row in rows) + "\n"


def log(cells, names, head, between=",", where=str):
    """A robot's log: something that tells the row, then its joints."""
    return table(
        [head, *([*where(i, name), *cells.joints(i)] for i, name in zip(cells.rows, names, strict=True))],
        between,
    )


def named(cells, form):
    return [form.format(k + 1) for k in range(len(cells.rows))]


def only(_, name):
    return [name]


def analyzer_en(s):
    """Comments, no units, three targets; joints by the group's name."""
    c = Cells(s)
    names = named(c, "Pose {:02}")
    rows = [
        ["A", n, f"P{m + 1}", *c.place(i, m)] for i, n in zip(c.rows, names, strict=True) for m in range(3)
    ]
    text = "// Job: cell 4\n// Frame: Instrument::0, units mm\n" + table(
        [["Collection", "Group", "Point", "X", "Y", "Z"], *rows]
    )
    return text, log(c, names, ["Group", *(f"A{k + 1}" for k in JOINTS)], where=only), (0, 1, 2)


def nested(s):
    """The same with a nest that is read now and then, which is no pose of the arm."""
    content, joints, targets = analyzer_en(s)
    *head, names, first, second, third = content.splitlines(keepends=True)[:6]
    nest = "A,Drift,NEST1,1500.0,-800.0,120.0\n"
    return (
        "".join([*head, names, nest, first, second, third, nest, *content.splitlines(True)[6:]]),
        joints,
        targets,
    )


def nested_beside(s):
    """One target in a column, joints in the rows that have them."""
    c = Cells(s)
    rows = [[n, "P1", *c.place(i), *c.joints(i)] for i, n in zip(c.rows, named(c, "M{}"), strict=True)]
    rows[10:10] = [["M0", "HOME", "1500.0", "-800.0", "120.0", *([""] * 6)]] * 2
    head = ["Name", "Target", "X [mm]", "Y [mm]", "Z [mm]", *(f"A{k + 1}" for k in JOINTS)]
    return table([head, *rows]), None, (0,)


def analyzer_bare(s):
    """No header at all; joints by the point's name."""
    c = Cells(s)
    names = named(c, "R{:02}")
    text = table([[n, *c.place(i)] for i, n in zip(c.rows, names, strict=True)], ", ")
    return text, log(c, names, ["Name", *(f"J{k + 1} [deg]" for k in JOINTS)], where=only), (0,)


def analyzer_de(s):
    """A workbook with the joints in it."""
    c = Cells(s)
    head = ["Sammlung", "Gruppe", "X [mm]", "Y [mm]", "Z [mm]", *(f"Achse {k + 1} [°]" for k in JOINTS)]
    rows = [
        ["A", n, *map(float, c.place(i)), *map(float, c.joints(i))]
        for i, n in zip(c.rows, named(c, "Stellung {}"), strict=True)
    ]
    return packed(parts({"Messung": [["Messprotokoll"], head, *rows]})), None, (0,)


def analyzer_fr(s):
    """Decimal commas, date and time apart; a log that is 3 s late."""
    c = Cells(s, ",")
    head = ["Nom", "X (mm)", "Y (mm)", "Z (mm)", "Date", "Heure"]
    rows = [
        [n, *c.place(i), c.time(i, "%d/%m/%Y"), c.time(i, "%H:%M:%S")]
        for i, n in zip(c.rows, named(c, "pt{}"), strict=True)
    ]
    joints = log(
        c, c.rows, ["Date", "Heure", *(f"Axe {k + 1}" for k in JOINTS)], ";",
        lambda i, _: [c.time(i, "%d/%m/%Y", 3), c.time(i, "%H:%M:%S", 3)],
    )  # fmt: skip
    return table([head, *rows], ";"), joints, (0,)


def polyworks_en(s):
    """A row an axis, the nominal value beside the measured one."""
    c = Cells(s)
    names = named(c, "point {}")
    rows = [
        [n, axis, "0.0000", x]
        for i, n in zip(c.rows, names, strict=True)
        for axis, x in zip("XYZ", c.place(i), strict=True)
    ]
    joints = log(c, names, ["Label", *(f"J{k + 1}" for k in JOINTS)], where=only)
    return table([["Object Name", "Control", "Nom", "Meas"], *rows]), joints, (0,)


def polyworks_de(s):
    """Nominal values that must not be taken, decimal commas."""
    c = Cells(s, ",")
    names = named(c, "Punkt {}")
    head = [
        "Objekt",
        *(f"Soll {x}" for x in "XYZ"),
        *(f"Ist {x}" for x in "XYZ"),
        *(f"Abw {x}" for x in "XYZ"),
    ]
    rows = [[n, "1,0", "2,0", "3,0", *c.place(i), *["0,0"] * 3] for i, n in zip(c.rows, names, strict=True)]
    joints = log(c, names, ["Punkt", *(f"A{k + 1} [Grad]" for k in JOINTS)], ";", only)
    return table([head, *rows], ";").encode("cp1252"), joints.replace("[Grad]", "[°]").encode("cp1252"), (0,)


def polyworks_fr(s):
    """Tabs, joints in the file."""
    c = Cells(s, ",")
    head = ["Objet", *(f"{x} mesurée [mm]" for x in "XYZ"), *(f"Axe {k + 1} [deg]" for k in JOINTS)]
    return table([head, *([k, *c.place(i), *c.joints(i)] for k, i in enumerate(c.rows))], "\t"), None, (0,)


def polyworks_xlsx(s):
    """A workbook in metres; the log has radians counted from 0."""
    c = Cells(s)
    names = named(c, "M{:03}")
    rows = [[n, *map(float, c.place(i, scale=1, digits=7))] for i, n in zip(c.rows, names, strict=True)]
    joints = table([
        ["name", *(f"q{k}" for k in JOINTS)],
        *([n, *c.joints(i, 1, 7)] for i, n in zip(c.rows, names, strict=True)),
    ])  # fmt: skip
    return packed(parts({"Data": [["Name", "x", "y", "z"], *rows]})), joints, (0,)


def leica_en(s):
    """Runs of blanks, three shots of every point, units in brackets."""
    c = Cells(s)
    names, rng = named(c, "P{:02}"), np.random.default_rng(3)
    rows = []
    for i, n in zip(c.rows, names, strict=True):
        off = rng.normal(size=(3, 3)) * 0.02
        off -= off.mean(axis=0)
        rows += [
            [n, *(f"{1e3 * x + d:.5f}" for x, d in zip(s.position[i, 0], own, strict=True))] for own in off
        ]
    joints = log(c, names, ["PointName", *(f"A{k + 1}_deg" for k in JOINTS)], where=only)
    return table([["PointName", "X[mm]", "Y[mm]", "Z[mm]"], *rows], "   "), joints, (0,)


def leica_de(s):
    """By time: the robot's log has a row a second, in another way of writing."""
    c = Cells(s, ",")
    rows = [
        [n, *c.place(i), c.time(i, "%d.%m.%Y"), c.time(i, "%H:%M:%S")]
        for i, n in zip(c.rows, named(c, "Pkt{}"), strict=True)
    ]
    head = ["PunktNr", "X", "Y", "Z", "Datum", "Uhrzeit"]
    d = Cells(s)
    lines = [
        [d.time(i, "%Y-%m-%dT%H:%M:%S.250", second), *d.joints(i)]
        for i in c.rows
        for second in range(-10, 10)
    ]
    return table([head, *rows], ";"), table([["timestamp", *(f"joint{k + 1}" for k in JOINTS)], *lines]), (0,)


def leica_fr(s):
    """Metres, and uncertainties of two standard deviations."""
    c = Cells(s, ",")
    head = [
        "Point",
        *(f"{x} [m]" for x in "XYZ"),
        *(f"U95 {x} [µm]" for x in "XYZ"),
        *(f"Axe{k + 1} [deg]" for k in JOINTS),
    ]
    rows = [
        [n, *c.place(i, 0, 1, 7), "60,0", "60,0", "60,0", *c.joints(i)]
        for i, n in zip(c.rows, named(c, "{}"), strict=True)
    ]
    return table([head, *rows], ";"), None, (0,)


def leica_shots(s):
    """The last number of a name counts the shots; joints stand in every row."""
    c = Cells(s)
    rows = []
    for i, n in zip(c.rows, named(c, "P{:02}"), strict=True):
        for k, d in enumerate((-0.01, 0.0, 0.01)):
            rows.append([f"{n}_{k + 1}", *(f"{1e3 * x + d:.5f}" for x in s.position[i, 0]), *c.joints(i)])
    return table([["Point ID", "X", "Y", "Z", *(f"J{k + 1}" for k in JOINTS)], *rows], "\t"), None, (0,)


def faro_inches(s):
    """Inches, time of twelve hours, a log of epoch seconds is none: by name."""
    c = Cells(s)
    names = named(c, "Target-{:02}")
    rows = [
        [n, *c.place(i, 0, 1 / 0.0254, 6), c.time(i, "%m/%d/%Y %I:%M:%S %p")]
        for i, n in zip(c.rows, names, strict=True)
    ]
    joints = log(c, names, ["Target", *(f"Axis {k + 1}" for k in JOINTS)], "\t", only)
    return table([["Name", "X (in)", "Y (in)", "Z (in)", "Time"], *rows]), joints, (0,)


def faro_de(s):
    """All targets in a row."""
    c = Cells(s, ",")
    head = [
        "Messung",
        *(f"P{m + 1} {x} [mm]" for m in range(3) for x in "XYZ"),
        *(f"Achse{k + 1}" for k in JOINTS),
    ]
    rows = [[k, *(x for m in range(3) for x in c.place(i, m)), *c.joints(i)] for k, i in enumerate(c.rows)]
    return table([head, *rows], ";"), None, (0, 1, 2)


def api_fr(s):
    """Lost targets as a word, loads in a column."""
    c = Cells(s, ",", loaded=True)
    head = ["Pose", *(f"{x}" for x in "XYZ"), "Charge [kg]", *(f"Axe {k + 1}" for k in JOINTS)]
    rows = [
        [i // 2 + 1, *(["---"] * 3 if i == 5 else c.place(i)), f"{240 * s.wrench[i].any():.0f}", *c.joints(i)]
        for i in c.rows
    ]
    return table([head, *rows], ";"), None, (0,)


def api_en(s):
    """Names of pose, target and state, mass of the loaded rows."""
    c = Cells(s, loaded=True)
    rows = [
        [
            f"S{i // 2 + 1:02}_P{m + 1}_{'loaded' if s.wrench[i].any() else 'unloaded'}",
            *c.place(i, m),
            240 * int(s.wrench[i].any()),
            *c.joints(i),
        ]
        for i in c.rows
        for m in range(3)
    ]
    return (
        table([["Point", "X", "Y", "Z", "Payload (kg)", *(f"J{k + 1}" for k in JOINTS)], *rows]),
        None,
        (0, 1, 2),
    )


def side_by_side(unloaded, loaded, named):
    """Pairs: both readings of a run in a row, the target in the column's name or in a column."""

    def make(s):
        c, targets = Cells(s, ",", loaded=True), (0, 1, 2)
        states = (unloaded, loaded)
        head = [f"{state} {x}" for state in states for x in "XYZ"]
        if named:
            head = [f"P{m + 1} {name} [mm]" for m in targets for name in head]
        rows = []
        for i in c.rows[::2]:
            cells = [[*c.place(i, m), *c.place(i + 1, m)] for m in targets]
            cells = (
                [[x for own in cells for x in own]]
                if named
                else [[f"P{m + 1}", *own] for m, own in enumerate(cells)]
            )
            rows += [[i // 2 + 1, "240", *c.joints(i), *own] for own in cells]
        first = ["Pose", "Last [kg]", *(f"A{k + 1} [°]" for k in JOINTS), *([] if named else ["Marker"])]
        return table([[*first, *head], *rows], ";"), None, targets

    make.__name__ = f"pairs_{unloaded}_{loaded}"
    return make


def state_by_state(loaded):
    """A row a target and state, the joints by the pose's name: no shots, no marker in the states."""

    def make(s):
        c = Cells(s, ",", loaded=True)
        rows = [
            [f"M{i // 2 + 1:02}", f"P{m + 1}", loaded if i % 2 else "leer", 240 * (i % 2), *c.place(i, m)]
            for i in c.rows
            for m in range(3)
        ]
        head = ["Pose", *(f"A{k + 1}" for k in JOINTS)]
        joints = log(c, c.rows, head, ";", lambda i, _: [f"M{i // 2 + 1:02}"])
        first, *lines = joints.splitlines(keepends=True)
        own = [["Pose", "Marker", "Zustand", "Last [kg]", "X [mm]", "Y [mm]", "Z [mm]"], *rows]
        return table(own, ";"), first + "".join(lines[::2]), (0, 1, 2)

    make.__name__ = f"leer_{loaded}"
    return make


EXPORTS = (
    analyzer_en, nested, nested_beside, analyzer_bare, analyzer_de, analyzer_fr, polyworks_en, polyworks_de,
    polyworks_fr, polyworks_xlsx,
    leica_en, leica_de, leica_fr, leica_shots, faro_inches, faro_de, api_fr, api_en,
    side_by_side("leer", "beladen", False), side_by_side("before", "after", True), state_by_state("Last"),
    state_by_state("schwer"),
)  # fmt: skip


def written(make, known, folder):
    """The files of an export, and how it is read."""
    content, joints, targets = make(known)
    content = content.encode() if isinstance(content, str) else content
    file = folder / ("export.xlsx" if content.startswith(b"PK") else "export.txt")
    file.write_bytes(content)
    if joints is None:
        return file, [], targets
    (folder / "robot.csv").write_bytes(joints.encode() if isinstance(joints, str) else joints)
    return file, ["--log", folder / "robot.csv"], targets


@pytest.mark.parametrize("make", EXPORTS, ids=lambda make: make.__name__)
def test_an_export_is_read_by_the_map_that_is_proposed(make, known, tmp_path):
    file, flags, targets = written(make, known, tmp_path)
    done = run("data", "map", ARM, file, *flags)
    assert done.returncode == 0, done.stderr + done.stdout
    found = read_series(file, load_arm(find_arm(ARM)), file.with_suffix(".toml"))
    [series] = found.series
    loaded = bool(series.wrench.any())
    rows = np.arange(known.rows) if loaded else np.flatnonzero(~known.wrench.any(axis=1))
    rows = np.setdiff1d(rows, [5]) if make is api_fr else rows
    if make.__name__.startswith("pairs"):  # all unloaded ones, then all loaded ones
        rows = np.r_[rows[::2], rows[1::2]]
        check = run("data", "check", ARM, file, "--map", file.with_suffix(".toml"))
        assert "20 runs in 20 poses" in check.stdout, check.stdout + check.stderr
    order = [series.markers.index(f"P{m + 1}") for m in targets] if len(targets) > 1 else [0]
    np.testing.assert_allclose(series.q, known.q[rows], atol=3e-7)
    np.testing.assert_allclose(series.position[:, order], known.position[rows][:, list(targets)], atol=2e-7)
    np.testing.assert_allclose(series.wrench, known.wrench[rows] if loaded else 0, atol=1e-6)
    assert f"{series.rows} readings" in done.stdout
    assert "They fit the arm as drawn to" in done.stdout
    assert ("NEST1 without joints" in done.stdout) is (make is nested)
    assert ("shots" in done.stdout) is (make in (leica_en, leica_shots))
    if make is leica_fr:
        assert series.sigma == pytest.approx(30e-6)
    if make in (leica_en, leica_shots):
        assert any("60 shots are 20 readings" in note for note in found.notes)


def centimetres(s):
    """Lengths that look like millimetres, by their size alone."""
    c = Cells(s)
    rows = [[n, *c.place(i, 0, 100), *c.joints(i)] for i, n in zip(c.rows, named(c, "{}"), strict=True)]
    return table([["Name", "X", "Y", "Z", *(f"A{k + 1}" for k in JOINTS)], *rows]), None, (0,)


def slipped(s):
    """A log whose rows belong to the names before them, from the sixth on."""
    content, joints, targets = analyzer_bare(s)
    head, *rows = joints.splitlines()
    joints = [row.partition(",")[2] for row in rows]
    joints[5:] = [joints[-1], *joints[5:-1]]
    names = [row.partition(",")[0] for row in rows]
    return content, table([head.split(","), *zip(names, joints, strict=True)]), targets


def backwards(s):
    """The second joint counts the other way."""
    content, *rest = polyworks_fr(s)
    head, *rows = [line.split("\t") for line in content.splitlines()]
    rows = [[*row[:5], f"{-float(row[5].replace(',', '.')):.5f}".replace(".", ","), *row[6:]] for row in rows]
    return table([head, *rows], "\t"), *rest


def an_hour_apart(s):
    content, joints, targets = leica_de(s)
    return content, joints.replace("T09:", "T10:"), targets


def without_targets(s):
    """Three targets under one name: no shots."""
    c = Cells(s)
    rows = [
        [n, *c.place(i, m), *c.joints(i)]
        for i, n in zip(c.rows, named(c, "P{}"), strict=True)
        for m in range(3)
    ]
    return table([["Name", "X", "Y", "Z", *(f"A{k + 1}" for k in JOINTS)], *rows]), None, (0,)


def a_name_less(s):
    content, joints, targets = analyzer_bare(s)
    return content, joints.replace("R03", "R3x"), targets


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (centimetres, "10 times too small: centimetres read as millimetres?"),
        (slipped, "the readings are those of the pose after"),
        (backwards, "column Axe 2 [deg]: expected -130"),
        (an_hour_apart, "one has none in 3590 s; do the clocks agree?"),
        (without_targets, "expected shots of one point within 0.002 m"),
        (a_name_less, "line 3: no row of robot.csv is called 'R03'"),
    ],
)
def test_a_wrong_guess_is_not_silent(make, said, known, tmp_path):
    file, flags, _ = written(make, known, tmp_path)
    done = run("data", "map", ARM, file, *flags)
    assert done.returncode == 2
    assert said in done.stderr
    assert done.stderr.count("\n") == 1
    assert "They fit the arm" not in done.stdout


def test_a_log_is_joined_or_refused_line_by_line(known, tmp_path):
    file, flags, _ = written(leica_de, known, tmp_path)
    own = tmp_path / "export.toml"
    assert run("data", "map", ARM, file, *flags).returncode == 0
    text = own.read_text()
    arm = load_arm(find_arm(ARM))
    for old, new, said in (
        (
            "within_s = 1.0",
            "within_s = 0.1",
            r"line 2: expected a row of robot.csv within 0.1 s, the nearest is 0.25 s",
        ),
        ('"robot.csv"', '"none.csv"', r"none.csv: cannot be read"),
        ('"Datum"', '"Tag"', r"no column 'Tag' to join by; columns are \['PunktNr'"),
        ("[log]", "[log]\nby = 3", r"log.by: unknown key; keys are file, on, to, within_s"),
    ):
        own.write_text(text.replace(old, new))
        with pytest.raises(InputError, match=said):
            read_series(file, arm, own)
