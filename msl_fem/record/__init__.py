"""Measured or simulated data: a frozen record of a rig, its runs and its static map, read from a folder and written."""

from msl_fem.record.linear_law import LinearLaw, PidLaw, StateSpaceLaw, law_of, linear_laws
from msl_fem.record.reader import load_record
from msl_fem.record.record import Noise, Origin, Record, Role, Run, Sampling, StaticMap, Tolerance
from msl_fem.record.writer import check_record_folder, write_record

__all__ = [
    "LinearLaw",
    "Noise",
    "Origin",
    "PidLaw",
    "Record",
    "Role",
    "Run",
    "Sampling",
    "StateSpaceLaw",
    "StaticMap",
    "Tolerance",
    "check_record_folder",
    "law_of",
    "linear_laws",
    "load_record",
    "write_record",
]
