// Predicted standard deviations of distances: what two places share of the errors of photographs and calibration drops out.

class Errors {
  constructor(scene) { this.grid = scene.errors; }

  // Of the ground at a place: sigmas along easting, northing, height, and the factor L, three rows of numbers. Bilinear.
  at(place) {
    const { low_m: low, step_m: step, nodes, rank, sigma_m: sigma, factor_m: factor } = this.grid;
    const [u, v] = [0, 1].map(k => clamp((place[k] - low[k]) / step[k], 0, nodes - 1));
    const [column, row] = [u, v].map(value => Math.min(Math.floor(value), nodes - 2));
    const [p, q] = [u - column, v - row];
    const corners = [[0, 0, (1 - p) * (1 - q)], [1, 0, p * (1 - q)], [0, 1, (1 - p) * q], [1, 1, p * q]]
      .map(([c, r, weight]) => [(row + r) * nodes + column + c, weight]);
    const mean = pick => corners.reduce((sum, [node, weight]) => sum + weight * pick(node), 0);
    return {
      sigma: [0, 1, 2].map(k => mean(node => sigma[node][k])),
      factor: [0, 1, 2].map(k => [...Array(rank).keys()].map(n => mean(node => factor[node][k][n]))),
    };
  }

  // What a point of the cloud scatters by itself: variances along easting, northing, height. A height's is what its sigma
  // holds beyond the photographs' part, or the median of the cloud where that part, a datum of metres say, outweighs it;
  // a point of a dense surface has none in plan.
  own(end, ground) {
    const { own_m: median } = this.grid;
    const rest = (total, shared, usual) =>
      (shared > 0.8 * total && usual !== null ? Math.min(usual ** 2, total) : Math.max(total - shared, 0));
    const square = ground.sigma.map(s => s * s), { plan_m: plan, sigma_m: height } = end.cloud;
    const inPlan = plan === null ? 0 : rest(plan * plan, square[0] + square[1], median[0]) / 2;
    return [inPlan, inPlan, height === null ? 0 : rest(height * height, square[2], median[1])];
  }

  // Standard deviations along the axes of an end by itself, null where one is not known.
  alone(end) {
    if (end.point) return end.point.surveyed_sigma_m;
    if (end.photograph) return end.photograph.sigma_m;
    const { plan_m: plan, sigma_m: height } = end.cloud;
    if (height === null) return null;
    if (plan !== null) return [plan / Math.SQRT2, plan / Math.SQRT2, height];
    return this.grid ? [...this.at(end.place).sigma.slice(0, 2), height] : null;
  }

  // Sigmas of the distance in plan, of the height difference and of the slope distance between two ends, in metres, and
  // what they hold; null where nothing is known.
  distance(from, to) {
    const step = to.place.map((value, k) => value - from.place[k]), plan = Math.hypot(step[0], step[1]);
    const level = plan > 0 ? [step[0] / plan, step[1] / plan, 0] : [Math.SQRT1_2, Math.SQRT1_2, 0];
    const length = Math.hypot(...step), slope = length > 0 ? step.map(value => value / length) : [0, 0, 1];
    const directions = [level, [0, 0, 1], slope];
    if ([from, to].some(end => end.surface > MEASURED)) return null; // nobody has measured it
    if (from.cloud && to.cloud && this.grid) {
      const [a, b] = [this.at(from.place), this.at(to.place)], [one, other] = [this.own(from, a), this.own(to, b)];
      const error = [0, 1, 2].map(k => a.factor[k].map((value, n) => b.factor[k][n] - value));
      const sigma = directions.map(d => {
        const shared = a.factor[0].map((_, n) => d[0] * error[0][n] + d[1] * error[1][n] + d[2] * error[2][n]);
        return Math.sqrt(dot3(shared, shared) + d.reduce((sum, value, k) => sum + value * value * (one[k] + other[k]), 0));
      });
      const whole = from.cloud.sigma_m !== null && to.cloud.sigma_m !== null;
      return { sigma, kind: whole ? "joint" : "shape" };
    }
    const [one, other] = [this.alone(from), this.alone(to)];
    if (!one || !other) return null;
    const sigma = directions.map(d => Math.sqrt(d.reduce((sum, v, k) => sum + v * v * (one[k] ** 2 + other[k] ** 2), 0)));
    return { sigma, kind: from.point && to.point ? "surveyed" : "alone" };
  }
}

function dot3(a, b) { return a.reduce((sum, value, k) => sum + value * b[k], 0); }
