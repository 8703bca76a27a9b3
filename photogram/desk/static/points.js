// Points marked in photographs: the page of photogram mark, within this one.

import { post } from "./api.js";
import { $ } from "./page.js";
import { code, t } from "./words.js";

let shown = null, wanted = null, spoken = null;

// Which point is shown when the page of marking is next.
export function markingOf(point) {
  wanted = point;
}

export async function show(state) {
  $("no-points").hidden = state.survey.has_points;
  $("no-points").textContent = t("The project has no ground points: give their coordinates in project.yaml under control_points, or begin the survey again with a table of points.");
  if (!state.survey.has_points) return;
  const { address, notes } = await post("mark");
  $("points-notes").hidden = !notes.length;
  $("points-notes").textContent = notes.join("\n");
  if (address !== shown || !$("marking").src || wanted !== null) {
    shown = address;
    // another address of the same page would only move its hash
    $("marking").contentWindow.location.replace("about:blank");
    $("marking").src = wanted === null ? address : `${address}#${encodeURIComponent(wanted)}`;
    wanted = null;
  } else if (spoken !== code()) $("marking").contentWindow.location.reload();
  spoken = code();
  $("marking").hidden = false;
}
