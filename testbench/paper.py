"""Numbers that the paper gives, to stand beside ours: sections 5 and 6, their tables and text."""

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
    "MLS56": {"readings_p95_mm": 0.085, "readings_max_relative_percent": 0.94},
    "MLS32": {"readings_p95_mm": 0.078, "readings_max_relative_percent": 0.80},
    "MGCO147": {"readings_max_relative_percent": 0.87},
    "MGCO69": {"readings_p95_mm": 0.084},
    "MGCO56": {"readings_p95_mm": 0.072, "readings_max_relative_percent": 0.62},
}
"""The cells of Table II that the text of section 5.2 gives.

They stand beside our errors against readings: that the paper's 120 check runs carry noise is our reading.
"""
