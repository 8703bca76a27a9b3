// Controls, legend, scale and cards: everything of the page that is text.

const SIGMA_NOTES = {
  joint: "± 1 sigma, predicted: matching of both points, and errors of exterior orientation and calibration, as far as they are not common to both. The datum cancels.",
  shape: "± 1 sigma, predicted: errors of exterior orientation and calibration, as far as they are not common to both. The points have no sigmas of their own, so matching is not included.",
  surveyed: "± 1 sigma, from the stated sigmas of both points, assumed independent.",
  alone: "± 1 sigma, from the sigmas of both ends including the datum, assumed independent: too large where errors are common.",
  none: "No sigma: the files give none for one of the ends.",
};
const SURFACE_NOTES = {
  [MEASURED]: "Measured: between the corners of the mesh.",
  [WALL]: "A wall, interpolated between the heights beside it: not measured.",
  [INTERPOLATED]: "Interpolated: not measured.",
};
const MODE_TITLES = { height: "Height, m", sigma: "Sigma of the height, m", confidence: "Confidence, 0 to 1" };

class Panel {
  constructor(view) {
    this.view = view;
    const { scene } = view, digits = scene.step_m < 0.001 ? 4 : 3;
    this.digits = digits;
    $("panel").open = innerWidth >= 736;
    this.pictures = new Pictures(scene);
    for (const name of ["home", "oblique", "top", "whole"]) $(name).onclick = () => view.go(name);
    $("compass").onclick = () => view.go("north");
    $("measure").onclick = () => view.measure(!view.measuring);
    $("size").oninput = () => this.setSize();
    $("parallel").onchange = () => { this.setParallel($("parallel").checked); view.moved(); view.still(); };
    document.querySelectorAll("#modes input").forEach(input => { input.onchange = () => this.setMode(input.value); });
    document.querySelectorAll(".ticks input").forEach(input => input.addEventListener("change", () => { this.legend(); view.still(0); }));
    this.enlargements();
    this.places();
    this.setSize();
    this.labels = scene.points.map(point => this.label(point));
  }

  help() {
    $("panel").open = $("help").open = true;
    $("help").scrollIntoView();
    $("help").querySelector("summary").focus();
  }

  shown() {
    const ticked = name => ($(`show-${name}`) ? $(`show-${name}`).checked : false);
    return Object.fromEntries(["cloud", "surface", "photographs", "control", "check", "names", "errors"].map(n => [n, ticked(n)]));
  }

  setSize() {
    this.view.pointScale = 2 ** Number($("size").value);
    $("size-value").textContent = `× ${Number(this.view.pointScale.toPrecision(2))}`;
    this.view.still(0);
  }

  setMode(mode) {
    const { view } = this;
    view.mode = mode;
    document.querySelectorAll("#modes input").forEach(input => { input.checked = input.value === mode; });
    this.legend();
    view.still(0);
  }

  setDrawn(names) {
    for (const name of DRAWN) $(`show-${name}`).checked = names.includes(name);
    this.legend();
    this.view.still(0);
  }

  setParallel(on) {
    this.view.eye.parallel = on;
    $("parallel").checked = on;
  }

  enlargements() {
    const { view } = this, select = $("exaggeration"), series = [1, 2, 5];
    const values = [...Array(18).keys()].map(k => series[k % 3] * 10 ** Math.floor(k / 3));
    const wanted = values.reduce((a, b) => (Math.abs(Math.log(b / view.exaggeration)) < Math.abs(Math.log(a / view.exaggeration)) ? b : a));
    for (const value of values.filter(v => v === 1 || v >= wanted / 30 && v <= wanted * 30))
      select.add(new Option(value === 1 ? "true to scale" : `${value} times enlarged`, value, false, value === wanted));
    view.exaggeration = wanted;
    select.onchange = () => { view.exaggeration = Number(select.value); view.signs(); };
  }

  places() {
    const { view } = this, { scene } = view, select = $("places"), things = [];
    const group = (title, entries) => {
      if (!entries.length) return;
      const list = document.createElement("optgroup");
      list.label = title;
      for (const entry of entries) {
        list.append(new Option((entry.point || entry.photograph).name, things.length));
        things.push(entry);
      }
      select.append(list);
    };
    for (const [role, title] of [["control", "Control points"], ["check", "Check points"]])
      group(title, scene.points.filter(p => p.role === role).map(point => ({ point, place: local(scene, point.surveyed_map_m) })));
    group("Photographs", scene.photographs.map(photograph => ({ photograph, place: photograph.centre_m })));
    select.parentElement.hidden = !things.length;
    select.onchange = () => {
      const thing = things[Number(select.value)];
      if (select.value === "" || !thing) return;
      view.choose(thing);
      view.goTo(thing.place);
    };
  }

  label(point) {
    const span = document.createElement("span");
    span.textContent = point.name;
    span.dataset.name = point.name;
    $("labels").append(span);
    return { span, point, place: local(this.view.scene, point.surveyed_map_m) };
  }

  // ---- what follows every picture ----

  follow() {
    const { view } = this, { eye } = view, shown = this.shown(), taken = [];
    for (const label of this.labels) {
      const seen = shown.names && shown[label.point.role] ? eye.project(label.place) : null;
      label.width ||= label.span.offsetWidth;
      const box = seen && [seen[0] + 10, seen[1] - 9, seen[0] + 10 + label.width, seen[1] + 9];
      const free = box && box[0] > -100 && box[1] > -20 && box[0] < eye.width && box[1] < eye.height
        && taken.every(other => box[2] < other[0] || other[2] < box[0] || box[3] < other[1] || other[3] < box[1]);
      label.span.style.visibility = free ? "visible" : "hidden";
      if (!free) continue;
      taken.push(box);
      label.span.style.transform = `translate(${box[0].toFixed(1)}px, ${box[1].toFixed(1)}px)`;
      Object.assign(label.span.dataset, { x: seen[0].toFixed(2), y: seen[1].toFixed(2) });
    }
    const flat = Math.cos(eye.tilt) * 0.6 + 0.4;
    $("needle").setAttribute("transform", `scale(1 ${flat.toFixed(3)}) rotate(${(-eye.azimuth * 180 / Math.PI).toFixed(2)})`);
    this.scaleBar();
  }

  scaleBar() {
    const { eye } = this.view, most = 110 * eye.metresPerPixel, decade = 10 ** Math.floor(Math.log10(most));
    const length = [5, 2, 1].map(step => step * decade).find(value => value <= most);
    const [unit, size] = [["km", 1000], ["m", 1], ["cm", 0.01], ["mm", 0.001]].find(([, s]) => length >= s * 0.999) || ["mm", 0.001];
    $("scale-length").textContent = `${Number((length / size).toPrecision(3))} ${unit}`;
    $("scale-bar").style.width = `${(length / eye.metresPerPixel).toFixed(1)}px`;
    $("scale-where").textContent = eye.parallel ? "everywhere" : "in the middle";
  }

  legend() {
    const { view } = this, title = MODE_TITLES[view.mode], { surface } = this.shown();
    if ($("faces")) $("faces").hidden = !surface;
    $("ramp").hidden = !title;
    if (!title) return;
    const [low, high] = view.range(), colours = view.scene.maps[view.mode];
    const stops = colours.filter((_, k) => k % 7 === 0).map(colour => `rgb(${colour})`);
    const digits = view.mode === "height" ? (high - low > 20 ? 1 : 2) : view.mode === "sigma" ? 3 : 1;
    $("ramp-title").textContent = title;
    $("ramp-colours").style.background = `linear-gradient(90deg, ${stops})`;
    const more = view.mode !== "confidence";
    $("ramp-low").textContent = `${more && view.mode === "height" ? "≤ " : ""}${minus(low.toFixed(digits))}`;
    $("ramp-high").textContent = `${more ? "≥ " : ""}${minus(high.toFixed(digits))}`;
    $("ramp-note").textContent = { height: "", sigma: "predicted standard deviation; grey: not known", confidence: "of the matching; grey: not known" }[view.mode]
      + (surface && view.mode !== "height" ? "; of points, the surface has the orthophoto’s colours" : "");
  }

  tip(thing) {
    const tip = $("tip");
    tip.hidden = !thing;
    if (!thing) return;
    tip.textContent = thing.name;
    const left = Math.min(thing.at[0] + 14, innerWidth - tip.offsetWidth - 8);
    tip.style.transform = `translate(${left}px, ${Math.max(thing.at[1] - 34, 4)}px)`;
  }

  // ---- cards ----

  card(title, rows, notes) {
    const said = $("said");
    said.replaceChildren();
    said.hidden = title === null;
    if (title === null) return;
    const element = (name, text, to = said) => {
      const made = document.createElement(name);
      made.textContent = text;
      to.append(made);
      return made;
    };
    const close = element("button", "×");
    close.type = "button";
    close.className = "close";
    close.setAttribute("aria-label", "Close");
    close.onclick = () => this.view.dismiss();
    element("h2", title);
    if (rows.length) {
      const list = element("dl", "");
      for (const [name, value] of rows) {
        element("dt", name, list);
        element("dd", value, list);
      }
    }
    for (const note of notes) element("p", note);
  }

  metres(value) { return `${minus(value.toFixed(this.digits))} m`; }

  three(values, digits = 3) { return values.map(value => minus(value.toFixed(digits))).join("\u2002"); }

  coordinates(position) {
    const { units } = this.view.scene, feet = { "US survey foot": "ftUS", foot: "ft" };
    return ["Easting", "Northing", "Height"].map((name, k) => {
      const [unit, length] = k < 2 ? [units.plan, units.plan_m] : [units.height, units.height_m];
      return [name, length === 1 ? this.metres(position[k]) : `${minus((position[k] / length).toFixed(this.digits))} ${feet[unit] ?? unit}`];
    });
  }

  sayChosen(thing) {
    if (!thing) { this.card(null); return; }
    const { scene } = this.view, map = thing.place.map((value, k) => value + scene.origin_map_m[k]);
    if (thing.surface) {
      this.card("Point of the surface", this.coordinates(map), [SURFACE_NOTES[thing.surface]]);
      this.pictureOf(thing.place);
    } else if (thing.cloud) {
      const { sigma_m: sigma, plan_m: plan, confidence } = thing.cloud, rows = this.coordinates(map);
      if (plan !== null) rows.push(["Sigma in plan", this.metres(plan)]);
      if (sigma !== null) rows.push(["Sigma of height", this.metres(sigma)]);
      if (confidence !== null) rows.push(["Confidence", confidence.toFixed(2)]);
      this.card("Point of the cloud", rows, []);
      this.pictureOf(thing.place);
    } else if (thing.photograph) {
      const p = thing.photograph, rows = this.coordinates(map);
      if (p.sigma_m) rows.push(["Sigmas E, N, H, m", this.three(p.sigma_m)]);
      rows.push(["ω, φ, κ, °", this.three(p.angles_deg)], ["Tie points", String(p.tie_points)], ["Camera", p.camera]);
      const none = this.pictures.some && !this.pictures.source(p.name) ? ["This page has no picture of it."] : [];
      this.card(p.name, rows, ["Adjusted projection centre. On the ground: footprint at the mean height.", ...none]);
      this.picture(p, null);
    } else {
      this.sayPoint(thing.point);
      this.pictureOf(thing.place);
    }
  }

  // The picture of a photograph in the card, with a mark at shares of its width and height.
  picture(photograph, mark) {
    const source = this.pictures.source(photograph.name);
    if (!source) return;
    const figure = document.createElement("figure"), frame = document.createElement("div"), image = new Image();
    image.src = source;
    image.alt = mark ? `${photograph.name}, which shows this place` : `Photograph ${photograph.name}`;
    frame.append(image);
    figure.append(frame);
    if (mark) {
      const ring = document.createElement("i"), words = document.createElement("button");
      [ring.style.left, ring.style.top] = mark.map(share => `${(100 * share).toFixed(2)}%`);
      frame.append(ring);
      words.type = "button";
      words.textContent = photograph.name;
      words.onclick = () => this.view.choose({ photograph, place: photograph.centre_m });
      const caption = document.createElement("figcaption");
      caption.append("In ", words, ", nearest to its centre; it may be occluded.");
      figure.append(caption);
    }
    $("said").querySelector("h2").after(figure);
  }

  pictureOf(place) {
    const best = this.pictures.best(place);
    if (best) this.picture(best.photograph, best.at);
  }

  sayPoint(point) {
    const rows = this.coordinates(point.surveyed_map_m), notes = [];
    if (point.surveyed_sigma_m) rows.push(["Stated sigmas, m", this.three(point.surveyed_sigma_m)]);
    if (point.residual_m) rows.push(["Residuals E, N, H, m", this.three(point.residual_m)]);
    if (point.sigma_m) rows.push(["Predicted sigmas, m", this.three(point.sigma_m)]);
    notes.push(point.residual_m ? "Surveyed coordinates; residuals are adjusted minus surveyed." : "Surveyed coordinates; too few marks for an intersection.");
    const mixed = new Set(point.axis_roles).size > 1;
    const role = mixed ? `easting ${point.axis_roles[0]}, northing ${point.axis_roles[1]}, height ${point.axis_roles[2]}` : `${point.role} point`;
    this.card(`${point.name}, ${role}`, rows, notes);
  }

  sayMeasured(ends) {
    if (ends === null) { this.card(null); return; }
    if (ends.length < 2) {
      this.card("Measure a distance", [], [ends.length ? "Click the second point." : "Click two places of the ground, or symbols."]);
      return;
    }
    const [e, n, h] = [0, 1, 2].map(k => ends[1].place[k] - ends[0].place[k]), plan = Math.hypot(e, n);
    const bearing = (Math.atan2(e, n) * 180 / Math.PI + 360) % 360;
    const found = this.view.errors.distance(...ends), values = [plan, h, Math.hypot(plan, h)];
    const said = values.map((value, k) => (found ? `${minus(value.toFixed(this.digits))} ± ${found.sigma[k].toFixed(this.digits)} m` : this.metres(value)));
    const rows = [["In plan", said[0]], ["Height difference", said[1]], ["Slope distance", said[2]],
      ["Grid bearing", `${bearing.toFixed(3)}°`], ["Slope", `${minus((Math.atan2(h, plan) * 180 / Math.PI).toFixed(2))}°`]];
    const clouds = ends.filter(end => end.cloud && !end.surface), cells = clouds.length && clouds.every(end => end.cloud.plan_m === null);
    const notes = [SIGMA_NOTES[found ? found.kind : "none"], "In the map grid, its scale factor not taken off. Click two more, or Esc."];
    if (found && cells) notes.splice(1, 0, `Points are at cell centres, ${this.view.scene.spacing_m.toPrecision(2)} m apart: ± does not include the pointing error in plan.`);
    else if (found) notes.splice(1, 0, "± does not include the pointing error.");
    this.card("Distance", rows, notes);
  }
}

function minus(text) { return text.replace("-", "−"); }
