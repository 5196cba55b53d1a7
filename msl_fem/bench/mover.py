"""The forces on the mover, its attached part and the magnets' support."""

import numpy as np

from msl_fem.bench.circuit import CURRENT, PULL
from msl_fem.bench.friction import friction_force
from msl_fem.bench.plant import Array, Disturbance, Flexure, Plant, V, X
from msl_fem.bench.squeeze_film import film_damping
from msl_fem.computing.compiled import compiled


@compiled
def flexure_force(f: Flexure, position: float) -> float:
    """What stretching of the leaves adds to the spring's force, N; against the displacement.

    A leaf whose ends are held at their distance gets longer: F = K x (1 - 1/sqrt(1 + (x/l)^2)), K x^3/(2 l^2) for
    small x (the stretched-string term of Senturia, Microsystem Design, 2001, sect. 10.4). A negative K softens.
    """
    ratio = position / f.stretch_length
    # 1 - 1/sqrt(1 + r^2) without the cancellation for small r
    root = np.sqrt(1.0 + ratio * ratio)
    return f.stretch_stiffness * position * ratio * ratio / (root * (1.0 + root))


@compiled
def outside_force(d: Disturbance, time: float, y: Array, sides: Array) -> float:
    """Force in N, along +x, of what no believed equation has."""
    position, velocity = y[X], y[V]
    force = -d.drag * velocity * abs(velocity) + d.product * sides[0, CURRENT] * sides[1, CURRENT]
    if d.hum != 0.0:
        phase = d.hum_frequency * time + d.hum_phase
        force += d.hum * (np.sin(phase) + d.hum_third * np.sin(3.0 * phase))
    if d.cogging != 0.0:
        force += d.cogging * np.sin(2.0 * np.pi * position / d.cogging_period + d.cogging_phase)
    return force


@compiled
def move(plant: Plant, y: Array, external: float, sides: Array, dy: Array) -> None:
    """The rates of all mechanical states; `external` in N is what acts beside magnets, suspension and friction."""
    m, f, at = plant.motion, plant.flexure, plant.layout
    x, v = y[X], y[V]
    pull, film, support_v = 0.0, 0.0, 0.0
    if at.support >= 0:
        support_v = y[at.support + 1]
    for j in range(plant.magnets.sides):
        toward = 1.0 - 2.0 * j
        pull += toward * sides[j, PULL]
        if plant.film.damping > 0.0:
            position = x - y[at.support] if at.support >= 0 else x
            film += film_damping(plant.film, plant.magnets.nominal_gap - toward * position)
    reaction = pull - film * (v - support_v)  # of the magnets and the film, on the mover
    force = reaction + external - m.damping * v - m.stiffness * x
    if f.stretch_stiffness != 0.0:
        force -= flexure_force(f, x)
    for b in range(f.branches):
        branch = x - y[at.branches + b]
        force -= f.branch_stiffness[b] * branch
        if b == 0:
            force -= f.cushion * branch * abs(branch)
        dy[at.branches + b] = f.branch_rate[b] * branch
    if at.bristle >= 0:
        drag, dy[at.bristle] = friction_force(plant.friction, v, y[at.bristle])
        force -= drag
    mass = m.mass
    if at.attached >= 0:
        a = plant.attached
        part = a.share * m.mass
        mass -= part
        slip, slip_v = y[at.attached] - x, y[at.attached + 1] - v
        inner = part * a.frequency * (a.frequency * slip + 2.0 * a.damping_ratio * slip_v)
        force += inner
        dy[at.attached], dy[at.attached + 1] = y[at.attached + 1], -inner / part
    if at.support >= 0:
        s = plant.support
        dy[at.support] = support_v
        dy[at.support + 1] = (-reaction - s.damping * support_v - s.stiffness * y[at.support]) / s.mass
    dy[X] = v
    dy[V] = force / mass
