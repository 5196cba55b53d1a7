"""Diagnosis: what the simulation gets wrong, by which cause, and how much better it becomes."""
