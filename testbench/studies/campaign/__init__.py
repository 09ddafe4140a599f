"""Campaigns of many trials: a preset names factors, models, tables and rivals; loop and report are one."""
