"use strict";
// The explorer: the coenergy surface and the guard's lines of the page's data, at the sliders' current and gap.
const explorer = (() => {
  const data = JSON.parse(document.getElementById("explorer-data").textContent);
  const doubles = (text) => new Float64Array(Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer);
  const gaps = doubles(data.gap);
  const currents = doubles(data.current);
  const coefficients = doubles(data.coefficients); // [gap cell][current cell][power of the gap][power of the current]
  const guard = {
    gap: doubles(data.guard.gap),
    limit: data.guard.limit.map(doubles),
    slope: data.guard.slope.map(doubles),
    currentMax: data.guard.current_max,
  };
  const POWERS = 6;
  const CELLS = currents.length - 1;
  const clip = (x, low, high) => Math.min(Math.max(x, low), high);
  const last = (nodes) => nodes[nodes.length - 1];

  function cell(nodes, x) {
    let low = 0;
    let high = nodes.length - 1;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (nodes[middle] <= x) low = middle; else high = middle;
    }
    return low;
  }

  // W', lambda, F, dlambda/di, dF/di, dF/dg in SI units: Horner along i, then along g, as the table does it.
  function evaluate(i, g) {
    const size = Math.abs(i);
    if (!(g >= gaps[0] && g <= last(gaps) && size <= last(currents))) return null;
    const m = cell(gaps, g);
    const n = cell(currents, size);
    const y = g - gaps[m];
    const x = size - currents[n];
    const at = (m * CELLS + n) * POWERS * POWERS;
    let w = 0, wG = 0, wGG = 0, wI = 0, wIG = 0, wII = 0;
    for (let p = POWERS - 1; p >= 0; p--) {
      let a = 0, b = 0, c = 0;
      for (let q = POWERS - 1; q >= 0; q--) {
        c = c * x + b;
        b = b * x + a;
        a = a * x + coefficients[at + p * POWERS + q];
      }
      wGG = wGG * y + wG;
      wG = wG * y + w;
      w = w * y + a;
      wIG = wIG * y + wI;
      wI = wI * y + b;
      wII = wII * y + 2 * c;
    }
    const sign = i < 0 ? -1 : 1;
    return [w, sign * wI, -wG, wII, -sign * wIG, -2 * wGG];
  }

  // Limits of all levels in A, the region's number and the reason's number, as the guard says.
  function judge(i, g) {
    const inside = g >= guard.gap[0] && g <= last(guard.gap);
    if (!inside || Number.isNaN(i)) return { limits: null, region: 2, reason: Number.isNaN(i) ? 6 : Number.isNaN(g) ? 5 : 4 };
    const m = cell(guard.gap, g);
    const limits = guard.limit.map((limit, k) => Math.max(0, limit[m] + guard.slope[k][m] * (g - guard.gap[m])));
    const size = Math.abs(i);
    const region = !(size <= last(limits)) ? 2 : size <= limits[0] ? 0 : 1;
    return { limits, region, reason: size > guard.currentMax ? 3 : region };
  }

  const part = (name) => document.getElementById(`explorer-${name}`);
  const number = (value, digits = 4) => {
    const text = value.toPrecision(digits);
    return (text.includes("e") ? String(Number(text)) : text).replace(/-/g, "\u2212");
  };
  const write = (name, text) => {
    for (const place of document.querySelectorAll(`#explorer [data-out="${name}"]`)) place.textContent = text;
  };

  const state = { current: data.start.current, gap: data.start.gap };
  const axis = (title, more) => ({ title: { text: title }, ...more });
  const look = data.map.layout;
  const cutLook = (y) => ({
    margin: { l: 60, r: 12, t: 10, b: 48 }, paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
    font: look.font, showlegend: false, height: 300, paperShare: 0.48, hovermode: "closest",
    xaxis: { ...look.xaxis, ...axis("coil current in A"), range: [0, last(currents)] },
    yaxis: { ...look.yaxis, ...axis(y), range: undefined, rangemode: "tozero" }, modebar: look.modebar,
  });

  const LINES = 61;
  const CUT = 161;
  const even = (low, high, n) => Array.from({ length: n }, (_, k) => (k === n - 1 ? high : low + ((high - low) * k) / (n - 1)));

  function contours(name) {
    const k = data.quantities.findIndex((quantity) => quantity.name === name);
    const { label, unit, scale } = data.quantities[k];
    const g = even(gaps[0], last(gaps), LINES);
    const i = even(0, last(currents), LINES);
    return {
      type: "contour", x: g.map((v) => v * 1e3), y: i, z: i.map((a) => g.map((b) => evaluate(a, b)[k] * scale)),
      contours: { coloring: "none", showlabels: true, labelfont: { size: 11 } }, ncontours: 14, line: { color: "#6b7280", width: 1 },
      showscale: false, name: label, showlegend: false,
      hovertemplate: `gap %{x:.4g} mm, %{y:.4g} A: ${label} %{z:.5g} ${unit}<extra></extra>`,
    };
  }

  const cross = () => ({
    type: "scatter", mode: "markers", x: [state.gap * 1e3], y: [state.current], name: "here", showlegend: false,
    marker: { size: 15, symbol: "cross-thin", color: "#000000", line: { width: 2.5, color: "#000000" } }, hoverinfo: "skip",
  });

  function mapTraces() {
    const name = part("lines").value;
    return [...data.map.data, ...(name ? [contours(name)] : []), cross()];
  }

  const LEVEL_COLOURS = data.levels.map((_, k) => (k === 0 ? "#009E73" : k === data.levels.length - 1 ? "#D55E00" : "#E69F00"));

  function cutTraces(name) {
    const k = data.quantities.findIndex((quantity) => quantity.name === name);
    const { label, unit, scale } = data.quantities[k];
    const i = even(0, last(currents), CUT);
    const y = i.map((a) => evaluate(a, state.gap)[k] * scale);
    const { limits } = judge(state.current, state.gap);
    const top = Math.max(...y);
    const verticals = (limits || []).map((limit, n) => ({
      type: "scatter", mode: "lines", x: [limit, limit], y: [0, top], name: `${data.levels[n]} T`, hoverinfo: "name",
      line: { color: LEVEL_COLOURS[n], width: 1.4, dash: "dot" },
    }));
    const here = evaluate(state.current, state.gap)[k] * scale;
    return [
      { type: "scatter", mode: "lines", x: i, y, line: { color: "#0072B2", width: 1.8 }, name: label,
        hovertemplate: `%{x:.4g} A: %{y:.5g} ${unit}<extra></extra>` },
      ...verticals,
      { type: "scatter", mode: "markers", x: [state.current], y: [here], marker: { size: 10, color: "#0072B2" }, hoverinfo: "skip" },
    ];
  }

  const plots = {
    map: report.add(part("map"), mapTraces(), { ...look, height: 420 }),
    force: report.add(part("force"), cutTraces("force"), cutLook("force of one magnet in N")),
    flux: report.add(part("flux"), cutTraces("flux_linkage"), cutLook("flux linkage in mWb")),
  };

  // Whether the level is reached at the map's gap nearest to the present one.
  function reached(level) {
    const m = cell(guard.gap, clip(state.gap, guard.gap[0], last(guard.gap)));
    const near = state.gap - guard.gap[m] < guard.gap[m + 1] - state.gap ? m : m + 1;
    return data.reached[level][near];
  }

  function sentence(judged) {
    const g = `at a gap of ${number(state.gap * 1e3)} mm`;
    if (!judged.limits || judged.reason === 3) return data.reasons[judged.reason];
    const limit = (k) => `the ${number(judged.limits[k])} A ` + (reached(k)
      ? `that may bring ${data.levels[k]} T`
      : `where the map ends, ${data.levels[k]} T not reached,`);
    const end = data.levels.length - 1;
    if (judged.region === 0) return `below ${limit(0)} ${g}`;
    if (judged.region === 1) return `above ${limit(0)}, below ${limit(end)} ${g}`;
    return `above ${limit(end)} ${g}`;
  }

  const ROUNDING = 1e-12; // of a quantity's largest value: less is nothing
  const told = (values, k) => (Math.abs(values[k]) < ROUNDING * data.quantities[k].largest ? 0 : values[k]);

  function tell() {
    const values = evaluate(state.current, state.gap);
    const judged = judge(state.current, state.gap);
    data.quantities.forEach(({ name, unit, scale }, k) => write(name, `${number(told(values, k) * scale, 5)} ${unit}`));
    write("side_force", `${number(told(values, 2) * data.magnets, 5)} N`);
    write("gap", `${number(state.gap * 1e3)} mm`);
    write("current", `${number(state.current)} A`);
    data.levels.forEach((_, k) => {
      const limit = judged.limits && judged.limits[k];
      write(`limit_${k}`, judged.limits ? `${number(limit)} A` : "outside the map");
      write(`margin_${k}`, judged.limits ? `${number(limit - Math.abs(state.current), 3)} A` : "-");
    });
    write("region", data.regions[judged.region]);
    document.querySelector('#explorer [data-out="region"]').className = data.regions[judged.region];
    write("reason", sentence(judged));
  }

  let waiting = false;
  function show() {
    tell();
    if (waiting) return; // figures once a frame, however fast a slider moves
    waiting = true;
    requestAnimationFrame(() => {
      waiting = false;
      plots.map.data[plots.map.data.length - 1] = cross();
      plots.force.data = cutTraces("force");
      plots.flux.data = cutTraces("flux_linkage");
      Object.values(plots).forEach(report.draw);
    });
  }

  function go(current, gap) {
    if (Number.isFinite(current)) state.current = clip(current, 0, last(currents));
    if (Number.isFinite(gap)) state.gap = clip(gap, gaps[0], last(gaps));
    for (const [name, value] of [["gap", state.gap * 1e3], ["current", state.current]]) {
      for (const handle of [part(name), part(`${name}-number`)]) {
        if (handle !== document.activeElement || handle.type === "range") handle.value = Number(value.toPrecision(6));
      }
    }
    show();
  }

  function bind(name, low, high, scale) {
    for (const handle of [part(name), part(`${name}-number`)]) {
      handle.min = low * scale;
      handle.max = high * scale;
      handle.addEventListener("input", () => {
        const value = handle.value === "" ? NaN : Number(handle.value) / scale;
        go(name === "current" ? value : NaN, name === "gap" ? value : NaN);
      });
    }
  }
  bind("gap", gaps[0], last(gaps), 1e3);
  bind("current", 0, last(currents), 1);
  part("lines").addEventListener("change", () => {
    plots.map.data = mapTraces();
    report.draw(plots.map);
  });
  let pressed = null;
  part("map").addEventListener("pointerdown", (event) => { pressed = [event.clientX, event.clientY]; }, true);
  document.addEventListener("pointerup", (event) => {
    const still = pressed && Math.hypot(event.clientX - pressed[0], event.clientY - pressed[1]) < 4; // no zoom's drag
    pressed = null;
    if (!still) return;
    const { xaxis, yaxis, _size: size } = part("map")._fullLayout;
    const box = part("map").getBoundingClientRect();
    const x = event.clientX - box.left - size.l;
    const y = event.clientY - box.top - size.t;
    if (x >= 0 && x <= size.w && y >= 0 && y <= size.h) go(yaxis.p2c(y), xaxis.p2c(x) / 1e3);
  }, true);

  // #gap=0.3&current=4 (mm, A) in the address opens the page there.
  function fromAddress() {
    const asked = new URLSearchParams(location.hash.slice(1));
    const value = (name) => (asked.has(name) ? Number(asked.get(name)) : NaN);
    go(value("current"), value("gap") / 1e3);
  }
  window.addEventListener("hashchange", fromAddress);
  fromAddress();
  return { evaluate, judge, go, state };
})();
