"""What leaves the checkout is whole: the wheel's data, the conda recipe, the citation, the paper's references."""

import re
import subprocess
import tomllib
from fnmatch import fnmatch

import pytest
import yaml
from conftest import ROOT

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
CONDA_NAMES = {"netgen": "netgen-mesher", "qdldl-python": "qdldl", "matplotlib-base": "matplotlib"}
EXEMPT = {"materials/SOURCE.md"}
"""Read by people in the repository, not by the package."""


def test_every_data_file_of_the_package_is_in_the_wheel() -> None:
    """A file that git keeps in msl_fem/ and no pattern of package-data names would be missing outside the checkout."""
    try:
        done = subprocess.run(["git", "ls-files", "msl_fem"], cwd=ROOT, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("no checkout of git")
    data = {line.removeprefix("msl_fem/") for line in done.stdout.splitlines() if not line.endswith(".py")} - EXEMPT
    patterns = PROJECT["tool"]["setuptools"]["package-data"]["msl_fem"]
    assert len(data) > 30
    assert not {
        name for name in data if not any(fnmatch(name, p) and name.count("/") == p.count("/") for p in patterns)
    }


def recipe() -> dict:
    text = (ROOT / "conda" / "meta.yaml").read_text()
    version = re.search(r'set version = "([^"]+)"', text)[1]
    plain = re.sub(r"\{%.*?%\}\n", "", text).replace("{{ version }}", version).replace("{{ PYTHON }}", "python")
    return yaml.safe_load(plain)


def test_the_conda_recipe_asks_for_what_pyproject_does() -> None:
    asked = [line.split(" ", 1) for line in recipe()["requirements"]["run"]]
    named = {CONDA_NAMES.get(name, name): version for name, version in asked if name != "python"}
    stated = dict(re.fullmatch(r"([A-Za-z0-9_-]+)(.*)", dep).groups() for dep in PROJECT["project"]["dependencies"])
    assert named == stated
    assert dict(asked)["python"] == PROJECT["project"]["requires-python"]


def test_one_version_everywhere() -> None:
    version = PROJECT["project"]["version"]
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert recipe()["package"]["version"] == citation["version"] == version
    assert citation["license"] == recipe()["about"]["license"] == PROJECT["project"]["license"]


def test_the_papers_citations_are_in_its_bibliography() -> None:
    paper, known = (ROOT / "paper" / "paper.md").read_text(), (ROOT / "paper" / "paper.bib").read_text()
    head = yaml.safe_load(paper.split("---")[1])
    assert {"title", "tags", "authors", "affiliations", "date", "bibliography"} <= set(head)
    cited = set(re.findall(r"@([A-Za-z]+\d{4}\w*)", paper.split("---", 2)[2]))
    assert cited == set(re.findall(r"^@\w+\{(\w+),", known, flags=re.MULTILINE))
    for section in ("Summary", "Statement of need", "Reproduction", "References"):
        assert f"# {section}" in paper
