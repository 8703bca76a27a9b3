// The surface as the page holds it: its mesh for the drawing, its heights under the pointer.

const NOT_DRAWN = 0, MEASURED = 1, WALL = 2, INTERPOLATED = 3; // what a square of the mesh is

class Surface {
  constructor(scene) {
    const { surface } = scene;
    Object.assign(this, { surface, rows: surface.rows, columns: surface.columns, spacing: surface.spacing_m });
    this.steps = new Uint16Array(bytesOf("heights").buffer);
    this.squares = bytesOf("squares");
    const [east, north] = surface.first_map_m;
    this.first = local(scene, [east, north, surface.low_map_m]); // the north-west corner, at the lowest height
    let [low, high] = [surface.unknown, 0];
    for (const step of this.steps) {
      if (step === surface.unknown) continue;
      if (step < low) low = step;
      if (step > high) high = step;
    }
    const [width, length] = [(this.columns - 1) * this.spacing, (this.rows - 1) * this.spacing];
    this.low = [this.first[0], this.first[1] - length, this.first[2] + low * surface.step_m];
    this.high = [this.first[0] + width, this.first[1], this.first[2] + high * surface.step_m];
  }

  height(row, column) { return this.first[2] + this.steps[row * this.columns + column] * this.surface.step_m; }

  // Corners of the triangles, two a square, its diagonal from south-west to north-east: those of one kind after another,
  // and of each kind the first of them and their number.
  triangles() {
    const { rows, columns, squares } = this, parts = [], count = [0, 0, 0, 0];
    for (const kind of squares) count[kind] += 6;
    const index = new Uint32Array(count[MEASURED] + count[WALL] + count[INTERPOLATED]);
    for (let kind = MEASURED, first = 0; kind <= INTERPOLATED; first += count[kind++]) parts.push([kind, first, count[kind]]);
    const at = [0, ...parts.map(([, first]) => first)];
    for (let row = 0, square = 0; row < rows - 1; row++) {
      for (let column = 0; column < columns - 1; column++, square++) {
        const kind = squares[square], k = at[kind], nw = row * columns + column, sw = nw + columns;
        if (kind === NOT_DRAWN) continue;
        index[k] = nw; index[k + 1] = sw; index[k + 2] = nw + 1;
        index[k + 3] = nw + 1; index[k + 4] = sw; index[k + 5] = sw + 1;
        at[kind] = k + 6;
      }
    }
    return { index, parts };
  }

  // Where the ray through a pixel of the page first meets the mesh, how deep that is, and what is there; null where it
  // passes by. Squares are walked through in the order in which the ray crosses them.
  under(eye, x, y) {
    const { right, up, forward } = eye.axes(), scale = (eye.parallel ? eye.distance : 1) / eye.focal;
    const [across, above] = [(x - eye.width / 2) * scale, (eye.height / 2 - y) * scale];
    const aside = right.map((value, k) => across * value + above * up[k]), stand = eye.position();
    const from = eye.parallel ? stand.map((value, k) => value + aside[k]) : stand;
    const ray = eye.parallel ? forward : forward.map((value, k) => value + aside[k]);
    // columns, rows and metres up, for each metre of depth
    const place = [(from[0] - this.first[0]) / this.spacing, (this.first[1] - from[1]) / this.spacing, from[2]];
    const step = [ray[0] / this.spacing, -ray[1] / this.spacing, ray[2]];
    const low = [0, 0, this.low[2] - 1e-6], high = [this.columns - 1, this.rows - 1, this.high[2] + 1e-6];
    let [enter, leave] = [eye.parallel ? -Infinity : 0, Infinity];
    for (let k = 0; k < 3; k++) {
      if (Math.abs(step[k]) < 1e-12) { if (place[k] < low[k] || place[k] > high[k]) return null; continue; }
      const ends = [(low[k] - place[k]) / step[k], (high[k] - place[k]) / step[k]];
      [enter, leave] = [Math.max(enter, Math.min(...ends)), Math.min(leave, Math.max(...ends))];
    }
    if (!(enter <= leave)) return null;
    const inside = (value, k) => Math.floor(clamp(place[k] + value * step[k], 0, high[k] - 1e-9));
    for (let depth = enter, steps = this.columns + this.rows + 2; depth <= leave && steps > 0; steps--) {
      const middle = depth + 1e-7 * Math.max(1, Math.abs(depth)), column = inside(middle, 0), row = inside(middle, 1);
      const exits = [column, row].map((value, k) => (step[k] ? (value + (step[k] > 0 ? 1 : 0) - place[k]) / step[k] : Infinity));
      const end = Math.max(Math.min(...exits, leave), middle);
      const hit = this.within(row, column, place, step, depth, end);
      if (hit !== null) {
        const kind = this.squares[row * (this.columns - 1) + column];
        return { place: from.map((value, k) => value + hit * ray[k]), depth: hit, kind };
      }
      if (end >= leave) return null;
      depth = end;
    }
    return null;
  }

  // At what depth a ray meets the two triangles of a square, between two depths; null where it does not.
  within(row, column, place, step, enter, leave) {
    if (this.squares[row * (this.columns - 1) + column] === NOT_DRAWN) return null;
    const [nw, ne, sw, se] = [[0, 0], [0, 1], [1, 0], [1, 1]].map(([r, c]) => this.height(row + r, column + c));
    const [u, v] = [place[0] - column, place[1] - row], slack = 1e-6, hits = [];
    for (const [base, east, south, upper] of [[nw, ne - nw, sw - nw, true], [sw + ne - se, se - sw, se - ne, false]]) {
      const along = step[2] - east * step[0] - south * step[1];
      if (along === 0) continue;
      const depth = (base + east * u + south * v - place[2]) / along, sum = u + v + depth * (step[0] + step[1]);
      const span = slack * Math.max(1, Math.abs(depth));
      if (depth < enter - span || depth > leave + span || (upper ? sum > 1 + slack : sum < 1 - slack)) continue;
      hits.push(depth);
    }
    return hits.length ? Math.min(...hits) : null;
  }
}
