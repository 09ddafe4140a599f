"""Absolute readings explained: geometry, springs, joint errors, frames and mounts in one fit."""
