"use strict";
// What both explorers share: arrays of doubles, one magnet's coenergy surface, numbers and even steps.
const explorerParts = (() => {
  const doubles = (text) => new Float64Array(Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer);
  const clip = (x, low, high) => Math.min(Math.max(x, low), high);
  const last = (nodes) => nodes[nodes.length - 1];
  const even = (low, high, n) => Array.from({ length: n }, (_, k) => (k === n - 1 ? high : low + ((high - low) * k) / (n - 1)));

  function cell(nodes, x) {
    let low = 0;
    let high = nodes.length - 1;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (nodes[middle] <= x) low = middle; else high = middle;
    }
    return low;
  }

  const number = (value, digits = 4) => {
    const text = value.toPrecision(digits);
    return (text.includes("e") ? String(Number(text)) : text).replace(/-/g, "\u2212");
  };

  // The function of current and gap with W', lambda, F, dlambda/di, dF/di, dF/dg in SI units; null outside the table.
  function coenergySurface(data) {
    const POWERS = 6;
    const gaps = doubles(data.gap);
    const currents = doubles(data.current);
    const coefficients = doubles(data.coefficients); // [gap cell][current cell][power of the gap][power of the current]
    const cells = currents.length - 1;

    // Horner along i, then along g, as the table does it.
    function evaluate(i, g) {
      const size = Math.abs(i);
      if (!(g >= gaps[0] && g <= last(gaps) && size <= last(currents))) return null;
      const m = cell(gaps, g);
      const n = cell(currents, size);
      const y = g - gaps[m];
      const x = size - currents[n];
      const at = (m * cells + n) * POWERS * POWERS;
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
    return { gaps, currents, evaluate };
  }

  // A slider and the number beside it, both of elements `${prefix}-${name}`, kept to a range; tell(name, value) in SI.
  function handle(prefix, name, low, high, scale, tell) {
    const both = [`${prefix}-${name}`, `${prefix}-${name}-number`].map((id) => document.getElementById(id));
    for (const one of both) {
      one.min = low * scale;
      one.max = high * scale;
      one.addEventListener("input", () => tell(name, one.value === "" ? NaN : Number(one.value) / scale));
    }
    return (value) => {
      for (const one of both) {
        if (one !== document.activeElement || one.type === "range") one.value = Number((value * scale).toPrecision(6));
      }
    };
  }

  // Calls go(x, y) in the axes' units where the figure in an element is clicked, and not dragged.
  function onClick(place, go) {
    let pressed = null;
    place.addEventListener("pointerdown", (event) => { pressed = [event.clientX, event.clientY]; }, true);
    document.addEventListener("pointerup", (event) => {
      const still = pressed && Math.hypot(event.clientX - pressed[0], event.clientY - pressed[1]) < 4; // no zoom's drag
      pressed = null;
      if (!still) return;
      const { xaxis, yaxis, _size: size } = place._fullLayout;
      const box = place.getBoundingClientRect();
      const x = event.clientX - box.left - size.l;
      const y = event.clientY - box.top - size.t;
      if (x >= 0 && x <= size.w && y >= 0 && y <= size.h) go(xaxis.p2c(x), yaxis.p2c(y));
    }, true);
  }

  // The look of a figure that is a cut, from that of another one.
  const cutLook = (look, x, y, range) => ({
    margin: { l: 60, r: 12, t: 10, b: 48 }, paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
    font: look.font, showlegend: false, height: 300, paperShare: 0.48, hovermode: "closest",
    xaxis: { ...look.xaxis, title: { text: x }, range },
    yaxis: { ...look.yaxis, title: { text: y }, range: undefined, rangemode: "tozero" }, modebar: look.modebar,
  });

  const levelColours = (levels) => levels.map((_, k) => (k === 0 ? "#009E73" : k === levels.length - 1 ? "#D55E00" : "#E69F00"));

  // The point of the sliders in a map.
  const cross = (x, y) => ({
    type: "scatter", mode: "markers", x: [x], y: [y], name: "here", showlegend: false,
    marker: { size: 15, symbol: "cross-thin", color: "#000000", line: { width: 2.5, color: "#000000" } }, hoverinfo: "skip",
  });

  // Lines of equal values of a quantity of the page's data over a map; `where` is what stands before it under the pointer.
  const contours = (quantity, x, y, z, where) => ({
    type: "contour", x, y, z, contours: { coloring: "none", showlabels: true, labelfont: { size: 11 } }, ncontours: 14,
    line: { color: "#6b7280", width: 1 }, showscale: false, name: quantity.label, showlegend: false,
    hovertemplate: `${where}: ${quantity.label} %{z:.5g} ${quantity.unit}<extra></extra>`,
  });

  return { cross, contours, doubles, clip, last, even, cell, number, coenergySurface, handle, onClick, cutLook, levelColours };
})();
