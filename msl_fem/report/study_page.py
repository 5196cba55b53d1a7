"""The study's report: what each stage found, in one sentence, a figure and the numbers beside it."""

import datetime
import platform
from importlib.metadata import version
from typing import Any

import numpy as np

from msl_fem.control import ClosedLoopRun
from msl_fem.files.quantity import format_quantity
from msl_fem.identification import sampled_run, simulate_armax
from msl_fem.report.design_stages import magnet_stages, operation_stages
from msl_fem.report.explorer import explorer
from msl_fem.report.field_picture import field_plot
from msl_fem.report.figures import (
    force_over_current,
    predicted_position,
)
from msl_fem.report.page import Page, Stage
from msl_fem.report.page_words import fit_text, millimetres, percent, round_values, words
from msl_fem.report.study_loop import loop_stages, response_stage
from msl_fem.report.unseen_stage import unseen_stage
from msl_fem.study import Study

Numbers = tuple[tuple[str, str], ...]


def headline_numbers(study: Study) -> dict[str, Any]:
    """The study's headline numbers by stage, as its JSON carries them."""
    sweep, point = study.field.report, study.field.point
    fits = {fit.run: fit for fit in study.identification.fits}
    loop = study.loop
    made = study.operating_map
    nominal = _nominal_gap(study)
    return {
        "field": {
            "points": sweep.points,
            "mesh_error": sweep.mesh_error,
            "interpolation_error": sweep.interpolation_error,
            "reciprocity_error": sweep.reciprocity_error,
            "force_N": point.quantities.force,
            "force_stress_tensor_N": point.quantities.force_stress_tensor,
        }
        | _polarity_numbers(study),
        "map_at_nominal_gap_A": {
            f"{level:g} T": float(np.interp(nominal, made.gap, row))
            for level, row in zip(made.levels, made.current, strict=True)
        },
        "coupled_model": {
            "stability_limit_A": study.model.stability_limit,
            "natural_frequency_Hz": study.model.linearisation.natural_frequency,
            "position_rms_m": {
                "noise": float(np.std(study.model.noise.position)),
                "swept_sine": float(np.std(study.model.sweep.position)),
            },
        },
        "armax": {name: {"one_step": fit.one_step, "free_run": fit.free_run} for name, fit in fits.items()},
        "closed_loop": {name: _loop_numbers(run) for name, run in loop.runs.items()}
        | {
            "bandwidth_Hz": loop.response.bandwidth,
            "flat_band_Hz": loop.response.flat_band,
            "peak_sensitivity": loop.design.peak_sensitivity,
            "unseen_plants": loop.unseen.to_json(),
        },
        "guard_violations": sum(run.guard_violations for run in loop.runs.values()),
    }


def _loop_numbers(run: ClosedLoopRun) -> dict[str, Any]:
    return {
        "tracking_rms_m": run.tracking_rms,
        "peak_current_A": run.peak_current,
        "copper_loss_W": run.copper_loss,
        "guard_violations": run.guard_violations,
        "guard_regions": run.region_counts,
    }


def study_page(study: Study) -> Page:
    """The report of a study."""
    fit = {f.run: f for f in study.identification.fits}["swept_sine"]
    sine, violations = study.loop.runs["sine"], headline_numbers(study)["guard_violations"]
    first = study.operating_map.levels[0]
    nominal = _nominal_gap(study)
    preferred = float(np.interp(nominal, study.operating_map.gap, study.operating_map.current[0]))
    headline = (
        (f"{preferred:.3g} A", f"brings {first:g} T at the nominal gap of {millimetres(nominal)}"),
        (percent(whole_force_error(study)), _error_label(study)),
        (fit_text(fit.free_run), "ARMAX free-run fit, held-out swept sine"),
        (format_quantity(sine.tracking_rms, "m", digits=3), "RMS tracking error, 2 Hz sine"),
        (str(violations), "guard violations in the closed-loop runs below"),
        (f"{study.loop.unseen.held} of {study.loop.unseen.error.size}", "plants held that the design has not seen"),
    )
    stages = (
        *magnet_stages(study.actuator),
        _field(study),
        _table(study),
        _map(study),
        *operation_stages(study.actuator, study.field.table),
        _model(study),
        *loop_stages(study),
        response_stage(study),
        unseen_stage(study.loop.unseen),
    )
    notes = (
        *study.field.report.notes,
        *study.operating_map.warnings,
        *study.identification.model.notes,
        *study.loop.notes,
    )
    return Page(
        f"{study.actuator.name}: from section to closed loop",
        "Finite elements, force and flux tables, operating map, coupled model, identification and guarded control; "
        "figures are counterparts of those of Gutierrez and Ro, IEEE Trans. Magnetics 34(5), 1998.",
        headline,
        stages,
        _provenance(study),
        notes,
    )


def _polarity_numbers(study: Study) -> dict[str, Any]:
    costs = {name: apart.force_error for name, apart in study.field.polarity.items()}
    return {"force_error_of_sides_apart": costs} if costs else {}


def _polarity_sentence(study: Study) -> str:
    """What both polarities cost on this armature, and which one the actuator states."""
    costs, sides = study.field.polarity, study.actuator.sides
    if not costs or sides is None:
        return ""
    level = study.operating_map.levels[0]
    return (
        f" With both sides on, each at the current that brings {level:g} T, half the range off the middle, two magnets "
        f"taken apart give {percent(abs(costs['opposing'].force_error))} too much or too little force where their "
        f"fluxes oppose and add up in the armature, {percent(abs(costs['aiding'].force_error))} where they aid; the "
        f"actuator states {sides.polarity}."
    )


def _field(study: Study) -> Stage:
    point = study.field.point
    q = point.quantities
    at = f"{point.current:.3g} A and a gap of {millimetres(point.gap)}"
    loaded = max(q.flux_density, key=lambda name: q.flux_density[name].mean)
    sentence = (
        f"At {at} the most loaded section is the {words(loaded)} with {q.flux_density[loaded].mean:.3f} T "
        "in the iron; "
        f"each magnet pulls with {q.force:.1f} N, and virtual work and stress tensor agree to "
        f"{percent(abs(q.force_stress_tensor / q.force - 1))}."
        f"{_polarity_sentence(study)}"
    )
    numbers = (
        ("force, virtual work", f"{q.force:.2f} N"),
        ("force, stress tensor", f"{q.force_stress_tensor:.2f} N"),
        ("force error estimate", percent(point.force_error_estimate)),
        ("flux linkage", f"{q.flux_linkage * 1e3:.3f} mWb"),
        ("incremental inductance", f"{q.incremental_inductance * 1e3:.3f} mH"),
        *((f"{words(name)}, mean in the iron", f"{b.mean:.3f} T") for name, b in q.flux_density.items()),
        ("unknowns", f"{point.unknowns}"),
        ("Newton steps", f"{point.newton_iterations}"),
    )
    plot = field_plot(study.field.field, study.field.solution)
    return Stage("The field", sentence, numbers, plot=plot)


def _table(study: Study) -> Stage:
    table, report = study.field.table, study.field.report
    gaps = round_values(float(table.gap[0]), float(table.gap[-1]))
    top = float(table.force(table.current[-1], table.gap[0]))
    sentence = (
        f"The force rises with the square of the current until the iron saturates, up to {top:.0f} N a magnet at "
        f"{millimetres(float(table.gap[0]))}; between the {report.points} solved points it is the "
        "derivative of "
        "one smooth coenergy surface. It follows the fields to "
        f"{percent(table_force_error(study))} of the largest force: "
        f"{percent(report.mesh_error)} from the mesh and {percent(report.interpolation_error)} from interpolation."
        f"{_of_the_ends(study)}"
    )
    numbers = (
        ("gaps", f"{table.gap[0] * 1e3:.3g} ... {table.gap[-1] * 1e3:.3g} mm ({table.gap.size})"),
        ("currents", f"0 ... {table.current[-1]:.3g} A ({table.current.size})"),
        ("error of the table, all together", percent(whole_force_error(study))),
        ("of it, mesh", percent(report.mesh_error)),
        ("of it, interpolation", percent(report.interpolation_error)),
        ("of it, what is not known of the stack's ends", percent(ends_force_error(study))),
        ("reciprocity error", percent(report.reciprocity_error)),
        ("unknowns", f"{report.unknowns}"),
        ("CPU seconds", f"{report.cpu_seconds:.1f}"),
    )
    return Stage("Force over current and gap", sentence, numbers, plot=force_over_current(table, gaps=gaps))


def _map(study: Study) -> Stage:
    made = study.operating_map
    nominal = _nominal_gap(study)
    at = [float(np.interp(nominal, made.gap, row)) for row in made.current]
    reached = [not np.isnan(i) for i in at]
    levels = " and ".join(
        f"{level:g} T at {i:.2f} A" for level, i, ok in zip(made.levels, at, reached, strict=True) if ok
    )
    sentence = (
        f"At the nominal gap the iron reaches {levels or 'no level'}; below the first curve commands are preferred, "
        f"between the curves discouraged, above the last unacceptable. The criterion is the {made.criterion} flux "
        "density in the iron of the most loaded section."
    )
    numbers = (
        *((f"{level:g} T at nominal gap", f"{i:.3f} A") for level, i in zip(made.levels, at, strict=True)),
        ("loading section", ", ".join(dict.fromkeys(words(s) for row in made.section for s in row))),
        ("largest error of a current", f"{np.nanmax(made.error) * 1e3:.2g} mA"),
        *(
            (f"{made.levels[k]:g} T not reached from", millimetres(float(made.gap[m])))
            for k, m in _missed(made.current)
        ),
    )
    table, point = study.field.table, study.field.point
    start = (min(0.75 * point.current, float(table.current[-1])), point.gap)
    sides = study.actuator.sides
    widget = explorer(table, made, start=start, magnets=sides.magnets_per_side if sides else 1)
    return Stage("Operating regions (Fig. 2 of the paper)", sentence, numbers, widget=widget)


def _missed(current: np.ndarray) -> list[tuple[int, int]]:
    """(level, first gap) of each level that is not reached everywhere."""
    return [(k, int(np.argmax(np.isnan(row)))) for k, row in enumerate(current) if np.isnan(row).any()]


def _model(study: Study) -> Stage:
    record, model = study.model.record, study.identification.model
    run = record.run("swept_sine")
    free = simulate_armax(model, sampled_run(record, run))
    fits = {f.run: f for f in study.identification.fits}
    held = fits["swept_sine"]
    noise = study.actuator.position_sensor.noise
    sentence = (
        f"ARMAX with the inputs {', '.join(model.input_names)}, identified on band-limited noise, "
        "reproduces the held-out "
        f"swept sine in free run to {fit_text(held.free_run)} (one step ahead to {fit_text(held.one_step)}); "
        "one-step errors of "
        f"{format_quantity(model.noise_variance**0.5, 'm', digits=3)} stand against "
        f"{format_quantity(noise, 'm')} of sensor "
        "noise. Nothing here is measured: the record is simulated with the coupled model and its sensors' noise."
    )
    delta = model.rational.delta if model.rational else 0.0
    numbers = (
        ("free-run fit, swept sine (held out)", fit_text(held.free_run)),
        ("one-step fit, swept sine", fit_text(held.one_step)),
        ("free-run fit, noise (fitted)", fit_text(fits["noise"].free_run)),
        ("one-step fit, noise", fit_text(fits["noise"].one_step)),
        ("gap offset delta", format_quantity(delta, "m", digits=3)),
        ("bias of both sides", f"{study.model.bias:.2f} A"),
        ("open loop stable up to", f"{study.model.stability_limit:.2f} A"),
        ("natural frequency at bias", f"{study.model.linearisation.natural_frequency:.1f} Hz"),
        ("converged", "yes" if model.convergence.converged else "no"),
    )
    origin = "simulated" if record.origin == "simulated" else "measured"
    plot = predicted_position(run.time, run["position_m"], free.output, origin=origin)
    return Stage(f"{origin.capitalize()} against predicted position (Fig. 5)", sentence, numbers, plot=plot)


def _provenance(study: Study) -> Numbers:
    table = study.field.table.provenance
    iron = table.get("iron", {})
    seconds = ", ".join(f"{name} {value:.1f}" for name, value in study.seconds.items())
    return (
        ("actuator", f"{study.actuator.name}, SHA-256 {study.actuator.digest[:16]}"),
        *((f"iron of the {region}", str(text)) for region, text in iron.items()),
        ("excitations", "; ".join(study.model.excitations)),
        ("references", "; ".join(study.loop.references.values())),
        ("seconds by stage", seconds),
        ("versions", f"msl_fem {version('msl-fem')}, Python {platform.python_version()}"),
        ("date", datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d %H:%M UTC")),
    )


def table_force_error(study: Study) -> float:
    """Bound of the table's force, of its largest force: that of the mesh and that of interpolation together."""
    return study.field.report.mesh_error + study.field.report.interpolation_error


def whole_force_error(study: Study) -> float:
    """That bound with what is left of the stack's ends."""
    return table_force_error(study) + ends_force_error(study)


def ends_force_error(study: Study) -> float:
    """Relative: what is left of the stack's ends in the force, where they are corrected; else 0."""
    return float(study.field.table.provenance.get("end_effects_error", {}).get("force", 0.0))


def _error_label(study: Study) -> str:
    return f"error of the force table{', its ends included' if ends_force_error(study) else ', of its largest force'}"


def _of_the_ends(study: Study) -> str:
    ends = ends_force_error(study)
    return f" The fields themselves know the flux at the stack's ends to {percent(ends)} of the force." if ends else ""


def _nominal_gap(study: Study) -> float:
    motion = study.actuator.motion
    assert motion is not None
    assert motion.nominal_gap is not None
    return motion.nominal_gap
