// The page: time, camera, read-outs and the strip of foot contacts.

const element = (id) => document.getElementById(id);
const data = JSON.parse(element("replay").textContent);
const robots = data.robots.map((r) => new Robot(r, data.dt));
const own = data.meshes.map((m) => new Mesh(m));
const duration = Math.max(...robots.map((r) => r.duration), data.dt);
let scene = element("scene");
const slider = element("time"), strip = element("strip");
const player = element("player"), embedded = player.classList.contains("embedded");
const play = element("play"), clock = element("clock"), speed = element("speed");
const panes = Array.from(document.querySelectorAll(".pane"));
const still = window.matchMedia("(prefers-reduced-motion: reduce)");
// Small robots are seen from nearer.
const reach = Math.max(...robots.map((r) => r.reach));
const home = { azimuth: -2.15, elevation: 0.38, distance: 3.7 * reach };
const camera = { ...home };
let colors = palette();
let time = 0, playing = !still.matches, visible = true, dirty = true, last = null, renderer = null;

function parameter(name) {
  const found = location.hash.slice(1).split("&").find((p) => p === name || p.startsWith(name + "="));
  return found === undefined ? null : found.slice(name.length + 1);
}

function makeRenderer() {
  if (parameter("flat") === null) {
    try { return new WebGlRenderer(scene, own); } catch (problem) { console.warn("drawn flat:", problem); }
  }
  element("flat").hidden = false;
  // A canvas that has once given a WebGL context refuses any other.
  const fresh = scene.cloneNode();
  scene.replaceWith(fresh);
  scene = fresh;
  return new FlatRenderer(scene, own);
}

/** Rectangles of the panes in pixels of the canvas, from its lower left. */
function boxes() {
  const whole = scene.getBoundingClientRect(), ratio = scene.width / whole.width;
  return panes.map((pane) => {
    const b = pane.getBoundingClientRect();
    return [b.left - whole.left, whole.bottom - b.bottom, b.width, b.height].map((x) => Math.round(x * ratio));
  });
}

function viewOf(state, aspect, ground) {
  // On uneven ground the camera climbs with the robot.
  const target = [state.follow[0], state.follow[1], ground ? state.follow[2] : state.height];
  const { azimuth, elevation } = camera;
  // Narrow panes step back so that the robot's length still fits.
  const distance = camera.distance * Math.max(1, 1.25 / aspect);
  const eye = add(target, [
    distance * Math.cos(elevation) * Math.cos(azimuth),
    distance * Math.cos(elevation) * Math.sin(azimuth),
    distance * Math.sin(elevation),
  ]);
  if (!ground) { eye[2] = Math.max(eye[2], 0.03); }
  return { eye, target, matrix: cameraMatrix(eye, target, 0.62, aspect, Math.min(0.05, 0.1 * camera.distance), 60) };
}

function signed(x) {
  const text = Math.abs(x).toFixed(2);
  return (x >= 0 || text === "0.00" ? "+" : "\u2212") + text;
}

function draw() {
  const ratio = window.devicePixelRatio || 1;
  [[scene, scene.clientWidth, scene.clientHeight], [strip, strip.clientWidth, strip.clientHeight]].forEach(([c, w, h]) => {
    const [width, height] = [Math.max(1, Math.round(w * ratio)), Math.max(1, Math.round(h * ratio))];
    if (c.width !== width || c.height !== height) { c.width = width; c.height = height; }
  });
  boxes().forEach((box, i) => {
    const state = robots[i].at(time);
    const { ground } = robots[i], view = viewOf(state, box[2] / Math.max(box[3], 1), ground);
    renderer.draw(shapes(robots[i], state, colors), view, box, colors, ground);
    panes[i].querySelectorAll("tbody tr").forEach((row, k) => {
      row.cells[1].textContent = signed(state.command[k]);
      row.cells[2].textContent = signed(state.velocity[k]);
    });
  });
  if (!strip.hidden) { drawStrip(ratio); }
  document.dispatchEvent(new CustomEvent("gaitfit-time", { detail: time }));
  clock.textContent = time.toFixed(2) + " / " + duration.toFixed(2) + " s";
  slider.value = time;
}

/** A bar wherever a foot touches the ground, a row a foot, robots below one another. */
function drawStrip(ratio) {
  const pen = strip.getContext("2d"), row = 15, label = 64, thumb = 8;
  const width = strip.clientWidth - label - 2 * thumb;
  const x = (t) => label + thumb + width * t / duration;
  const style = getComputedStyle(document.documentElement);
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, strip.clientWidth, strip.clientHeight);
  pen.font = "12px system-ui, sans-serif";
  pen.textBaseline = "middle";
  let y = 0;
  robots.forEach((robot) => {
    if (robots.length !== 1) {
      pen.fillStyle = style.getPropertyValue("--ink");
      pen.fillText(robot.name, 0, y + row / 2);
      y += row;
    }
    robot.feet.forEach((name, foot) => {
      pen.fillStyle = style.getPropertyValue("--track");
      pen.fillRect(x(0), y + 2, x(robot.duration) - x(0), row - 4);
      pen.fillStyle = style.getPropertyValue("--contact");
      robot.stretches[foot].forEach(({ from, to }) =>
        pen.fillRect(x(from), y + 2, Math.max(x(to) - x(from), 0.5), row - 4));
      pen.fillStyle = style.getPropertyValue("--soft");
      pen.fillText(name, 0, y + row / 2, label - 6);
      y += row;
    });
    y += 8;
  });
  pen.fillStyle = style.getPropertyValue("--ink");
  pen.fillRect(x(time) - 0.75, 0, 1.5, y - 8);
}

function setPlaying(on) {
  if (on && time >= duration) { time = 0; }
  playing = on;
  last = null;
  play.textContent = on ? "Pause" : "Play";
  dirty = true;
}

function seek(t) {
  time = Math.max(0, Math.min(duration, t));
  dirty = true;
}

function tick(now) {
  if (playing && visible) {
    // A hidden page halts; do not leap when it returns.
    const passed = last === null ? 0 : Math.min((now - last) / 1000, 0.5);
    last = now;
    time += passed * Number(speed.value);
    if (time >= duration) { time = element("loop").checked ? 0 : duration; }
    if (time === duration) { setPlaying(false); }
    dirty = true;
  }
  if (dirty && visible) { dirty = false; draw(); }
  requestAnimationFrame(tick);
}

function orbit() {
  const fingers = new Map();
  const spread = () => {
    const [a, b] = Array.from(fingers.values());
    return Math.hypot(a.x - b.x, a.y - b.y);
  };
  const zoom = (factor) => {
    camera.distance = Math.max(0.9 * reach, Math.min(22 * reach, camera.distance * factor));
    dirty = true;
  };
  const stage = element("stage");
  stage.addEventListener("pointerdown", (e) => {
    fingers.set(e.pointerId, { x: e.clientX, y: e.clientY });
    stage.setPointerCapture(e.pointerId);
  });
  stage.addEventListener("pointermove", (e) => {
    const before = fingers.get(e.pointerId);
    if (!before) { return; }
    const apart = fingers.size === 2 ? spread() : 0;
    fingers.set(e.pointerId, { x: e.clientX, y: e.clientY });
    if (fingers.size === 2) {
      zoom(apart / Math.max(spread(), 1));
    } else {
      camera.azimuth -= (e.clientX - before.x) * 0.008;
      camera.elevation = Math.max(-0.05, Math.min(1.5, camera.elevation + (e.clientY - before.y) * 0.006));
    }
    dirty = true;
  });
  ["pointerup", "pointercancel"].forEach((kind) => stage.addEventListener(kind, (e) => fingers.delete(e.pointerId)));
  stage.addEventListener("wheel", (e) => {
    // Within a report the wheel scrolls the page until the player has been clicked.
    if (embedded && !player.contains(document.activeElement)) { return; }
    e.preventDefault();
    zoom(Math.exp(e.deltaY * 0.001));
  }, { passive: false });
  stage.addEventListener("dblclick", () => { Object.assign(camera, home); dirty = true; });
}

function keys(e) {
  if (e.ctrlKey || e.metaKey || e.altKey || e.target.tagName === "SELECT") { return; }
  const actions = {
    " ": () => setPlaying(!playing),
    ArrowLeft: () => seek(time - (e.shiftKey ? 1 : data.dt)),
    ArrowRight: () => seek(time + (e.shiftKey ? 1 : data.dt)),
    Home: () => seek(0),
    End: () => seek(duration),
  };
  if (actions[e.key] && !(e.key === " " && e.target === play)) {
    e.preventDefault();
    actions[e.key]();
  }
}

function start() {
  renderer = makeRenderer();
  slider.max = duration;
  slider.step = data.dt;
  strip.style.height = robots.reduce((sum, r) => sum + 15 * (r.feet.length + (robots.length === 1 ? 0 : 1)) + 8, -8) + "px";
  strip.hidden = robots.every((r) => r.feet.length === 0);
  document.addEventListener("gaitfit-seek", (e) => { setPlaying(false); seek(e.detail); });
  slider.addEventListener("input", () => { setPlaying(false); seek(Number(slider.value)); });
  const scrub = (e) => {
    const width = strip.clientWidth - 64 - 16;
    seek((e.clientX - strip.getBoundingClientRect().left - 72) / width * duration);
  };
  strip.addEventListener("pointerdown", (e) => { strip.setPointerCapture(e.pointerId); setPlaying(false); scrub(e); });
  strip.addEventListener("pointermove", (e) => { if (e.buttons !== 0) { scrub(e); } });
  play.addEventListener("click", () => setPlaying(!playing));
  (embedded ? player : document).addEventListener("keydown", keys);
  new ResizeObserver(() => { dirty = true; }).observe(element("stage"));
  // A player scrolled out of sight waits.
  new IntersectionObserver((seen) => {
    visible = seen[seen.length - 1].isIntersecting;
    last = null;
  }).observe(player);
  window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { colors = palette(); dirty = true; });
  scene.addEventListener("webglcontextlost", (e) => e.preventDefault());
  scene.addEventListener("webglcontextrestored", () => { renderer = new WebGlRenderer(scene, own); dirty = true; });
  orbit();
  const from = Number(parameter("t"));
  if (parameter("t") !== null && Number.isFinite(from)) { playing = false; seek(from); }
  setPlaying(playing);
  requestAnimationFrame(tick);
}

start();
