// Two rasters side by side on one map: the left one up to a line that a slider moves, the right one beyond it.

import { $ } from "./page.js";
import { t } from "./words.js";

// Classes that the canvases of the two layers bear; the style sheet cuts them off at the line.
export const LEFT = "swipe-left", RIGHT = "swipe-right";

export function begin(left, right) {
  $("swipe-left").textContent = left;
  $("swipe-right").textContent = right;
  $("swipe").hidden = false;
  $("swipe-line").hidden = false;
  moved();
}

export function end() {
  $("swipe").hidden = true;
  $("swipe-line").hidden = true;
}

function moved() {
  const share = Number($("swipe-share").value);
  $("swipe-share").setAttribute("aria-valuetext", t("{share} % of the map shows {survey}", { share, survey: $("swipe-left").textContent }));
  $("result-map-frame").style.setProperty("--share", `${share}%`);
}

$("swipe-share").addEventListener("input", moved);
