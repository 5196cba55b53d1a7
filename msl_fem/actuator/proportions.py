"""Whether the lengths of an E-core belong to one magnet: sizes that fit each other, a coil that fits its window."""

from collections.abc import Mapping

from msl_fem.files.quantity import format_quantity

LARGEST_MAGNET, THINNEST = 10.0, 1e-3  # m; of the largest length: beyond, the mesher has nothing to hold on to
WIDEST_MARGIN = 100.0  # of the largest length


def check_proportions(
    lengths: Mapping[str, float],
    *,
    clearances: Mapping[str, float],
    margins: Mapping[str, float],
    stack_depth: float,
) -> None:
    """ValueError unless the lengths of a section belong to one magnet.

    Parameters
    ----------
    lengths : key to a length in m that is above 0
    clearances : key to one that may be 0
    margins : key to the air beyond the magnet
    """
    largest = max(lengths.values())
    if largest > LARGEST_MAGNET:
        name = max(lengths, key=lengths.__getitem__)
        raise ValueError(f"{name} {_metres(lengths[name])} is above {_metres(LARGEST_MAGNET)}; look at its unit")
    smallest = THINNEST * largest
    for name, value in {**lengths, **{n: v for n, v in clearances.items() if v > 0}}.items():
        if value < smallest:
            or_zero = ", or 0" if name in clearances else ""
            raise ValueError(
                f"{name} {_metres(value)} is below {_metres(smallest)}, a thousandth of the magnet's largest "
                f"length; make it larger{or_zero}"
            )
    widest = WIDEST_MARGIN * largest
    for name, value in margins.items():
        _check_range(name, value, smallest, widest)
    overhang = "armature_overhang"
    _check_range(overhang, clearances[overhang], 0.0, widest)
    _check_range("stack_depth", stack_depth, smallest, LARGEST_MAGNET)


def check_coil_fits(name: str, used: float, window: float) -> None:
    """ValueError where a coil with its clearance, `used`, is larger than its window; `name` is width or height."""
    if used > window * (1 + 1e-9):
        raise ValueError(
            f"coil.{name} with its clearance is {_metres(used)}, more than the "
            f"window's {_metres(window)}; make the coil smaller or the window larger"
        )


def check_chamfer(chamfer: float, thinnest_pole: float) -> None:
    """ValueError where the chamfer takes more than a quarter of the thinnest pole."""
    if chamfer > thinnest_pole / 4:
        raise ValueError(
            f"pole_chamfer {_metres(chamfer)} is above "
            f"{_metres(thinnest_pole / 4)}, a quarter of the thinnest pole; make it smaller"
        )


def check_air_beyond_armature(side: float, overhang: float) -> None:
    """ValueError where the air box, counted from the core, ends before the armature does."""
    if side <= overhang:
        raise ValueError(
            f"air.side {_metres(side)} counts from the core and must be above "
            f"armature_overhang {_metres(overhang)}; make the air box wider"
        )


def _check_range(name: str, value: float, lowest: float, highest: float) -> None:
    if not lowest <= value <= highest:
        raise ValueError(
            f"{name} {_metres(value)} is not allowed; with this magnet it must be "
            f"{_metres(lowest)} ... {_metres(highest)}"
        )


def _metres(value: float) -> str:
    return format_quantity(value, "m")
