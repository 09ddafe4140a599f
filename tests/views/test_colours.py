"""Roles of colours: one a model, told apart, seen on any ground, and purple is load alone."""

from itertools import combinations

import numpy as np
import pytest

from testbench.campaign.models import MODELS, named_models
from testbench.model.structure import all153, template56
from testbench.studies.identifiability.trial import FILLERS, GCO, LS
from testbench.views import colours
from testbench.views.colours import CHOICE, SCALE, SERIES, look

APART = 0.05  #: Least distance of two models' colours in OKLab: a just noticeable one is 0.02.
GROUNDS = ((252, 252, 252), (28, 28, 30))  #: A page, and a label in the dark viewer.
SEEN = 3.0  #: Contrast of lines and dots, WCAG 2.1, 1.4.11.
OF_LMS = np.array([[0.4122, 0.5363, 0.0514], [0.2119, 0.6807, 0.1074], [0.0883, 0.2817, 0.6300]])
OF_LAB = np.array([[0.2105, 0.7936, -0.0041], [1.9780, -2.4286, 0.4506], [0.0259, 0.7828, -0.8087]])
"""Ottosson's OKLab of linear sRGB: root of the cones, then lightness, green to red, blue to yellow."""


def linear(colour):
    part = np.asarray(colour[:3], float) / 255
    return np.where(part <= 0.04045, part / 12.92, ((part + 0.055) / 1.055) ** 2.4)


def oklab(colour):
    return OF_LAB @ np.cbrt(OF_LMS @ linear(colour))


def contrast(a, b):
    low, high = sorted(linear(x) @ [0.2126, 0.7152, 0.0722] for x in (a, b))
    return (high + 0.05) / (low + 0.05)


def method(name):
    return "none" if name.startswith(("MLS", "Joints")) else "psd"


PLAIN = {name: look(name, method(name)) for name in MODELS if name != "MGCO69"}  # MGCO68 where joint 1 turns
FILLED = ("Joints", "MLS56", "MGCO56", "MGCO68", "ALL153")  #: What studies fit with a prior.
TOGETHER = (
    PLAIN
    | {f"{name} + prior": look(name, method(name), prior=True) for name in FILLED}
    | {"MLS56, PSD of equal fit": look("MLS56", "free"), "default": CHOICE}
    | {
        f"{name}, {own.name}": look(
            name, "none" if own is LS else "psd", own.filling != "least trace", own.filling
        )
        for name in ("MGCO68", "ALL153")
        for own in FILLERS
        if own is not GCO
    }
)
"""All models that any study shows, wider than any shows together."""
ROLES = {name: getattr(colours, name) for name in ("NOMINAL", "MEASURED", "LOAD", "GREY", "TASK")}
EVERY = {name: own.colour for name, own in TOGETHER.items()} | ROLES


@pytest.mark.parametrize("ground", GROUNDS)
def test_lines_and_dots_stand_out_from_a_page_and_from_the_dark(ground):
    dim = {name: contrast(c, ground) for name, c in EVERY.items() if contrast(c, ground) < SEEN}
    dim |= {c: contrast(c, ground) for c in (*SCALE, *SERIES) if contrast(c, ground) < SEEN}
    assert dim == {}


def test_models_and_roles_are_told_apart_by_colour_alone():
    close = {
        (a, b): np.linalg.norm(oklab(EVERY[a]) - oklab(EVERY[b]))
        for a, b in combinations(EVERY, 2)
        if np.linalg.norm(oklab(EVERY[a]) - oklab(EVERY[b])) < APART
    }
    assert close == {}
    assert min(np.linalg.norm(oklab(a) - oklab(b)) for a, b in combinations(SERIES, 2)) > APART


def test_purple_is_load_and_nothing_else():
    for name, colour in [*EVERY.items(), *((c, c) for c in (*SCALE, *SERIES))]:
        _, red, yellow = oklab(colour)
        hue, chroma = np.degrees(np.arctan2(yellow, red)) % 360, np.hypot(red, yellow)
        assert (chroma > 0.04 and 290 < hue < 358) == (name == "LOAD"), (name, hue)


def test_one_model_has_one_colour_whatever_a_study_calls_its_structure():
    assert look("MGCO56", "none", prior=True) == look("MLS56", "none", prior=True)
    assert look("MGCO56", "psd", True, "prior") == look("MGCO56", "psd", prior=True)
    assert look("Joints", "psd") == look("Joints", "none")


def test_models_of_an_arm_of_five_joints_look_as_those_of_six(slides):
    joints, template, full, every = (
        model.structure.name for model in named_models(slides, ("Joints", "MGCO48", "MGCO126", "ALL"))
    )
    assert (template, every) == (template56(slides.arm).name, all153(slides.arm).name) == ("MGCO48", "ALL131")
    same = {joints: "Joints", template: "MGCO56", full: "MGCO147", every: "ALL153"}
    for own, kin in same.items():
        assert look(own, "psd", prior=own == every) == look(kin, "psd", prior=own == every)


def test_least_squares_is_orange_gco_green_and_joints_alone_blue():
    orange, green, blue = (
        np.degrees(np.arctan2(*oklab(look(name, method(name)).colour)[:0:-1])) % 360
        for name in ("MLS56", "MGCO56", "Joints")
    )
    assert (orange, green, blue) == pytest.approx((75, 145, 265), abs=15)


def test_an_own_structure_has_a_colour_of_its_method():
    assert look("own", "psd").colour in colours.SHADES["psd", "none"].values()
    assert look("own", "none").colour in colours.SHADES["none", "none"].values()
