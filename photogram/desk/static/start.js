// Which survey: a folder of this machine, its tables, and a project file for it.

import { get, post } from "./api.js";
import { go, renew, show as showStep } from "./main.js";
import { $, element, fill, guarded, plural } from "./page.js";

let listed = null;

export async function show(state) {
  const survey = state.survey;
  $("start-title").textContent = survey ? survey.name : "Which survey?";
  $("open-survey").hidden = !survey;
  if (survey) fill($("open-survey"), ...beginning(survey));
  const others = state.recent.filter(folder => folder !== survey?.folder);
  $("recent").hidden = !others.length;
  fill($("recent-list"), ...others.map(folder => choice(folder, () => open(folder))));
  await list(listed?.path ?? survey?.folder ?? "");
}

const list = guarded(async path => {
  listed = await get("folders", path ? { path } : {});
  $("path").value = listed.path;
  const inside = [listed.has_project ? "a survey" : null, listed.photographs ? plural(listed.photographs, "photograph") : null];
  $("inside").textContent = `Here: ${inside.filter(Boolean).join(", ") || "no photographs, no survey"}.`;
  fill($("folders"), ...(listed.above ? [choice("..", () => list(listed.above), "the folder above")] : []),
    ...listed.folders.map(folder => choice(folder.name, () => list(folder.path),
      folder.has_project ? "survey" : folder.photographs ? plural(folder.photographs, "photograph") : "")));
});

const open = guarded(async folder => {
  await post("open", { folder });
  await renew();
  await go("map");
  await showStep();
});

function choice(name, act, words = "") {
  return element("li", {}, element("button", { type: "button", onclick: act }, name, words ? element("small", {}, words) : null));
}

function beginning(survey) {
  if (survey.problem) return [element("p", { class: "bad" }, survey.problem)];
  const close = element("button", { type: "button", onclick: guarded(async () => { await post("close"); await renew(); await showStep(); }) }, "Close");
  if (survey.has_project) {
    return [element("p", {}, `${plural(survey.photographs, "photograph")} in ${survey.photographs_folder}.`),
      element("div", { class: "actions" }, element("a", { class: "button main", href: "#map" }, "Go on"), close)];
  }
  const rows = survey.tables.map((table, number) => element("tr", {},
    element("th", { scope: "row" }, element("label", { for: `table-${number}` }, table.file)),
    element("td", {}, element("select", { id: `table-${number}`, "data-file": table.file },
      ...[["control", "control points"], ["check", "check points"], ["none", "not used"]].map(([value, words]) =>
        element("option", { value, selected: value === table.use }, words))))));
  const field = (name, title, input) => element("label", {}, title, Object.assign(input, { name }));
  const text = (placeholder, more = {}) => element("input", { type: "text", placeholder, spellcheck: "false", ...more });
  const more = element("form", { class: "lines" },
    field("crs", "Map grid, such as EPSG:25832", text("the UTM zone of the photographs")),
    field("focal_px", "Focal length, px", text("from the tags", { inputmode: "decimal" })),
    field("heights", "Heights of the points", element("select", {}, ...[["", "not stated"], ["ellipsoidal", "above the ellipsoid"], ["orthometric", "above a geoid"]].map(([value, words]) => element("option", { value }, words)))),
    field("geoid", "Geoid, such as EGM96 or EPSG:5799", text("none")));
  const begin = guarded(async () => {
    const tables = Object.fromEntries([...$("open-survey").querySelectorAll("select[data-file]")]
      .map(select => [select.dataset.file, select.value]).filter(([, use]) => use !== "none"));
    const said = Object.fromEntries([...new FormData(more)].map(([name, value]) => [name, value.trim()]).filter(([, value]) => value));
    if ("focal_px" in said) said.focal_px = Number(said.focal_px.replace(",", "."));
    await post("begin", { tables, recursive: survey.in_folders, ...said });
    await renew();
    await go("map");
    await showStep();
  });
  return [
    element("p", {}, `${plural(survey.photographs, "photograph")} in ${survey.photographs_folder}${survey.in_folders ? " and folders within" : ""}, no project yet.`),
    rows.length ? element("h3", {}, "Tables beside them") : null,
    rows.length ? element("table", {}, element("tbody", {}, ...rows)) : null,
    element("details", {}, element("summary", {}, "What the photographs do not say"), more),
    element("div", { class: "actions" }, element("button", { id: "begin", type: "button", class: "main", onclick: begin }, "Begin the survey"), close),
  ].filter(Boolean);
}

$("go").addEventListener("click", () => list($("path").value));
$("path").addEventListener("keydown", event => { if (event.key === "Enter") list($("path").value); });
$("open").addEventListener("click", () => open($("path").value));
