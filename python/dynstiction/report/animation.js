"use strict";
(() => {
  const get = (id) => document.getElementById(id);
  const frames = JSON.parse(get("frames").textContent);
  const count = frames.time.length;
  const width = 520, height = 190, radius = 92, trailLength = 60, seconds = 20;
  const largest = Math.max(...frames.x.map((x, i) => Math.hypot(x, frames.y[i]))) || 1;
  const [low, high] = frames.range;
  const start = frames.span[0], end = frames.span[1];
  const tipX = (i) => radius * frames.x[i] / largest;
  const tipY = (i) => -radius * frames.y[i] / largest;
  const placeX = (i) => width * (frames.time[i] - start) / (end - start);
  const placeY = (i) => height * (1 - (frames.force[i] - low) / ((high - low) || 1));
  const set = (id, values) => Object.entries(values).forEach(([key, value]) => get(id).setAttribute(key, value));
  const points = (indices, x, y) => indices.map((i) => x(i).toFixed(1) + "," + y(i).toFixed(1)).join(" ");
  const all = Array.from({ length: count }, (_, i) => i);

  set("trace", { points: points(all, placeX, placeY) });
  set("frame", { max: count - 1 });
  get("top").textContent = "spring force kₓuₓ, " + low.toPrecision(4) + " to " + high.toPrecision(4) + " N";
  get("first").textContent = start + " s";
  get("last").textContent = end + " s";

  function show(i) {
    const x = tipX(i), y = tipY(i), angle = Math.atan2(y, x) * 180 / Math.PI;
    set("vector", { x2: x, y2: y });
    set("head", { transform: "translate(" + x + " " + y + ") rotate(" + angle + ")" });
    set("trail", { points: points(all.slice(Math.max(0, i - trailLength), i + 1), tipX, tipY) });
    set("place", { x1: placeX(i), x2: placeX(i) });
    set("dot", { cx: placeX(i), cy: placeY(i) });
    get("clock").textContent = "t = " + frames.time[i].toFixed(3) + " s";
    get("now").textContent = "X = " + frames.position[i].toPrecision(4) + " mm";
    get("frame").value = i;
  }

  let playing = false, origin = 0;
  function tick(now) {
    if (!playing) return;
    const i = Math.floor((now - origin) / (1000 * seconds) * count);
    if (i >= count) {
      pause();
      show(count - 1);
      return;
    }
    show(i);
    requestAnimationFrame(tick);
  }
  function pause() {
    playing = false;
    get("play").textContent = "Play";
  }
  get("play").addEventListener("click", () => {
    if (playing) {
      pause();
      return;
    }
    playing = true;
    get("play").textContent = "Pause";
    const from = Number(get("frame").value) % (count - 1);
    origin = performance.now() - 1000 * seconds * from / count;
    requestAnimationFrame(tick);
  });
  get("frame").addEventListener("input", () => {
    pause();
    show(Number(get("frame").value));
  });
  show(Math.floor(count / 8));
})();
