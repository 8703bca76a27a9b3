// Which survey: a folder of this machine, its tables, and a project file for it.

import { get, post } from "./api.js";
import { go, renew, show as showStep } from "./main.js";
import { $, duration, element, ENGLISH, fill, guarded, problem } from "./page.js";
import { titleOf } from "./run.js";
import { nt, t, typed } from "./words.js";

const ASK_EVERY_MS = 3000;

let listed = null;

export async function show(state) {
  const survey = state.survey;
  $("start-title").textContent = survey ? survey.name : t("Which survey?");
  $("open-survey").hidden = !survey;
  if (survey) fill($("open-survey"), ...beginning(survey));
  await others(survey?.folder);
  await list(listed?.path ?? survey?.folder ?? "");
}

// The other surveys, and what their runs do, as long as anybody looks.
let asking = null;
async function others(own) {
  clearTimeout(asking);
  const surveys = (await get("recent")).filter(survey => survey.folder !== own), focused = document.activeElement?.dataset.folder;
  $("recent").hidden = !surveys.length;
  fill($("recent-list"), ...surveys.map(survey => choice(survey.folder, () => open(survey.folder), doing(survey))));
  if (focused) $("recent-list").querySelector(`[data-folder="${CSS.escape(focused)}"]`)?.focus();
  asking = setTimeout(guarded(() => others(own)), ASK_EVERY_MS);
}

export const leave = () => clearTimeout(asking);

function doing({ run, stage, seconds_left: left, has_results: results }) {
  const words = { running: stage ? t("running: {stage}", { stage: titleOf(stage) }) : t("running"), paused: t("paused"), failed: t("failed"), stopped: t("stopped") }[run];
  return [words, left ? t("{time} left", { time: duration(left) }) : null, results ? t("has results") : null].filter(Boolean).join(", ");
}

const list = guarded(async path => {
  listed = await get("folders", path ? { path } : {});
  $("path").value = listed.path;
  $("inside").textContent = listed.has_project ? t("Here: a survey.") : listed.photographs
    ? nt("Here: {n} photograph.", "Here: {n} photographs.", listed.photographs) : t("Here: no photographs, no survey.");
  fill($("folders"), ...(listed.above ? [choice("..", () => list(listed.above), t("the folder above"))] : []),
    ...listed.folders.map(folder => choice(folder.name, () => list(folder.path),
      folder.has_project ? t("survey") : folder.photographs ? nt("{n} photograph", "{n} photographs", folder.photographs) : "")));
});

const open = guarded(async folder => {
  await post("open", { folder });
  await renew();
  await go("map");
  await showStep();
});

function choice(name, act, words = "") {
  return element("li", {}, element("button", { type: "button", onclick: act, "data-folder": name }, element("span", { translate: "no" }, name), words ? element("small", {}, words) : null));
}

function beginning(survey) {
  if (survey.problem) return [element("p", { class: "bad", ...ENGLISH }, survey.problem)];
  const close = element("button", { type: "button", onclick: guarded(async () => { await post("close"); await renew(); await showStep(); }) }, t("Close"));
  if (survey.has_project) {
    return [element("p", {}, nt("{n} photograph in {folder}.", "{n} photographs in {folder}.", survey.photographs, { folder: survey.photographs_folder })),
      element("div", { class: "actions" }, element("a", { class: "button main", href: "#map" }, t("Go on")), close)];
  }
  const rows = survey.tables.map((table, number) => element("tr", {},
    element("th", { scope: "row" }, element("label", { for: `table-${number}` }, table.file)),
    element("td", {}, element("select", { id: `table-${number}`, "data-file": table.file },
      ...[["control", t("control points")], ["check", t("check points")], ["none", t("not used")]].map(([value, words]) =>
        element("option", { value, selected: value === table.use }, words))))));
  const field = (name, title, input) => element("label", {}, title, Object.assign(input, { name }));
  const text = (placeholder, more = {}) => element("input", { type: "text", placeholder, spellcheck: "false", ...more });
  const more = element("form", { class: "lines" },
    field("crs", t("Map grid, such as EPSG:25832"), text(t("the UTM zone of the photographs"))),
    field("focal_px", t("Focal length, px"), text(t("from the tags"), { inputmode: "decimal" })),
    field("heights", t("Heights of the points"), element("select", {}, ...[["", t("not stated")], ["ellipsoidal", t("above the ellipsoid")], ["orthometric", t("above a geoid")]].map(([value, words]) => element("option", { value }, words)))),
    field("geoid", t("Geoid, such as EGM96 or EPSG:5799"), text(t("none"))));
  const files = element("input", { id: "table-files", type: "file", multiple: "", accept: ".csv,.txt,.xml", class: "visually-hidden", onchange: () => added(files.files) });
  const begin = guarded(async () => {
    const tables = Object.fromEntries([...$("open-survey").querySelectorAll("select[data-file]")]
      .map(select => [select.dataset.file, select.value]).filter(([, use]) => use !== "none"));
    const solution = $("solution")?.value;
    if (solution) {
      await post("begin", { solution, ...(more.elements.crs.value.trim() ? { crs: more.elements.crs.value.trim() } : {}) });
      await renew();
      await go("map");
      return showStep();
    }
    const said = Object.fromEntries([...new FormData(more)].map(([name, value]) => [name, value.trim()]).filter(([, value]) => value));
    if ("focal_px" in said) said.focal_px = typed(said.focal_px);
    await post("begin", { tables, recursive: survey.in_folders, ...said });
    await renew();
    await go("map");
    await showStep();
  });
  const theirs = survey.solutions.length ? element("p", {}, element("label", {}, t("Begin with"), " ",
    element("select", { id: "solution", onchange: event => { beside.hidden = Boolean(event.target.value); note.hidden = !event.target.value; } },
      element("option", { value: "" }, t("the photographs alone")),
      ...survey.solutions.map(({ file, program }) => element("option", { value: file, translate: "no" }, `${program}: ${file}`))))) : null;
  const note = element("p", { class: "muted", hidden: true }, t("Cameras, poses, points and marks are those of this solution; tables are not read."));
  const beside = element("div", {},
    element("h3", {}, t("Tables beside them")),
    rows.length ? element("table", {}, element("tbody", {}, ...rows)) : null,
    element("p", {}, element("label", { class: "button", for: "table-files" }, t("Add tables of points …")), files, " ", element("span", { class: "muted" }, t("or drop them on this page"))));
  return [
    element("p", {}, survey.in_folders
      ? nt("{n} photograph in {folder} and folders within, no project yet.", "{n} photographs in {folder} and folders within, no project yet.", survey.photographs, { folder: survey.photographs_folder })
      : nt("{n} photograph in {folder}, no project yet.", "{n} photographs in {folder}, no project yet.", survey.photographs, { folder: survey.photographs_folder })),
    theirs, note, beside,
    element("details", {}, element("summary", {}, t("What the photographs do not say")), more),
    element("div", { class: "actions" }, element("button", { id: "begin", type: "button", class: "main", onclick: begin }, t("Begin the survey")), close),
  ].filter(Boolean);
}

// Tables that were chosen or dropped, copied beside the photographs.
const added = guarded(async list => {
  for (const file of list) {
    const bytes = new Uint8Array(await file.arrayBuffer());
    let text = "";
    for (let n = 0; n < bytes.length; n += 32768) text += String.fromCharCode(...bytes.subarray(n, n + 32768));
    await post("table", { name: file.name, content: btoa(text) });
  }
  await renew();
  await showStep();
});

$("start").addEventListener("dragover", event => event.preventDefault());
$("start").addEventListener("drop", event => {
  event.preventDefault();
  const entries = [...event.dataTransfer.items].map(item => item.webkitGetAsEntry?.());
  if (entries.some(entry => entry?.isDirectory) || $("begin") === null) {
    problem(new Error(t("Folders of photographs are chosen in the list below: a browser does not say where they lie. Tables of points can be dropped once a folder of photographs is open.")));
  } else added(event.dataTransfer.files);
});
$("go").addEventListener("click", () => list($("path").value));
$("path").addEventListener("keydown", event => { if (event.key === "Enter") list($("path").value); });
$("open").addEventListener("click", () => open($("path").value));
