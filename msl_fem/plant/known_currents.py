"""The rows of a current that is known over a step: what the stages of Runge-Kutta, and its end, take of it."""

from msl_fem.computing.compiled import compiled
from msl_fem.computing.lanes import Flag, Rows, Value, choose
from msl_fem.plant.effects import electrical, magnetic
from msl_fem.plant.equations import coupled_rows
from msl_fem.plant.layout import (
    CIRCUIT_1,
    CIRCUIT_2,
    I1,
    INDUCTANCE,
    KNOWN_1,
    KNOWN_2,
    KNOWN_LAST,
    KNOWN_MEMORY,
    KNOWN_SLOPES,
    KNOWN_VALUE,
    N_KNOWN,
)
from msl_fem.plant.plant import PlantParameters
from msl_fem.plant.poles import Four, fall_for_squares, slopes_of_fall


@compiled
def put_fall(
    state: Rows, work: Rows, j: int, where: Flag, away: Value, rise: Value, bend: Value, fall: Four, step: float
) -> None:  # fmt: skip
    """The current of side j into its rows, in some lanes: a line that rises by `rise`, and bends by `bend` s^2, from
    which it begins `away` and to which it falls with those moments."""
    row, goal = KNOWN_1 + j * N_KNOWN, state[I1 + j] - away
    m_0, square, m_s, last = fall
    begin, middle, end = fall_for_squares(m_0, square, m_s, away + last)
    b, m, n = slopes_of_fall(away, m_0, m_s, last)
    value, slope, rate = row + KNOWN_VALUE, row + KNOWN_SLOPES, 1.0 / step
    work[value] = choose(where, goal + begin, work[value])
    work[value + 1] = choose(where, goal + middle + (0.5 * rise - 0.25 * bend), work[value + 1])
    work[value + 2] = choose(where, goal + end + rise, work[value + 2])
    work[slope] = choose(where, (rise - bend - b) * rate, work[slope])
    work[slope + 1] = choose(where, (rise - m) * rate, work[slope + 1])
    work[slope + 2] = choose(where, (rise + bend - n) * rate, work[slope + 2])
    work[row + KNOWN_LAST] = choose(where, goal + last + rise, work[row + KNOWN_LAST])


@compiled
def rates_together(p: PlantParameters, e: Rows, work: Rows, step: float) -> Four:
    """Z of both sides, d(u)/ds = -Z (u - where it goes) over a step, its rows one after the other."""
    l_1, l_2 = work[CIRCUIT_1 + INDUCTANCE], work[CIRCUIT_2 + INDUCTANCE]
    w, share, unmix = p.bandwidth + (l_1 - l_1), l_1 - l_1, 1.0 + (l_1 - l_1)
    if e is not None:
        w, share, unmix = e[electrical.BANDWIDTH], e[magnetic.SHARE], e[magnetic.UNMIX]
    (own_1, other_1), (own_2, other_2) = coupled_rows(e, work, l_1, l_2, w * l_1, w * l_2)
    scale = w * step * unmix / (own_1 * own_2 - other_1 * other_2)
    z_11, z_12 = own_2 + share * other_1, 0.0 - (other_1 + share * own_2)
    z_21, z_22 = 0.0 - (other_2 + share * own_1), own_1 + share * other_2
    if e is None:
        return scale * z_11, scale * z_12, scale * z_21, scale * z_22
    else:
        by_1, by_2 = scale * (1.0 + work[KNOWN_1 + KNOWN_MEMORY]), scale * (1.0 + work[KNOWN_2 + KNOWN_MEMORY])
        return by_1 * z_11, by_2 * z_12, by_1 * z_21, by_2 * z_22
