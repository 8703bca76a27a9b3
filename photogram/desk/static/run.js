// The run: its stages, what they say, and its end.

import { get, post } from "./api.js";
import { renew } from "./main.js";
import { $, duration, element, ENGLISH, fill, guarded } from "./page.js";
import { fixed, t } from "./words.js";

// What a person reads of a stage.
export function titleOf(stage) {
  return {
    photographs: t("Photographs"), features: t("Features"), pairs: t("Pairs"), matches: t("Matching"), tie_points: t("Tie points"),
    orientation: t("Orientation"), transfer: t("Tie points between"), intersection: t("Linear intersection"), comparison: t("Comparison"),
    adjustment: t("Joint adjustment"), dense: t("Dense matching"), surface: t("Surface"), volumes: t("Volumes"),
    relief: t("Terrain and contours"), orthophoto: t("Orthophoto"), results: t("Results"),
  }[stage] ?? stage;
}

const titleOfChoice = choice => ({ full: t("All"), quick: t("Quick look"), own: t("As project.yaml says") })[choice];
const wordsOfChoice = choice => ({
  full: t("surface cell by cell, orthophoto, terrain"), quick: t("key points at half size, a surface between tie points"), own: t("neither of the two"),
})[choice];
let began = null, next = 0, told = null, chosen = null;
let stages = new Map(), warnings = [], last = null;

export const secondsLeft = () => (told?.state === "running" ? last?.seconds_left ?? null : null);
export const stageTitle = () => (last?.stage ? titleOf(last.stage) : null);

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
  fill($("choices"), element("legend", {}, t("What is made")), ...choices.map(({ choice, prediction }) => element("label", {},
    element("input", { type: "radio", name: "choice", value: choice, checked: choice === settings.choice }), titleOfChoice(choice), " ",
    element("small", {}, prediction.stages.length ? t("{what}; {time} from here", { what: wordsOfChoice(choice), time: duration(prediction.seconds) }) : t("{what}; up to date", { what: wordsOfChoice(choice) })))));
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
  $("run-start").textContent = { stopped: t("Go on"), failed: t("Try again") }[state] ?? t("Start");
  const words = {
    none: null, running: left ? t("{time} left.", { time: duration(left) }) : t("Under way."), paused: t("Paused: it takes no processor time, and keeps its memory."),
    done: t("Finished."), failed: t("Failed."), stopped: t("Stopped: what is finished is kept."),
  }[state];
  $("settings").hidden = busy || !chosen;
  const predicted = chosen?.choices.find(({ choice }) => choice === chosen.settings.choice).prediction;
  const ahead = busy || !predicted ? null : predicted.stages.length
    ? t("Predicted: {time}, up to {memory} GB of memory.", { time: duration(predicted.seconds), memory: fixed(predicted.memory_bytes / 1e9, 1) }) : t("Everything is up to date.");
  $("run-words").textContent = [words, ahead].filter(Boolean).join(" ");
  fill($("stages"), ...(own ? [...stages].map(([name, stage]) => row(name, stage)) : []));
  const said = own ? [...warnings.map(event => [event.event, event.text, "en"]), ...(told.state === "failed" && told.text && !warnings.some(w => w.event === "error") ? [["error", told.text, told.lang]] : [])] : [];
  $("log-title").hidden = !said.length;
  fill($("log"), ...said.map(([kind, text, lang]) => element("li", { class: kind }, element("b", {}, kind === "error" ? t("Error") : t("Warning")), " ", element("span", { lang }, text))));
}

function row(name, stage) {
  const share = stage.state === "done" ? 1 : stage.total ? stage.done / stage.total : null;
  return element("li", { class: stage.state },
    element("span", { class: "name" }, titleOf(name)),
    element("progress", share === null ? { max: 1, "aria-label": titleOf(name) } : { max: 1, value: share, "aria-label": titleOf(name) }),
    element("span", { class: "time" }, stage.state === "done" ? duration(stage.seconds) : stage.total ? t("{done} of {total}", { done: stage.done, total: stage.total }) : ""),
    element("span", { class: "text", ...ENGLISH }, stage.text ?? ""));
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
