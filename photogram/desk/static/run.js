// The run: its stages, what they say, and its end.

import { get, post } from "./api.js";
import { renew } from "./main.js";
import { $, duration, element, fill, guarded } from "./page.js";

export const TITLES = {
  photographs: "Photographs", features: "Features", pairs: "Pairs", matches: "Matching", tie_points: "Tie points",
  orientation: "Orientation", transfer: "Tie points between", intersection: "Linear intersection", comparison: "Comparison", adjustment: "Joint adjustment", dense: "Dense matching",
  surface: "Surface", volumes: "Volumes", relief: "Terrain and contours", orthophoto: "Orthophoto", results: "Results",
};
const CHOICES = { full: ["All", "surface cell by cell, orthophoto, terrain"], quick: ["Quick look", "key points at half size, a surface between tie points"], own: ["As project.yaml says", "neither of the two"] };
let began = null, next = 0, told = null, chosen = null;
let stages = new Map(), warnings = [], last = null;

export const secondsLeft = () => (told?.state === "running" ? last?.seconds_left ?? null : null);
export const stageTitle = () => (last?.stage ? TITLES[last.stage] ?? last.stage : null);

export async function ask() {
  const answer = await get("run", { after: next });
  if (answer.began_unix_s !== began) {
    [began, next, stages, warnings, last] = [answer.began_unix_s, 0, new Map(), [], null];
    if (answer.next > answer.events.length) return ask();
  }
  for (const event of answer.events) take(event);
  next = answer.next;
  told = answer;
  return answer;
}

function take(event) {
  last = event;
  if (event.event === "warning" || event.event === "error") warnings.push(event);
  if (!event.stage) return;
  const before = stages.get(event.stage) ?? { began: event.seconds };
  stages.set(event.stage, {
    ...before, state: event.event === "end" ? "done" : before.state === "done" ? "done" : "running",
    done: event.done, total: event.total, text: event.text || (event.event === "advance" ? before.text : ""), seconds: event.seconds - before.began,
  });
}

export async function show() {
  await ask();
  chosen = null;
  draw();
  if (told.state !== "running" && told.state !== "paused") {
    chosen = await get("settings");
    offer();
    draw();
  }
}

// What can be chosen, with the time that each choice is predicted to take.
function offer() {
  const { settings, choices } = chosen, form = $("settings");
  fill($("choices"), element("legend", {}, "What is made"), ...choices.map(({ choice, prediction }) => element("label", {},
    element("input", { type: "radio", name: "choice", value: choice, checked: choice === settings.choice }), CHOICES[choice][0],
    element("small", {}, ` ${CHOICES[choice][1]}; ${prediction.stages.length ? `${duration(prediction.seconds)} from here` : "up to date"}`))));
  for (const name of ["cell_m", "interval_m"]) form.elements[name].value = settings[name] ?? "";
  form.elements.terrain.value = settings.terrain;
  form.elements.orthophoto.value = settings.orthophoto ? "yes" : "no";
}

export function draw() {
  const busy = told.state === "running" || told.state === "paused", own = told.kind !== "deliver";
  $("run-start").hidden = busy;
  $("run-pause").hidden = told.state !== "running" || !own;
  $("run-resume").hidden = told.state !== "paused";
  $("run-stop").hidden = !busy;
  const left = secondsLeft();
  const state = own ? told.state : "none";
  $("run-start").textContent = { stopped: "Go on", failed: "Try again" }[state] ?? "Start";
  const words = {
    none: null, running: left ? `${duration(left)} left` : "Under way", paused: "Paused: it takes no processor time, and keeps its memory",
    done: "Finished", failed: "Failed", stopped: "Stopped: what is finished is kept",
  }[state];
  $("settings").hidden = busy || !chosen;
  const predicted = chosen?.choices.find(({ choice }) => choice === chosen.settings.choice).prediction;
  const ahead = busy || !predicted ? null : predicted.stages.length ? `Predicted: ${duration(predicted.seconds)}, up to ${(predicted.memory_bytes / 1e9).toFixed(1)} GB of memory` : "Everything is up to date";
  $("run-words").textContent = [words, ahead].filter(Boolean).map(part => `${part}.`).join(" ");
  fill($("stages"), ...(own ? [...stages].map(([name, stage]) => row(name, stage)) : []));
  const said = own ? [...warnings.map(event => [event.event, event.text]), ...(told.state === "failed" && told.text && !warnings.some(w => w.event === "error") ? [["error", told.text]] : [])] : [];
  $("log-title").hidden = !said.length;
  fill($("log"), ...said.map(([kind, text]) => element("li", { class: kind }, element("b", {}, kind === "error" ? "Error" : "Warning"), ` ${text}`)));
}

function row(name, stage) {
  const share = stage.state === "done" ? 1 : stage.total ? stage.done / stage.total : null;
  return element("li", { class: stage.state },
    element("span", { class: "name" }, TITLES[name] ?? name),
    element("progress", share === null ? { max: 1, "aria-label": TITLES[name] ?? name } : { max: 1, value: share, "aria-label": TITLES[name] ?? name }),
    element("span", { class: "time" }, stage.state === "done" ? duration(stage.seconds) : stage.total ? `${stage.done} of ${stage.total}` : ""),
    element("span", { class: "text" }, stage.text ?? ""));
}

export function toldNow() { draw(); }
export { toldNow as told };

let saving = Promise.resolve(); // a start that follows a choice at once waits for it

const act = name => guarded(async () => {
  const before = saving;
  saving = Promise.resolve();
  await before;
  await post(name);
  await renew();
  await show();
});
const length = field => (field.value === "" ? null : Number(field.value));
$("settings").addEventListener("submit", event => event.preventDefault());
async function save() {
  const fields = $("settings").elements;
  try {
    await post("settings", {
      choice: fields.choice.value, orthophoto: fields.orthophoto.value === "yes", terrain: fields.terrain.value,
      cell_m: length(fields.cell_m), interval_m: length(fields.interval_m),
    });
  } finally {
    await show();
  }
}
$("settings").addEventListener("change", guarded(() => (saving = save())));
$("run-start").addEventListener("click", act("start"));
$("run-pause").addEventListener("click", act("pause"));
$("run-resume").addEventListener("click", act("resume"));
$("run-stop").addEventListener("click", act("stop"));
