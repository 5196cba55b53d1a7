"""Force of both sides about a bias, as a biased controller believes it: by the pair's table and by one magnet's alone.

Each held position is solved anew with both sides at `fine`. Run: python benchmarks/pair_bias.py [--bias 3].
"""

import argparse
from pathlib import Path

import numpy as np

from msl_fem.actuator import load_actuator
from msl_fem.control.baselines import bias_point
from msl_fem.control.design_model import design_model_of
from msl_fem.magnetics.field.two_sided import TwoSidedField, TwoSidedPosition
from msl_fem.maps import operating_map
from msl_fem.plant.operating_point import net_force
from msl_fem.plant.plant import plant_parameters
from msl_fem.table.pair_table import load_table

ROOT = Path(__file__).parents[1]


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--bias", type=float, nargs="+", default=[2.0, 3.0])
    asked = parser.parse_args()
    actuator = load_actuator(ROOT / "geometries/fast_tool_servo.toml")
    plant = plant_parameters(actuator)
    pair = load_table(ROOT / "lookup_tables/fast_tool_servo_pair.nc")
    alone = load_table(ROOT / "lookup_tables/fast_tool_servo.nc")
    model = design_model_of(actuator, pair, operating_map(pair, levels=(1.2, 1.6)))
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
