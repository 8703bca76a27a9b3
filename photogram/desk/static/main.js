// The page: which survey is open, which step is shown, and what runs.

import { get } from "./api.js";
import { $, duration, element, fill, guarded, keepingFields, problem } from "./page.js";
import * as hand from "./hand.js";
import * as look from "./look.js";
import * as map from "./overview.js";
import * as points from "./points.js";
import * as run from "./run.js";
import * as start from "./start.js";
import { code, languages, speak, t } from "./words.js";

const STEPS = { start, map, points, run, look, hand };
const ASK_EVERY_MS = 1000;

const page = { state: null, run: null, shown: null };

function wanted() {
  const step = location.hash.slice(1);
  if (!page.state?.survey) return "start";
  if (!page.state.survey.has_project) return "start";
  return step in STEPS ? step : "map";
}

export async function renew() {
  page.state = await get("state");
  $("title").textContent = page.state.survey ? page.state.survey.name : t("No survey open");
  document.title = page.state.survey ? `${page.state.survey.name} – photogram desk` : "photogram desk";
  const open = Boolean(page.state.survey?.has_project);
  for (const link of document.querySelectorAll("[data-step]")) {
    const usable = open || link.dataset.step === "start";
    link.setAttribute("aria-disabled", String(!usable));
    link.tabIndex = usable ? 0 : -1;
  }
  await watch();
}

export async function show(step = wanted()) {
  problem(null);
  if (page.shown && page.shown !== step) STEPS[page.shown].leave?.();
  for (const name of Object.keys(STEPS)) $(name).hidden = name !== step;
  for (const link of document.querySelectorAll("[data-step]")) {
    if (link.dataset.step === step) link.setAttribute("aria-current", "step");
    else link.removeAttribute("aria-current");
  }
  page.shown = step;
  try {
    await STEPS[step].show(page.state);
  } catch (error) {
    problem(error);
  }
}

export async function go(step) {
  if (location.hash === `#${step}`) await show(step);
  else location.hash = step;
}

async function watch() {
  if (!page.state?.survey?.has_project) {
    $("running").hidden = true;
    return;
  }
  const before = page.run?.state, told = await run.ask();
  page.run = told;
  const goesOn = told.state === "running" || told.state === "paused";
  $("running").hidden = !goesOn;
  if (goesOn) $("running").replaceChildren(element("a", { href: told.kind === "deliver" ? "#hand" : "#run" }, underWay(told)));
  if (before === "running" && told.state !== "running" && page.shown !== "run" && page.shown !== "start") await show(page.shown);
  STEPS[page.shown]?.told?.(told);
}

function underWay({ kind, state }) {
  const left = run.secondsLeft();
  const what = kind === "deliver" ? t("Writing deliverables") : run.stageTitle() ?? t("Run");
  if (state === "paused") return t("{what}: paused", { what });
  return left ? t("{what}: running, {time} left", { what, time: duration(left) }) : t("{what}: running", { what });
}

// The languages that the page can speak; another one changes its words, and nothing else.
function offerLanguages() {
  fill($("language"), ...languages().map(({ code: value, name }) => element("option", { value, lang: value, selected: value === code() }, name)));
}

$("language").addEventListener("change", guarded(async () => {
  await speak($("language").value);
  await keepingFields($(page.shown), async () => {
    await renew();
    await show();
  });
}));

window.addEventListener("hashchange", () => show());
window.addEventListener("keydown", event => {
  if (event.altKey && /^[1-6]$/.test(event.key)) {
    event.preventDefault();
    document.querySelectorAll("[data-step]")[Number(event.key) - 1].click();
  }
});

offerLanguages();
await renew().catch(problem);
await show();
let asking = false;
setInterval(async () => {
  if (asking || document.hidden) return;
  asking = true;
  try {
    await watch();
  } catch (error) {
    problem(error);
  } finally {
    asking = false;
  }
}, ASK_EVERY_MS);
