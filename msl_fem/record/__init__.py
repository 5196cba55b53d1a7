"""Measured or simulated data: a frozen record of a rig, its runs and its static map, read from a folder and written."""

from msl_fem.record.columns import Channel
from msl_fem.record.frames import FrameLabels, record_from_frames
from msl_fem.record.linear_law import PidLaw, StatedLaw, StateSpaceLaw, law_of, linear_laws
from msl_fem.record.reader import load_record
from msl_fem.record.record import Record, Run, StaticMap
from msl_fem.record.rig_file import Mover, Noise, Origin, Role, Sampling, Tolerance
from msl_fem.record.writer import check_record_folder, write_record

__all__ = [
    "Channel",
    "FrameLabels",
    "Mover",
    "Noise",
    "Origin",
    "PidLaw",
    "Record",
    "Role",
    "Run",
    "Sampling",
    "StateSpaceLaw",
    "StatedLaw",
    "StaticMap",
    "Tolerance",
    "check_record_folder",
    "law_of",
    "linear_laws",
    "load_record",
    "record_from_frames",
    "write_record",
]
