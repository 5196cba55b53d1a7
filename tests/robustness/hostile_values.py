"""Values that no file should hold: wrong types, huge and odd numbers, texts that want to be a path, code or markup."""

import re
from typing import Any

import numpy as np

CANARY = "canary"
"""A file that some texts try to create where they are run, opened or unpacked; it must never appear."""
TEXTS = (
    "", " ", "x", "mm", "0", "-1", "1 m", "1 kg", "-0.6 mm", "0 mm", "0.6 mmm", "0.6 mm mm", "1e999 mm", "nan mm",
    "inf mm", "-inf A", "1e-400 m", "1e30 km", "1,2 mm", "0.6 mm; rm -rf x", "5 A\n6 A", "5 A\x00", "\u202e5 A", "½ mm",
    "٣ mm", "1_000 mm", "0x10 mm", "1e5000", "9" * 400, "m" * 5000, "mm**9999999", "m^(2^30)", "1 m^9^9^9", "1/0 m",
    "()", "{}", "[]", "../../x", "../../../../../../etc/passwd", "/etc/passwd", "/dev/zero", "/dev/null", "..", ".",
    "/", "/proc/self/mem", "~/x", "a/../../b", "file:///etc/passwd", "C:\\x", "con", "\\\\host\\share", "x\x00.nc",
    "x\n.nc", "-rf", "--help",
    "a" * 300, "<script>alert(1)</script>", "\"><img src=x onerror=alert(1)>", "{{7*7}}", "{% include 'x' %}", "${x}",
    f"$(touch {CANARY})", f"`touch {CANARY}`", f"; touch {CANARY}", f"__import__('os').system('touch {CANARY}')",
    f"exec(open('{CANARY}','w').write('x'))", f"=cmd|'touch {CANARY}'!A0", "%s%s%s%n", "%(x)s", "{0.__class__}",
    "\x1b[31mred\x1b[0m", "[bold]x[/bold]", "[/x]", "\ud7ff", "\ufeff", "é" * 50, "null", "true", "linear:0",
    "linear:-1",
    "linear:nan", "linear:1e400", "analytic:", "analytic:e9", "m19.csv", "e-core", "table", "mesh", "current", "force",
)  # fmt: skip
NUMBERS = (
    0, -1, 1, 2, 3, 7, 10**6, -(10**9), 10**18, 2**31, 2**63, 2**64, 10**400, 0.0, -0.0, 0.5, 1e-320, 1e-30, 1e30,
    1e300, -1e300, float("inf"), float("-inf"), float("nan"), 1.5, 99.9,
)  # fmt: skip


_QUANTITY = re.compile(r"([+-]?\d+\.?\d*(?:[eE][+-]?\d+)?)(.*)", flags=re.DOTALL)


def scaled(rng: np.random.Generator, value: Any) -> Any:
    """A number, or a text that begins with one, times a power of ten or minus one: plausible, and maybe impossible."""
    factor = (-1.0, 10.0 ** float(rng.integers(-18, 19)), 10.0 ** float(rng.integers(-2, 3)), 0.0)[rng.integers(4)]
    if isinstance(value, str) and (found := _QUANTITY.fullmatch(value)):
        return f"{float(found[1]) * factor:g}{found[2]}"
    if isinstance(value, int | float) and not isinstance(value, bool):
        try:
            return type(value)(value * factor)
        except (OverflowError, ValueError):
            return value
    return hostile_value(rng)


def hostile_value(rng: np.random.Generator, *, depth: int = 0) -> Any:
    """A value of any kind that TOML and JSON know."""
    kind = rng.integers(0, 10 if depth < 3 else 7)
    if kind <= 3:
        return TEXTS[rng.integers(len(TEXTS))]
    if kind <= 5:
        return NUMBERS[rng.integers(len(NUMBERS))]
    if kind == 6:
        return bool(rng.integers(2))
    if kind == 7:
        return [hostile_value(rng, depth=depth + 1) for _ in range(rng.integers(0, 4))]
    if kind == 8:
        return {
            str(TEXTS[rng.integers(len(TEXTS))]): hostile_value(rng, depth=depth + 1) for _ in range(rng.integers(0, 3))
        }
    return [[NUMBERS[rng.integers(len(NUMBERS))]] * int(rng.integers(1, 5))] * int(rng.integers(1, 3))


def spoilt_document(rng: np.random.Generator, document: Any) -> Any:
    """A copy of a document with one to three of its values replaced, removed, renamed, doubled or wrapped.

    Or with a few of its numbers somewhat larger or smaller: what a reader accepts, and equations may not.
    """
    if rng.random() < 0.35:
        for _ in range(int(rng.integers(1, 5))):
            document = _stretched(rng, document)
        return document
    for _ in range(int(rng.integers(1, 4))):
        document = _spoil(rng, document)
    return document


def _stretched(rng: np.random.Generator, document: Any) -> Any:
    """A copy with one number, or text that begins with one, times 0.001 to 1000."""
    if isinstance(document, dict) and document:
        key = list(document)[rng.integers(len(document))]
        return document | {key: _stretched(rng, document[key])}
    if isinstance(document, list) and document:
        at = int(rng.integers(len(document)))
        return [*document[:at], _stretched(rng, document[at]), *document[at + 1 :]]
    factor = 10.0 ** rng.uniform(-3, 3)
    if isinstance(document, str) and (found := _QUANTITY.fullmatch(document)):
        return f"{float(found[1]) * factor:.4g}{found[2]}"
    if isinstance(document, bool) or not isinstance(document, int | float):
        return document
    return type(document)(document * factor)


def _spoil(rng: np.random.Generator, document: Any) -> Any:
    """Walks down to a random place and spoils it there."""
    if isinstance(document, dict) and document and rng.random() < 0.9:
        key = list(document)[rng.integers(len(document))]
        changed = dict(document)
        action = rng.integers(0, 14)
        if action == 0:
            del changed[key]
        elif action == 1:
            changed[str(TEXTS[rng.integers(len(TEXTS))])] = changed.pop(key)
        elif action == 2:
            changed[str(TEXTS[rng.integers(len(TEXTS))])] = hostile_value(rng)
        else:
            changed[key] = _spoil(rng, changed[key])
        return changed
    if isinstance(document, list) and document and rng.random() < 0.8:
        at = int(rng.integers(len(document)))
        action = rng.integers(0, 4)
        if action == 0:
            return document[:at]
        if action == 1:
            return [*document, *document[at:]]
        return [*document[:at], _spoil(rng, document[at]), *document[at + 1 :]]
    return scaled(rng, document) if rng.random() < 0.6 else hostile_value(rng)


def spoilt_bytes(rng: np.random.Generator, content: bytes) -> bytes:
    """A copy with bytes cut off, flipped, inserted, repeated, or of another encoding."""
    at = int(rng.integers(0, len(content) + 1))
    action = rng.integers(0, 9)
    if action == 0:
        return content[:at]
    if action == 1:
        return content[at:]
    if action == 2:
        changed = bytearray(content)
        for place in rng.integers(0, max(len(content), 1), rng.integers(1, 20)):
            if changed:
                changed[place] = rng.integers(256)
        return bytes(changed)
    if action == 3:
        return content[:at] + bytes(rng.integers(0, 256, rng.integers(1, 200), dtype=np.uint8)) + content[at:]
    if action == 4:
        return content[:at] + b"\x00" * int(rng.integers(1, 50)) + content[at:]
    if action == 5:
        return content.decode("utf-8", "replace").encode(("utf-16", "utf-32", "cp037")[rng.integers(3)], "replace")
    if action == 6:
        return (
            content[:at] + (b"\xff\xfe", b"\xc3\x28", b"\xed\xa0\x80", b"\xef\xbb\xbf")[rng.integers(4)] + content[at:]
        )
    if action == 7:
        return content + content
    return content[:at] + content[max(at - int(rng.integers(1, 400)), 0) :]
