"""Names and texts that want to be markup, script or links, through every page, in a real browser: shown, never run."""

from collections.abc import Callable
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import plotly.graph_objects as go
import pytest
from conftest import ROOT
from devtools import Browser

from msl_fem.actuator import Actuator, load_actuator
from msl_fem.diagnosis.estimates import Estimate
from msl_fem.diagnosis.kind import PredictionError, Size
from msl_fem.diagnosis.result import Accuracy, Cause, ChannelResiduals, Diagnosis, Evidence, TriedVariant, Unexplained
from msl_fem.maps import operating_map
from msl_fem.mechanics import assess_flexure
from msl_fem.mechanics.gap_trade import gap_trade
from msl_fem.record import Noise, Record, Run, Sampling
from msl_fem.report.design_pages import flexure_page, gap_trade_page
from msl_fem.report.diagnosis_page import diagnosis_page
from msl_fem.report.explorer import explorer
from msl_fem.report.page import Grid, Page, Stage, write_page
from msl_fem.table.magnetic_table import SECTION, MagneticTable, read_table

CRAFTED = (
    '<img src=x onerror="window.ran=1">',
    "</script><script>window.ran=1</script>",
    "</style></title></textarea><script>window.ran=1</script>",
    "\"'><svg onload=window.ran=1>",
    "<a href='javascript:window.ran=1'>here</a>",
    "javascript:window.ran=1",
    "<iframe srcdoc='<script>parent.ran=1</script>'></iframe>",
    "<!--<script>",
    "\\u003cscript\\u003ewindow.ran=1\\u003c/script\\u003e",
    "${window.ran=1}{{window.ran=1}}`+(window.ran=1)+`",
    "\u2028window.ran=1\u2029\u202e",
)
ALL = " ".join(CRAFTED)
FLEXURE = load_actuator(ROOT / "geometries" / "fast_tool_servo_flexure.toml")


def named_so(actuator: Actuator) -> Actuator:
    """No file may name an actuator so; the pages do not rely on it."""
    return actuator.model_copy(update={"name": ALL})


def page_of_texts() -> Page:
    """A text wherever a page and its figure can have one."""
    traces = [
        go.Scatter(x=[1, 2], y=[3, 4], name=text, text=[text, text], hovertext=text, hovertemplate=text)
        for text in CRAFTED
    ]
    layout = {
        "title": {"text": CRAFTED[0]},
        "xaxis": {"title": {"text": CRAFTED[3]}, "tickvals": [1], "ticktext": CRAFTED[1:2]},
        "annotations": [{"text": text, "x": 1, "y": 3} for text in CRAFTED], "showlegend": True,
    }  # fmt: skip
    stages = [Stage(text, text, ((text, text),), table=Grid((text, text), ((text, text),))) for text in CRAFTED]
    stages.append(Stage("figure", ALL, ((ALL, ALL),), plot=go.Figure(traces, layout)))
    return Page(ALL, ALL, ((ALL, ALL),), tuple(stages), ((ALL, ALL),), CRAFTED)


def page_of_an_explorer() -> Page:
    """The map's explorer with crafted sections, warnings, names and digests."""
    table = read_table(ROOT / "lookup_tables" / "fast_tool_servo.nc")
    extras = {(SECTION + ALL if name == f"{SECTION}yoke" else name): v for name, v in table.extras.items()}
    crafted: MagneticTable = replace(table, extras=extras, provenance={"actuator": ALL, "notes": [ALL]})
    regions = replace(operating_map(crafted), warnings=(ALL,), digest=ALL, actuator=ALL)
    return Page("map", ALL, (), (Stage("map", ALL, (), widget=explorer(crafted, regions, start=(1.0, 5e-4))),), ())


def diagnosed() -> Page:
    """A diagnosis of a record whose runs, excitations and reasons are crafted."""
    rng, n = np.random.default_rng(1), 1200
    residual = ChannelResiduals(ALL, "held-out", "position_m", 1e4, 5e-8, *(rng.normal(0, 5e-8, n) for _ in range(3)))
    error = PredictionError(ALL, "held-out", "position_m", 1e-6, 0.1, 5e-8, n, 1e-5)
    tried = (TriedVariant(1, "time_delay", ALL, 10.0, 20.0, True),)
    evidence = Evidence(
        tried, (residual,), {ALL: {"position_m": residual.nominal}}, (Size("time_delay", ALL, "position_m", 0.1, 1e-7),)
    )
    cause = Cause("time_delay", {"command": Estimate(1e-4, 9e-5, 1.1e-4)}, 20.0, None, 9.0)
    found = Diagnosis(
        "named-and-unexplained",
        ALL,
        (cause,),
        unexplained=Unexplained(0.3, (ALL,), ALL, ALL),
        accuracy=(Accuracy(error, error, error),),
        threshold=5.0,
        evidence=evidence,
        notes=CRAFTED,
    )
    run = Run(ALL, ALL, "held-out", {"time_s": np.arange(n) / 1e4, "position_m": np.zeros(n)})
    record = Record(
        "measured",
        named_so(FLEXURE),
        sampling=Sampling(rate=1e4),
        noise=Noise(position=5e-8),
        runs=(run,),
        warnings=CRAFTED,
    )
    return diagnosis_page(record, found)


def flexure() -> Page:
    return flexure_page(named_so(FLEXURE), assess_flexure(FLEXURE, bandwidth=50.0))


def trade() -> Page:
    return gap_trade_page(named_so(FLEXURE), gap_trade(FLEXURE, read_table(ROOT / "lookup_tables/fast_tool_servo.nc")))


@pytest.mark.parametrize("made", [page_of_texts, page_of_an_explorer, diagnosed, flexure, trade])
def test_no_text_runs_or_asks_for_anything(browser: Browser, page_file: Path, made: Callable[[], Page]) -> None:
    page = made()
    assert ALL in texts_of(page)
    file = write_page(page, page_file)
    browser.size(1120)  # whatever another test has left: such a title leaves no room on a phone
    browser.open(file)
    browser.run("for (const a of document.querySelectorAll('a, [onclick]')) a.dispatchEvent(new MouseEvent('click'))")
    browser.run("new Promise(done => setTimeout(() => done(1), 200))")
    assert browser.run("window.ran === undefined")
    assert [a for a in browser.requests if not a.startswith(("data:", "blob:"))] == [file.resolve().as_uri()]
    assert browser.complaints == []
    assert browser.run("document.querySelectorAll('img[src=x], iframe, [onerror], [onload]').length") == 0
    assert browser.run('document.body.textContent.includes("</script><script>window.ran=1</script>")')


def texts_of(thing: Any) -> str:
    """All texts of a page, joined."""
    if isinstance(thing, str):
        return thing
    if is_dataclass(thing) and not isinstance(thing, type):
        return "\n".join(texts_of(getattr(thing, one.name)) for one in fields(thing))
    return "\n".join(map(texts_of, thing)) if isinstance(thing, tuple | list) else ""
