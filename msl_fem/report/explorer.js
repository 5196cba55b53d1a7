"use strict";
// The explorer: the coenergy surface and the guard's lines of the page's data, at the sliders' current and gap.
const explorer = (() => {
  const data = JSON.parse(document.getElementById("explorer-data").textContent);
  const { doubles, clip, last, even, cell, number } = explorerParts;
  const { gaps, currents, evaluate } = explorerParts.coenergySurface(data);
  const guard = {
    gap: doubles(data.guard.gap),
    limit: data.guard.limit.map(doubles),
    slope: data.guard.slope.map(doubles),
    currentMax: data.guard.current_max,
  };

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
  const write = (name, text) => {
    for (const place of document.querySelectorAll(`#explorer [data-out="${name}"]`)) place.textContent = text;
  };

  const state = { current: data.start.current, gap: data.start.gap };
  const look = data.map.layout;
  const cutLook = (y) => explorerParts.cutLook(look, "coil current in A", y, [0, last(currents)]);

  const LINES = 61;
  const CUT = 161;

  function contours(name) {
    const k = data.quantities.findIndex((quantity) => quantity.name === name);
    const g = even(gaps[0], last(gaps), LINES);
    const i = even(0, last(currents), LINES);
    const z = i.map((a) => g.map((b) => evaluate(a, b)[k] * data.quantities[k].scale));
    return explorerParts.contours(data.quantities[k], g.map((v) => v * 1e3), i, z, "gap %{x:.4g} mm, %{y:.4g} A");
  }

  const cross = () => explorerParts.cross(state.gap * 1e3, state.current);

  function mapTraces() {
    const name = part("lines").value;
    return [...data.map.data, ...(name ? [contours(name)] : []), cross()];
  }

  const LEVEL_COLOURS = explorerParts.levelColours(data.levels);

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
    shown.gap(state.gap);
    shown.current(state.current);
    show();
  }

  const asked = (name, value) => go(name === "current" ? value : NaN, name === "gap" ? value : NaN);
  const shown = {
    gap: explorerParts.handle("explorer", "gap", gaps[0], last(gaps), 1e3, asked),
    current: explorerParts.handle("explorer", "current", 0, last(currents), 1, asked),
  };
  part("lines").addEventListener("change", () => {
    plots.map.data = mapTraces();
    report.draw(plots.map);
  });
  explorerParts.onClick(part("map"), (x, y) => go(y, x / 1e3));

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
