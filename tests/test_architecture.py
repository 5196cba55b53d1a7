"""docs/architecture.md is true: the import order, who may use which library, who may open files."""

import ast
import re
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PACKAGE = ROOT / "msl_fem"
DOCUMENT = ROOT / "docs" / "architecture.md"
ORDER = re.findall(r"^\d+\. `(msl_fem\.[a-z_.]+)`", DOCUMENT.read_text(), flags=re.MULTILINE)
SIBLINGS = {"msl_fem.identification", "msl_fem.control", "msl_fem.diagnosis"}
USERS = {
    "skfem": {
        "msl_fem.magnetics.solver.mesh",
        "msl_fem.magnetics.solver.magnetostatics",
        "msl_fem.magnetics.solver.postprocess",
        "msl_fem.mechanics.flexure_beam",
    },
    "netgen": {"msl_fem.magnetics.solver.mesh"},
    "matplotlib": {"msl_fem.report"},
    "plotly": {"msl_fem.report"},
    "pyvista": {"msl_fem.report"},
    "casadi": {"msl_fem.export"},
    "ezdxf": {"msl_fem.export"},
    "control": {"msl_fem.export", "msl_fem.identification"},
    "gymnasium": {"msl_fem.export"},
    "pyamg": {"msl_fem.magnetics.three_d.multigrid"},
}
FILE_USERS = {
    "msl_fem.files",
    "msl_fem.materials",
    "msl_fem.actuator",
    "msl_fem.table",
    "msl_fem.record",
    "msl_fem.maps",
    "msl_fem.computing.row_cache",
    "msl_fem.design.sizing",
    "msl_fem.plant",
    "msl_fem.export",
    "msl_fem.report",
    "msl_fem.cli",
}
FILE_CALLS = {"open", "read_text", "read_bytes", "write_text", "write_bytes", "open_dataset", "read_csv", "to_csv"}


class Trees(Mapping[str, ast.Module]):
    """Syntax trees of the package's modules by name, read when asked for: every process collects, one looks at them."""

    def __init__(self) -> None:
        self._paths = {self._name(path): path for path in sorted(PACKAGE.rglob("*.py"))}
        self._read: dict[str, ast.Module] = {}

    @staticmethod
    def _name(path: Path) -> str:
        return ".".join(["msl_fem", *path.relative_to(PACKAGE).with_suffix("").parts]).removesuffix(".__init__")

    def __getitem__(self, name: str) -> ast.Module:
        if name not in self._read:
            self._read[name] = ast.parse(self._paths[name].read_text())
        return self._read[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._paths)

    def __len__(self) -> int:
        return len(self._paths)


MODULES = Trees()
KINDS = (ast.Import, ast.ImportFrom, ast.Call, ast.Attribute)


@cache
def nodes(tree: ast.Module) -> list[ast.AST]:
    """What the rules look at, walked once."""
    return [node for node in ast.walk(tree) if isinstance(node, KINDS)]


def within(module: str, rooms: Iterable[str]) -> bool:
    """Whether the module is one of these, or lies in one."""
    return any(module == room or module.startswith(f"{room}.") for room in rooms)


def entry(module: str) -> str:
    """The list's entry that a module belongs to; a package that holds rooms alone is its own."""
    return next((room for room in ORDER if within(module, [room])), module)


@cache
def imports(tree: ast.Module) -> tuple[str, ...]:
    return tuple(_imports(tree))


def _imports(tree: ast.Module) -> Iterator[str]:
    for node in nodes(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "imports are absolute"
            for alias in node.names:
                inner = f"{node.module}.{alias.name}"
                yield inner if inner in MODULES else str(node.module)


def test_every_module_stands_in_the_list() -> None:
    halls = {"msl_fem", "msl_fem.magnetics"}
    assert {entry(name) for name in MODULES} - halls == set(ORDER)


@pytest.mark.parametrize("module", [name for name in MODULES if entry(name) in ORDER])
def test_a_module_imports_only_from_those_before_it(module: str) -> None:
    here = ORDER.index(entry(module))
    for imported in imports(MODULES[module]):
        if imported.startswith("msl_fem."):
            assert ORDER.index(entry(imported)) <= here, f"{module} imports {imported}"
            assert imported != "msl_fem", f"{module} imports the package's door"
            pair = {entry(module), entry(imported)}
            assert not (len(pair) == 2 and pair <= SIBLINGS), f"{module} imports its sibling {imported}"


def test_the_bench_is_known_to_the_command_line_alone_and_shares_no_equations() -> None:
    """A diagnosis that could see the bench, or a bench made of the coupled model, would prove nothing."""
    users = {
        entry(n) for n, tree in MODULES.items() if any(entry(i) == "msl_fem.bench" for i in imports(tree) if "." in i)
    }
    assert users <= {"msl_fem.bench", "msl_fem.cli"}
    allowed = ["msl_fem.plant.excitation", "msl_fem.plant.excitation_kinds"]
    halves = {"msl_fem.identification", "msl_fem.control", "msl_fem.diagnosis", "msl_fem.study"}
    for name in (n for n in MODULES if entry(n) == "msl_fem.bench"):
        for imported in imports(MODULES[name]):
            assert entry(imported) not in halves, f"{name} imports {imported}"
            assert entry(imported) != "msl_fem.plant" or within(imported, allowed), f"{name} imports {imported}"


def test_no_import_cycle() -> None:
    edges = {name: {i for i in imports(tree) if i in MODULES and i != name} for name, tree in MODULES.items()}
    done: set[str] = set()

    def visit(name: str, path: tuple[str, ...]) -> None:
        assert name not in path, f"cycle: {' -> '.join([*path[path.index(name) :], name])}"
        if name not in done:
            for other in edges[name]:
                visit(other, (*path, name))
            done.add(name)

    for name in MODULES:
        visit(name, ())


@pytest.mark.parametrize("library", USERS)
def test_a_library_is_used_only_where_it_belongs(library: str) -> None:
    for name, tree in MODULES.items():
        if any(i.split(".")[0] == library for i in imports(tree)):
            assert within(name, USERS[library]), f"{name} imports {library}"


def test_files_are_opened_only_by_readers_and_writers() -> None:
    for name, tree in MODULES.items():
        for node in nodes(tree):
            if isinstance(node, ast.Call):
                called = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
                assert called not in FILE_CALLS or within(name, FILE_USERS), f"{name} calls {called}"


def test_imports_by_name_are_few() -> None:
    """What `imports` cannot see: who hands over to a module that is named in a text."""
    by_name = {
        name
        for name, tree in MODULES.items()
        if any("importlib" in (i.split(".")[0]) and i.endswith("import_module") for i in _imported_names(tree))
    }
    own_code = {"msl_fem.computing.lanes", "msl_fem.computing.machine_code"}  # their own module's source
    libraries = {"msl_fem.record.log_libraries"}
    assert by_name - own_code - libraries == {
        "msl_fem", "msl_fem.cli.app", "msl_fem.export.formats", "msl_fem.files.shown",
    }  # fmt: skip


def _imported_names(tree: ast.Module) -> Iterator[str]:
    """`module.name` of each import, and `importlib.import_module` where it is called so."""
    for node in nodes(tree):
        if isinstance(node, ast.ImportFrom):
            yield from (f"{node.module}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            yield f"{node.value.id}.{node.attr}"


def test_names_say_what_is_inside() -> None:
    for name in MODULES:
        assert not {"utils", "helpers", "common", "core", "misc"} & set(name.split(".")), name


def test_the_model_half_needs_no_finite_elements() -> None:
    """From control, no path of imports leads to the field half; what a magnet's drawing says needs no field."""
    reached, todo = set(), ["msl_fem.control", *(n for n in MODULES if n.startswith("msl_fem.control."))]
    while todo:
        for imported in imports(MODULES[todo.pop()]):
            if imported in MODULES and imported not in reached:
                reached.add(imported)
                todo.append(imported)
    drawings = [f"msl_fem.magnetics.{name}" for name in ("section", "triangles", "kinds")]
    field_half = [room for room in ORDER if room.startswith("msl_fem.magnetics.") and room not in drawings]
    assert len(field_half) == 6
    assert not [name for name in reached if within(name, field_half)]


STATION = re.compile(r"`((?:[a-z_0-9]+/)*[a-z_0-9]+\.py):([A-Za-z_]\w*)`")


@pytest.mark.parametrize(("path", "name"), sorted(set(STATION.findall(DOCUMENT.read_text()))))
def test_every_station_that_the_document_names_is_there(path: str, name: str) -> None:
    tree = ast.parse((PACKAGE / path).read_text())
    assert name in {n.name for n in ast.walk(tree) if isinstance(n, ast.FunctionDef | ast.ClassDef)}


def test_a_walk_has_at_most_ten_stations() -> None:
    walks = DOCUMENT.read_text().split("\n## Walks\n")[1].split("\n## ")[0].split("\n**")[1:]
    assert len(walks) >= 4
    assert all(1 <= len(re.findall(r"^\d+\. ", walk, flags=re.MULTILINE)) <= 10 for walk in walks)


def test_the_picture_shows_every_room() -> None:
    picture = (DOCUMENT.parent / "pictures" / "architecture.svg").read_text()
    shown = {word for text in re.findall(r">([^<>]+)</text>", picture) for word in text.split(", ")}
    assert {room.rsplit(".", 1)[-1] for room in ORDER} <= shown


def test_the_house_has_few_rooms() -> None:
    """At most 24 entries beside data: a new idea is a file of a room, not a room."""
    assert len({path.relative_to(PACKAGE).parts[0] for path in PACKAGE.rglob("*.py")}) <= 24
