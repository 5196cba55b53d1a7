"""What instruments and stray flux do on the bench: as in the coupled model, by other equations, and all of it told."""

import numpy as np
import pytest
from bench_rigs import DRIVES, RATE, VOLTAGE_SERVO, excitations, noise_commands, plain_rig

from msl_fem.bench import BenchOptions, parse_nuisances, sealed_record
from msl_fem.bench.nuisances import NAMES, Nuisances, draw_nuisances, spoilt_columns, with_stray_flux
from msl_fem.bench.plant import Ladder
from msl_fem.bench.running import run_rig
from msl_fem.errors import InputError
from msl_fem.plant.effects import EffectValues
from msl_fem.plant.excitation import Inputs
from msl_fem.plant.layout import OUT_FLUX_1, OUT_I1, OUT_VOLTAGE_1, OUT_X, initial_state
from msl_fem.plant.simulate import integrate
from msl_fem.prediction import ModelHypothesis, fit_record, run_data
from msl_fem.prediction.hypothesis import kernel_plant
from msl_fem.record import Tolerance

STRAY = {"leakage_inductance_1": 0.03, "leakage_inductance_2": -0.02, "mutual_inductance": 0.04}


@pytest.mark.parametrize("drive", ["current", "voltage"])
def test_stray_flux_by_two_routes(drive: str) -> None:
    actuator, table = DRIVES[drive]
    commands = noise_commands(drive)[:1500] * np.minimum(np.arange(1500) / 200, 1)[:, None]
    run = run_rig(with_stray_flux(plain_rig(drive), actuator, table, Nuisances(STRAY)), commands, rate=RATE)
    plant = kernel_plant(ModelHypothesis(actuator, table, factors=STRAY), rate=RATE)
    state = initial_state(plant.parameters, 0.0, 0.0, 0.0, 0.0)
    out = integrate(plant.surface, plant.parameters, Inputs(commands, RATE), state=state, substeps=20)[1]
    plain = run_rig(plain_rig(drive), commands, rate=RATE)
    for name, column in (("current", OUT_I1), ("voltage", OUT_VOLTAGE_1)):
        other = out[:, column : column + 2]
        assert np.abs(getattr(run, name) - other).max() <= 2e-6 * np.abs(other).max(), name
    assert np.abs(run.position - out[:, OUT_X]).max() <= 2e-6 * np.abs(run.position).max()
    told = "current" if drive == "voltage" else "voltage"
    assert np.abs(getattr(run, told) - getattr(plain, told)).max() > 5e-3 * np.abs(getattr(plain, told)).max()
    linked = out[:, OUT_FLUX_1] - run.flux_linkage[:, 0]  # the bench's flux linkage is that of the table
    p = plant.parameters
    assert linked == pytest.approx(p.leakage_1 * run.current[:, 0] + p.mutual * run.current[:, 1], abs=1e-7)


def test_eddy_currents_follow_stray_flux_too_by_two_routes() -> None:
    """A ladder on the bench, modes in the model: what they change agrees within 1 % beside leakage of 10 %."""
    actuator, table = DRIVES["current"]
    stray = {"leakage_inductance_1": 0.1, "leakage_inductance_2": -0.1, "mutual_inductance": -0.05}
    commands = noise_commands("current")[:1500] * np.minimum(np.arange(1500) / 200, 1)[:, None]
    rig = with_stray_flux(plain_rig("current"), actuator, table, Nuisances(stray))
    eddies, diffusion = 2e-4, 2e-3
    plain, own = (ModelHypothesis(actuator, table, effects=values, factors=stray) for values in (None, EffectValues(
        {"eddy_currents": {"time_constant": eddies, "diffusion_time": diffusion}}
    )))  # fmt: skip
    inductance = kernel_plant(plain, rate=RATE).parameters.inductance
    with_ladder = rig.with_parts(ladder=Ladder(4, eddies / inductance, diffusion))
    first, second = (run_rig(one, commands, rate=RATE).voltage for one in (rig, with_ladder))
    routes = []
    for belief in (plain, own):
        plant = kernel_plant(belief, rate=RATE)
        state = initial_state(plant.parameters, 0.0, 0.0, 0.0, 0.0)
        how = {"state": state, "substeps": plant.substeps, "effects": plant.effects}
        out = integrate(plant.surface, plant.parameters, Inputs(commands, RATE), **how)[1]
        routes.append(out[:, OUT_VOLTAGE_1 : OUT_VOLTAGE_1 + 2])
    change = second - first
    assert np.abs(change).max() > 0.05 * np.abs(first).max()
    assert np.std(routes[1] - routes[0] - change, axis=0) == pytest.approx([0.0, 0.0], abs=0.01 * np.std(change))


def test_the_record_holds_what_instruments_write_and_the_answer_tells_it() -> None:
    def made(drive: str, **options: object):
        how = BenchOptions(seed=4, excitations=excitations(drive, duration=0.12), noise="none", **options)
        return sealed_record(*DRIVES[drive], (), how)

    for drive in ("voltage", "current"):
        plain, spoilt = (
            made(drive),
            made(drive, nuisances=(("current_gain", 2.0), ("position_zero", 1.0), ("command_zero", 1.0))),
        )
        told = draw_nuisances(
            (("current_gain", 2.0), ("position_zero", 1.0), ("command_zero", 1.0)), Tolerance(), seed=4
        )
        for one, two in zip(plain.record.runs, spoilt.record.runs, strict=True):
            again = spoilt_columns(dict(one.columns), told)
            for name, values in two.columns.items():
                assert values == pytest.approx(again[name], abs=1e-15), name
            assert np.ptp(two["position_m"] - one["position_m"]) < 1e-18
            assert abs(two["position_m"] - one["position_m"])[0] == pytest.approx(1e-6)
            assert two["current_2_A"] == pytest.approx(told.values["current_gain_2"] * one["current_2_A"])
        assert set(spoilt.answer["nuisances"]) == set(told.values)
        assert plain.answer["nuisances"] == {}


def test_what_rig_toml_states_may_be_wrong() -> None:
    how = BenchOptions(
        seed=4, excitations=excitations("voltage", duration=0.12), static=True, stated_noise=2.0, stated_hold="linear",
        stated_bandwidth=10e6, nuisances=(("static_gap_zero", 1.0), ("leakage_inductance", 1.0)),
    )  # fmt: skip
    record = sealed_record(*DRIVES["voltage"], (), how).record
    assert record.noise.current == 2 * VOLTAGE_SERVO.current_sensor.noise
    assert record.actuator.position_sensor.noise == 2 * VOLTAGE_SERVO.position_sensor.noise
    assert record.actuator.drive.bandwidth == 10e6
    assert record.sampling.hold == "linear"
    assert record.static.gap_zero == "gauge"
    usual = BenchOptions(seed=4, excitations=excitations("voltage", duration=0.12), static=True)
    assert sealed_record(*DRIVES["voltage"], (), usual).record.static.gap_zero == "mover"


def test_the_believed_model_finds_them_within_its_intervals() -> None:
    """All at one tolerance, on a rig that is off within its own: intervals hold, residuals are as the noise."""
    how = BenchOptions(
        seed=9, excitations=excitations("voltage", duration=0.6), noise="white", tolerance=Tolerance(table=0.0),
        nuisances=parse_nuisances(["all=1"]),
    )  # fmt: skip
    sealed = sealed_record(*DRIVES["voltage"], (), how)
    record = sealed.record
    belief, runs = ModelHypothesis(record.actuator, DRIVES["voltage"][1]), [run_data(record, record.runs[0])]
    fit = fit_record(belief, runs, record.tolerance)
    assert max(fit.excess.values()) < 1.05
    true = draw_nuisances(how.nuisances, how.tolerance, seed=9)
    for name, value in true.values.items():
        if name in fit.parameters:
            fitted = fit.parameters[name]
            assert abs(fitted.value - value) < 4 * (fitted.high - fitted.low) / 3.92, name
    without = fit_record(belief, runs, record.tolerance.model_copy(update=dict.fromkeys(NAMES, 0.0)))
    assert max(without.excess.values()) > 1.1


@pytest.mark.parametrize(
    ("text", "complaint"),
    [("all", "NAME=SIZE"), ("all=-1", "0 ... 10"), ("voltage=1", "'voltage' is unknown; there are all, position_zero"),
     ("all=x", "NAME=SIZE")],
)  # fmt: skip
def test_nuisances_that_are_none(text: str, complaint: str) -> None:
    with pytest.raises(InputError, match=complaint.replace("...", r"\.\.\.")):
        parse_nuisances([text])
    assert dict(parse_nuisances(["all=1", "voltage_gain=2"]))["voltage_gain"] == 2.0
