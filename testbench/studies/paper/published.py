"""The paper's numbers of sections 5.1, 5.2 and 6, to compare with ours."""

SECTION_6: dict[str, dict[str, float]] = {
    "MLS32": {"identification_rms_mm": 0.107},
    "MLS56": {
        "identification_rms_mm": 0.085,
        "check_rms_mm": 0.144,
        "check_max_relative_percent": 4.19,
    },
    "MGCO47": {"identification_rms_mm": 0.152},
    "MGCO56": {
        "identification_rms_mm": 0.240,
        "check_max_mm": 0.354,
        "check_max_relative_percent": 6.28,
    },
    "MGCO68": {
        "identification_rms_mm": 0.119,
        "check_rms_mm": 0.136,
        "check_max_relative_percent": 3.98,
    },
}

SECTION_5_2: dict[str, dict[str, float]] = {
    "MLS56": {"check_p95_mm": 0.085, "check_max_relative_percent": 0.94},
    "MLS32": {"check_p95_mm": 0.078, "check_max_relative_percent": 0.80},
    "MGCO147": {"check_max_relative_percent": 0.87},
    "MGCO69": {"check_p95_mm": 0.084},
    "MGCO56": {"check_p95_mm": 0.072, "check_max_relative_percent": 0.62},
}
"""The cells of Table II that the text of section 5.2 gives.

They stand beside our errors against readings: that the paper's 120 check runs carry noise is our reading.
"""

Matrix = tuple[tuple[float, ...], ...]

EQ_22: Matrix = (
    (-7.32e-7, -2.15e-6, 2.05e-6, 1.29e-6, -2.25e-6, -6.89e-7),
    (-1.58e-6, 7.58e-5, -2.10e-6, 6.52e-7, -9.35e-7, 3.91e-4),
    (-3.00e-6, 1.79e-6, 3.43e-5, -1.95e-6, -1.73e-4, 1.03e-6),
    (8.39e-6, -1.74e-5, -3.59e-5, 3.80e-3, -1.80e-5, 2.50e-5),
    (-3.16e-5, -1.19e-5, -1.79e-4, -1.72e-5, 1.10e-3, 1.85e-5),
    (2.26e-5, 4.33e-4, 2.66e-5, 6.69e-5, 3.21e-5, 2.60e-3),
)
"""Compliance that least squares found in section 5.1, as printed in Eq. (22) [m/N, rad/N, rad/(N m)].

The truth, Eq. (21), is the compliance of models/single_link.
"""

EQ_23: Matrix = (
    (1.12e-7, -1.31e-6, 3.06e-7, 1.87e-6, -9.50e-7, 5.49e-7),
    (-1.31e-6, 7.62e-5, -8.24e-7, -8.45e-7, -4.65e-7, 3.92e-4),
    (3.06e-7, -8.24e-7, 2.95e-5, -2.68e-6, -1.75e-4, 6.63e-7),
    (1.87e-6, -8.45e-7, -2.68e-6, 3.80e-3, -1.79e-5, 6.47e-5),
    (-9.50e-7, -4.65e-7, -1.75e-4, -1.79e-5, 1.05e-3, 3.45e-5),
    (5.49e-7, 3.92e-4, 6.63e-7, 6.47e-5, 3.45e-5, 2.60e-3),
)
"""Compliance that GCO found from the same data, as printed in Eq. (23), same units."""
