// Compare: the survey with a design, another surface or another survey, as `photogram compare` does it.

import { comparedAddress, get, post } from "./api.js";
import { $, element, ENGLISH, fill, figure, guarded } from "./page.js";
import { differenceLayer, differenceLegend, rasterLayer } from "./rasters.js";
import * as swipe from "./swipe.js";
import { nt, t, typed } from "./words.js";

const ASK_EVERY_MS = 700;
let look = null, view = null, drawn = [], asking = false;
let shown = { name: null, how: null };

// ``made`` is the map of the results and its own rasters; nothing is compared on it yet.
export async function begin(made) {
  look = made;
  clear();
  fill($("compare-own"), ...made.layers.filter(layer => ["surface", "terrain"].includes(layer.name))
    .map(layer => element("option", { value: layer.name }, surfaceOf(layer.name))));
  relation();
  await renew();
}

// The outlines among the kept measurements, which volumes and stable ground are chosen from.
export function outlines(kept) {
  const areas = kept.map((item, number) => ({ ...item, number })).filter(item => item.kind === "area" || item.kind === "volume");
  const groups = [
    ["compare-outlines", t("Volumes within"), t("without any: everything that both cover"), t("everything that both cover; for less, draw an area with the tools above")],
    ["compare-stable", t("Ground that has not moved"), "", t("none; draw areas with the tools above")],
  ];
  for (const [id, title, hint, none] of groups) {
    const ticked = new Set(chosen(id));
    fill($(id), element("legend", {}, title),
      ...areas.map(({ name, number }) => element("label", {}, element("input", { type: "checkbox", value: String(number), checked: ticked.has(number) }), name)),
      element("small", {}, areas.length ? hint : none));
  }
}

const chosen = id => [...$(id).querySelectorAll("input:checked")].map(box => Number(box.value));

function relation() {
  const design = $("compare-form").elements.relation.value === "design";
  $("compare-epoch").hidden = design;
  $("compare-sigmas").hidden = design;
}

const renew = guarded(async () => {
  view = await get("comparisons");
  const { name, done, total } = view.under_way;
  $("compare-words").textContent = !name ? "" : total ? t("Comparing: {done} of {total} …", { done, total }) : t("Comparing …");
  $("compare-start").disabled = Boolean(name);
  list();
  if (name && !asking) {
    asking = true;
    setTimeout(async () => {
      asking = false;
      await renew();
      if (!view.under_way.name && view.comparisons[0]?.told) show(view.comparisons[0]);
    }, ASK_EVERY_MS);
  }
});

function entry(item) {
  const title = titleOf(item.asked);
  const button = (name, words, act, pressed = null) => element("button", { type: "button", "data-act": `${item.name} ${name}`, "aria-pressed": pressed === null ? null : String(pressed), onclick: guarded(act) }, words);
  const remove = button("remove", t("Remove"), async () => {
    if (shown.name === item.name) clear();
    await post("forget-comparison", { name: item.name });
    await renew();
  });
  if (!item.told) return element("li", {}, element("h3", {}, title), element("p", { class: "bad", ...ENGLISH }, item.problem), element("div", { class: "actions" }, remove));
  const { told } = item;
  return element("li", {}, element("h3", {}, title),
    item.is_outdated ? element("p", { class: "attention" }, t("One of the two has changed since: compare again.")) : null,
    ...told.volumes.flatMap(volume => [element("h4", {}, volume.name), element("dl", {}, ...volume.figures.flatMap(f => [element("dt", {}, f.name), element("dd", {}, figure(f.value, f.sigma, f.unit))]))]),
    element("p", { class: "muted" }, t("{share} of the cells within the level of detection.", { share: told.within })),
    element("div", { class: "actions" },
      button("difference", t("Difference"), () => (isShown(item, "difference") ? clear() : show(item)), isShown(item, "difference")),
      ...item.other_layers.filter(layer => look.layers.some(own => own.name === layer.name))
        .map(layer => button(layer.name, swipeTitle(layer.name), () => (isShown(item, layer.name) ? clear() : sideBySide(item, layer)), isShown(item, layer.name))),
      remove),
    element("details", { "data-act": item.name }, element("summary", {}, t("What was compared")), ...told.said.map(text => element("p", ENGLISH, text)),
      element("p", { class: "muted" }, t("The same in a terminal:")), element("code", {}, item.command)));
}

const surfaceOf = name => ({ surface: t("surface"), terrain: t("terrain") })[name];
const swipeTitle = layer => ({ orthophoto: t("Swipe: orthophoto"), surface: t("Swipe: surface"), terrain: t("Swipe: terrain") })[layer];

function titleOf({ path, relation, own }) {
  const file = path.split("/").filter(Boolean).at(-1);
  if (own === "terrain") {
    return { design: t("{file}: a design, against the terrain", { file }), earlier: t("{file}: an earlier survey or surface, against the terrain", { file }), later: t("{file}: a later survey or surface, against the terrain", { file }) }[relation];
  }
  return { design: t("{file}: a design", { file }), earlier: t("{file}: an earlier survey or surface", { file }), later: t("{file}: a later survey or surface", { file }) }[relation];
}

const isShown = (item, how) => shown.name === item.name && shown.how === how;

// All comparisons, the last one first; what had the focus, and what was unfolded, has it again.
function list() {
  if (!view) return;
  const focus = document.activeElement?.dataset.act, open = [...$("comparisons").querySelectorAll("details[open]")].map(one => one.dataset.act);
  fill($("comparisons"), ...view.comparisons.filter(item => item.name !== view.under_way.name).map(entry));
  for (const one of $("comparisons").querySelectorAll("[data-act]")) {
    if (one.dataset.act === focus) one.focus({ preventScroll: true });
    if (open.includes(one.dataset.act)) one.open = true;
  }
}

// Nothing is compared on the map any more.
export function clear() {
  if (!look) return;
  swipe.end();
  for (const layer of drawn) look.map.removeLayer(layer);
  drawn = [];
  shown = { name: null, how: null };
  look.others(true);
  list();
}

function show(item) {
  clear();
  shown = { name: item.name, how: "difference" };
  const made = differenceLayer(name => comparedAddress(item.name, name), item.told.half_range).layer;
  drawn = [made];
  look.map.getLayers().insertAt(look.rasterCount(), made);
  differenceLegend($("legend"), item.told);
  list();
}

function sideBySide(item, layer) {
  clear();
  shown = { name: item.name, how: layer.name };
  const own = look.layers.find(one => one.name === layer.name);
  const range = own.kind === "picture" ? [] : [Math.min(own.range[0], layer.range[0]), Math.max(own.range[1], layer.range[1])];
  const mineFirst = item.asked.relation !== "earlier";
  const mine = rasterLayer({ ...own, range }, look.address(own), mineFirst ? swipe.LEFT : swipe.RIGHT).layer;
  const theirs = rasterLayer({ ...layer, range }, comparedAddress(item.name, `other/${layer.name}`), mineFirst ? swipe.RIGHT : swipe.LEFT).layer;
  drawn = [mine, theirs];
  look.others(false);
  look.map.getLayers().insertAt(0, mine);
  look.map.getLayers().insertAt(1, theirs);
  const other = item.asked.path.split("/").filter(Boolean).at(-1);
  swipe.begin(...(mineFirst ? [t("this survey"), other] : [other, t("this survey")]));
  look.legend({ ...own, range });
  list();
}

// Which surfaces of a LandXML file, or layers of a drawing, where there are several.
const askParts = guarded(async () => {
  const path = $("compare-path").value.trim();
  fill($("compare-parts"));
  $("compare-parts").hidden = true;
  if (!/\.(xml|landxml|dxf)$/i.test(path)) return;
  const { what, triangles } = await get("parts", { path }), names = Object.keys(triangles);
  if (names.length < 2 || path !== $("compare-path").value.trim()) return;
  fill($("compare-parts"), element("legend", {}, what === "layer" ? t("Which layer") : t("Which surface")),
    ...names.map(name => element("label", {}, element("input", { type: "checkbox", value: name }), name, " ", element("small", {}, nt("{n} triangle", "{n} triangles", triangles[name])))));
  $("compare-parts").hidden = false;
});

// A file or a folder of this machine, chosen in a list.
const browse = guarded(async path => {
  const listed = await get("surfaces", path ? { path } : {});
  const choice = (words, act, more = "") => element("li", {}, element("button", { type: "button", onclick: act }, element("span", { translate: "no" }, words), more ? element("small", {}, more) : null));
  const take = async path => {
    $("compare-path").value = path;
    $("compare-listing").hidden = true;
    $("compare-path").focus();
    await askParts();
  };
  $("compare-folder").textContent = listed.path;
  fill($("compare-entries"), ...(listed.above ? [choice("..", () => browse(listed.above), t("the folder above"))] : []),
    ...listed.entries.map(one => (one.is_folder && !one.is_survey ? choice(one.name, () => browse(one.path), t("folder")) : choice(one.name, () => take(one.path), one.is_survey ? t("survey") : ""))));
  $("compare-listing").hidden = false;
  $("compare-entries").querySelector("button")?.focus();
});

$("compare-choose").addEventListener("click", () => ($("compare-listing").hidden ? browse("") : ($("compare-listing").hidden = true)));
$("compare-form").addEventListener("change", relation);
$("compare-path").addEventListener("change", askParts);
$("compare-form").addEventListener("submit", guarded(async event => {
  event.preventDefault();
  const form = $("compare-form").elements, design = form.relation.value === "design";
  const number = name => (form[name].value.trim() ? typed(form[name].value) : null);
  const sigmas = [number("own_sigma"), number("common_sigma")];
  if (!design && sigmas.filter(value => value === null).length === 1) throw new Error(t("Give both standard deviations, or neither."));
  await post("compare", {
    path: form.path.value, relation: form.relation.value, own: form.own.value || "surface",
    parts: [...$("compare-parts").querySelectorAll("input:checked")].map(box => box.value),
    sigma_m: design || sigmas[0] === null ? null : sigmas, correlation_m: number("correlation"),
    outlines: chosen("compare-outlines"), stable: design ? [] : chosen("compare-stable"), taken_off: design ? null : form.taken_off.value || null,
  });
  $("compare-new").open = false;
  await renew();
}));
