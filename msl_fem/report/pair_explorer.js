"use strict";
// The explorer of a pair: coenergy of both sides and the guard of both, at the sliders' position and currents.
const pairExplorer = (() => {
  const data = JSON.parse(document.getElementById("pair-explorer-data").textContent);
  const { doubles, clip, last, even, cell, number } = explorerParts;
  const alone = explorerParts.coenergySurface(data.one_sided);
  const half = data.gap_sum / 2;
  const positions = doubles(data.position);
  const firsts = doubles(data.current_1);
  const seconds = doubles(data.current_2);
  const hermite = doubles(data.hermite); // [position][current 1][current 2][orders along position, current 2, current 1]
  const AT_NODE = 27;

  // The six polynomials that are 1 for f, f', f'' at the start and the end of a cell; values, slopes and curvatures.
  function endPolynomials(t, length) {
    const s = t / length;
    const [s2, s3, s4, s5] = [s * s, s ** 3, s ** 4, s ** 5];
    const values = [
      1 - 10 * s3 + 15 * s4 - 6 * s5, s - 6 * s3 + 8 * s4 - 3 * s5, 0.5 * (s2 - 3 * s3 + 3 * s4 - s5),
      10 * s3 - 15 * s4 + 6 * s5, -4 * s3 + 7 * s4 - 3 * s5, 0.5 * (s3 - 2 * s4 + s5),
    ];
    const slopes = [
      -30 * s2 + 60 * s3 - 30 * s4, 1 - 18 * s2 + 32 * s3 - 15 * s4, 0.5 * (2 * s - 9 * s2 + 12 * s3 - 5 * s4),
      30 * s2 - 60 * s3 + 30 * s4, -12 * s2 + 28 * s3 - 15 * s4, 0.5 * (3 * s2 - 8 * s3 + 5 * s4),
    ];
    const bends = [
      -60 * s + 180 * s2 - 120 * s3, -36 * s + 96 * s2 - 60 * s3, 0.5 * (2 - 18 * s + 36 * s2 - 20 * s3),
      60 * s - 180 * s2 + 120 * s3, -24 * s + 84 * s2 - 60 * s3, 0.5 * (6 * s - 24 * s2 + 20 * s3),
    ];
    const scaled = (row, per) => row.map((value, k) => value * length ** (k % 3 - per));
    return [scaled(values, 0), scaled(slopes, 1), scaled(bends, 2)];
  }

  const ORDERS = [[0, 0, 0], [0, 1, 0], [0, 0, 1], [1, 0, 0], [0, 2, 0], [0, 0, 2], [0, 1, 1], [1, 1, 0], [1, 0, 1], [2, 0, 0]];

  // What the sides have in common: D, D_1, D_2, D_x, D_11, D_22, D_12, D_1x, D_2x, D_xx.
  function together(x, i, j) {
    const k = cell(positions, x);
    const m = cell(firsts, i);
    const n = cell(seconds, j);
    const along = [[positions, x, k], [firsts, i, m], [seconds, j, n]].map(
      ([nodes, at, low]) => endPolynomials(at - nodes[low], nodes[low + 1] - nodes[low]));
    const out = new Array(ORDERS.length).fill(0);
    for (let a = 0; a < 6; a++) {
      for (let b = 0; b < 6; b++) {
        for (let c = 0; c < 6; c++) {
          const node = ((k + Math.floor(a / 3)) * firsts.length + m + Math.floor(b / 3)) * seconds.length + n + Math.floor(c / 3);
          const value = hermite[node * AT_NODE + (a % 3) * 9 + (c % 3) * 3 + (b % 3)];
          for (let q = 0; q < ORDERS.length; q++) {
            const [p, r, s] = ORDERS[q];
            out[q] += along[0][p][a] * along[1][r][b] * along[2][s][c] * value;
          }
        }
      }
    }
    return out;
  }

  // The quantities of the page's data in SI units; null outside the table.
  function evaluate(x, i, j) {
    const inside = x >= positions[0] && x <= last(positions) && i >= firsts[0] && i <= last(firsts) && j >= seconds[0] && j <= last(seconds);
    if (!inside) return null;
    const one = alone.evaluate(i, half - x);
    const two = alone.evaluate(j, half + x);
    const shared = together(x, i, j);
    const apart = [one[0] + two[0], one[1], two[1], one[2] - two[2], one[3], two[3], 0, one[4], -two[4], -one[5] - two[5]];
    return shared.map((value, k) => value + apart[k]);
  }

  const guard = { ...data.guard, limit: data.guard.limit.map((levels) => levels.map((rows) => rows.map(doubles))) };

  // The current of side 1 up to which a level is not reached, as `pair_limit_at` says it; inside the map.
  function limitAt(relation, level, x, other) {
    const limit = guard.limit[relation][level];
    const t = (x - guard.position) * guard.per_position;
    const s = (other - guard.other) * guard.per_other;
    const m = Math.min(Math.trunc(t), limit.length - 2);
    const n = Math.min(Math.trunc(s), limit[0].length - 2);
    const low = limit[m][n] + (limit[m][n + 1] - limit[m][n]) * (s - n);
    const high = limit[m + 1][n] + (limit[m + 1][n + 1] - limit[m + 1][n]) * (s - n);
    return low + (high - low) * (t - m);
  }

  // Limits of both sides in A and the region's number, as the guard of a pair says.
  function judge(x, i, j) {
    const size = [Math.abs(i), Math.abs(j)];
    const within = size[0] <= guard.other_end && size[1] <= guard.other_end && x >= guard.position && x <= guard.position_end;
    if (!within) return { limits: null, region: 2 };
    const relation = i * j > 0 ? 1 : 0;
    const levels = data.levels.map((_, k) => k);
    const limits = [levels.map((k) => limitAt(relation, k, x, size[1])), levels.map((k) => limitAt(relation, k, -x, size[0]))];
    const regions = limits.map((limit, side) => (!(size[side] <= last(limit)) ? 2 : size[side] <= limit[0] ? 0 : 1));
    return { limits, region: Math.max(...regions) };
  }

  function sentence(judged, i, j) {
    if (!judged.limits) return "outside the map";
    const size = [Math.abs(i), Math.abs(j)];
    const how = i === 0 || j === 0 ? "one side on" : `both sides on, ${data.relations[i * j > 0 ? 1 : 0]}`;
    const level = judged.region === 2 ? data.levels.length - 1 : 0;
    const side = size[1] - judged.limits[1][level] > size[0] - judged.limits[0][level] ? 1 : 0;
    const limit = judged.limits[side][level];
    const where = `${data.levels[level]} T in its iron or the armature`;
    if (judged.region === 0) return `${how}: side ${side + 1} stays below ${where} up to ${number(limit)} A`;
    if (limit < 0) return `${how}: the current of side ${2 - side} alone may bring ${data.levels[level]} T in the armature`;
    return `${how}: above the ${number(limit)} A up to which side ${side + 1} stays below ${where}`;
  }

  const part = (name) => document.getElementById(`pair-explorer-${name}`);
  const write = (name, text) => {
    for (const place of document.querySelectorAll(`#pair-explorer [data-out="${name}"]`)) place.textContent = text;
  };
  const state = { ...data.start };
  const quantity = (name) => data.quantities.findIndex((one) => one.name === name);

  const FINE = 141;
  const LINES = 49;
  const CUT = 121;
  const ends = { first: [firsts[0], last(firsts)], second: [seconds[0], last(seconds)] };

  function regions() {
    const i = even(...ends.first, FINE);
    const j = even(...ends.second, FINE);
    const colours = data.fills.flatMap((fill, k) => [[k / 3, fill], [(k + 1) / 3, fill]]);
    return {
      type: "heatmap", x: i, y: j, z: j.map((b) => i.map((a) => judge(state.position, a, b).region)), zmin: 0, zmax: 2,
      colorscale: colours, showscale: false, hoverinfo: "skip", name: "regions",
    };
  }

  const legend = () => data.regions.map((name, k) => ({
    type: "scatter", mode: "markers", x: [null], y: [null], name, marker: { symbol: "square", size: 12, color: data.fills[k] },
  }));

  function contours(name) {
    const k = quantity(name);
    const i = even(...ends.first, LINES);
    const j = even(...ends.second, LINES);
    const z = j.map((b) => i.map((a) => evaluate(state.position, a, b)[k] * data.quantities[k].scale));
    return explorerParts.contours(data.quantities[k], i, j, z, "%{x:.4g} A, %{y:.4g} A");
  }

  const cross = () => explorerParts.cross(state.first, state.second);

  function mapTraces() {
    const name = part("lines").value;
    return [regions(), ...legend(), ...(name ? [contours(name)] : []), cross()];
  }

  const force = quantity("force");

  // The force along one of the variables, the others as they stand, and the point of the sliders.
  function cut(values, here, at, scale) {
    return [
      { type: "scatter", mode: "lines", x: values.map((v) => v * scale), y: values.map((v) => at(v)[force]), line: { color: "#0072B2", width: 1.8 },
        name: "force", hovertemplate: "%{x:.4g}: %{y:.5g} N<extra></extra>" },
      { type: "scatter", mode: "markers", x: [here * scale], y: [at(here)[force]], marker: { size: 10, color: "#0072B2" }, hoverinfo: "skip" },
    ];
  }
  const overFirst = () => cut(even(...ends.first, CUT), state.first, (v) => evaluate(state.position, v, state.second), 1);
  const overPosition = () =>
    cut(even(positions[0], last(positions), CUT), state.position, (v) => evaluate(v, state.first, state.second), 1e3);

  const look = data.look;
  const mapLook = {
    ...look, height: 460,
    xaxis: { ...look.xaxis, title: { text: "current of side 1 in A" }, range: ends.first },
    yaxis: { ...look.yaxis, title: { text: "current of side 2 in A" }, range: ends.second },
  };
  const cutLook = (x, range) => {
    const made = explorerParts.cutLook(look, x, "force towards side 1 in N", range);
    return { ...made, yaxis: { ...made.yaxis, rangemode: "normal" } };
  };
  const plots = {
    map: report.add(part("map"), mapTraces(), mapLook),
    first: report.add(part("first-cut"), overFirst(), cutLook("current of side 1 in A", ends.first)),
    position: report.add(part("along"), overPosition(), cutLook("position in mm", [positions[0] * 1e3, last(positions) * 1e3])),
  };

  const ROUNDING = 1e-10; // of a quantity's largest value: less is nothing

  function tell() {
    const { position, first, second } = state;
    const values = evaluate(position, first, second);
    const judged = judge(position, first, second);
    data.quantities.forEach(({ name, unit, scale, largest }, k) => {
      write(name, `${number((Math.abs(values[k]) < ROUNDING * largest ? 0 : values[k]) * scale, 5)} ${unit}`);
    });
    write("gaps", `${number((half - position) * 1e3)}, ${number((half + position) * 1e3)} mm`);
    data.levels.forEach((_, k) => [0, 1].forEach((side) => {
      const limit = judged.limits && judged.limits[side][k];
      write(`limit_${side}_${k}`, !judged.limits ? "outside the map" : limit < 0 ? "none" : `${number(limit)} A`);
    }));
    write("region", data.regions[judged.region]);
    document.querySelector('#pair-explorer [data-out="region"]').className = data.regions[judged.region];
    write("reason", sentence(judged, first, second));
  }

  let waiting = false;
  let moved = false; // the map's regions are those of another position
  function show() {
    tell();
    if (waiting) return; // figures once a frame, however fast a slider moves
    waiting = true;
    requestAnimationFrame(() => {
      waiting = false;
      if (moved) plots.map.data = mapTraces();
      else plots.map.data[plots.map.data.length - 1] = cross();
      moved = false;
      plots.first.data = overFirst();
      plots.position.data = overPosition();
      Object.values(plots).forEach(report.draw);
    });
  }

  function go(position, first, second) {
    if (Number.isFinite(position)) {
      const asked = clip(position, positions[0], last(positions));
      moved = moved || asked !== state.position;
      state.position = asked;
    }
    if (Number.isFinite(first)) state.first = clip(first, ...ends.first);
    if (Number.isFinite(second)) state.second = clip(second, ...ends.second);
    Object.entries(shown).forEach(([name, tellHandle]) => tellHandle(state[name]));
    show();
  }

  const asked = (name, value) => go(...["position", "first", "second"].map((one) => (one === name ? value : NaN)));
  const shown = {
    position: explorerParts.handle("pair-explorer", "position", positions[0], last(positions), 1e3, asked),
    first: explorerParts.handle("pair-explorer", "first", ...ends.first, 1, asked),
    second: explorerParts.handle("pair-explorer", "second", ...ends.second, 1, asked),
  };
  part("lines").addEventListener("change", () => {
    plots.map.data = mapTraces();
    report.draw(plots.map);
  });
  explorerParts.onClick(part("map"), (x, y) => go(NaN, x, y));
  go(state.position, state.first, state.second);
  return { evaluate, judge, go, state };
})();
