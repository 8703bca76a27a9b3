// Mouse, pen, fingers and keys: what they ask of the view. `view` offers eye, moved(), still(), pick(), and so on.

class Hands {
  constructor(canvas, view) {
    this.canvas = canvas;
    this.view = view;
    this.held = new Map();
    this.travelled = 0;
    const on = (name, act) => canvas.addEventListener(name, event => act.call(this, event), { passive: false });
    on("pointerdown", this.down);
    on("pointermove", this.move);
    on("pointerup", this.up);
    on("pointercancel", this.up);
    on("pointerleave", () => { this.pointer = null; view.hover(null); });
    on("wheel", this.wheel);
    on("dblclick", event => view.centre(...this.at(event)));
    // keys act where the picture has the focus, and where nothing has it
    document.addEventListener("keydown", event => {
      const anywhere = event.key === "Escape";
      if (anywhere || event.target === canvas || event.target === document.body || event.target === document.documentElement) this.key(event);
    });
    // a control that was used with the mouse gives the focus back; one used with keys keeps it
    document.addEventListener("click", event => {
      const used = event.target.closest("#panel button, #panel input, #compass, #said button");
      if (used && event.detail > 0) this.focus();
    });
    document.addEventListener("change", event => { if (event.target.matches("select") && this.byHand) this.focus(); });
    document.addEventListener("pointerdown", () => { this.byHand = true; canvas.classList.remove("keys"); }, true);
    document.addEventListener("keydown", event => {
      this.byHand = false;
      if (!["Shift", "Control", "Alt", "Meta"].includes(event.key)) canvas.classList.add("keys");
    }, true);
    on("contextmenu", event => event.preventDefault());
  }

  focus() { this.canvas.focus({ preventScroll: true }); }

  at(event) {
    const box = this.canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  }

  down(event) {
    this.canvas.setPointerCapture(event.pointerId);
    this.focus();
    if (!this.held.size) this.travelled = 0;
    this.held.set(event.pointerId, this.at(event));
    this.view.kept = null;
    this.moving = event.button === 1 || event.button === 2 || event.shiftKey || event.ctrlKey;
    this.canvas.classList.add("held");
    this.view.stop();
  }

  move(event) {
    const now = this.at(event), before = this.held.get(event.pointerId);
    if (!before) {
      this.pointer = event.pointerType === "touch" ? null : now;
      this.view.hover(this.pointer);
      return;
    }
    const [dx, dy] = [now[0] - before[0], now[1] - before[1]];
    this.travelled += Math.hypot(dx, dy);
    if (this.held.size === 1 && this.travelled < 4) return; // a hand that trembles while it clicks
    if (this.held.size === 2) this.pinch(event.pointerId, before, now);
    else if (this.moving) this.view.eye.pan(dx, dy);
    else this.view.eye.turn(dx, dy);
    this.held.set(event.pointerId, now);
    this.view.moved();
  }

  // Two fingers: their middle moves the ground, their distance brings it nearer, their direction turns it.
  pinch(id, before, now) {
    const other = [...this.held].find(([key]) => key !== id)[1], { eye } = this.view;
    const span = end => Math.max(Math.hypot(end[0] - other[0], end[1] - other[1]), 10);
    const direction = end => Math.atan2(end[1] - other[1], end[0] - other[0]);
    const turned = direction(now) - direction(before);
    eye.pan((now[0] - before[0]) / 2, (now[1] - before[1]) / 2);
    this.view.zoom(span(before) / span(now), (now[0] + other[0]) / 2, (now[1] + other[1]) / 2);
    eye.azimuth -= Math.atan2(Math.sin(turned), Math.cos(turned));
  }

  up(event) {
    if (!this.held.delete(event.pointerId)) return;
    if (this.held.size) return;
    this.canvas.classList.remove("held");
    if (event.type === "pointerup" && this.travelled < 4) {
      if (event.button === 0) this.view.pick(...this.at(event), event.pointerType === "touch" ? 1.8 : 1);
    } else {
      this.view.still();
    }
  }

  wheel(event) {
    event.preventDefault();
    const pixels = event.deltaY * (event.deltaMode === 1 ? 33 : event.deltaMode === 2 ? 400 : 1);
    this.view.stop();
    this.view.zoom(Math.exp(clamp(pixels, -300, 300) * (event.ctrlKey ? 0.008 : 0.0016)), ...this.at(event));
    this.view.moved();
    this.view.still(250);
  }

  key(event) {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    const { view } = this, { eye } = view, step = 48;
    const arrows = { ArrowLeft: [1, 0], ArrowRight: [-1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
    const acts = {
      "+": () => view.zoom(0.8), "=": () => view.zoom(0.8), "-": () => view.zoom(1.25), "_": () => view.zoom(1.25),
      Enter: () => view.pick(eye.width / 2, eye.height / 2), " ": () => view.pick(eye.width / 2, eye.height / 2),
      h: () => view.go("home"), Home: () => view.go("home"), "?": () => view.panel.help(),
      o: () => view.go("oblique"), t: () => view.go("top"), w: () => view.go("whole"), n: () => view.go("north"),
      s: () => view.switchDrawn(), m: () => view.measure(!view.measuring), Escape: () => view.dismiss(),
    };
    ["1", "2", "3", "4"].forEach((name, k) => { acts[name] = () => view.colourBy(k); });
    const arrow = arrows[event.key], act = acts[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (!arrow && !act) return;
    event.preventDefault();
    if (arrow) {
      view.stop();
      if (event.shiftKey) eye.pan(arrow[0] * step, arrow[1] * step);
      else eye.turn(-arrow[0] * step / 2, -arrow[1] * step / 2);
    } else {
      act();
    }
    view.moved();
    view.still(250);
  }
}
