"""What the true arm does beyond the model: each disturbance alone, another compensator, all of them."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace

from testbench.errors import BenchError
from testbench.plant import STIFF_COMPENSATOR, TYPICAL, Disturbances

NONE, ALL = "none", "all together"
PLAIN_COMPENSATOR, STIFF = "gravity compensator", "compensator, other reading"
SWITCHES: dict[str, tuple[str, ...]] = {
    "own weight": ("own_weight",),
    PLAIN_COMPENSATOR: ("compensator",),
    "nominal geometry": ("geometry",),
    "joint sensors": ("sensor_offset",),
    "payload mass": ("mass_error",),
    "payload centre": ("centre_error",),
    "stiffening joints": ("stiffening",),
    "backlash": ("backlash",),
    "hysteresis": ("hysteresis",),
    "soft foundation": ("foundation",),
}
"""Fields of Disturbances that each case switches on, at their typical size."""


def cases(scale: float, only: Sequence[str] = ()) -> dict[str, Disturbances]:
    """Disturbances by name: none, each alone, the compensator's other reading, all together.

    Args:
        scale: Size of those that have one, over the typical one.
        only: Cases to keep beside none; then all together are these alone.

    Raises:
        BenchError: When there is no such case.
    """
    sized = resized(TYPICAL, scale)
    if only:
        return _only(sized, only)
    alone = {
        name: replace(Disturbances(), **{field: getattr(sized, field) for field in fields})
        for name, fields in SWITCHES.items()
    }
    return {
        NONE: Disturbances(),
        **alone,
        STIFF: Disturbances(compensator=STIFF_COMPENSATOR),
        ALL: sized,
    }


def _only(sized: Disturbances, only: Sequence[str]) -> dict[str, Disturbances]:
    """None, the cases asked for, and they together."""
    for name in only:
        if name not in SWITCHES:
            raise BenchError(f"no disturbance {name!r}; disturbances are {', '.join(SWITCHES)}")
    fields = {name: {key: getattr(sized, key) for key in SWITCHES[name]} for name in only}
    together = {key: value for own in fields.values() for key, value in own.items()}
    alone = {name: replace(Disturbances(), **own) for name, own in fields.items()}
    return {NONE: Disturbances(), **alone, ALL: replace(Disturbances(), **together)}


def sizes(scale: float, only: Sequence[str] = ()) -> dict[str, Mapping[str, object]]:
    """What every case switches on, as plain data."""
    return {
        name: {key: value for key, value in asdict(case).items() if value}
        for name, case in cases(scale, only).items()
    }


def resized(typical: Disturbances, scale: float) -> Disturbances:
    """Every disturbance that has a size, so many times as large."""
    fields = "sensor_offset mass_error centre_error stiffening backlash hysteresis foundation".split()
    geometry = typical.geometry
    if geometry is not None:
        geometry = replace(geometry, position=scale * geometry.position, angle=scale * geometry.angle)
    return replace(typical, geometry=geometry, **{name: scale * getattr(typical, name) for name in fields})
