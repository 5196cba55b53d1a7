"""The type of `a + b` of numbers, looked up once; the search is a fifth of numba's work on a long function.

Numba goes through all that an operator could mean, sums of lists, of texts and of arrays among it, and asks each twice,
anew at every sign of a formula. What an operator of numbers, lanes and rows gives follows from their types alone.
"""

import operator
from typing import Any

from numba import types

_OPERATORS = frozenset(f for f in vars(operator).values() if callable(f))
_numba_s: Any = types.Function.get_call_type
_plain: tuple[type[types.Type], ...] = (types.Float, types.Integer, types.Boolean)


def remember_operators_of(*kinds: type[types.Type]) -> None:
    """Makes numba keep what each operator gives for values of these types, and of numbers with them."""
    global _plain
    _plain += kinds


def _remembered(self: Any, context: Any, args: tuple[Any, ...], kws: dict[str, Any]) -> Any:
    """`get_call_type` of a function that numba brings."""
    key = self.typing_key
    if kws or key not in _OPERATORS or not all(isinstance(a, _plain) for a in args):
        return _numba_s(self, context, args, kws)
    if len(args) != 2 or not isinstance(args[0], types.Literal):  # two constants are folded
        args = tuple(map(types.unliteral, args))
    known = vars(self).setdefault("_known_operators", {})
    found = known.get((context, args))
    if found is None:
        found = _numba_s(self, context, args, kws)
        if self.get_impl_key(found) is key:  # none that would be compiled by the options of this moment
            known[context, args] = found
    return found


types.Function.get_call_type = _remembered
