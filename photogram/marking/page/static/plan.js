// The survey from above: points by state, and the photographs of the one that is marked.

const SVG = "http://www.w3.org/2000/svg";
const svg = document.querySelector("#plan");

// Triangle for control, diamond for check points, circle for tie points, as in the list.
export function shape(role, x, y, r) {
  if (role === "tie") {
    const circle = document.createElementNS(SVG, "circle");
    for (const [key, value] of [["cx", x], ["cy", y], ["r", r * 0.85]]) circle.setAttribute(key, value);
    return circle;
  }
  const path = document.createElementNS(SVG, "path");
  const corners = role === "control" ? [[0, -1], [1, 0.85], [-1, 0.85]] : [[0, -1], [1, 0], [0, 1], [-1, 0]];
  path.setAttribute("d", `M${corners.map(([a, b]) => `${(x + a * r).toFixed(2)},${(y + b * r).toFixed(2)}`).join("L")}Z`);
  return path;
}

export function draw(plan, points, chosen, seen, choose) {
  const { width, height } = svg.getBoundingClientRect(), margin = 12;
  const all = [...plan.points, ...plan.photographs];
  if (!all.length || !width) return svg.replaceChildren();
  const east = all.map((place) => place.east_m), north = all.map((place) => place.north_m);
  const low = [Math.min(...east), Math.min(...north)], high = [Math.max(...east), Math.max(...north)];
  const k = Math.min((width - 2 * margin) / Math.max(high[0] - low[0], 1e-6), (height - 2 * margin) / Math.max(high[1] - low[1], 1e-6));
  const x = (place) => width / 2 + (place.east_m - (low[0] + high[0]) / 2) * k;
  const y = (place) => height / 2 - (place.north_m - (low[1] + high[1]) / 2) * k;
  svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
  const made = [];
  for (const place of plan.photographs) {
    const circle = shape("tie", x(place), y(place), seen.has(place.name) ? 3 : 2);
    circle.setAttribute("class", `photograph${seen.has(place.name) ? " seen" : ""}`);
    made.push(circle);
  }
  const known = new Map(points.map((point) => [point.name, point]));
  for (const place of plan.points) {
    const point = known.get(place.name);
    if (!point) continue;
    const drawn = shape(point.role, x(place), y(place), 6), title = document.createElementNS(SVG, "title");
    const states = [point.enough ? "enough" : "", point.wrong ? "wrong" : "", place.name === chosen ? "chosen" : ""];
    drawn.setAttribute("class", ["point", ...states].filter(Boolean).join(" "));
    title.textContent = `${place.name}: ${point.words}`;
    drawn.append(title);
    drawn.addEventListener("click", () => choose(place.name));
    made.push(drawn);
  }
  svg.replaceChildren(...made);
}
