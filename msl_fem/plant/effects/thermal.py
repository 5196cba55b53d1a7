"""What a coil's temperature at the start of a run follows from: the operation before it."""

from msl_fem.computing.arrays import Array
from msl_fem.computing.lanes import RowLayout
from msl_fem.plant.effects import expressions
from msl_fem.plant.effects.entry import NO_MAGNETS, NOT_AT_REST, Effect, KernelSetting, Parameter, Part, Values

LAYOUT = RowLayout(after=expressions.LAYOUT)
RISE_1, RISE_2 = LAYOUT.rows(2)  # of the sides' resistance when the run begins, relative
CORE_RISE = LAYOUT.row()  # towards which the coils go at first


def _history(e: Array, v: Values, setting: KernelSetting) -> None:
    e[RISE_1], e[RISE_2] = v["thermal_history", "rise_1"], v["thermal_history", "rise_2"]
    e[CORE_RISE] = v["thermal_history", "core_rise"]


THERMAL = (
    Effect(
        name="thermal_history",
        group="electrical",
        sentence="the coils begin warm from what was done before, and settle towards the core",
        equation=(
            "rho_j(0) = rise_j, kappa_j(0) = core_rise, rho_j' = -settling_rate (rho_j - kappa_j), "
            "kappa_j' = core_rate (rho_j - kappa_j); beside coil_heating both rates are means by the amounts"
        ),
        source="Boglietti et al., IEEE Trans. Ind. Electron. 56(3), 2009, 871-882 (lumped capacities)",
        parameters=(
            Parameter("rise_1", "", 0.0, (-0.3, 1.0), 0.01, "of side 1's resistance when the run begins, relative"),
            Parameter("rise_2", "", 0.0, (-0.3, 1.0), 0.01, "of side 2's resistance when the run begins, relative"),
            Parameter("core_rise", "", 0.0, (-0.3, 1.0), 0.01, "of the resistance of a coil as warm as the core is"),
            Parameter(
                "settling_rate",
                "s^-1",
                0.1,
                (1e-4, 10.0),
                0.1,
                "one over the coil's time constant",
                shape=True,
                tried=(0.2, 1.5),
                width=1.5,
            ),
            Parameter(
                "core_rate",
                "s^-1",
                0.01,
                (1e-6, 10.0),
                0.01,
                "at which the core follows the coil",
                shape=True,
                tried=(0.03,),
                width=1.5,
            ),
        ),
        needs=("magnets",),
        coefficients=_history,
        design=Part(declined="the drive's current loop makes up for a resistance that changes"),
        inverse=NO_MAGNETS,
        static=NOT_AT_REST,
        advice="measure the coils' resistance before and after a run; wait until they are as warm as the core",
        sets=(("rise_1", "rise_2"), ("rise_1", "rise_2", "core_rise"), ("rise_1",)),
        one_form=True,
    ),
)
