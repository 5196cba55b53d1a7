"""The virtual bench: simulated records of a rig with undisclosed true parameters and perhaps a hidden effect.

Its equations are its own, finer than those of the models that are to find out, and known to the command line and to
tests alone. Of the coupled model it uses the excitations and nothing else.
"""

from msl_fem.bench.catalogue import INSIDE, OUTSIDE_BY_NAME, parse_requests
from msl_fem.bench.nuisances import parse_nuisances
from msl_fem.bench.sealed import BenchOptions, ClosedLoop, SealedRecord, sealed_record, usual_excitations, usual_unit

__all__ = [
    "INSIDE",
    "OUTSIDE_BY_NAME",
    "BenchOptions",
    "ClosedLoop",
    "SealedRecord",
    "parse_nuisances",
    "parse_requests",
    "sealed_record",
    "usual_excitations",
    "usual_unit",
]
