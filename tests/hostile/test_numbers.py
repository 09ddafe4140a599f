"""Numbers that only Python reads, or that no arm can have: in MJCF, URDF, TOML, tables and flags alike."""

import pytest
from spoil import swap

ODD = {
    "Arabic": "\u0663",
    "full width": "\uff11",
    "underscore": "1_0",
    "hex": "0x10",
    "hex float": "0x1p3",
    "infinite": "inf",
    "none": "nan",
    "beyond": "1e308",
}
"""What Python's int or float reads, or another program reads otherwise."""


def text(file, pattern):
    return lambda lab, odd: swap(pattern, odd)(lab / file)


def cell(file, column):
    def spoil(lab, odd):
        head, first, *rest = (lab / file).read_text().splitlines()
        cells = first.split(",")
        cells[head.split(",").index(column) if column else 0] = odd
        (lab / file).write_text("\n".join([head, ",".join(cells), *rest]))

    return spoil


def mapped(lab, odd):
    (lab / "map.toml").write_text(f"[values]\nsigma_um = {odd}\n")


XML, TOML, ROBOT, DATA = "arm/rigid.xml", "arm/elastic.toml", "robot.urdf", "data.csv"
CHECK, NEW, READ = "check arm", "new robot --from robot.urdf", "data check arm data.csv"
PLACES = {
    "mass of a link": (text(XML, '(?<=mass=")[0-9.]+(?=")'), CHECK, "rigid.xml", "mass: "),
    "mass of a robot's link": (text(ROBOT, '(?<=value=")9(?=")'), NEW, "robot.urdf", "<mass>: value"),
    "diameter": (text(TOML, r"(?<=outer_diameter = \{ value = )[^,]+"), CHECK, "elastic.toml"),
    "place of a target": (cell(DATA, "before_x_m"), READ, DATA),
    "run": (cell(DATA, "run"), READ, DATA),
    "force": (cell(DATA, "force_z_N"), READ, DATA),
    "task": (cell("tasks.csv", ""), "plan arm --task tasks.csv --poses 4", "tasks.csv: line 2"),
    "map": (mapped, f"{READ} --map map.toml", "map.toml"),
    "flag": (lambda lab, odd: None, "plan arm --task tasks.csv --tracker 4,-1,{}", "--tracker"),
}
EVERY = {
    **dict.fromkeys(("mass of a link", "place of a target"), ODD),
    **dict.fromkeys(("mass of a robot's link", "task", "map", "flag"), ("Arabic", "hex float", "beyond")),
    "run": ("Arabic", "underscore"),
    "diameter": ("Arabic", "hex float", "infinite", "none", "beyond"),  # TOML has underscores and hex
    "force": ("hex", "beyond"),
}
CROSSED = [(place, odd) for place, own in EVERY.items() for odd in own]


@pytest.mark.parametrize(("place", "odd"), CROSSED)
def test_an_odd_number_is_refused_where_it_stands(attack, lab, place, odd):
    spoil, command, *said = PLACES[place]
    spoil(lab, ODD[odd])
    attack(lab, *command.format(ODD[odd]).split()).refused(*said)


def test_a_force_next_to_none_is_refused(attack, lab):
    head, *rows = (lab / "data.csv").read_text().splitlines()
    (lab / "data.csv").write_text("\n".join([head, *(row.replace(",-9.81,", ",-1e-200,") for row in rows)]))
    asked = ("identify", "arm", "data.csv", "--model", "MGCO56", "--no-intervals", "--out", "out")
    attack(lab, *asked).refused("data.csv: line 2, column force_z_N: expected 0 or numbers from 1e-100")


def test_more_runs_than_are_worked_on_are_refused(attack, lab):
    asked = "simulate arm --poses 9999 --loads 1,2,3,4,5,6 --out o.csv"
    attack(lab, *asked.split()).refused("expected at most 50000 runs")
    pulls = [f"--pull={1 + k},0,0" for k in range(30)]
    asked = "plan arm --task tasks.csv --poses 4 --candidates 5000"
    attack(lab, *asked.split(), *pulls).refused("--load and --pull, times --candidates: expected")
