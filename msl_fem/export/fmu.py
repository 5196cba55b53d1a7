"""The coupled model as an FMU: FMI 2.0 or 3.0, co-simulation, C source with the tables compiled in.

The archive holds the model description, `sources/` with everything that a compiler needs, a page of documentation, and
the shared library for this machine where gcc is there. What is compiled is printed from the functions that `simulate`
runs (`plant_model`): the plain model, or the one with every effect of the catalogue, whose parameters are the FMU's.
"""

import hashlib
import math
import zipfile
from dataclasses import dataclass
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from msl_fem.errors import InputError
from msl_fem.export.c_pair_table import shared_header
from msl_fem.export.c_table import table_header
from msl_fem.export.c_text import c_prefix, c_source
from msl_fem.export.fmu_library import FLAGS, compile_library
from msl_fem.export.fmu_variables import UNITS, Variable, channel_count, effect_variables, unit_exponents, variables
from msl_fem.export.formats import ModelSource
from msl_fem.export.plant_model import HISTORY_DEPTH, plant_source
from msl_fem.files.whole_file import whole_file
from msl_fem.plant import plant_parameters
from msl_fem.plant.effects import neutral_vector
from msl_fem.plant.effects.electrical import N_QUEUE
from msl_fem.plant.preparation import check_effects
from msl_fem.plant.step_count import STEP_OF_FASTEST, fastest_rate, rates_of_effects

COMPILED = ("fmu_api.c", "fmu_plant.c")
"""What a compiler takes of the sources of FMI 2.0."""
_MODEL = ("fmu_plant.c", "fmu_plant.h", "fmu_content.h")


@dataclass(frozen=True)
class Interface:
    """A version of FMI.

    Attributes
    ----------
    version : as the model description states it
    compiled : sources that a compiler takes
    headers : of the standard, and what else the interface includes
    descriptions : template to its place in the archive
    platform : of 64-bit Linux, in the folder binaries
    types : the names of Real, Integer and Boolean
    """

    version: str
    compiled: tuple[str, ...]
    headers: tuple[str, ...]
    descriptions: tuple[tuple[str, str], ...]
    platform: str
    types: tuple[str, str, str]


FMI_2 = Interface(
    "2.0",
    COMPILED,
    ("fmi2/fmi2TypesPlatform.h", "fmi2/fmi2FunctionTypes.h", "fmi2/fmi2Functions.h"),
    (("model_description.xml.j2", "modelDescription.xml"),),
    "linux64",
    ("Real", "Integer", "Boolean"),
)
FMI_3 = Interface(
    "3.0",
    ("fmu_api3.c", "fmu_plant.c"),
    ("fmu_api3_refused.h", "fmi3/fmi3PlatformTypes.h", "fmi3/fmi3FunctionTypes.h", "fmi3/fmi3Functions.h"),
    (
        ("model_description3.xml.j2", "modelDescription.xml"),
        ("build_description.xml.j2", "sources/buildDescription.xml"),
    ),
    "x86_64-linux",
    ("Float64", "Int32", "Boolean"),
)
_KINDS = ("Real", "Integer", "Boolean")
_STEP_SIZE, _STOP_TIME = 1e-4, 1.0
_EPOCH = (1980, 1, 1, 0, 0, 0)  # of the files in the archive, so that the same model gives the same bytes

_BEFORE = "/* Printed by msl_fem from the functions of msl_fem.plant; do not edit. */\n"
_PAGES = Environment(
    loader=PackageLoader("msl_fem.export", "."),
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
    keep_trailing_newline=True,
    autoescape=True,
)


def _xml_number(value: float | bool) -> str:
    return str(value).lower() if isinstance(value, bool) else repr(float(value))


_PAGES.filters["xml_number"] = _xml_number


def fmu_files(source: ModelSource, *, name: str | None = None, fmi: Interface = FMI_2) -> dict[str, bytes]:
    """Path in the archive to content, without libraries.

    Raises
    ------
    InputError : a section of the actuator that the coupled model needs is missing, magnets without a table, a `name`
        that cannot begin C names
    """
    content = _content(source, name, fmi)
    shipped = dict.fromkeys((*fmi.compiled, *_MODEL, *fmi.headers))
    texts = {f"sources/{Path(one).name}": files("msl_fem.export").joinpath(one).read_text() for one in shipped}
    texts["sources/actuator.h"] = c_source("actuator.h.j2", content)
    if source.table is not None and content["plant"].sides:
        texts["sources/magnet_table.h"] = table_header(source.table, name="magnet")
        if source.table.shared is not None:
            texts["sources/shared_table.h"] = shared_header(source.table, name="pair")
    printed = plant_source(content["plant"], effects=source.effects is not None, pair=content["pair"])
    texts |= {f"sources/{path}": _BEFORE + text for path, text in printed.items()}
    unnamed = c_source("fmu_variables.h.j2", content)
    content["guid"] = _guid([*texts.values(), unnamed])
    texts["sources/fmu_variables.h"] = c_source("fmu_variables.h.j2", content)
    texts["sources/build.txt"] = c_source("fmu_note.txt.j2", content)
    for template, place in fmi.descriptions:
        texts[place] = _PAGES.get_template(template).render(content)
    texts["documentation/index.html"] = _PAGES.get_template("fmu_page.html.j2").render(content)
    return {path: text.encode() for path, text in texts.items()}


def _content(source: ModelSource, name: str | None, fmi: Interface) -> dict[str, Any]:
    """What the templates take."""
    actuator, table = source.actuator, source.table
    plant = plant_parameters(actuator)
    if plant.sides and table is None:
        raise InputError(f"{actuator.name} has magnets and there is no table; make one with 'msl-fem table'")
    effects = source.effects
    rates = [fastest_rate(plant, table)]
    if effects is not None:
        check_effects(plant, effects)
        rates += rates_of_effects(plant, effects).values()
    largest_step = STEP_OF_FASTEST / max(rates)
    if not (math.isfinite(largest_step) and largest_step > 0):
        largest_step = _STEP_SIZE  # nothing that would set a rate: a free mass
    found = variables(plant, largest_step=largest_step, effects=effects)
    kinds = {kind: [v for v in found if v.kind == kind] for kind in _KINDS}
    listed = [(v, kinds[v.kind].index(v)) for v in found]
    return {
        "actuator": actuator.name,
        "digest": actuator.digest,
        "version": version("msl-fem"),
        "identifier": c_prefix(actuator.name, name),
        "guid": "",
        "plant": plant,
        "channels": channel_count(plant),
        "pair": table is not None and plant.sides > 0 and table.shared is not None,
        "rectangle": table.rectangle if table is not None and plant.sides else "",
        "kinds": kinds,
        "effects": [] if effects is None else effect_variables(plant, effects),
        "neutral": neutral_vector(),
        "late": N_QUEUE,
        "history": HISTORY_DEPTH,
        "listed": listed,
        "outputs": [n + 1 for n, v in enumerate(found) if v.causality == "output"],
        "units": _used_units(found),
        "compiled": fmi.compiled,
        "fmi": fmi.version,
        "fmi_headers": [Path(one).name for one in fmi.headers if one.startswith("fmi")],
        "platform": fmi.platform,
        "types": dict(zip(_KINDS, fmi.types, strict=True)),
        "numbered": [(v, n) for n, v in enumerate(v for kind in _KINDS for v in kinds[kind])],
        "flags": FLAGS,
        "step_size": repr(_STEP_SIZE),
        "stop_time": repr(_STOP_TIME),
    }


def _used_units(found: tuple[Variable, ...]) -> dict[str, dict[str, int]]:
    used = {v.unit for v in found if v.unit}
    known = {name: exponents for name, exponents in UNITS.items() if name in used}
    return known | {name: unit_exponents(name) for name in sorted(used - known.keys())}


def _guid(texts: list[str]) -> str:
    """A GUID of what is compiled: another model has another one."""
    digest = hashlib.sha256("\0".join(texts).encode()).hexdigest()
    return "{" + "-".join((digest[:8], digest[8:12], digest[12:16], digest[16:20], digest[20:32])) + "}"


def write(source: ModelSource, target: Path, *, name: str | None = None, fmi: Interface = FMI_2) -> tuple[Path, ...]:
    """The archive written, with the library for this machine where it can be compiled.

    Raises
    ------
    InputError : as `fmu_files`, or the folder cannot be written
    ComputationError : gcc is there and refuses the source
    """
    content = fmu_files(source, name=name, fmi=fmi)
    place = f"binaries/{fmi.platform}/{c_prefix(source.actuator.name, name)}.so"
    sources = {Path(path).name: text for path, text in content.items() if path.startswith("sources/")}
    library = compile_library(sources, compiled=fmi.compiled, place=place)
    with whole_file(target) as partial, zipfile.ZipFile(partial, "w", zipfile.ZIP_DEFLATED) as archive:
        for path, data in sorted((content | library).items()):
            archive.writestr(zipfile.ZipInfo(path, _EPOCH), data, zipfile.ZIP_DEFLATED)
    return (target,)


def write_fmi3(source: ModelSource, target: Path, *, name: str | None = None) -> tuple[Path, ...]:
    """As `write`, for FMI 3.0."""
    return write(source, target, name=name, fmi=FMI_3)


def platforms(archive: Path) -> list[str]:
    """The platforms, as FMI names them, that an archive holds a library for."""
    with zipfile.ZipFile(archive) as content:
        return sorted({path.split("/")[1] for path in content.namelist() if path.startswith("binaries/")})
