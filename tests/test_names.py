"""One word for one thing: no public class or function of the package has a name that means something else elsewhere."""

import ast
from collections import defaultdict
from pathlib import Path

PACKAGE = Path(__file__).parent.parent / "msl_fem"
ONE_MEANING = {
    "command": "a command of the command line, one in each module of cli",
    "write": "writes the files of an export format, one in each module of export",
    "operating_map": "the verb of the package, which hands over to the function of maps",
}
"""Names that several modules define, each in the one sense that stands here."""


def names_of(text: str) -> set[str]:
    """The public classes and functions that a module defines."""
    kinds = (ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    return {node.name for node in ast.parse(text).body if isinstance(node, kinds) and not node.name.startswith("_")}


def names_in_two_modules(package: Path) -> dict[str, list[str]]:
    """Modules by the name that they share."""
    modules = defaultdict(list)
    for path in sorted(package.rglob("*.py")):
        for name in names_of(path.read_text()):
            modules[name].append(path.relative_to(package).as_posix())
    return {name: paths for name, paths in modules.items() if len(paths) > 1}


def test_no_name_stands_for_two_things() -> None:
    shared = names_in_two_modules(PACKAGE)
    unknown = {name: paths for name, paths in shared.items() if name not in ONE_MEANING}
    assert not unknown, "rename one of each: the noun that says which"


def test_every_exempt_name_is_shared() -> None:
    assert set(ONE_MEANING) <= set(names_in_two_modules(PACKAGE))


def test_a_twin_is_seen(tmp_path: Path) -> None:
    (tmp_path / "room").mkdir()
    (tmp_path / "room" / "first.py").write_text("class Plant: ...\nclass _Own: ...\ndef run(): ...\n")
    (tmp_path / "second.py").write_text("class Plant: ...\nclass _Own: ...\nrun = 1\n")
    assert names_in_two_modules(tmp_path) == {"Plant": ["room/first.py", "second.py"]}
