"""Whether a flexure does what the actuator needs: stiffness, hardening, stress at full range, modes."""

import math
from dataclasses import dataclass

from msl_fem.actuator import GUIDED_MASS_SHARE, Actuator, Flexure, Motion
from msl_fem.errors import ActuatorError
from msl_fem.mechanics.flexure_beam import LeafBeam, Mode, Mover, PlaneMode, mover_modes, plane_modes


@dataclass(frozen=True)
class FullRange:
    """All leaves at the end of the range.

    Attributes
    ----------
    force_linear, force_cubic, force_exact, force_beam : N; k x, k x + k_3 x^3, the stretched beam in closed form, and
        by finite elements
    stress_bending, stress_membrane, stress_beam : Pa; closed forms at small displacements, and the beam's largest
    """

    range: float
    force_linear: float
    force_cubic: float
    force_exact: float
    force_beam: float
    stress_bending: float
    stress_membrane: float
    stress_beam: float

    @property
    def stress(self) -> float:
        """The larger of the closed forms' sum and the beam's, in Pa."""
        return max(self.stress_bending + self.stress_membrane, self.stress_beam)


@dataclass(frozen=True)
class SetModes:
    """Modes with the leaves in so many sets: the rigid mover's six, those in the plane with the leaves' own."""

    sets: int
    rigid: tuple[Mode, ...]
    plane: tuple[PlaneMode, ...]

    @property
    def above_first(self) -> tuple[float, ...]:
        """Hz, by which the second and third of the mover's modes lie above the lowest of all."""
        first = self.rigid[0].frequency
        return tuple(mode.frequency - first for mode in self.rigid[1:3])


@dataclass(frozen=True)
class SuspensionReport:
    """What a flexure does; SI units.

    Attributes
    ----------
    stiffness, stiffness_beam : of all leaves, closed form and finite elements; `stiffness_used` is the actuator's
    cubic_stiffness : N/m3, 0 where leaves may shorten
    first_mode : Hz, of moving mass and 13/35 of the leaves on `stiffness_used`
    leaf_mode : Hz, of a leaf between its clamps
    bandwidth : Hz wanted, None where none is
    """

    flexure: Flexure
    stiffness: float
    stiffness_beam: float
    stiffness_used: float
    cubic_stiffness: float
    full_range: FullRange | None
    first_mode: float
    leaf_mode: float
    modes: tuple[SetModes, ...]
    bandwidth: float | None
    notes: tuple[str, ...]

    @property
    def allowed_stress(self) -> float:
        return self.flexure.leaf.material.allowed_stress

    @property
    def stress_ok(self) -> bool | None:
        """Whether the stress at full range is allowed; None where no range is stated."""
        return None if self.full_range is None else self.full_range.stress <= self.allowed_stress

    @property
    def first_mode_ok(self) -> bool | None:
        """Whether the first mode lies above the wanted bandwidth; None where none is stated."""
        return None if self.bandwidth is None else self.first_mode > self.bandwidth


def assess_flexure(actuator: Actuator, *, bandwidth: float | None = None) -> SuspensionReport:
    """The report on an actuator's flexure.

    Parameters
    ----------
    bandwidth : Hz, above which the first mode is wanted (Gutierrez and Ro 1998)

    Raises
    ------
    ActuatorError : no [motion.flexure]
    InputError : a range beyond a tenth of the leaf's length
    """
    motion = actuator.motion
    if motion is None or motion.flexure is None:
        raise ActuatorError(f"{actuator.name} has no [motion.flexure]; state its leaves to have them judged")
    flexure = motion.flexure
    leaf = flexure.leaf
    moving = motion.moving_mass + GUIDED_MASS_SHARE * flexure.leaves * leaf.mass
    modes, notes = _modes(flexure, motion)
    return SuspensionReport(
        flexure=flexure,
        stiffness=flexure.stiffness,
        stiffness_beam=flexure.leaves * float(LeafBeam(leaf).tip_stiffness()[0, 0]),
        stiffness_used=motion.stiffness,
        cubic_stiffness=flexure.cubic_stiffness,
        full_range=None if motion.range is None else _full_range(flexure, motion.range),
        first_mode=math.sqrt(motion.stiffness / moving) / (2 * math.pi),
        leaf_mode=leaf.first_frequency,
        modes=modes,
        bandwidth=bandwidth,
        notes=(*motion.notes, *notes),
    )


def _full_range(flexure: Flexure, x: float) -> FullRange:
    leaf, n = flexure.leaf, flexure.leaves
    opposed = flexure.arrangement == "opposed"
    leaf.check_displacement(x)
    beam = LeafBeam(leaf).deflect(x, held_apart=opposed)
    linear = leaf.stiffness * x
    return FullRange(
        range=x,
        force_linear=n * linear,
        force_cubic=n * linear + flexure.cubic_stiffness * x**3,
        force_exact=n * (leaf.held_force(x) if opposed else linear),
        force_beam=n * beam.force,
        stress_bending=leaf.bending_stress(x),
        stress_membrane=leaf.membrane_stress(x) if opposed else 0.0,
        stress_beam=beam.stress,
    )


def _modes(flexure: Flexure, motion: Motion) -> tuple[tuple[SetModes, ...], tuple[str, ...]]:
    """The modes of the same leaves in one set and in two, and why one of them is missing."""
    mover = Mover(motion.moving_mass, flexure.roll_inertia, flexure.yaw_inertia, flexure.pitch_inertia)
    missing = [f"{axis}_inertia" for axis in ("roll", "yaw", "pitch") if getattr(flexure, f"{axis}_inertia") is None]
    notes = [f"motion.flexure.{name} is not stated: that rotation is taken as held" for name in missing]
    modes = []
    for sets in (1, 2):
        try:
            places = flexure.placements(sets)
        except ActuatorError as err:
            notes.append(f"no modes with {sets} set(s): {err}")
            continue
        plane: tuple[PlaneMode, ...] = ()
        if flexure.pitch_inertia is not None:
            plane = plane_modes(flexure.leaf, places, mass=motion.moving_mass, inertia=flexure.pitch_inertia)
        modes.append(SetModes(sets, mover_modes(flexure.leaf, places, mover), plane[:8]))
    return tuple(modes), tuple(notes)
