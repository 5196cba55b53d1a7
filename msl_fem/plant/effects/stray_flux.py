"""Effects of flux that pulls nothing, and of flux that stays: leakage, mutual inductance, remanence."""

from msl_fem.computing.arrays import Array
from msl_fem.computing.lanes import RowLayout
from msl_fem.plant.effects import magnetic
from msl_fem.plant.effects.entry import NO_MAGNETS, Effect, KernelSetting, Parameter, Part, Values, bending_current
from msl_fem.plant.effects.mechanisms import NEVER

LAYOUT = RowLayout(after=magnetic.LAYOUT)
LEAKAGE_1, LEAKAGE_2 = LAYOUT.rows(2)  # leakage inductance of the sides, H
LEAKAGE_BENDS = LAYOUT.row()  # with the square of the current, A^-2
MUTUAL_INDUCTANCE = LAYOUT.row()  # of both sides, H
REMANENT_1, REMANENT_2 = LAYOUT.rows(2)  # current that would make the sides' remanent flux, A
REMANENCE_FADES = LAYOUT.row()  # with the square of the flux linkage, Wb^-2
HALVED = 2.0 ** (2.0 / 3.0) - 1.0  # of (1 + z)^(-3/2) = 1/2


def _leakage(e: Array, v: Values, setting: KernelSetting) -> None:
    e[LEAKAGE_1] = setting.inductance * v["leakage_inductance", "share_1"]
    e[LEAKAGE_2] = setting.inductance * v["leakage_inductance", "share_2"]
    halving = v["leakage_inductance", "halving_current"]
    e[LEAKAGE_BENDS] = HALVED / (halving * halving) if halving < NEVER else 0.0


def _mutual(e: Array, v: Values, setting: KernelSetting) -> None:
    e[MUTUAL_INDUCTANCE] = setting.inductance * v["mutual_inductance", "share"] if setting.plant.sides == 2 else 0.0


def _remanence(e: Array, v: Values, setting: KernelSetting) -> None:
    e[REMANENT_1], e[REMANENT_2] = v["remanent_flux", "current_1"], v["remanent_flux", "current_2"]
    halving = v["remanent_flux", "halving_current"]
    flux = setting.inductance * halving
    e[REMANENCE_FADES] = 1.0 / (flux * flux) if halving < NEVER else 0.0


STRAY_FLUX = (
    Effect(
        name="leakage_inductance",
        group="magnetic",
        sentence="flux that links a coil and pulls nothing: end turns, stray iron, the air around",
        equation=(
            "lambda_j = Lambda_j + share_j L_0 u_j/sqrt(1 + 0.587 (u_j/halving_current)^2), L_0 the inductance of a "
            "side at the nominal gap; no force: a path through air, or through iron that saturates"
        ),
        source="Roters, Electromagnetic Devices, 1941, ch. 5 (leakage permeances)",
        parameters=(
            Parameter("share_1", "", 0.0, (-0.5, 2.0), 0.01, "side 1's leakage inductance over L_0"),
            Parameter("share_2", "", 0.0, (-0.5, 2.0), 0.01, "side 2's leakage inductance over L_0"),
            bending_current(
                "halving_current", "at which the iron on its path leaves half of its inductance", 30.0, optional=True
            ),
        ),
        needs=("magnets",),
        coefficients=_leakage,
        design=Part(declined="it makes no force; the drive's current loop gives the voltage that it takes"),
        inverse=NO_MAGNETS,
        static=Part(("share_1",), "the magnet of a static map stands as side 1's"),
        advice="look for iron beside the coils; make the table with end effects; measure the coil in free air",
        sets=(("share_1", "share_2"), ("share_1",), ("share_2",)),
        separating="the flux linkage at twice the largest gap, where the working flux is small and leakage is not",
    ),
    Effect(
        name="mutual_inductance",
        group="magnetic",
        sentence="a side's flux links the coils of the other side, through the armature they share",
        equation="lambda_1 = Lambda_1 + share L_0 u_2, lambda_2 = Lambda_2 + share L_0 u_1; no force",
        source="Woodson, Melcher, Electromechanical Dynamics I, 1968, ch. 3; the two-sided field, docs/decoupling.md",
        parameters=(Parameter("share", "", 0.0, (-0.5, 0.5), 0.01, "mutual inductance over L_0"),),
        needs=("magnets", "two sides"),
        coefficients=_mutual,
        design=Part(declined="it makes no force; the drive's current loop gives the voltage that it takes"),
        inverse=NO_MAGNETS,
        static=Part(declined="it takes two sides, a static map is of one magnet"),
        advice="solve both sides together (solve --current-2) and hold what follows against this; --polarity aiding",
        one_form=True,
    ),
    Effect(
        name="remanent_flux",
        group="magnetic",
        sentence="the iron keeps flux when the current has gone",
        equation=(
            "u_j = i_j + current_j/(1 + (lambda_j/lambda_h)^2), lambda_h = L_0 halving_current: the coercive force of "
            "the iron's recoil line, which bends, times its length, in amperes"
        ),
        source="Bozorth, Ferromagnetism, 1951, ch. 9; Furlani, Permanent Magnet and Electromechanical Devices, 2001",
        parameters=(
            Parameter("current_1", "A", 0.0, (-5.0, 5.0), 0.02, "that would make side 1's", of=(("current", 1),)),
            Parameter("current_2", "A", 0.0, (-5.0, 5.0), 0.02, "that would make side 2's", of=(("current", 1),)),
            bending_current("halving_current", "at whose flux, at the nominal gap, half of it is left", 10.0),
        ),
        needs=("magnets", "drive lag"),
        coefficients=_remanence,
        design=Part(declined="the controller's integrator makes up for a constant current"),
        inverse=NO_MAGNETS,
        static=Part(("current_1",), "the magnet of a static map stands as side 1's"),
        advice="demagnetise with an alternating current that dies away; measure force or flux without current",
        sets=(("current_1", "current_2"), ("current_1",), ("current_2",)),
        separating="force or flux without current, and one row with the current reversed",
        deviation_of={"magnetic_hysteresis": 0.01, "early_saturation": 0.05},
    ),
)
