"""docs/mathematics: equations and functions name each other; constants and tables are the code's.

Then some equations by numpy, from what the pages define, against the functions that they name.
"""

import ast
import csv
import importlib
import math
import re
from pathlib import Path

import numpy as np
import pytest
from loads import axis_loads
from scipy.stats import norm
from scipy.stats import t as student

from testbench.identify.fold import reduce
from testbench.identify.hierarchy import learn
from testbench.identify.metric import metric
from testbench.identify.posterior import linearise
from testbench.identify.prior import cad_prior
from testbench.identify.regression import f_m, generic_rows, rank
from testbench.identify.solve import solve
from testbench.model import structure as structures
from testbench.model.load import weight
from testbench.model.loaded import displacement, geometric_stiffness, load_jacobian, secant
from testbench.model.vjm import chain, observation

ROOT = Path(__file__).resolve().parents[1]
PAGES = {page.stem: page.read_text(encoding="utf-8") for page in (ROOT / "docs/mathematics").glob("*.md")}
LIBRARY = ("arm", "model", "plant", "identify", "design", "correct", "studies")
EQUATION = re.compile(r"^\$\$\n.+?\n\$\$ \(([^)]+)\)\n\n([^\n]*)$", re.DOTALL | re.MULTILINE)
NAME = re.compile(r"`(testbench\.[\w.]+)`")
CONSTANT = re.compile(r"^\| `(testbench\.[\w.]+)` \| ([-\d][^|]*) \|", re.MULTILINE)
BUILDERS = "all153 mgco147 mgco69 mgco68 mgco47 template56 joints_only".split()


def equations(page):
    """Label of every equation, and the functions that compute it."""
    return {label: NAME.findall(line) for label, line in EQUATION.findall(PAGES[page])}


def rows(page, first):
    """Cells of the rows of a table whose head begins with a word."""
    table = re.search(rf"^\| {first} \|.*\n\|[-:| ]+\|\n((?:\|.*\n)+)", PAGES[page], re.MULTILINE)
    return [[cell.strip() for cell in line.strip("| ").split("|")] for line in table[1].splitlines()]


def documented(path):
    """Pairs of a function and a label that its docstring names, of one module."""
    text = path.read_text(encoding="utf-8")
    if "Mathematics: `" not in text:
        return
    todo = [(".".join(path.relative_to(ROOT).with_suffix("").parts), ast.parse(text))]
    while todo:
        name, node = todo.pop()
        inner = (own for own in node.body if isinstance(own, ast.FunctionDef | ast.ClassDef))
        todo += [(f"{name}.{own.name}", own) for own in inner]
        for line in re.findall(r"^Mathematics: (.*)\.$", ast.get_docstring(node) or "", re.MULTILINE):
            yield from ((name, label) for label in re.findall(r"`(.+?)`", line))


def test_equations_and_functions_name_each_other():
    named = {(name, label) for page in PAGES for label, names in equations(page).items() for name in names}
    modules = (path for room in LIBRARY for path in (ROOT / "testbench" / room).rglob("*.py"))
    assert named == {pair for path in modules for pair in documented(path)}


@pytest.mark.parametrize("page", sorted(PAGES.keys() - {"index"}))
def test_every_equation_has_a_label_in_turn_and_a_function(page):
    found = equations(page)
    prefix = next(iter(found)).partition("-")[0]
    opened = len(re.findall(r"^\$\$$", PAGES[page], re.MULTILINE))  # an equation without a label opens two
    assert list(found) == [f"{prefix}-{k + 1}" for k in range(opened)]
    assert all(found.values())


def test_constants_have_the_values_and_places_of_the_tables():
    for name, value in (pair for page in PAGES.values() for pair in CONSTANT.findall(page)):
        module, _, constant = name.rpartition(".")
        found = np.ravel(getattr(importlib.import_module(module), constant))
        np.testing.assert_allclose(found, [float(x) for x in value.split(",")], rtol=1e-4, err_msg=name)


def test_coverage_by_kind_is_that_of_the_study():
    with (ROOT / "docs/studies/model_error/kinds.csv").open(encoding="utf-8") as file:
        found = {
            row["true arms"]: [row["covered, %"], row["in the worst tenth, %"]]
            for row in csv.DictReader(file)
        }
    table = rows("intervals", "true arms")
    assert len(table) > 3
    assert all(found[kind] == covered for kind, *covered in table)


def test_ranks_of_the_page_are_those_of_the_arm(kr500, rng):
    """They do not depend on the draw: of the full load, of a weight in many poses, in eight."""
    q = kr500.arm.drawn(rng, 40)
    load, where = weight(kr500.vjm, 460.3).over(len(q)), chain(kr500.vjm, q)
    for name, *numbers in rows("observation", "structure"):
        s = next(own for own in (getattr(structures, own)(kr500.arm) for own in BUILDERS) if own.name == name)
        A = observation(where, s, load.wrench, load.point, kr500.vjm.markers)
        found = [s.n, rank(generic_rows(kr500.vjm, s)), *(rank(A[:k].reshape(-1, s.n)) for k in (40, 8))]
        assert found == [int(x) for x in numbers], name


def pose(vjm, q, theta):
    """The tool in the world by (vjm-1) and (vjm-2), (runs, 4, 4), of virtual joints (runs, 7 n + 6)."""

    def screw(axis, size):
        W = np.cross(np.eye(3), axis)
        s, c = np.sin(size)[:, None, None], np.cos(size)[:, None, None]
        return placed(np.eye(3) + s * W + (1 - c) * W @ W, np.zeros(3))

    def placed(R, x):
        T = np.zeros((*np.broadcast_shapes(R.shape[:-2], x.shape[:-1]), 4, 4))
        T[..., :3, :3], T[..., :3, 3], T[..., 3, 3] = R, x, 1
        return T

    n, T = vjm.arm.n_joints, vjm.base
    for i, link in enumerate(vjm.arm.links):
        own, placement = theta[:, 6 * i : 6 * i + 6], vjm.tool if i == n else vjm.placements[i]
        F, none = placed(link.frame, np.zeros(3)), np.zeros(3)
        T = T @ placed(np.eye(3), placement[:3, 3]) @ F @ placed(np.eye(3), own[:, :3])
        for k in range(3):
            T = T @ screw(np.eye(3)[k], own[:, 3 + k])
        T = T @ F.T @ placed(placement[:3, :3], none)
        if i < n:
            T = T @ screw(vjm.axes[i], q[i] + theta[:, 6 * (n + 1) + i])
    return T


def jacobian(vjm, q, theta, point, h):
    """Twist of a point of the tool per unit of every virtual joint, by differences, (runs, 6, n_theta)."""
    steps = h * np.concatenate([np.eye(theta.shape[1]), -np.eye(theta.shape[1])])
    T = pose(vjm, q, (theta[:, None] + steps).reshape(-1, theta.shape[1]))
    x = (T @ np.r_[point, 1.0])[:, :3].reshape(len(theta), 2, -1, 3)
    R = T[:, :3, :3].reshape(len(theta), 2, -1, 3, 3)
    W = (R[:, 0] - R[:, 1]) @ pose(vjm, q, theta)[:, None, :3, :3].swapaxes(2, 3) / (2 * h)
    turn = np.stack([W[..., 2, 1], W[..., 0, 2], W[..., 1, 0]], axis=-1)
    return np.concatenate([(x[:, 0] - x[:, 1]) / (2 * h), turn], axis=2).swapaxes(1, 2)


def test_chain_observation_and_force_term_are_those_of_their_equations(kr500, rng):
    """(vjm-1) to (vjm-8), (obs-1) and (loaded-3), by a product of 4 x 4 matrices and its differences."""
    vjm, C = kr500.vjm, kr500.arm.C_theta
    q, wrench = kr500.arm.drawn(rng, 1), 1000 * rng.standard_normal((1, 6))
    theta, point, marker = 0.01 * rng.standard_normal((1, len(C))), rng.uniform(-0.3, 0.3, 3), vjm.markers[0]
    where = chain(vjm, q, theta)
    np.testing.assert_allclose(where.position, pose(vjm, q[0], theta)[:, :3, 3], rtol=0, atol=1e-12)
    J_F = jacobian(vjm, q[0], theta, point, 1e-6)
    np.testing.assert_allclose(load_jacobian(where, point[None]), J_F, rtol=0, atol=1e-8)  # h^2 and rounding

    def u(theta):
        return np.einsum("rxt,x->rt", jacobian(vjm, q[0], theta, point, 1e-4), wrench[0])

    h, n = 1e-4, len(C)
    found = (u(theta + h * np.eye(n)) - u(theta - h * np.eye(n))).T / (2 * h)
    K_w = geometric_stiffness(where, wrench, point[None])[0]
    np.testing.assert_allclose(K_w, found, rtol=0, atol=1e-5 * np.abs(K_w).max())

    none, rest = np.zeros_like(theta), chain(vjm, q)
    J, J_F = (jacobian(vjm, q[0], none, own, 1e-6)[0] for own in (marker, point))
    moved = J[:3] @ C @ J_F.T @ wrench[0]
    s = structures.all153(kr500.arm)
    told = observation(rest, s, wrench, point[None], marker[None])[0, 0] @ s.entries(C)
    by_springs = displacement(rest, secant(rest, C, wrench, point[None]), marker[None])[0, 0]
    for own in (told, by_springs):
        np.testing.assert_allclose(own, moved, rtol=0, atol=1e-7 * np.abs(moved).max())


def test_the_worked_example_sinks_by_what_the_page_says(kr500):
    q, load = np.radians([[0.0, -60, 80, 0, 40, 0]]), weight(kr500.vjm, 460.3).over(1)
    where = chain(kr500.vjm, q)
    sunk = -1e3 * displacement(
        where, secant(where, kr500.arm.C_theta, load.wrench, load.point), kr500.vjm.markers
    )
    assert re.search(r"marker 1 sinks by ([\d.]+) mm", PAGES["vjm"])[1] == f"{sunk[0, 0, 2]:.3f}"


def test_f_m_and_its_floor_are_those_of_their_equations(arm_6r, rng):
    """(est-3) and (est-4) from the readings one by one."""
    data, s = axis_loads(arm_6r, rng, poses=3), structures.template56(arm_6r.arm)
    pi, r = s.entries(arm_6r.arm.C_theta), reduce(arm_6r.vjm, s, data)
    where = chain(arm_6r.vjm, data.q)
    left = data.after - data.before - observation(where, s, data.wrench, data.point, arm_6r.vjm.markers) @ pi
    C = s.matrix(pi)
    turned = np.einsum("xtr,ts,ysr,ry->rx", where.J_theta[3:], C, where.J_theta, data.wrench)
    twist = data.rotation_after - data.rotation_before - turned  # turns of milliradians: vectors add
    f = [np.sqrt((own**2).sum(axis=-1).mean()) for own in (left, twist)]
    expected = f[0] / (math.sqrt(2) * data.sigma) + f[1] / (math.sqrt(2) * data.sigma_rotation)
    np.testing.assert_allclose(f_m(r, pi), expected, rtol=1e-5)
    assert r.f_m_floor == pytest.approx(2 * math.sqrt(3 * (1 - r.rank / (6 * data.runs))))


def test_half_widths_are_those_of_their_equations(kr500, rng):
    """(prior-2), (int-3), (int-4) and (int-6): noise and prior apart, by dense inverses."""
    s, data = structures.mgco47(kr500.arm), axis_loads(kr500, rng, poses=2)
    r = reduce(kr500.vjm, s, data)
    belief = learn(r, metric(cad_prior(kr500.arm), kr500.vjm, s))
    own, strength = belief.metric, belief.strength
    d = np.where(own.couplings, strength.coupling, strength.uncertainty)
    d = d * np.repeat(strength.shares, [size * (size + 1) // 2 for size in own.sizes])
    A = r.rows[0] @ own.L
    V = np.linalg.inv(A.T @ A + np.diag(d**-2))
    noise, prior = (
        belief.misfit**2 * own.L @ V @ X @ V @ own.L.T for X in (A.T @ A, np.diag((belief.unsure / d) ** 2))
    )
    prior = prior + belief.moves.T @ belief.moves
    a = rng.standard_normal((5, s.n)) / np.abs(s.entries(kr500.arm.C_theta) + 1e-12)
    spread = [np.einsum("kp,pq,kq->k", a, X, a) for X in (noise, prior)]
    expected = np.sqrt(norm.ppf(0.975) ** 2 * spread[0] + student.ppf(0.975, 4) ** 2 * spread[1])
    found = linearise(solve(r, "psd", belief)).half_widths(a)
    np.testing.assert_allclose(found, expected, rtol=1e-6)
