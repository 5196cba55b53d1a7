"""Force of both sides about a bias, as a biased controller believes it: by the pair's table and by one magnet's alone.

Each held position is solved anew with both sides at `fine`. Run: python benchmarks/pair_bias.py [--bias 3]. With
--overlap 10 30 60 (N): what the exact inverse gets wrong by the pair's table while both pull, the sides taken apart and
with what they share.
"""

import argparse
from pathlib import Path

import numpy as np

from msl_fem.actuator import load_actuator
from msl_fem.control.baselines import bias_point
from msl_fem.control.design_model import DesignModel, design_model_of
from msl_fem.control.inverse import magnet_current_limit, magnet_currents
from msl_fem.control.lqr_design import stage_with_overlap
from msl_fem.control.shared_force import NOTHING_SHARED, shared_force_at
from msl_fem.magnetics.field.two_sided import TwoSidedField
from msl_fem.magnetics.field.two_sided_section import TwoSidedPosition
from msl_fem.maps import operating_map
from msl_fem.maps.pair_limits import RELATIONS
from msl_fem.plant.operating_point import net_force
from msl_fem.plant.plant import plant_parameters
from msl_fem.table.pair_table import load_table

ROOT = Path(__file__).parents[1]


def worst_of_hand_over(model: DesignModel, overlap: float) -> str:
    """The largest errors of the force to 120 N over the positions, the sides apart and with what they share."""
    both, inverse, polarity = model.shared, model.inverse, model.coupled.polarity
    assert both is not None
    stage, worst = stage_with_overlap(model, overlap), []
    for shared in (NOTHING_SHARED, stage.shared):
        errors = [0.0]
        for x in np.linspace(-0.39e-3, 0.39e-3, 9):
            for force in np.linspace(-120, 120, 25):
                known = shared_force_at(shared, x, force)
                one, two = magnet_currents(inverse, force - known, x, overlap)
                if max(one, two) < magnet_current_limit(inverse, model.coupled.nominal_gap + abs(x)):
                    found = inverse.magnets * float(both.evaluate(x, one, polarity * two)["x"])
                    errors.append(found - known)
        worst.append(max(errors, key=abs))
    return f"{worst[0]:+.3f} N apart, {worst[1]:+.4f} N by the pair"


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--bias", type=float, nargs="+", default=[2.0, 3.0])
    parser.add_argument("--overlap", type=float, nargs="+", default=[])
    asked = parser.parse_args()
    actuator = load_actuator(ROOT / "geometries/fast_tool_servo.toml")
    plant = plant_parameters(actuator)
    pair = load_table(ROOT / "lookup_tables/fast_tool_servo_pair.nc")
    alone = load_table(ROOT / "lookup_tables/fast_tool_servo.nc")
    model_map = operating_map(pair, levels=(1.2, 1.6))
    model = design_model_of(actuator, pair, model_map)
    for overlap in asked.overlap:
        for polarity in RELATIONS:
            assert actuator.sides is not None
            sides = actuator.sides.model_copy(update={"polarity": polarity})
            other = design_model_of(actuator.model_copy(update={"sides": sides}), pair, model_map)
            print(f"overlap of {overlap:g} N, {polarity}: {worst_of_hand_over(other, overlap)}", flush=True)
    if asked.overlap:
        return
    print("bias A | x mm | control A | force N | error by the pair, one magnet: N, % of the spring's force")
    for bias in asked.bias:
        for x in np.linspace(0.05e-3, 0.4e-3, 8):
            point = bias_point(model, bias, float(x))
            if point is None:
                print(f"{bias:.2f} | {x * 1e3:.2f} | not held")
                continue
            currents = bias + point.control, bias - point.control
            if min(currents) < 0:
                continue
            place = TwoSidedPosition(plant.nominal_gap - x, plant.nominal_gap + x)
            field = TwoSidedField(actuator, place, accuracy="fine")
            truth = plant.magnets * field.solve(currents[0], plant.polarity * currents[1])[0].net_force
            spring = plant.stiffness * x
            believed = [
                float(net_force(plant, table, currents=currents, position=np.array(x))[0]) + spring
                for table in (pair, alone)
            ]
            errors = [f"{force - truth:+.4f} N, {100 * (force - truth) / spring:+.3f} %" for force in believed]
            print(f"{bias:.2f} | {x * 1e3:.2f} | {point.control:.4f} | {truth:.3f} | {' | '.join(errors)}", flush=True)


if __name__ == "__main__":
    main()
