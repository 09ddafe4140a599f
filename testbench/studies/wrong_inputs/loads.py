"""Mistakes in loads, in the stated noise and in what the folder says of compliances."""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from testbench.arm.mjcf import GRAVITY
from testbench.data.dataset import Dataset
from testbench.errors import Array
from testbench.identify.prior import Prior
from testbench.model.vjm import tool_pose
from testbench.studies.wrong_inputs.fault import Fault, Plant, bump, of_data
from testbench.studies.wrong_inputs.sound import PAYLOAD, Sound


def _wrench(change: Callable[[Sound, Array, np.random.Generator], Array]) -> Plant:
    def of(sound: Sound, d: Dataset, rng: np.random.Generator) -> Dataset:
        return replace(d, wrench=change(sound, d.wrench.copy(), rng))

    return of_data(of)


def _times(factor: float) -> Plant:
    return _wrench(lambda _, w, __: factor * w)


def _offset(sound: Sound, w: Array, rng: np.random.Generator) -> Array:
    """A force sensor 6.6 % of the payload's weight off: 300 N on the KR 500."""
    w[:, int(rng.integers(3))] += rng.choice([-1, 1]) * 0.0664 * GRAVITY * PAYLOAD[sound.cell.arm.name]
    return w


def _tool_axes(sound: Sound, d: Dataset, _: np.random.Generator) -> Dataset:
    w = d.wrench.copy()
    w[:, :3] = np.einsum("ryx,ry->rx", tool_pose(sound.cell.vjm, d.q)[1], w[:, :3])
    return replace(d, wrench=w)


def _other_axis(_: Sound, w: Array, __: np.random.Generator) -> Array:
    w[:, [0, 2]] = w[:, [2, 0]]
    return w


def _one_level(_: Sound, w: Array, __: np.random.Generator) -> Array:
    force = np.linalg.norm(w, axis=1)
    w[force > 0.99 * force.max()] *= 0.8
    return w


def _level_order(_: Sound, w: Array, __: np.random.Generator) -> Array:
    return np.ascontiguousarray(w.reshape(-1, 3, 6)[:, ::-1].reshape(-1, 6))


def _one_run(_: Sound, w: Array, rng: np.random.Generator) -> Array:
    w[int(rng.integers(len(w)))] *= 0.5
    return w


def _point(_: Sound, d: Dataset, rng: np.random.Generator) -> Dataset:
    return replace(d, point=d.point + bump(rng, 0.3))


def _point_mm(_: Sound, d: Dataset, __: np.random.Generator) -> Dataset:
    return replace(d, point=1e3 * (d.point + 0.05))


def _sigma(_: Sound, d: Dataset, __: np.random.Generator) -> Dataset:
    return replace(d, sigma=d.sigma / 20)


def _folder(factor: float) -> Plant:
    def plant(sound: Sound, _: np.random.Generator) -> Sound:
        return replace(sound, prior=Prior(f"{sound.prior.name}, wrong", factor * sound.prior.C_theta))

    return plant


def _levels(sound: Sound) -> bool:
    return sound.loads == "levels"


def _not_one(sound: Sound) -> bool:
    return sound.loads != "hung"


LOADS: Mapping[str, Fault] = {
    "kilograms": Fault("forces in kg", _times(1 / GRAVITY), ("scale",)),
    "kilonewtons": Fault("forces in kN", _times(1e-3), ("scale",)),
    "comma": Fault("forces ten times too large", _times(10.0), ("scale",)),
    "force_sign": Fault("sign of the forces", _times(-1.0), ("sign",)),
    "force_zero": Fault(
        "force sensor 6.6 % off, 300 N on a KR 500", _wrench(_offset), ("force_offset",), _not_one
    ),
    "force_axis": Fault("force along x instead of z", _wrench(_other_axis), ("force_axes",)),
    "tool_axes": Fault("forces in the tool's axes", of_data(_tool_axes), ("force_axes",)),
    "payload": Fault("one of three loads 20 % off", _wrench(_one_level), ("level",), _levels),
    "load_order": Fault("three loads in reversed order", _wrench(_level_order), ("levels",), _levels),
    "one_load": Fault("a load stated as half in one run", _wrench(_one_run), ("run_load",)),
    "load_point": Fault("load point 300 mm off", of_data(_point), ("load_point",)),
    "point_unit": Fault("load point in millimetres", of_data(_point_mm), ("load_point",)),
    "noise": Fault("noise stated 20 times too small", of_data(_sigma), ("noise",)),
    "soft_folder": Fault("folder ten times too soft", _folder(10.0), ("scale",)),
    "stiff_folder": Fault("folder ten times too stiff", _folder(0.1), ("scale",)),
}
"""Mistakes by name."""
