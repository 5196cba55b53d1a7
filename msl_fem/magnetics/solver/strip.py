"""Strips of air that stretch: how the linear regions' stiffness follows a gap, or a position between two gaps."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from scipy import sparse

from msl_fem.computing.arrays import Array

STRIP = "strip"


@dataclass(frozen=True)
class Strip:
    """A region whose height is offset + rate q, in m, q being the coordinate that a field is solved at.

    Of one magnet q is the gap; of two on either side of an armature it is the armature's position, which closes one
    strip as it opens the other.
    """

    region: str = STRIP
    offset: float = 0.0
    rate: float = 1.0

    def height(self, coordinate: float) -> float:
        return self.offset + self.rate * coordinate


@dataclass(frozen=True, eq=False)
class AirDepth:
    """How many times deeper than the iron the air is: its field energy at a given A is divided by that.

    Attributes
    ----------
    strip : gap (m) to the factor k of the strip, dk/dgap and d2k/dgap2
    regions : name of another linear region to its factor at points (2, ...) of the mesh; 1 where not named
    """

    strip: Callable[[float], tuple[float, float, float]] = lambda gap: (1.0, 0.0, 0.0)
    regions: Mapping[str, Callable[[Array], Array]] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class StripStiffness:
    """The stiffness S = (s X + Y/s)/k(h) of a strip of the height h = s times the mesh's, and its derivatives.

    Attributes
    ----------
    strip : which region it is, and its height
    mesh_height : in m
    x, y : (n_dof, n_dof) integrals of dA/dx dA'/dx and dA/dy dA'/dy over mu_0, at the mesh's height
    x_values, y_values : (nnz,) the same on the tangent's pattern
    """

    strip: Strip
    mesh_height: float
    x: sparse.csr_matrix
    y: sparse.csr_matrix
    x_values: Array
    y_values: Array

    def values(self, coordinate: float, depth: AirDepth) -> Array:
        """S on the tangent's pattern, (nnz,)."""
        height = self.strip.height(coordinate)
        s = height / self.mesh_height
        return (s * self.x_values + self.y_values / s) / depth.strip(height)[0]

    def product(self, potential: Array, coordinate: float, depth: AirDepth) -> Array:
        """S A, (n_dof,)."""
        height = self.strip.height(coordinate)
        s = height / self.mesh_height
        return (s * (self.x @ potential) + (self.y @ potential) / s) / depth.strip(height)[0]

    def slopes(self, potential: Array, coordinate: float, depth: AirDepth) -> tuple[Array, Array]:
        """First and second derivative of S A with respect to the coordinate, (n_dof,) each."""
        height = self.strip.height(coordinate)
        s = height / self.mesh_height
        x_product, y_product = self.x @ potential, self.y @ potential
        first = (x_product - y_product / s**2) / self.mesh_height
        second = 2 * y_product / s**3 / self.mesh_height**2
        k, slope, bend = depth.strip(height)
        if slope or bend:  # (S/k)' and (S/k)''
            product = s * x_product + y_product / s
            second = second - first * (2 * slope / k) + product * ((2 * slope**2 / k - bend) / k)
            first = first - product * (slope / k)
        rate = self.strip.rate
        return first * rate / k, second * rate**2 / k
