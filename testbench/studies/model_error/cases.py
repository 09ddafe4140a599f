"""What the true arm does beyond the model: each disturbance alone, another compensator, all of them."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace

from testbench.errors import BenchError
from testbench.plant import STIFF_COMPENSATOR, TYPICAL, Disturbances

NONE, ALL = "none", "all together"
PLAIN_COMPENSATOR, STIFF = "gravity compensator", "stiff compensator"
SWITCHES: dict[str, str] = {
    "own weight": "own_weight",
    PLAIN_COMPENSATOR: "compensator",
    "nominal geometry": "geometry",
    "joint sensors": "sensor_offset",
    "payload mass": "mass_error",
    "payload centre": "centre_error",
    "stiffening joints": "stiffening",
    "backlash": "backlash",
    "hysteresis": "hysteresis",
    "soft foundation": "foundation",
}
"""The field of Disturbances that each case switches on, at its typical size."""


def cases(scale: float, only: Sequence[str] = ()) -> dict[str, Disturbances]:
    """Disturbances, `scale` times the typical: none, each alone, another compensator, all together.

    Those of `only` are kept beside none, and all together are these alone; BenchError for one unknown.
    """
    for name in only:
        if name not in SWITCHES:
            raise BenchError(f"no disturbance {name!r}; disturbances are {', '.join(SWITCHES)}")
    sized = vars(resized(TYPICAL, scale))
    values = {name: {SWITCHES[name]: sized[SWITCHES[name]]} for name in only or SWITCHES}
    alone = {name: Disturbances(**value) for name, value in values.items()}
    stiff = {} if only else {STIFF: Disturbances(compensator=STIFF_COMPENSATOR)}
    together = {field: size for value in values.values() for field, size in value.items()}
    return {NONE: Disturbances(), **alone, **stiff, ALL: Disturbances(**together)}


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
