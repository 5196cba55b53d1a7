"""Sweeps of field solutions over gap and current."""
