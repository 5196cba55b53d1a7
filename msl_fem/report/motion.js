"use strict";
// Plays the places of the mover, computed beforehand, thirty frames a second; nothing moves before it is asked to.
const motion = (() => {
  const root = document.getElementById("motion");
  const data = JSON.parse(root.querySelector("[data-motion]").textContent);
  const blocks = [...root.querySelectorAll("[data-track]")];
  const now = (name) => root.querySelector(`[data-now="${name}"]`);
  const button = root.querySelector("button");
  const frame = root.querySelector("input");
  const PAUSE = 1000 / 30;
  let timer = null;
  const to = (element, x) => element.setAttribute("transform", `translate(${x} 0)`);

  function show(n) {
    frame.value = n;
    blocks.forEach((block, k) => to(block, data.places[k][n]));
    to(now("measured"), data.places[0][n]);
    to(now("cursor"), data.cursor[n]);
    root.querySelector('[data-out="time"]').textContent = data.time[n];
  }
  function stop() {
    clearInterval(timer);
    timer = null;
    button.textContent = "play";
  }
  function play() {
    const last = data.time.length - 1;
    if (Number(frame.value) === last) show(0);
    button.textContent = "stop";
    timer = setInterval(() => { if (Number(frame.value) === last) stop(); else show(Number(frame.value) + 1); }, PAUSE);
  }
  button.addEventListener("click", () => { if (timer) stop(); else play(); });
  frame.addEventListener("input", () => { stop(); show(Number(frame.value)); });
  window.addEventListener("beforeprint", stop);
  return { show, play, stop };
})();
