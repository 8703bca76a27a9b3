// The page of `photogram mark`: which point, which photographs, what the hands do. What is marked is kept by the server.

import * as api from "./api.js";
import * as loupe from "./loupe.js";
import { Patch } from "./patch.js";
import * as plan from "./plan.js";
import { fixed, nt, t, typed } from "./words.js";

const FIRST = 12, LATER = 12, PAUSE_MS = 300;
const REACH = 8; // CSS px from a click within which a target is looked for
const $ = (id) => document.getElementById(id);

let session = null; // what the server says of all points
let view = null; // and of the one that is chosen
let places = null; // the survey from above
let chosen = null, active = null, shown = FIRST, ownSpan = null, amount = 1, northUp = false, version = 0;
let order = [], visited = [], patches = new Map(), sending = Promise.resolve(), pause = 0;

// ---- what is shown --------------------------------------------------------------------------------------------------

let silence = 0;
function said(text, lang = null) {
  $("said").textContent = text;
  if (lang) $("said").lang = lang;
  else $("said").removeAttribute("lang");
  $("said").hidden = false;
  clearTimeout(silence);
  silence = setTimeout(() => { $("said").hidden = true; }, 6000);
}

const counted = (n, photographs) => nt("{n} mark, {photographs} photographs.", "{n} marks, {photographs} photographs.", n, { photographs });

// What places of points are predicted from: the tags, perhaps with the reason why it is no more, or an adjustment.
function placed(basis) {
  if (basis === "adjustment") return t("Places from the adjustment.");
  return basis === "tags" ? t("Places from the tags.") : t("Places from the tags ({reason}).", { reason: basis.replace(/^tags \((.*)\)$/s, "$1") });
}

const roleOf = role => ({ control: t("control"), check: t("check"), tie: t("tie") })[role];

function showSession() {
  const { points } = session, marks = points.reduce((sum, point) => sum + point.marks, 0);
  document.title = `${session.title}: photogram mark`;
  $("survey").textContent = session.title;
  $("basis").textContent = [counted(marks, session.photographs), placed(session.basis), session.computing ? t("Computing …") : ""].filter(Boolean).join(" ");
  const entries = points.map((point) => {
    const entry = document.createElement("li"), button = document.createElement("button");
    button.type = "button";
    button.dataset.point = point.name;
    button.setAttribute("aria-current", String(point.name === chosen));
    const icon = document.createElementNS("http://www.w3.org/2000/svg", "svg");
    icon.setAttribute("viewBox", "0 0 12 12");
    icon.setAttribute("class", `shape${point.enough ? " full" : ""}`);
    icon.setAttribute("aria-hidden", "true");
    icon.append(plan.shape(point.role, 6, 6.3, 4.6));
    const title = Object.assign(document.createElement("span"), { className: "title", textContent: point.name });
    const words = document.createElement("span");
    words.className = "words";
    const parts = [roleOf(point.role), point.marks ? point.short : t("no marks")];
    if (point.doubtful) parts.push(t("{n} doubtful", { n: point.doubtful }));
    if (point.proposals) parts.push(t("{n} proposed", { n: point.proposals }));
    words.textContent = parts.join(", ");
    if (point.enough) words.classList.add("enough");
    button.append(icon, title, words);
    if (point.wrong) button.append(Object.assign(document.createElement("span"), { className: "words wrong", textContent: t("something is wrong") }));
    button.addEventListener("click", () => choose(point.name));
    entry.append(button);
    return entry;
  });
  const had = document.activeElement?.dataset?.point;
  $("points").replaceChildren(...entries);
  if (had) $("points").querySelector(`[data-point="${CSS.escape(had)}"]`)?.focus();
  const warnings = [
    ...session.blunders.map((text) => [text, "wrong", "en"]), ...session.warnings.map((text) => [text, "", ""]),
    ...(session.problem ? [[session.problem, "", "en"]] : []),
  ];
  $("warnings").replaceChildren(...warnings.map(([textContent, className, lang]) =>
    Object.assign(document.createElement("li"), { textContent, className, ...(lang ? { lang } : {}) })));
  $("search").textContent = session.search;
  $("search").hidden = !session.search;
  $("find").disabled = session.searching;
  const left = session.proposals - session.agreeing;
  $("confirm").hidden = !session.proposals;
  $("confirm").disabled = !session.agreeing || session.computing;
  $("confirm").textContent = session.agreeing
    ? left
      ? nt("Confirm {n} that agrees, {left} left", "Confirm {n} that agree, {left} left", session.agreeing, { left })
      : nt("Confirm {n} that agrees", "Confirm {n} that agree", session.agreeing)
    : t("{n} proposed, none agrees yet", { n: left });
  $("undo").disabled = !session.undoable;
  $("redo").disabled = !session.redoable;
}

function showPoint() {
  const { point } = view;
  $("name").textContent = point.name;
  $("words").textContent = view.point.marks ? point.words : t("no marks yet");
  for (const button of document.querySelectorAll("[data-role]")) {
    button.setAttribute("aria-pressed", String(button.dataset.role === point.role));
    button.disabled = !point.surveyed;
  }
  $("next").disabled = view.next === null;
  const records = new Map(view.photographs.map((record) => [record.name, record]));
  order = [...order.filter((name) => records.has(name)), ...[...records.keys()].filter((name) => !order.includes(name))];
  const span = ownSpan ?? view.span_px, now = new Set(order.slice(0, shown));
  for (const [name, patch] of patches) if (!now.has(name)) { patch.gone(); patches.delete(name); }
  for (const name of now) {
    let patch = patches.get(name);
    if (!patch) {
      patch = new Patch(records.get(name), hands);
      patch.contrast(amount);
      patch.northUp = northUp;
      patches.set(name, patch);
      $("patches").append(patch.figure);
    }
    patch.update(records.get(name), span);
  }
  $("more").hidden = order.length <= shown;
  $("more").textContent = t("Show more photographs ({n})", { n: Math.max(order.length - shown, 0) });
  showScale();
  if (places) plan.draw(places, session.points, chosen, new Set(order), choose);
}

function showScale() {
  const patch = patches.values().next().value;
  if (!patch?.span) return;
  const across = patch.picture.getBoundingClientRect().width, k = across / patch.span;
  $("scale").textContent = k >= 1 ? `${fixed(k, 1)} : 1` : `1 : ${fixed(1 / k, 1)}`;
}

// The point comes with the state that it belongs to: an action in between can take it away.
async function refresh() {
  const asked = chosen;
  const [now, above] = await Promise.all([api.state(asked), api.plan()]);
  session = now;
  places = above;
  version = Math.max(version, session.version);
  if (chosen === asked || !session.points.some((point) => point.name === chosen)) chosen = session.shown?.point.name ?? null;
  showSession();
  if (session.shown && session.shown.point.name === chosen) {
    view = session.shown;
    showPoint();
    document.body.dataset.ready = session.computing ? "places" : "all";
    document.body.dataset.version = Math.min(session.version, view.version);
  }
}

// A refresh that began after it was asked for: of several that wait, one is made.
let refreshing = null, following = null;
function refreshed() {
  if (refreshing) {
    following ??= refreshing.then(() => { following = null; return refreshed(); });
    return following;
  }
  refreshing = refresh().catch((fault) => said(fault.message, fault.lang)).finally(() => { refreshing = null; });
  return refreshing;
}

async function follow() {
  for (;;) {
    try {
      const newest = await api.changed(version);
      if (newest !== version) {
        version = newest;
        await refreshed();
      }
    } catch {
      said(t("photogram mark has ended: start it again; every mark is kept"));
      await new Promise((resolve) => setTimeout(resolve, 3000));
    }
  }
}

function choose(name, back = false) {
  if (name === null || name === chosen) return;
  flush();
  if (chosen !== null && !back) visited.push(chosen);
  chosen = name;
  for (const patch of patches.values()) patch.gone();
  patches = new Map();
  order = [];
  active = null;
  shown = FIRST;
  ownSpan = null;
  loupe.hide();
  history.replaceState(null, "", `#${encodeURIComponent(name)}`);
  refreshed().then(() => {
    $("patches").scrollTop = 0;
    patches.values().next().value?.figure.focus();
    readAhead();
  });
}

function readAhead() {
  const patch = patches.values().next().value;
  if (view?.next && patch) api.ahead(view.next, FIRST, patch.picture.width);
}

// ---- what is done ---------------------------------------------------------------------------------------------------

function act(action) {
  // one after the other, in the order in which the hands did it
  sending = sending.then(() => api.act(action)).then(refreshed).catch((fault) => { said(fault.message, fault.lang); return refreshed(); });
  return sending;
}

function acted(action) {
  flush();
  return act(action);
}

const of = (patch) => ({ point: chosen, photograph: patch.record.name });

function flush() {
  clearTimeout(pause);
  for (const patch of patches.values()) {
    if (patch.moved && patch.moved !== patch.sent) {
      patch.sent = patch.moved;
      act({ do: "mark", ...of(patch), u: patch.moved.u, v: patch.moved.v, raw: true });
    }
  }
}

const hands = {
  said,
  chosen(patch) {
    if (active === patch) return;
    active?.figure.classList.remove("active");
    const before = active;
    active = patch;
    patch.figure.classList.add("active");
    before?.draw();
    patch.draw();
  },
  marked(patch, u, v, raw) {
    const reach = REACH * patch.span / patch.picture.getBoundingClientRect().width;
    flush();
    const expected = patch.expect(u, v); // shown at once, until the server says where the target is
    act({ do: "mark", ...of(patch), u, v, raw, reach }).then(() => patch.settle(expected));
  },
  zoomed(times) {
    zoom(times);
  },
  hovered(patch, event) {
    loupe.follow(patch.record, patch.pixel(event), event, patch.picture.style.filter, patch.turn);
  },
  left() {
    loupe.hide();
  },
};

function zoom(times) {
  const patch = active ?? patches.values().next().value;
  if (!patch) return;
  const largest = Math.max(patch.record.width_px, patch.record.height_px);
  ownSpan = times === null ? null : Math.min(Math.max(patch.span * times, 6), largest);
  for (const each of patches.values()) each.zoom(ownSpan ?? view.span_px);
  showScale();
}

function step(by) {
  const now = [...patches.values()], next = now[now.indexOf(active) + by];
  if (next) {
    next.figure.focus();
    next.figure.scrollIntoView({ block: "nearest" });
  } else if (by > 0) choose(view.next);
}

// The point that was shown before, or the one above in the list.
function previous() {
  const names = session.points.map((point) => point.name);
  const before = visited.findLast((name) => name !== chosen && names.includes(name));
  visited = before === undefined ? [] : visited.slice(0, visited.lastIndexOf(before));
  choose(before ?? names[(names.indexOf(chosen) - 1 + names.length) % names.length], true);
}

function nudge(du, dv) {
  if (!active?.move(du, dv)) return;
  clearTimeout(pause);
  pause = setTimeout(flush, PAUSE_MS);
}

const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

function key(event) {
  if (event.target.closest("dialog, input") || event.metaKey || event.altKey) return;
  const inPatch = event.target === document.body || Boolean(event.target.closest("#patches"));
  if (event.key in ARROWS && inPatch && active) {
    const size = event.ctrlKey ? 10 : event.shiftKey ? 1 : 0.1, [du, dv] = ARROWS[event.key];
    nudge(du * size, dv * size);
  } else if (event.ctrlKey) return;
  else if (event.key === "Enter" && inPatch) step(event.shiftKey ? -1 : 1);
  else if (event.key === " " && inPatch && active) {
    if (active.isProposed) acted({ do: "confirm", ...of(active) });
    else if (!active.mark) hands.marked(active, ...active.cursor, false);
  } else if (/^[1-9]$/.test(event.key)) {
    amount = Number(event.key);
    for (const patch of patches.values()) patch.contrast(amount);
    said(t("Contrast {amount}", { amount }));
  } else {
    const done = COMMANDS[event.key.toLowerCase()];
    if (!done || event.key === " " || event.key === "Enter") return;
    done(event);
  }
  event.preventDefault();
}

function turn() {
  northUp = !northUp;
  $("north").setAttribute("aria-pressed", String(northUp));
  for (const patch of patches.values()) { patch.northUp = northUp; patch.show(); }
}

const COMMANDS = {
  x: () => { if (active?.mark) acted({ do: "remove", ...of(active) }); },
  u: (event) => acted({ do: event.shiftKey ? "redo" : "undo" }),
  v: () => { if (active) acted({ do: "not_visible", ...of(active), visible: active.record.hidden }); },
  d: () => { if (active?.mark) acted({ do: "doubtful", ...of(active), doubtful: !active.record.mark?.doubtful }); },
  c: () => acted({ do: "role", point: chosen, role: "check" }),
  k: () => acted({ do: "role", point: chosen, role: "control" }),
  t: () => { if (!session.searching) acted({ do: "look" }); },
  a: () => { if (session.agreeing && !session.computing) acted({ do: "confirm_agreeing" }); },
  n: () => choose(view.next),
  o: turn,
  p: previous,
  r: () => { if (active) { active.back(active.span); active.show(); } },
  "+": () => zoom(0.8),
  "=": () => zoom(0.8),
  "-": () => zoom(1.25),
  0: () => zoom(null),
  "?": () => $("help").showModal(),
};

function added(event) {
  event.preventDefault();
  const form = new FormData(event.target), number = (name) => typed(String(form.get(name)));
  const position = ["east", "north", "height"].map(number), sigma = ["sigma-east", "sigma-north", "sigma-height"].map(number);
  const action = { do: "point", name: String(form.get("name")).trim() };
  if (position.some((value) => !Number.isNaN(value))) {
    if ([...position, ...sigma].some(Number.isNaN)) return said(t("Give easting, northing, height and their standard deviations, or none"));
    Object.assign(action, { position, sigma_m: sigma });
  }
  api.act(action).then(() => {
    $("new").close();
    event.target.reset();
    return refreshed();
  }).then(() => choose(action.name)).catch((fault) => said(fault.message, fault.lang));
}

document.addEventListener("keydown", key);
$("in").addEventListener("click", () => zoom(0.8));
$("out").addEventListener("click", () => zoom(1.25));
$("north").addEventListener("click", turn);
$("undo").addEventListener("click", () => acted({ do: "undo" }));
$("redo").addEventListener("click", () => acted({ do: "redo" }));
$("next").addEventListener("click", () => choose(view.next));
$("find").addEventListener("click", () => acted({ do: "look" }));
$("confirm").addEventListener("click", () => acted({ do: "confirm_agreeing" }));
$("more").addEventListener("click", () => { shown += LATER; showPoint(); });
$("keys").addEventListener("click", () => $("help").showModal());
$("help-close").addEventListener("click", () => $("help").close());
$("add").addEventListener("click", () => $("new").showModal());
$("new-cancel").addEventListener("click", () => $("new").close());
$("new-form").addEventListener("submit", added);
for (const button of document.querySelectorAll("[data-role]")) {
  button.addEventListener("click", () => acted({ do: "role", point: chosen, role: button.dataset.role }));
}
addEventListener("pagehide", flush);
addEventListener("resize", () => { if (places && session) plan.draw(places, session.points, chosen, new Set(order), choose); });

chosen = decodeURIComponent(location.hash.slice(1)) || null;
refreshed().then(() => { patches.values().next().value?.figure.focus(); readAhead(); return follow(); });
