"""Force of both sides about a bias, as a biased controller believes it: by the pair's table and by one magnet's alone.

Each held position is solved anew with both sides at `fine`. Run: python benchmarks/pair_bias.py [--bias 3]. With
--overlap 10 30 60 (N): what the exact inverse, which takes the sides apart, gets wrong by the pair's table while both
pull.
"""

import argparse
from pathlib import Path

import numpy as np

from msl_fem.actuator import load_actuator
from msl_fem.control.baselines import bias_point
from msl_fem.control.design_model import DesignModel, design_model_of
from msl_fem.control.inverse import hand_over, magnet_current, magnet_current_limit
from msl_fem.magnetics.field.two_sided import TwoSidedField, TwoSidedPosition
from msl_fem.maps import operating_map
from msl_fem.plant.operating_point import net_force
from msl_fem.plant.plant import plant_parameters
from msl_fem.table.magnetic_table import MagneticTable
from msl_fem.table.pair_table import load_table

ROOT = Path(__file__).parents[1]


def worst_of_hand_over(model: DesignModel, pair: MagneticTable, overlap: float) -> str:
    """The largest error of the force over positions to 0.4 mm and forces to 120 N, in both polarities."""
    assert pair.shared is not None
    plant, inverse = plant_parameters(model.actuator), model.inverse
    worst = {}
    for polarity in (-1.0, 1.0):
        errors = [0.0]
        for x in np.linspace(-0.4e-3, 0.4e-3, 9):
            for force in np.linspace(-120, 120, 25):
                gaps = plant.nominal_gap - x, plant.nominal_gap + x
                most = [magnet_current_limit(inverse, gap) for gap in gaps]
                pulls = [pull / plant.magnets for pull in hand_over(float(force), overlap)]
                both = zip(pulls, gaps, most, strict=True)
                one, two = (magnet_current(inverse.surface_1, *each) for each in both)
                if np.isfinite(one + two):
                    errors.append(plant.magnets * float(pair.shared.evaluate(x, one, polarity * two)["x"]))
        worst["aiding" if polarity > 0 else "opposing"] = max(errors, key=abs)
    return ", ".join(f"{error:+.3f} N {name}" for name, error in worst.items())


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--bias", type=float, nargs="+", default=[2.0, 3.0])
    parser.add_argument("--overlap", type=float, nargs="+", default=[])
    asked = parser.parse_args()
    actuator = load_actuator(ROOT / "geometries/fast_tool_servo.toml")
    plant = plant_parameters(actuator)
    pair = load_table(ROOT / "lookup_tables/fast_tool_servo_pair.nc")
    alone = load_table(ROOT / "lookup_tables/fast_tool_servo.nc")
    model = design_model_of(actuator, pair, operating_map(pair, levels=(1.2, 1.6)))
    for overlap in asked.overlap:
        print(f"overlap of {overlap:g} N: {worst_of_hand_over(model, pair, overlap)}", flush=True)
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
