"""Roles of colours: one a model, told apart, seen on any ground, and purple is load alone."""

from itertools import combinations

import numpy as np
import pytest

from testbench.model.structure import all153, template56
from testbench.report import colours
from testbench.report.colours import CHOICE, SCALE, SERIES, look
from testbench.report.recording import run
from testbench.studies.campaign.identifiability import FILLERS, GCO, LS
from testbench.workflows.models import MODELS, named_models

APART = 5.0  #: Least CIEDE2000 of two models' colours: a just noticeable one is 1.
GROUNDS = ((252, 252, 252), (28, 28, 30))  #: A page, and a label in the dark viewer.
SEEN = 3.0  #: Contrast of lines and dots, WCAG 2.1, 1.4.11.
NORMAL = np.eye(3)
PROTANOPE = np.array(
    [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]]
)
DEUTERANOPE = np.array(
    [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]]
)
"""Linear sRGB as it is seen: Machado, Oliveira and Fernandes 2009, severity 1."""
XYZ = np.array(
    [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750], [0.0193339, 0.119192, 0.9503041]]
)
WHITE = np.array([0.95047, 1.0, 1.08883])  #: D65.
FAR_APART = 15.0  #: CIEDE2000 of any two roles that are drawn beside each other.


def linear(colour):
    part = np.asarray(colour[:3], float) / 255
    return np.where(part <= 0.04045, part / 12.92, ((part + 0.055) / 1.055) ** 2.4)


def contrast(a, b):
    low, high = sorted(linear(x) @ [0.2126, 0.7152, 0.0722] for x in (a, b))
    return (high + 0.05) / (low + 0.05)


def cielab(colour, eye=NORMAL):
    """CIE L*a*b* of a colour as an eye sees it."""
    x = XYZ @ np.clip(eye @ linear(colour), 0, 1) / WHITE
    f = np.where(x > 216 / 24389, np.cbrt(x), (24389 / 27 * x + 16) / 116)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


def hue(colour):
    """In CIELAB [deg], and the chroma."""
    _, red, yellow = cielab(colour)
    return np.degrees(np.arctan2(yellow, red)) % 360, np.hypot(red, yellow)


def apart(one, other, eye=NORMAL):
    return ciede2000(cielab(one, eye), cielab(other, eye))


def ciede2000(one, other):
    """Sharma, Wu and Dalal 2005."""
    (L1, a1, b1), (L2, a2, b2) = one, other
    C7 = ((np.hypot(a1, b1) + np.hypot(a2, b2)) / 2) ** 7
    stretched = 1.5 - 0.5 * np.sqrt(C7 / (C7 + 25**7))
    C1, C2 = np.hypot(stretched * a1, b1), np.hypot(stretched * a2, b2)
    h1, h2 = (np.degrees(np.arctan2(b, stretched * a)) % 360 for a, b in ((a1, b1), (a2, b2)))
    turn = (h2 - h1 + 180) % 360 - 180
    h = np.radians(h1 + turn / 2)
    dL, dC, dH = L2 - L1, C2 - C1, 2 * np.sqrt(C1 * C2) * np.sin(np.radians(turn) / 2)
    L, C = (L1 + L2) / 2, (C1 + C2) / 2
    T = 1 - 0.17 * np.cos(h - np.pi / 6) + 0.24 * np.cos(2 * h)
    T += 0.32 * np.cos(3 * h + np.radians(6)) - 0.2 * np.cos(4 * h - np.radians(63))
    dL /= 1 + 0.015 * (L - 50) ** 2 / np.sqrt(20 + (L - 50) ** 2)
    dC, dH = dC / (1 + 0.045 * C), dH / (1 + 0.015 * C * T)
    blue = np.exp(-((((np.degrees(h) % 360) - 275) / 25) ** 2))
    R = -2 * np.sqrt(C**7 / (C**7 + 25**7)) * np.sin(np.radians(60 * blue))
    return np.sqrt(dL**2 + dC**2 + dH**2 + R * dC * dH)


@pytest.mark.parametrize("eye", [NORMAL, PROTANOPE, DEUTERANOPE], ids=["normal", "protanope", "deuteranope"])
def test_everybody_tells_least_squares_gco_joints_prior_and_truth_apart(eye):
    assert look("MLS56", "none").colour == colours.DISTINCT[0]
    assert look("MGCO56", "psd").colour == colours.DISTINCT[1]
    assert look("Joints", "none").colour == colours.DISTINCT[2]
    assert look("MLS56", "none", prior=True).colour == colours.DISTINCT[3]
    for a, b in combinations(colours.DISTINCT, 2):
        assert apart(a, b, eye) >= FAR_APART, (a, b)


def method(name):
    return "none" if name.startswith(("MLS", "Joints")) else "psd"


PLAIN = {name: look(name, method(name)) for name in MODELS if name != "MGCO69"}  # MGCO68 where joint 1 turns
FILLED = ("Joints", "MLS56", "MGCO56", "MGCO68", "ALL153")  #: What studies fit with a prior.
TOGETHER = (
    PLAIN
    | {f"{name} + prior": look(name, method(name), prior=True) for name in FILLED}
    | {
        f"{name} (paper)": look(name, "psd", filling="paper")
        for name in PLAIN
        if method(name) == "psd" and name != "Joints"
    }
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
    dim |= {c: contrast(c, ground) for c in SERIES if contrast(c, ground) < SEEN}
    assert dim == {}


def test_the_ramp_of_maps_is_brighter_all_the_way_for_every_eye_and_seen_on_both_grounds():
    assert min(contrast(c, ground) for c in SCALE for ground in GROUNDS) > 1.75
    for eye in (NORMAL, PROTANOPE, DEUTERANOPE):
        light = [cielab(colour, eye)[0] for colour in SCALE]
        assert light[-1] - light[0] > 40
        assert np.diff(light) == pytest.approx((light[-1] - light[0]) / (len(SCALE) - 1), rel=0.15)


def test_least_squares_and_gco_differ_in_shape_in_space():
    assert {look("MLS56", "none").stroke, look("MLS32", "none", prior=True).stroke} == {"lines"}
    assert {look("MGCO56", "psd").stroke, look("Joints", "none").stroke, CHOICE.stroke} == {"arrows"}


def test_models_and_roles_are_told_apart_by_colour_alone():
    assert [pair for pair in combinations(EVERY, 2) if apart(*map(EVERY.get, pair)) < APART] == []
    assert min(apart(a, b) for a, b in combinations(SERIES, 2)) > APART


def test_purple_is_load_and_nothing_else():
    for name, colour in [*EVERY.items(), *((c, c) for c in (*SCALE, *SERIES))]:
        angle, chroma = hue(colour)
        assert (chroma > 10 and 300 < angle < 358) == (name == "LOAD"), (name, angle)


def test_words_for_colours_call_no_model_by_the_colour_of_another_role():
    roles = {run._hue(getattr(colours, name)) for name in ("NOMINAL", "MEASURED", "LOAD", "TASK", "GREY")}
    called = {name: run._hue(own.colour) for name, own in TOGETHER.items() if run._hue(own.colour) in roles}
    assert called == {}


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
    found = [hue(look(name, method(name)).colour)[0] for name in ("MLS56", "MGCO56", "Joints")]
    assert found == pytest.approx((75, 155, 285), abs=15)
