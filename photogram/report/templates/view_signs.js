// Photographs as frusta, ground points as signs, residuals and sigmas enlarged: all as lines in the local frame.

const CONTROL = [213, 94, 0, 255], CHECK = [0, 158, 115, 255];

function local(scene, mapPosition) { return mapPosition.map((value, k) => value - scene.origin_map_m[k]); }

function along(place, ray, length) { return place.map((value, k) => value + length * ray[k]); }

function frustum(photograph, depth, tint) {
  const { centre_m: centre, rays } = photograph, corners = rays.map(ray => along(centre, ray, depth));
  const lines = corners.map(corner => [centre, corner, tint]);
  corners.forEach((corner, k) => lines.push([corner, corners[(k + 1) % 4], tint]));
  // a roof over the upper edge says which way up the photograph is
  const [left, right] = corners, lower = corners[3];
  const roof = [0, 1, 2].map(k => (left[k] + right[k]) / 2 + 0.22 * (left[k] - lower[k]));
  return [...lines, [left, roof, tint], [right, roof, tint]];
}

// The rays through the corners down to a level plane, and the ground between them, where all of them reach it.
function footprint(photograph, ground, tint) {
  const { centre_m: centre, rays } = photograph;
  const lengths = rays.map(ray => (ground - centre[2]) / ray[2]);
  if (lengths.some((length, k) => !(length > 0) || rays[k][2] > -0.1 * Math.hypot(...rays[k]))) return [];
  const feet = rays.map((ray, k) => along(centre, ray, lengths[k]));
  const faint = [...tint.slice(0, 3), 130];
  return [...feet.map(foot => [centre, foot, faint]), ...feet.map((foot, k) => [foot, feet[(k + 1) % 4], tint])];
}

// Three ellipses, upright and level, of standard deviations along easting, northing and height.
function ellipsoid(place, sigma, scale, tint) {
  const lines = [], steps = 40;
  for (const [one, other] of [[0, 1], [0, 2], [1, 2]]) {
    const at = step => {
      const angle = 2 * Math.PI * step / steps, point = [...place];
      point[one] += scale * sigma[one] * Math.cos(angle);
      point[other] += scale * sigma[other] * Math.sin(angle);
      return point;
    };
    for (let step = 0; step < steps; step++) lines.push([at(step), at(step + 1), tint]);
  }
  return lines;
}

// Of a ground point: its residual from the surveyed place to the adjusted one, and the standard deviations there.
function errorLines(scene, point, scale, tint) {
  if (!point.residual_m) return [];
  const place = local(scene, point.surveyed_map_m), tip = along(place, point.residual_m, scale);
  const faint = [...tint.slice(0, 3), 190];
  return [[place, tip, tint], ...(point.sigma_m ? ellipsoid(tip, point.sigma_m, scale, faint) : [])];
}

function roleTint(point) { return point.role === "check" ? CHECK : CONTROL; }

function colourOf(name) {
  const text = getComputedStyle(document.documentElement).getPropertyValue(name).trim().slice(1);
  return [0, 2, 4].map(k => parseInt(text.slice(k, k + 2), 16));
}

// Hands all lines and signs to the drawing, with the colours of the scheme and the enlargement that are set now.
function placeSigns(drawing, scene, exaggeration) {
  const blue = [...colourOf("--photograph"), 255];
  drawing.setLines("photographs", scene.photographs.flatMap(p => frustum(p, scene.frustum_m, blue)), 1.6);
  const spread = scene.photographs.filter(p => p.sigma_m);
  const faint = [...blue.slice(0, 3), 120];
  drawing.setLines("photographs errors", spread.flatMap(p => ellipsoid(p.centre_m, p.sigma_m, exaggeration, faint)), 1);
  for (const role of ["control", "check"]) {
    const points = scene.points.filter(point => point.role === role);
    const shape = role === "check" ? 1 : 0;
    const lines = points.flatMap(p => errorLines(scene, p, exaggeration, roleTint(p)));
    drawing.setLines(`${role} casing`, lines.map(([start, end]) => [start, end, [255, 255, 255, 170]]), 3.6);
    drawing.setLines(`${role} errors`, lines, 2);
    drawing.setSigns(role, points.map(p => [local(scene, p.surveyed_map_m), roleTint(p), shape]), 22);
  }
}

// What is chosen or measured, over all else.
function placeChoice(drawing, scene, chosen, measured) {
  const tint = [...colourOf("--chosen"), 255], lines = [];
  if (chosen && chosen.photograph) {
    lines.push(...frustum(chosen.photograph, scene.frustum_m, tint));
    lines.push(...footprint(chosen.photograph, scene.ground_m, tint));
  }
  if (measured.length === 2) lines.push([measured[0].place, measured[1].place, tint]);
  drawing.setLines("choice", lines, 2.4);
  const places = [...measured.map(end => end.place), ...(chosen && chosen.cloud ? [chosen.place] : [])];
  drawing.setSigns("choice signs", places.map(place => [place, tint, 2]), 13);
}
