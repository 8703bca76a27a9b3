// A photograph around a point. Pixels are those of the photograph: the centre of its top-left pixel is (0, 0), so that a
// pixel u reaches from u - 0.5 to u + 0.5, and a window of the server's from `left` covers u from left - 0.5 on.

import * as api from "./api.js";
import { fixed, t } from "./words.js";

const CLICK = 4; // CSS px that a pointer may move and still click
const HOLD_MS = 300; // that a finger rests before the loupe follows it
const HALO = "#000b", MARK = "#ffe14d", PLACE = "#5fe3ff", PROPOSED = "#e9b0ff", WRONG = "#ff5a3c";

export class Patch {
  constructor(record, hands) {
    this.record = record;
    this.hands = hands;
    this.span = null;
    this.centre = null;
    this.cursor = null;
    this.moved = null; // a mark that the keys have moved
    this.sent = null; // and what of it was sent
    this.shown = null; // the picture that is there, with its window
    this.asked = null;
    this.over = false;
    this.northUp = false;
    this.build();
  }

  build() {
    const element = (tag, className, parent) => {
      const made = document.createElement(tag);
      if (className) made.className = className;
      parent?.append(made);
      return made;
    };
    this.figure = element("figure");
    this.figure.tabIndex = 0;
    this.figure.dataset.photograph = this.record.name;
    this.frame = element("div", "frame", this.figure);
    this.picture = element("canvas", "picture", this.frame);
    this.drawing = element("canvas", "drawing", this.frame);
    this.caption = element("figcaption", "", this.figure);
    this.figure.addEventListener("focus", () => this.hands.chosen(this));
    const at = this.drawing;
    at.addEventListener("pointerdown", (event) => this.pressed(event));
    at.addEventListener("pointermove", (event) => this.dragged(event));
    at.addEventListener("pointerup", (event) => this.released(event));
    at.addEventListener("pointercancel", () => this.letGo());
    at.addEventListener("touchmove", (event) => { if (this.press?.held) event.preventDefault(); }, { passive: false });
    at.addEventListener("pointerenter", () => { this.over = true; });
    at.addEventListener("pointerleave", () => { this.over = false; this.hands.left(this); });
    at.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.hands.zoomed(event.deltaY > 0 ? 1.25 : 0.8);
    }, { passive: false });
    this.observer = new ResizeObserver(() => this.resized());
    this.observer.observe(this.frame);
  }

  gone() {
    this.observer.disconnect();
    this.asked?.abort();
    this.figure.remove();
  }

  get mark() {
    return this.moved ?? this.record.mark;
  }

  // Whether a target is proposed here, and nobody has moved the cross-hair away from it.
  get isProposed() {
    const { proposal } = this.record;
    return !this.mark && Boolean(proposal) && this.cursor[0] === proposal.u && this.cursor[1] === proposal.v;
  }

  // Where the patch should be, unless somebody has moved it.
  get home() {
    const { u, v, width_px, height_px } = this.record, mark = this.record.mark ?? this.record.proposal;
    if (mark) return [mark.u, mark.v];
    if (u === null) return [(width_px - 1) / 2, (height_px - 1) / 2];
    return [Math.min(Math.max(u, 0), width_px - 1), Math.min(Math.max(v, 0), height_px - 1)];
  }

  update(record, span) {
    const before = this.record;
    this.record = record;
    const changed = before.mark?.u !== record.mark?.u || before.mark?.v !== record.mark?.v;
    if (changed && this.moved === this.sent) this.moved = null; // else the keys have moved it on since
    const gained = (before.u === null && record.u !== null) || (!before.proposal && record.proposal && !this.over);
    if (this.centre === null || gained) this.back(span);
    else if (span !== this.span || (!this.panned && !record.mark && this.isOff(span))) {
      // what somebody is about to click on stays where it is
      if (this.over) this.span ??= span;
      else if (this.panned || (before.mark && record.mark)) this.span = span;
      else this.back(span);
    }
    this.say();
    this.show();
  }

  isOff(span) {
    const [u, v] = this.home;
    return Math.hypot(u - this.centre[0], v - this.centre[1]) > span / 12;
  }

  back(span) {
    this.span = span;
    this.panned = false;
    this.centre = this.home;
    this.cursor = [...this.centre];
  }

  zoom(span) {
    this.span = span;
    if (this.mark && !this.panned) this.centre = [this.mark.u, this.mark.v];
    this.show();
  }

  say() {
    const { record } = this, lines = [];
    const line = (text, className) => {
      const made = document.createElement("span");
      made.textContent = text;
      if (className) made.className = className;
      lines.push(made);
    };
    line(record.name, "photograph");
    if (record.hidden) line(t("not visible here"));
    else if (record.rejected || record.off_target) line(record.words, "wrong");
    else if (record.mark) {
      const kind = { raw: t("as clicked"), imported: t("given") }[record.mark.kind] ?? record.mark.kind;
      const parts = [kind, record.words, record.mark.doubtful ? t("doubtful") : ""].filter(Boolean);
      line(parts.join(", ") || t("marked"));
    } else if (record.proposal) {
      const { kind, agrees } = record.proposal;
      line(agrees ? t("proposed: {kind}, agrees with the rest", { kind }) : t("proposed: {kind}, not confirmed by others", { kind }));
    } else if (record.u === null) line(t("nothing says where it is"));
    else if (!record.inside) line(t("outside the photograph, by the prediction"));
    else line(t("not marked, ± {radius} px", { radius: fixed(record.ellipse.long_px, record.ellipse.long_px < 10 ? 1 : 0) }));
    this.caption.replaceChildren(...lines);
    this.figure.classList.toggle("hidden", record.hidden);
    this.figure.setAttribute("aria-label", lines.map((made) => made.textContent).join(": "));
  }

  // ---- pictures ----------------------------------------------------------------------------------------------------

  resized() {
    const ratio = window.devicePixelRatio, { width, height } = this.frame.getBoundingClientRect();
    for (const canvas of [this.picture, this.drawing]) {
      canvas.width = Math.max(Math.round(width * ratio), 1);
      canvas.height = Math.max(Math.round(height * ratio), 1);
    }
    this.show();
  }

  // By how much the picture is turned on the screen, clockwise: north points up where that is wanted and known.
  get turn() {
    const { north_rad } = this.record;
    return this.northUp && north_rad !== null ? -Math.PI / 2 - north_rad : 0;
  }

  // Offsets in the photograph as they are on the screen, and back.
  turned(du, dv, turn = this.turn) {
    if (turn === 0) return [du, dv];
    const c = Math.cos(turn), s = Math.sin(turn);
    return [c * du - s * dv, s * du + c * dv];
  }

  backTurned(dx, dy) {
    return this.turned(dx, dy, -this.turn);
  }

  show() {
    if (this.centre === null || this.span === null) return;
    this.draw();
    const scale = this.wantedScale(), turn = this.turn;
    const reach = this.span / 2 * (Math.abs(Math.cos(turn)) + Math.abs(Math.sin(turn)));
    const left = Math.floor(this.centre[0] - reach + 0.5), upper = Math.floor(this.centre[1] - reach + 0.5);
    const side = Math.ceil(2 * reach) + 1;
    const { width_px, height_px } = this.record;
    const box = [Math.max(left, 0), Math.max(upper, 0), Math.min(left + side, width_px), Math.min(upper + side, height_px)];
    if (box[2] <= box[0] || box[3] <= box[1]) return;
    const key = [left, upper, side, scale].join();
    if (key === this.key) return;
    this.key = this.figure.dataset.asked = key;
    this.asked?.abort();
    const asked = this.asked = new AbortController();
    api.patch(this.record.name, left, upper, side, side, scale, asked.signal).then((shown) => {
      if (this.asked !== asked) return;
      this.shown?.bitmap.close();
      this.shown = shown;
      this.draw();
      this.figure.dataset.drawn = key;
      performance.mark("drawn");
    }).catch((fault) => {
      if (fault.name === "AbortError") return;
      this.key = null;
      this.hands.said(fault.message, fault.lang);
    });
  }

  wantedScale() {
    let scale = 1;
    while (scale < 8 && this.span / (2 * scale) >= this.picture.width) scale *= 2;
    return scale;
  }

  draw() {
    if (this.centre === null) return;
    const { width, height } = this.picture, context = this.picture.getContext("2d");
    const k = width / this.span, [u, v] = this.centre;
    context.fillStyle = "#333";
    context.fillRect(0, 0, width, height);
    if (this.shown) {
      const { bitmap, left, upper, width: across, height: down, scale } = this.shown;
      context.save();
      context.imageSmoothingEnabled = k * scale < 2;
      context.imageSmoothingQuality = "high";
      context.translate(width / 2, height / 2);
      context.rotate(this.turn);
      context.drawImage(bitmap, (left - 0.5 - u) * k, (upper - 0.5 - v) * k, across * k, down * k);
      context.restore();
    }
    this.draws();
  }

  draws() {
    const { width, height } = this.drawing, context = this.drawing.getContext("2d");
    const k = width / this.span, turn = this.turn, ratio = window.devicePixelRatio;
    const at = (u, v) => {
      const [dx, dy] = this.turned(u - this.centre[0], v - this.centre[1], turn);
      return [width / 2 + dx * k, height / 2 + dy * k];
    };
    this.figure.dataset.view = [...this.centre, this.span, turn].join(" ");
    context.clearRect(0, 0, width, height);
    const stroke = (colour, dash = []) => {
      for (const [style, thick] of [[HALO, 3.6], [colour, 1.6]]) {
        context.strokeStyle = style;
        context.lineWidth = thick * ratio;
        context.setLineDash(dash.map((part) => part * ratio));
        context.stroke();
      }
    };
    const { record, mark } = this;
    if (record.u !== null && !mark) {
      const { long_px, short_px, angle_rad } = record.ellipse;
      context.beginPath();
      context.ellipse(...at(record.u, record.v), Math.max(long_px * k, 2), Math.max(short_px * k, 2), angle_rad + turn, 0, 2 * Math.PI);
      stroke(PLACE, [6, 4]);
    }
    if (!mark && record.proposal) { // a dotted ring, and its centre
      const [a, b] = at(record.proposal.u, record.proposal.v);
      context.beginPath();
      context.arc(a, b, 12 * ratio, 0, 2 * Math.PI);
      stroke(PROPOSED, record.proposal.agrees ? [] : [2, 4]);
      context.beginPath();
      context.arc(a, b, 0.8 * ratio, 0, 2 * Math.PI);
      stroke(PROPOSED);
    }
    if (mark) {
      const { rejected, off_target: missed } = record, other = rejected && record.u !== null ? record : this.moved ? null : missed;
      const colour = rejected || missed ? WRONG : MARK, far = 13 * ratio, near = 4 * ratio, [a, b] = at(mark.u, mark.v);
      context.beginPath();
      for (const [dx, dy] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) {
        context.moveTo(a + dx * near, b + dy * near);
        context.lineTo(a + dx * far, b + dy * far);
      }
      if (rejected || missed) { // a diamond around it
        const r = 18 * ratio;
        context.moveTo(a, b - r); context.lineTo(a + r, b); context.lineTo(a, b + r); context.lineTo(a - r, b);
        context.closePath();
      } else if (mark.kind === "imported") context.rect(a - far, b - far, 2 * far, 2 * far);
      stroke(colour);
      if (mark.doubtful) {
        context.font = `bold ${16 * ratio}px sans-serif`;
        context.lineWidth = 3 * ratio;
        context.setLineDash([]);
        context.strokeStyle = HALO;
        context.strokeText("?", a + far, b - near);
        context.fillStyle = colour;
        context.fillText("?", a + far, b - near);
      }
      if (other) { // where the others put it, or the target is
        context.beginPath();
        context.moveTo(a, b);
        context.lineTo(...at(other.u, other.v));
        stroke(WRONG, [2, 3]);
      }
    } else if (this.figure.classList.contains("active") && this.cursor) {
      const [a, b] = at(...this.cursor), far = 10 * ratio;
      context.beginPath();
      context.moveTo(a - far, b); context.lineTo(a + far, b); context.moveTo(a, b - far); context.lineTo(a, b + far);
      stroke("#fff", [2, 2]);
    }
  }

  contrast(amount) {
    this.picture.style.filter = amount === 1 ? "" : `contrast(${1 + (amount - 1) * 0.35})`;
  }

  // ---- hands -------------------------------------------------------------------------------------------------------

  // The pixel of the photograph under a pointer: the canvas as it lies on the page has the whole span, at any zoom.
  pixel(event) {
    const { left, top, width, height } = this.drawing.getBoundingClientRect(), [u, v] = this.centre;
    const across = ((event.clientX - left) / width - 0.5) * this.span, down = ((event.clientY - top) / height - 0.5) * this.span;
    const [du, dv] = this.backTurned(across, down);
    return [u + du, v + dv];
  }

  pressed(event) {
    if (event.button !== 0) return;
    const press = this.press = { x: event.clientX, y: event.clientY, centre: this.centre, far: false, held: false };
    if (event.pointerType === "touch") { // a finger hides what it points at: the loupe shows it
      press.timer = setTimeout(() => { press.held = !press.far; if (press.held) this.hands.hovered(this, event); }, HOLD_MS);
    }
    this.drawing.setPointerCapture(event.pointerId);
    this.figure.focus({ preventScroll: true });
  }

  dragged(event) {
    const { press } = this;
    if (event.pointerType !== "touch" || press?.held) this.hands.hovered(this, event);
    if (!press || press.held) return;
    const dx = event.clientX - press.x, dy = event.clientY - press.y;
    press.far ||= Math.hypot(dx, dy) > CLICK;
    if (!press.far) return;
    const { width } = this.drawing.getBoundingClientRect();
    const [du, dv] = this.backTurned(dx / width * this.span, dy / width * this.span);
    this.centre = [press.centre[0] - du, press.centre[1] - dv];
    this.panned = true;
    this.show();
  }

  letGo() {
    const { press } = this;
    clearTimeout(press?.timer);
    this.press = null;
    if (press?.held) this.hands.left(this);
    return press;
  }

  released(event) {
    const press = this.letGo();
    if (!press || press.far) return;
    const [u, v] = this.pixel(event), { width_px, height_px } = this.record;
    if (u < -0.5 || v < -0.5 || u > width_px - 0.5 || v > height_px - 0.5) return;
    this.hands.marked(this, u, v, event.altKey);
  }

  // Show a mark that is on its way to the server.
  expect(u, v) {
    this.moved = this.sent = { u, v, kind: "raw", doubtful: false };
    this.draws();
    return this.moved;
  }

  // The server has answered, perhaps that it could not be kept.
  settle(expected) {
    if (this.moved !== expected) return;
    this.moved = null;
    this.draws();
  }

  // Move the mark by keys, or the cross-hair where there is no mark.
  move(dx, dy) {
    const [du, dv] = this.backTurned(dx, dy);
    const { width_px, height_px } = this.record, within = (value, size) => Math.min(Math.max(value, -0.5), size - 0.5);
    const from = this.mark ? [this.mark.u, this.mark.v] : this.cursor;
    const to = [within(from[0] + du, width_px), within(from[1] + dv, height_px)];
    if (this.mark) this.moved = { ...this.mark, u: to[0], v: to[1], kind: "raw" };
    else this.cursor = to;
    const beyond = Math.max(Math.abs(to[0] - this.centre[0]), Math.abs(to[1] - this.centre[1]));
    if (beyond > this.span * 0.45) { this.centre = to; this.panned = true; }
    this.show();
    return Boolean(this.mark);
  }
}
