"""Presets of campaigns: each asks one question, and bears the name of its scenario."""
