// The page itself: what is shown, what is chosen, what is said of it.

const $ = id => document.getElementById(id);
const DRAWN = ["cloud", "surface"]; // what of the ground is drawn
const NO_FIGURES = { sigma_m: null, plan_m: null, confidence: null };
const HOME_TILTS = [0.87, 0.78, 0.69, 0.6]; // from straight down, rad

class View {
  constructor(canvas, gl) {
    this.canvas = canvas;
    this.scene = JSON.parse($("scene").textContent);
    this.cloud = new Cloud(this.scene);
    this.surface = this.scene.surface ? new Surface(this.scene) : null;
    this.drawing = new Drawing(gl, this.scene, this.cloud.steps, this.cloud.looks);
    this.eye = new Eye();
    this.modes = [...document.querySelectorAll("#modes input")].map(input => input.value);
    this.mode = this.modes[0];
    this.pointScale = 1;
    this.exaggeration = this.scene.exaggeration;
    this.share = Math.min(1, 1.2e6 / this.scene.shown);
    this.chosen = null;
    this.measuring = false;
    this.measured = [];
    this.errors = new Errors(this.scene);
    this.panel = new Panel(this);
    this.hands = new Hands(canvas, this);
    this.bounds();
    this.measureCanvas();
    new ResizeObserver(() => this.resized()).observe(canvas);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.signs());
    this.home();
    this.signs();
    this.draw(1); // writes the scale, whose card bounds the room that home has
    this.home();
    this.fromAddress();
    this.still(0);
    this.hands.focus();
  }

  // How near and far one may go, and the ball that holds everything.
  bounds() {
    const { scene } = this, centres = scene.photographs.map(p => p.centre_m);
    const points = scene.points.map(p => local(scene, p.surveyed_map_m));
    const ends = [scene.low_m, scene.high_m, ...centres, ...points];
    if (this.surface) ends.push(this.surface.low, this.surface.high);
    const low = [0, 1, 2].map(k => Math.min(...ends.map(p => p[k])));
    const high = [0, 1, 2].map(k => Math.max(...ends.map(p => p[k])));
    this.middle = low.map((value, k) => (value + high[k]) / 2);
    this.radius = Math.hypot(...low.map((value, k) => high[k] - value)) / 2 + 2 * scene.frustum_m;
    this.eye.nearest = Math.max(2 * scene.spacing_m, 1e-4 * this.radius);
    this.eye.box = [low, high];
    this.everything = [...scene.outline_m, ...centres];
  }

  // ---- where one stands ----

  stand(azimuth, tilt, points) {
    Object.assign(this.eye, { azimuth, tilt });
    const narrow = this.eye.width < 736, side = id => $(id).getBoundingClientRect();
    const margin = { left: 20, right: narrow || !$("panel").open ? 36 : this.eye.width - side("panel").left + 20,
      top: side("title").bottom + 12, bottom: this.eye.height - side("keysheet").top + 12 };
    this.eye.fit(points, margin);
  }

  // From the south, onto the ground that was surveyed: photographs are seen as far as they are in the picture.
  // As oblique as still fills the height of the picture: a narrow screen looks more steeply down.
  home() {
    for (const tilt of HOME_TILTS) {
      this.stand(0, tilt, this.scene.outline_m);
      if (this.eye.filled > 0.8) return;
    }
  }

  go(where) {
    const { eye } = this, from = eye.state();
    if (where === "home") this.home();
    if (where === "oblique") eye.tilt = HOME_TILTS[0];
    if (where === "top") [eye.tilt, eye.azimuth] = [0, 0];
    if (where === "north") eye.azimuth = 0;
    if (where === "whole") this.stand(eye.azimuth, eye.tilt, this.everything);
    this.fly(from, eye.state());
  }

  // What the hand comes nearer to: the ground under the pixel; over the sky what is in the middle, or nearest to it.
  ground(x, y) {
    const { eye } = this, middle = [eye.width / 2, eye.height / 2], now = performance.now();
    const kept = this.kept;
    const still = kept && now - kept.time < 600 && Math.hypot(x - kept.x, y - kept.y) < 8;
    if (kept && (still || this.hands.held.size === 2)) {
      kept.time = now;
      return kept;
    }
    const under = this.under(x, y), hit = under || this.under(...middle);
    const place = hit ? hit.place : this.cloud.nearestTo(eye, ...middle);
    return this.kept = { x, y, time: now, place, under: Boolean(under) };
  }

  // What is seen at a pixel, of the surface and of the cloud the one in front; where neither is shown, of the cloud.
  under(x, y) {
    const { eye, cloud } = this, shown = this.panel.shown();
    const face = shown.surface ? this.surface.under(eye, x, y) : null;
    const point = shown.cloud || !shown.surface ? cloud.under(eye, x, y, this.size()) : null;
    if (!point || (face && face.depth < point.depth - 3 * this.scene.spacing_m)) return face;
    return { ...point, place: cloud.place(point.index) };
  }

  zoom(factor, x = this.eye.width / 2, y = this.eye.height / 2) {
    const { eye } = this, { place, under } = this.ground(x, y);
    eye.zoomAbout(place, factor);
    // over the sky the ground comes into the middle
    if (!under && factor < 1) eye.target = place.map((value, k) => value + factor * (eye.target[k] - value));
  }

  fly(from, to) {
    this.stop();
    if (matchMedia("(prefers-reduced-motion: reduce)").matches) {
      this.eye.between(from, to, 1);
      this.still(0);
      return;
    }
    this.eye.between(from, to, 0);
    this.flight = { from, to, begun: performance.now() };
    this.moved();
  }

  stop() { this.flight = null; }

  centre(x, y) {
    const hit = this.under(x, y);
    if (!hit) return;
    const from = this.eye.state();
    this.fly(from, { ...from, target: hit.place });
  }

  goTo(place) {
    const from = this.eye.state();
    this.fly(from, { ...from, target: [...place], distance: Math.min(this.eye.distance, 0.4 * this.scene.extent_m) });
  }

  // ---- what is drawn ----

  measureCanvas() {
    const { canvas, eye } = this, ratio = Math.min(devicePixelRatio || 1, 2);
    [eye.width, eye.height] = [canvas.clientWidth || 1, canvas.clientHeight || 1];
    canvas.width = Math.max(1, Math.round(eye.width * ratio));
    canvas.height = Math.max(1, Math.round(eye.height * ratio));
    eye.farthest = 5 * this.radius * Math.max(1, eye.height / eye.width);
  }

  resized() {
    this.measureCanvas();
    this.draw(1);
  }

  // Wide enough to close the gaps between neighbours; where the cloud is thinned these are uneven.
  size() {
    const { scene } = this, cover = scene.shown < scene.total ? 2.3 : 1.6;
    return { metres: scene.spacing_m * this.pointScale * cover, pixels: 48 };
  }

  signs() {
    placeSigns(this.drawing, this.scene, this.exaggeration);
    this.choice();
  }

  choice() {
    placeChoice(this.drawing, this.scene, this.chosen, this.measured);
    this.still(0);
  }

  range() {
    return this.mode === "confidence" ? [0, 1] : this.scene[this.mode === "colour" ? "height" : this.mode];
  }

  // Something has moved: draw soon, as much of the cloud as can be drawn in time.
  moved() {
    clearTimeout(this.timer);
    this.panel.tip(null);
    if (this.asked) return;
    this.asked = true;
    requestAnimationFrame(now => {
      this.asked = false;
      this.pace(now);
      if (this.flight) this.step(now);
      this.draw(this.share);
    });
  }

  // Draw fewer points where pictures come slowly, more where they come fast.
  pace(now) {
    const took = now - (this.lastFrame || 0);
    this.lastFrame = now;
    if (took > 300 && !this.slow) { this.slow = took < 2000; return; }
    this.slow = false;
    if (took > 42) this.share = Math.max(this.share * 0.8, Math.min(1, 4e4 / this.scene.shown));
    else if (took < 21) this.share = Math.min(this.share * 1.1, 1);
  }

  step(now) {
    const { from, to, begun } = this.flight, share = clamp((now - begun) / 450, 0, 1);
    this.eye.between(from, to, share * share * (3 - 2 * share));
    if (share < 1) {
      this.moved();
    } else {
      this.flight = null;
      this.still(0);
    }
  }

  // All is still: draw everything, and turn about what is seen in the middle from now on.
  still(wait = 120) {
    clearTimeout(this.timer);
    this.timer = setTimeout(() => {
      if (this.flight) return;
      this.draw(1);
      const hit = this.under(this.eye.width / 2, this.eye.height / 2);
      if (hit && hit.depth > 0) this.eye.rest(hit.depth);
      this.hover(this.hands.pointer);
      this.toAddress();
    }, wait);
  }

  draw(share) {
    const { eye, drawing, panel, radius, middle } = this, at = eye.seen(middle)[2];
    const near = eye.parallel ? at - radius : Math.max(at - radius, eye.distance * 0.004);
    const shown = panel.shown();
    for (const name of ["photographs", "control", "check"]) {
      drawing.show(name, shown[name]);
      for (const kind of ["casing", "errors"]) drawing.show(`${name} ${kind}`, shown[name] && shown.errors);
    }
    if (shown.surface) drawing.mesh ||= new Mesh(drawing, this.surface, () => this.still(0));
    drawing.draw(eye, {
      cloud: shown.cloud, surface: shown.surface, mode: this.mode, range: this.range(), size: this.size(), pointScale: this.pointScale,
      background: colourOf("--sky").map(value => value / 255), depths: [near, Math.max(at + radius, near * 2)],
      tolerance: Math.max(3 * this.scene.spacing_m, 6 * eye.metresPerPixel),
    }, share);
    panel.follow();
    this.canvas.dataset.drawn = share < 1 ? "part" : "all";
    this.canvas.dataset.surface = shown.surface && drawing.mesh.loaded ? "drawn" : "";
  }

  // ---- what is under the pointer ----

  // The sign or photograph within a few pixels, the nearest first.
  signAt(x, y, reach = 1) {
    const shown = this.panel.shown(), { scene, eye } = this;
    const things = [
      ...scene.points.filter(p => shown[p.role]).map(point => ({ point, place: local(scene, point.surveyed_map_m), reach: 12 })),
      ...(shown.photographs ? scene.photographs : []).map(photograph => ({ photograph, place: photograph.centre_m, ...this.body(photograph) })),
    ];
    let best = null;
    for (const thing of things) {
      const seen = eye.project(thing.place);
      const away = seen ? apart([x, y], seen, thing.end || seen) / (reach * thing.reach) : Infinity;
      if (away <= 1 && (!best || away < best.away)) best = { ...thing, away };
    }
    return best;
  }

  // Of a frustum on the screen: the middle of its open side, and how far about its axis it is clicked on.
  body(photograph) {
    const { scene, eye } = this, corners = photograph.rays.map(ray => eye.project(along(photograph.centre_m, ray, scene.frustum_m)));
    if (corners.includes(null)) return { reach: 10 };
    const end = [0, 1].map(k => corners.reduce((sum, corner) => sum + corner[k] / 4, 0));
    const half = Math.min(...corners.map(corner => Math.hypot(corner[0] - end[0], corner[1] - end[1])));
    return { end, reach: clamp(half, 10, 60) };
  }

  hover(at) {
    const thing = at && this.signAt(...at);
    this.panel.tip(thing && { name: (thing.point || thing.photograph).name, at });
    this.canvas.classList.toggle("measuring", this.measuring);
  }

  pick(x, y, reach = 1) {
    let thing = this.signAt(x, y, reach);
    const shown = this.panel.shown();
    if (!thing && (shown.cloud || shown.surface)) {
      const hit = this.under(x, y);
      if (hit && hit.kind) thing = { surface: hit.kind, cloud: NO_FIGURES, place: hit.place };
      else if (hit) thing = { cloud: this.cloud.figures(hit.index), place: hit.place };
    }
    this.choose(thing);
  }

  choose(thing) {
    if (this.measuring && thing) {
      this.measured = [...(this.measured.length === 2 ? [] : this.measured), thing];
      this.panel.sayMeasured(this.measured);
    } else if (!this.measuring) {
      this.chosen = thing;
      this.panel.sayChosen(thing);
    }
    this.choice();
  }

  measure(on) {
    this.measuring = on;
    this.measured = [];
    this.chosen = null;
    this.canvas.classList.toggle("measuring", on);
    $("measure").setAttribute("aria-pressed", String(on));
    this.panel.sayMeasured(on ? [] : null);
    this.choice();
  }

  dismiss() {
    if (this.measuring) this.measure(false); else this.choose(null);
  }

  // From the cloud to the surface, and back.
  switchDrawn() {
    if (!this.surface) return;
    this.panel.setDrawn(this.panel.shown().surface ? ["cloud"] : ["surface"]);
  }

  colourBy(index) {
    if (index < this.modes.length) this.panel.setMode(this.modes[index]);
  }

  // ---- the address, so that a view can be kept and sent ----

  toAddress() {
    const { eye, scene } = this, round = (value, digits) => Number(value.toFixed(digits));
    const facts = {
      at: eye.target.map((value, k) => round(value + scene.origin_map_m[k], 3)).join(","),
      azimuth: round(eye.azimuth * 180 / Math.PI, 3), tilt: round(eye.tilt * 180 / Math.PI, 3), distance: round(eye.distance, 3),
      colour: this.mode, parallel: eye.parallel ? 1 : 0,
    };
    if (this.surface) facts.drawn = DRAWN.filter(name => this.panel.shown()[name]).join(",");
    const text = Object.entries(facts).map(([name, value]) => `${name}=${value}`).join("&");
    history.replaceState(null, "", `#${text}`);
  }

  fromAddress() {
    const facts = new URLSearchParams(location.hash.slice(1)), { eye, scene } = this;
    const at = (facts.get("at") || "").split(",").map(Number), number = name => Number(facts.get(name) ?? NaN);
    if (at.length === 3 && at.every(Number.isFinite)) eye.target = local(scene, at);
    if (Number.isFinite(number("azimuth"))) eye.azimuth = number("azimuth") * Math.PI / 180;
    if (Number.isFinite(number("tilt"))) eye.tilt = clamp(number("tilt") * Math.PI / 180, 0, Math.PI / 2);
    if (number("distance") > 0) eye.distance = clamp(number("distance"), eye.nearest, eye.farthest);
    this.panel.setParallel(facts.get("parallel") === "1");
    if (this.surface && facts.has("drawn")) this.panel.setDrawn(facts.get("drawn").split(","));
    this.panel.setMode(this.modes.includes(facts.get("colour")) ? facts.get("colour") : this.mode);
  }
}

// Distance of a pixel from the line between two others.
function apart(at, from, to) {
  const [dx, dy] = [to[0] - from[0], to[1] - from[1]], square = dx * dx + dy * dy;
  const share = square > 0 ? clamp(((at[0] - from[0]) * dx + (at[1] - from[1]) * dy) / square, 0, 1) : 0;
  return Math.hypot(at[0] - from[0] - share * dx, at[1] - from[1] - share * dy);
}

function fault(title, text) {
  $("fault-title").textContent = title;
  $("fault-text").textContent = text;
  $("fault").hidden = false;
}

function begin() {
  const canvas = $("picture"), gl = canvas.getContext("webgl2", { alpha: false, antialias: true });
  if (!gl) {
    fault("This browser cannot draw in 3-D", "The page needs WebGL 2. Enable graphics acceleration in the "
      + "browser’s settings, or open the page in a current Firefox, Chrome, Edge or Safari; the cloud also opens in CloudCompare.");
    return;
  }
  canvas.addEventListener("webglcontextlost", () =>
    fault("The graphics context was lost", "Load the page again; with fewer points (photogram view --points) it needs less memory."));
  new View(canvas, gl);
}

begin();
