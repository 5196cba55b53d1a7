"""Whether the lengths of a section belong to one magnet."""

from collections.abc import Mapping

from msl_fem.files.quantity import format_quantity

LARGEST_MAGNET = 10.0  # m
THINNEST = 1e-3  # of the largest length: below, the mesher has nothing to hold on to
WIDEST_MARGIN = 100.0  # of the largest length


def check_proportions(
    lengths: Mapping[str, float],
    *,
    clearances: Mapping[str, float],
    margins: Mapping[str, float],
    stack_depth: float | None = None,
) -> None:
    """ValueError unless the lengths of a section belong to one magnet.

    Parameters
    ----------
    lengths : key to a length in m that is above 0
    clearances : key to one that may be 0
    margins : key to the air beyond the magnet
    stack_depth : of a plane section
    """
    largest = max(lengths.values())
    if largest > LARGEST_MAGNET:
        name = max(lengths, key=lengths.__getitem__)
        raise ValueError(f"{name} {metres(lengths[name])} is above {metres(LARGEST_MAGNET)}; look at its unit")
    smallest = THINNEST * largest
    for name, value in {**lengths, **{n: v for n, v in clearances.items() if v > 0}}.items():
        if value < smallest:
            or_zero = ", or 0" if name in clearances else ""
            raise ValueError(
                f"{name} {metres(value)} is below {metres(smallest)}, a thousandth of the magnet's largest "
                f"length; make it larger{or_zero}"
            )
    widest = WIDEST_MARGIN * largest
    for name, value in margins.items():
        _check_range(name, value, smallest, widest)
    if "armature_overhang" in clearances:
        _check_range("armature_overhang", clearances["armature_overhang"], 0.0, widest)
    if stack_depth is not None:
        _check_range("stack_depth", stack_depth, smallest, LARGEST_MAGNET)


def check_coil_fits(name: str, used: float, window: float) -> None:
    """ValueError where a coil with its clearance, `used`, is larger than its window; `name` is width or height."""
    if used > window * (1 + 1e-9):
        raise ValueError(
            f"coil.{name} with its clearance is {metres(used)}, more than the "
            f"window's {metres(window)}; make the coil smaller or the window larger"
        )


def _check_range(name: str, value: float, lowest: float, highest: float) -> None:
    if not lowest <= value <= highest:
        raise ValueError(
            f"{name} {metres(value)} is not allowed; with this magnet it must be {metres(lowest)} ... {metres(highest)}"
        )


def metres(value: float) -> str:
    """A length as messages write it, like "0.5 mm"."""
    return format_quantity(value, "m")
