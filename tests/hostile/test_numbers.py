"""Numbers that only Python reads, or that no arm can have: in MJCF, URDF, TOML, tables and flags alike."""

from collections.abc import Iterable
from pathlib import Path

import pytest

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


URDF = {
    "mass of a link": ('value="9"', 'value="{}"', "<mass>: value"),
    "place of a joint": ('xyz="0 0 0.3"', 'xyz="0 0 {}"', "<origin>: xyz"),
    "size of a box": ('size="0.1 0.1 0.2"', 'size="{} 0.1 0.2"', "<box>: size"),
}


def crossed(places: Iterable[str]) -> list[tuple[str, str]]:
    """The first place with every odd number, every other place with one of them."""
    first, *others = places
    names = list(ODD)
    return [(first, odd) for odd in ODD] + [(other, names[k % len(names)]) for k, other in enumerate(others)]


def swap(file: Path, old: str, new: str) -> None:
    text = file.read_text()
    assert old in text, old
    file.write_text(text.replace(old, new, 1))


PLACES = {
    "size of a geom": ("arm/rigid.xml", 'size="0.0675"', 'size="{}"', "<geom>: size"),
    "place of a body": ("arm/rigid.xml", 'pos="0 0 0.7"', 'pos="0 0 {}"', "<body name='link_1'>: pos"),
    "mass of a link": ("arm/rigid.xml", 'mass="30"', 'mass="{}"', "<inertial>: mass"),
    "limit of a joint": (
        "arm/rigid.xml",
        'range="-2.4 0.5"',
        'range="-2.4 {}"',
        "<joint name='joint_2'>: range",
    ),
    "gravity": ("arm/rigid.xml", "0 0 -9.81", "0 0 {}", "<option>: gravity"),
}


@pytest.mark.parametrize(("place", "odd"), crossed(PLACES))
def test_in_mjcf(attack, lab, place, odd):
    file, old, new, said = PLACES[place]
    swap(lab / file, old, new.format(ODD[odd]))
    attack(lab, "check", "arm").refused("rigid.xml: line ", said)


@pytest.mark.parametrize(("place", "odd"), crossed(URDF))
def test_in_urdf(attack, lab, place, odd):
    old, new, said = URDF[place]
    swap(lab / "robot.urdf", old, new.format(ODD[odd]))
    attack(lab, "new", "robot", "--from", "robot.urdf").refused("robot.urdf", said)


@pytest.mark.parametrize("odd", ["Arabic", "hex float", "infinite", "none", "beyond"])
def test_in_toml_which_has_its_own_underscores_and_hex(attack, lab, odd):
    text = (lab / "arm/elastic.toml").read_text()
    at = text.index("outer_diameter")
    value = text[text.index("value = ", at) :].split(",")[0]
    swap(lab / "arm/elastic.toml", value, f"value = {ODD[odd]}")
    attack(lab, "check", "arm").refused("elastic.toml")


COLUMNS = ("before_x_m", "run", "joint_1_rad", "force_z_N", "sigma_m")


@pytest.mark.parametrize(("column", "odd"), [*crossed(COLUMNS), ("force_z_N", "beyond")])
def test_in_readings(attack, lab, column, odd):
    head, first, *rest = (lab / "data.csv").read_text().splitlines()
    cells = first.split(",")
    cells[head.split(",").index(column)] = ODD[odd]
    (lab / "data.csv").write_text("\n".join([head, ",".join(cells), *rest]))
    attack(lab, "data", "check", "arm", "data.csv").refused("data.csv")


def test_a_force_next_to_none_is_refused(attack, lab):
    head, *rows = (lab / "data.csv").read_text().splitlines()
    (lab / "data.csv").write_text("\n".join([head, *(row.replace(",-9.81,", ",-1e-200,") for row in rows)]))
    asked = ("identify", "arm", "data.csv", "--model", "MGCO56", "--no-intervals", "--out", "out")
    attack(lab, *asked).refused("data.csv: line 2, column force_z_N: expected 0 or numbers of at least")


@pytest.mark.parametrize("odd", ["Arabic", "hex float", "beyond"])
def test_in_tasks(attack, lab, odd):
    head, first, *rest = (lab / "tasks.csv").read_text().splitlines()
    (lab / "tasks.csv").write_text("\n".join([head, ",".join([ODD[odd], *first.split(",")[1:]]), *rest]))
    attack(lab, "plan", "arm", "--task", "tasks.csv", "--poses", "4").refused("tasks.csv: line 2")


@pytest.mark.parametrize("odd", ["Arabic", "hex float", "beyond"])
def test_in_a_map(attack, lab, odd):
    (lab / "map.toml").write_text(f"[values]\nsigma_um = {ODD[odd]}\n")
    attack(lab, "data", "check", "arm", "data.csv", "--map", "map.toml").refused("map.toml")


@pytest.mark.parametrize("odd", ["Arabic", "hex float", "beyond"])
def test_in_flags(attack, lab, odd):
    attack(lab, "plan", "arm", "--task", "tasks.csv", "--tracker", f"4,-1,{ODD[odd]}").refused("--tracker")


PLAN = ("plan", "arm", "--task", "tasks.csv", "--poses", "4")
MORE = {
    "poses of a file times loads": (
        "simulate",
        "arm",
        "poses.csv",
        "--loads",
        "1,2,3,4,5,6",
        "--out",
        "o.csv",
    ),
    "random poses times loads": (
        "simulate",
        "arm",
        "--poses",
        "9999",
        "--loads",
        "1,2,3,4,5,6",
        "--out",
        "o.csv",
    ),
    "loads times candidates": (*PLAN, *(f"--load={1 + k}" for k in range(30)), "--candidates", "5000"),
    "pulls times candidates": (*PLAN, *(f"--pull={1 + k},0,0" for k in range(30)), "--candidates", "5000"),
}


@pytest.mark.parametrize("asked", MORE)
def test_more_runs_than_are_worked_on(attack, lab, asked):
    head, first, *_ = (lab / "tasks.csv").read_text().splitlines()
    (lab / "poses.csv").write_text("\n".join([head, *[first] * 9999]))
    said = (
        "expected at most 50000 runs"
        if "poses" in asked
        else "--load and --pull, times --candidates: expected"
    )
    attack(lab, *MORE[asked]).refused(said)
