"""Numbers that the paper gives for section 6 (Table III and text), to stand beside ours."""

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
