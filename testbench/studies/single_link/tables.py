"""The tables of section 5.1: columns declared once for terminal, report.md, figure and recording."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from testbench.bench.rows import UM
from testbench.report.columns import columns
from testbench.studies.single_link.printed import Rows
from testbench.studies.single_link.report import LinkReport
from testbench.studies.single_link.trial import GCO, LEAST_SQUARES, SYMMETRIC
from testbench.views.schema import Column, Table

AXES = ("x", "y", "z", "phi_x", "phi_y", "phi_z")
SI = "10^-6 SI"  #: Eigenvalues are in mixed SI units, as the paper's.


def _both(key: str, heading: str, unit: str = "", form: str = "yes", **more: object) -> Column:
    return Column(key, heading, unit, form, paper=key, **more)  # type: ignore[arg-type]


NAME = Column("name", "model")
SMALLEST = _both(
    "min_eigenvalue_matrix", "smallest eigenvalue", SI, ".3f", scale=UM, short="smallest\n10^-6 SI"
)
SHAPE = (
    NAME,
    _both("conservative", "conservative", short="conser-\nvative"),
    _both("symmetric", "symmetric", short="sym-\nmetric"),
    _both("negative_eigenvalue_matrix", "eigenvalue below 0", short="eigen-\nvalue\nbelow 0"),
    _both("negative_eigenvalue", "of symmetric part below 0", short="of sym.\npart"),
    SMALLEST,
    _both(
        "min_eigenvalue", "smallest of symmetric part", SI, ".3f", scale=UM, short="of sym.\npart\n10^-6 SI"
    ),
    _both("f_m", "F_M", form=".2f"),
    Column("f_m_floor", "floor", form=".2f", exact=True),
)
"""What kind of matrix it is."""
POSITION = _both("prediction.position_rms_um", "position error", "um", ".1f")
ROTATION = _both("prediction.rotation_rms_urad", "rotation error", "urad", ".0f")
ENTRIES = (
    _both("entries.translation_rms_um_per_N", "C force-position", "um/N", ".2f", short="force\npos.\num/N"),
    _both(
        "entries.coupling_translation_rms_um_per_Nm", "C moment-position", "um/(N m)", ".2f",
        short="moment\npos.\num/(N m)",
    ),
    _both(
        "entries.coupling_rotation_rms_urad_per_N", "C force-rotation", "urad/N", ".2f",
        short="force\nrot.\nurad/N",
    ),
    _both(
        "entries.rotation_rms_urad_per_Nm", "C moment-rotation", "urad/(N m)", ".2f",
        short="moment\nrotation\nurad/(N m)",
    ),
)  # fmt: skip
ERRORS = (
    NAME,
    POSITION,
    _both("prediction.position_relative_percent", "of the deflection", "%", ".2f", short="%"),
    ROTATION,
    _both("prediction.rotation_relative_percent", "of the rotation", "%", ".2f", short="%"),
    *ENTRIES,
)
"""How far off it is, in predictions under fresh loads and in entries."""
RECORDED = ("name", "conservative", "symmetric", "negative_eigenvalue_matrix", POSITION.key, ROTATION.key)
ORDER = (
    Column("m", "m", form="d"),
    Column("f_m", "F_M", form=".3f"),
    Column("excess_percent", "F_M above the optimum", "%", ".2f"),
    Column("reaches_optimum", "reaches the optimum", form="yes"),
    replace(POSITION, paper=""),
    replace(ROTATION, paper=""),
)
OWN = (
    ORDER[0],
    Column("f_m", "F_M on the paper's data", form=".3f"),
    Column("rms_to_eq_23_over_sigma", "RMS distance to Eq. (23)", "sigma/load", ".2f"),
)
QUANTITIES = {column.key.split(".")[-1]: column.heading for column in (POSITION, ROTATION, *ENTRIES)}


def tables(report: LinkReport) -> dict[str, Table]:
    """Models, orders, wins, eigenvalues and matrices."""
    every = {column.key: column for column in (*SHAPE, *ERRORS)}
    wins = [
        {"name": words} | {other: pair.gco_better[key] for other, pair in report.paired.items()}
        for key, words in QUANTITIES.items()
    ]
    return {
        "shape": Table(SHAPE, report.models),
        "errors": Table(ERRORS, report.models, headline=POSITION.key),
        "recorded": Table(tuple(replace(every[key], exact=True) for key in RECORDED), report.models),
        "paired": Table(_wins(), wins),
        "order": Table(ORDER, report.order),
        "spectra": spectra({f"m = {row.m}": row.eigenvalues for row in report.order}),
        "own": Table(OWN, report.eq_22_23.eq_23_from_the_data_of_eq_22.order),
        "eigenvalues": spectra(_eigenvalues(report)),
        "claims": Table(columns("claim verdict why"), report.claims),
        **{f"matrix {name}": _matrix(name, C) for name, C in matrices(report).items()},
    }


def _wins() -> tuple[Column, ...]:
    others = [Column(name, f"than {name}", form="d") for name in (LEAST_SQUARES, SYMMETRIC)]
    return (Column("name", f"draws in which {GCO} is closer to the truth"), *others)


def spectra(found: dict[str, Sequence[object]]) -> Table:
    """Eigenvalues by what they are of, in ascending order."""
    heads = [Column(str(k), f"eigenvalue {k}", SI, ".3f", exact=True, scale=UM) for k in range(1, 7)]
    rows = [
        {"name": name} | {str(k): value for k, value in enumerate(values, 1)}
        for name, values in found.items()
    ]
    return Table((Column("name", "matrix"), *heads), rows)


def matrices(report: LinkReport) -> dict[str, Rows]:
    """The truth, the first draw, and what the paper prints, by title."""
    printed = report.eq_22_23
    return {
        "truth, Eq. (21)": report.truth_matrix,
        **{f"{name}, first draw": C.matrix for name, C in report.first_draw.items()},
        "LS, Eq. (22)": printed.eq_22.matrix,
        "GCO, Eq. (23)": printed.eq_23.matrix,
        "optimum of the paper's data": printed.eq_23_from_the_data_of_eq_22.optimum_matrix,
    }


def _eigenvalues(report: LinkReport) -> dict[str, Sequence[object]]:
    """Of every matrix, and of the symmetric part where the matrix is another one."""
    printed = report.eq_22_23
    found: dict[str, Sequence[object]] = {"truth, Eq. (21)": np.linalg.eigvalsh(report.truth_matrix).tolist()}
    drawn = {f"{name}, first draw": C for name, C in report.first_draw.items()}
    for name, C in {**drawn, "LS, Eq. (22)": printed.eq_22}.items():
        found[name] = C.eigenvalues_matrix
        if not np.array_equal(C.matrix, np.transpose(C.matrix)):
            found[f"{name}, symmetric part"] = C.eigenvalues_symmetric_part
    found["GCO, Eq. (23)"] = printed.eq_23.eigenvalues
    found["optimum of the paper's data"] = printed.eq_23_from_the_data_of_eq_22.optimum_eigenvalues
    return found


def _matrix(name: str, C: Rows) -> Table:
    heads = [Column(axis, axis, "", ".3f", scale=UM) for axis in AXES]
    rows = [{"name": axis} | dict(zip(AXES, row, strict=True)) for axis, row in zip(AXES, C, strict=True)]
    return Table((Column("name", f"{name}, {SI}"), *heads), rows)
