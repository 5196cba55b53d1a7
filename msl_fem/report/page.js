"use strict";
// Draws the page's figures, in light or dark colours, and again whenever the colours change or paper is wanted.
const report = (() => {
  const root = document.documentElement;
  const asked = window.matchMedia("(prefers-color-scheme: dark)");
  // The palette's colours that are too dark on a dark ground, and what stands for them there.
  const ON_DARK = {
    "#0072B2": "#4C9BE8", "#000000": "#E6E9EE", "#6b7280": "#9AA4B2", "#D55E00": "#F0793A", "#009E73": "#19C294",
    "#56B4E9": "#9BD4F5",
  };
  const PAPER_WIDTH = 690; // CSS pixels between the margins of A4
  const NARROW = 600; // CSS pixels of a telephone's window
  const FEW = 6; // names in a legend that stand above a figure without taking its room
  const ENTRY = 20; // CSS pixels of a name
  const LETTER = 7; // CSS pixels of a title's letter there
  const drawn = [];
  const listeners = [];
  let chosen = null;
  let onPaper = false;
  try { chosen = localStorage.getItem("msl-fem-theme"); } catch (refused) { /* a page in a sandbox keeps nothing */ }

  const theme = () => (onPaper ? "light" : chosen || (asked.matches ? "dark" : "light"));
  const colour = (name) => getComputedStyle(root).getPropertyValue(name).trim();
  const shown = (original) => (theme() === "dark" && ON_DARK[original]) || original;

  function dressTrace(trace) {
    const made = { ...trace };
    for (const part of ["line", "marker"]) {
      if (trace[part]) {
        made[part] = { ...trace[part] };
        if (typeof trace[part].color === "string") made[part].color = shown(trace[part].color);
        if (part === "marker" && trace.marker.line && typeof trace.marker.line.color === "string") {
          made.marker.line = { ...trace.marker.line, color: shown(trace.marker.line.color) };
        }
      }
    }
    return made;
  }

  // A picture of a fixed shape on a narrow screen: as high as it needs, no more.
  function fitHeight(layout) {
    const margin = layout.margin || {};
    const wide = Math.min(window.innerWidth - 40, 740) - (margin.l || 0) - (margin.r || 0);
    layout.height = Math.min(layout.height, Math.round(wide * layout.meta.shape) + (margin.t || 0) + (margin.b || 0));
  }

  // A title in lines no longer than its axis, on a narrow screen in smaller letters.
  function fitTitle(axis, across, layout) {
    const [from, to] = axis.domain || [0, 1];
    const { t = 0, b = 0 } = layout.margin || {};
    const room = (across ? 0.62 * (window.innerWidth - 40) : (layout.height || 420) - t - b) * (to - from);
    const lines = [""];
    for (const word of axis.title.text.split(" ")) {
      const longer = `${lines[lines.length - 1]} ${word}`.trim();
      if (longer.length * LETTER > room && lines[lines.length - 1]) lines.push(word);
      else lines[lines.length - 1] = longer;
    }
    const ticks = across && to - from < 0.6 ? { nticks: 3, tickangle: 0 } : {}; // beside another figure
    return { ...axis, ...ticks, automargin: true, title: { ...axis.title, text: lines.join("<br>"), font: { size: 13 } } };
  }

  function dressLayout(layout, keep) {
    const made = { ...layout, font: { ...layout.font, color: colour("--ink") } };
    for (const key of Object.keys(layout).filter((name) => /^[xy]axis\d*$/.test(name))) {
      made[key] = { ...layout[key], linecolor: colour("--soft"), gridcolor: colour("--rule") };
      const now = keep && keep[key];
      if (window.innerWidth <= NARROW && !onPaper && layout[key].title && layout[key].title.text) {
        made[key] = fitTitle(made[key], key.startsWith("x"), layout);
      }
      if (now && now.autorange === false && layout[key].range === undefined) made[key].range = now.range.slice();
    }
    made.hoverlabel = { bgcolor: colour("--panel"), bordercolor: colour("--rule"), font: { color: colour("--ink") } };
    made.modebar = { ...layout.modebar, color: colour("--soft"), activecolor: colour("--accent") };
    if (made.meta && made.meta.shape) fitHeight(made);
    if (onPaper) made.width = PAPER_WIDTH * Math.min(1, made.paperShare || 1);
    delete made.paperShare;
    return made;
  }

  const CONFIG = {
    displaylogo: false, responsive: true,
    modeBarButtonsToRemove: ["select2d", "lasso2d", "copyLink", "sendDataToCloud"],
  };
  function draw(figure) {
    const config = onPaper ? { ...CONFIG, responsive: false } : CONFIG;
    const layout = dressLayout(figure.layout, figure.div._fullLayout);
    const named = figure.data.filter((trace) => trace.name && trace.showlegend !== false).length;
    const tall = window.innerWidth <= NARROW && !onPaper && named > FEW;
    if (tall) layout.height = (layout.height || 420) + ENTRY * named;
    if (tall || (layout.meta && layout.meta.shape)) figure.div.style.height = layout.height + "px";
    return Plotly.react(figure.div, figure.data.map(dressTrace), layout, config);
  }

  function add(div, data, layout) {
    const figure = { div, data, layout };
    drawn.push(figure);
    draw(figure);
    return figure;
  }

  function recolour() {
    root.dataset.theme = theme();
    const button = document.getElementById("theme");
    if (button) button.textContent = theme() === "dark" ? "light" : "dark";
    drawn.forEach(draw);
    listeners.forEach((listener) => listener());
  }

  function paper(wanted) {
    onPaper = wanted;
    recolour();
  }

  const button = document.getElementById("theme");
  if (button) button.addEventListener("click", () => {
    const wanted = theme() === "dark" ? "light" : "dark";
    chosen = wanted === (asked.matches ? "dark" : "light") ? null : wanted; // the system's own needs no choice
    try {
      if (chosen) localStorage.setItem("msl-fem-theme", chosen); else localStorage.removeItem("msl-fem-theme");
    } catch (refused) { /* then for this visit alone */ }
    recolour();
  });
  asked.addEventListener("change", recolour);
  window.addEventListener("beforeprint", () => paper(true));
  window.addEventListener("afterprint", () => paper(false));
  root.dataset.theme = theme();
  if (button) button.textContent = theme() === "dark" ? "light" : "dark";
  for (const text of document.querySelectorAll("script[data-figure]")) {
    const figure = JSON.parse(text.textContent);
    add(document.getElementById(text.dataset.figure), figure.data, figure.layout);
  }
  return { add, draw, colour, shown, theme, paper, whenRecoloured: (listener) => listeners.push(listener) };
})();
