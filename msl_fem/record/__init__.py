"""Measured or simulated data: a frozen record of a rig, its runs and its static map, read from a folder and written."""

from msl_fem.record.reader import load_record
from msl_fem.record.record import Noise, Origin, Record, Role, Run, Sampling, StaticMap, Tolerance
from msl_fem.record.writer import check_record_folder, write_record

__all__ = [
    "Noise",
    "Origin",
    "Record",
    "Role",
    "Run",
    "Sampling",
    "StaticMap",
    "Tolerance",
    "check_record_folder",
    "load_record",
    "write_record",
]
