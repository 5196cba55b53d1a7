"""The quantities of files that people write: dimension and sign of each."""

from typing import Annotated

from pydantic import Field

from msl_fem.files.schema import In

Length = Annotated[float, In("m"), Field(gt=0)]
Coordinate = Annotated[float, In("m")]
Clearance = Annotated[float, In("m"), Field(ge=0)]
Mass = Annotated[float, In("kg"), Field(gt=0)]
Inertia = Annotated[float, In("kg m^2"), Field(gt=0)]
Stiffness = Annotated[float, In("N/m"), Field(ge=0)]
Damping = Annotated[float, In("N s/m"), Field(ge=0)]
Force = Annotated[float, In("N")]
SLOWEST = 1e-6
"""Hz: a period of eleven days."""
Frequency = Annotated[float, In("Hz"), Field(ge=SLOWEST)]
Voltage = Annotated[float, In("V"), Field(gt=0)]
Current = Annotated[float, In("A"), Field(gt=0)]
Resistance = Annotated[float, In("ohm"), Field(gt=0)]
PositionNoise = Annotated[float, In("m"), Field(ge=0)]
CurrentNoise = Annotated[float, In("A"), Field(ge=0)]
Turns = Annotated[int, Field(gt=0, le=1_000_000)]
Fraction = Annotated[float, Field(gt=0, le=1)]
