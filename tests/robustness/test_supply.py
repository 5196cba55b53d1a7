"""What an installation brings along: bounded, pinned for tests, and named with its licence."""

import re
import tomllib
from importlib.metadata import distribution

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from packaging.version import Version
from targets import ROOT

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
NOTICES = (ROOT / "THIRD_PARTY_NOTICES.md").read_text()
OURS = canonicalize_name(PROJECT["name"])


def required(name: str, known: set[str]) -> set[str]:
    """Names of all that a package needs, itself included, as it is installed here."""
    name = canonicalize_name(name)
    if name in known:
        return known
    known.add(name)
    for text in distribution(name).requires or []:
        needed = Requirement(text)
        if needed.marker is None or needed.marker.evaluate({"extra": ""}):
            required(needed.name, known)
    return known


def pinned() -> dict[str, Version]:
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    pairs = (line.split("==") for line in lines if line and not line.startswith("#"))
    return {canonicalize_name(name): Version(version) for name, version in pairs}


def noticed() -> dict[str, str]:
    """Package to its licence, from the table of the notices."""
    table = NOTICES.partition("## Installed beside it")[2]
    rows = re.findall(r"^\| ([a-z0-9, -]+) \| ([^|]+) \|$", table, re.MULTILINE)
    return {name: licence for names, licence in rows for name in names.split(", ") if name not in ("---", "packages")}


def installed_with_us() -> set[str]:
    """Of the packages that come along here, those that are pinned: newer ones may need others."""
    names = {name for text in PROJECT["dependencies"] for name in required(Requirement(text).name, set())}
    return names & pinned().keys()


def test_every_package_that_comes_along_is_named_with_its_licence() -> None:
    here = installed_with_us()
    assert {"netgen-mesher", "numpy"} <= here
    assert not here - noticed().keys(), "say their licences in THIRD_PARTY_NOTICES.md"


@pytest.mark.parametrize("name", ["netgen-mesher", "netgen-occt"])
def test_the_lgpl_is_said_where_it_is(name: str) -> None:
    assert "LGPL" in noticed()[name]
    told = distribution(name).metadata
    said = " ".join([told.get("License-Expression") or "", *(told.get_all("Classifier") or [])])
    assert "LGPL" in said or "Lesser General" in said


def test_no_other_package_under_a_copyleft_comes_along_unsaid() -> None:
    for name in installed_with_us():
        licence = noticed()[name]
        told = distribution(name).metadata
        said = " ".join([told.get("License-Expression") or "", *(told.get_all("Classifier") or [])])
        for word, short in (("GPL", "GPL"), ("General Public", "GPL"), ("MPL", "MPL"), ("Mozilla", "MPL")):
            assert word not in said or short in licence, f"{name}: {said}"


def test_the_notices_go_with_the_distribution() -> None:
    assert "THIRD_PARTY_NOTICES.md" in PROJECT["license-files"]
    headers = list((ROOT / "msl_fem" / "export" / "fmi2").glob("*.h"))
    assert headers
    assert all("BSD" in header.read_text() for header in headers)


def test_what_is_pinned_fits_the_bounds_and_all_extras_are_pinned() -> None:
    bounds = [*PROJECT["dependencies"], *(one for extra in PROJECT["optional-dependencies"].values() for one in extra)]
    pins = pinned()
    for text in bounds:
        needed = Requirement(text)
        assert pins[canonicalize_name(needed.name)] in needed.specifier, text
