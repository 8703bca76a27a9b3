// The points as the page holds them: unpacked, found under the pointer, told in the map's coordinates.

function bytesOf(id) {
  const text = document.getElementById(id).textContent.trim();
  if (Uint8Array.fromBase64) return Uint8Array.fromBase64(text);
  const letters = atob(text), bytes = new Uint8Array(letters.length);
  for (let k = 0; k < letters.length; k++) bytes[k] = letters.charCodeAt(k);
  return bytes;
}

class Cloud {
  constructor(scene) {
    this.scene = scene;
    this.steps = new Uint16Array(bytesOf("points").buffer); // of little-endian machines, as all that run browsers are
    this.looks = bytesOf("looks");
    this.plan = scene.sigma_plan_step_m === null ? null : new Uint16Array(bytesOf("plan").buffer);
  }

  // Metres east, north and up of the local origin.
  place(index) {
    const block = this.scene.blocks.find(([, , , first, count]) => index >= first && index < first + count);
    return [0, 1, 2].map(k => (block[k] * 65536 + this.steps[4 * index + k]) * this.scene.step_m);
  }

  figures(index) {
    const { scene } = this, sigma = this.steps[4 * index + 3], confidence = this.looks[4 * index + 3];
    const plan = this.plan ? this.plan[index] : scene.unknown;
    return {
      sigma_m: sigma === scene.unknown ? null : sigma * scene.sigma_step_m,
      plan_m: plan === scene.unknown ? null : plan * scene.sigma_plan_step_m,
      confidence: !scene.confidence || confidence === 255 ? null : confidence / 254,
    };
  }

  // Some of the points, evenly chosen, in metres of the local frame: unpacked once.
  sample() {
    if (this.some) return this.some;
    const share = Math.min(1, 20000 / this.scene.shown), places = [];
    for (const [, , , first, count] of this.scene.blocks)
      for (let k = first; k < first + Math.max(1, count * share) && k < first + count; k++) places.push(this.place(k));
    return this.some = places;
  }

  // Of some points the one that is seen nearest to a pixel of the page.
  nearestTo(eye, x, y) {
    let best = null, least = Infinity;
    for (const place of this.sample()) {
      const seen = eye.project(place);
      const away = seen ? Math.hypot(seen[0] - x, seen[1] - y) : Infinity;
      if (away < least) [best, least] = [place, away];
    }
    return best || this.sample()[0];
  }

  // The point under a pixel of the page: of those within a few pixels the one in front, or nearly in front and nearest to
  // the pixel. `size` is the diameter in metres and the largest in pixels that points are drawn with.
  under(eye, x, y, size) {
    const { scene, steps } = this, { right, up, forward } = eye.axes(), from = eye.position();
    const side = 65536 * scene.step_m, [across, down] = [x - eye.width / 2, eye.height / 2 - y];
    const found = [];
    for (const [east, north, above, first, count] of scene.blocks) {
      const offset = [east * side - from[0], north * side - from[1], above * side - from[2]];
      const corner = [dot(right, offset), dot(up, offset), dot(forward, offset)];
      if (this.misses(eye, corner, [right, up, forward], side, across, down, size.pixels)) continue;
      const [r, u, f] = [right, up, forward].map(axis => axis.map(value => value * scene.step_m));
      for (let k = first, at = 4 * first; k < first + count; k++, at += 4) {
        const [e, n, h] = [steps[at], steps[at + 1], steps[at + 2]];
        const depth = corner[2] + f[0] * e + f[1] * n + f[2] * h;
        const scale = eye.focal / (eye.parallel ? eye.distance : depth);
        const dx = (corner[0] + r[0] * e + r[1] * n + r[2] * h) * scale - across;
        const dy = (corner[1] + u[0] * e + u[1] * n + u[2] * h) * scale - down;
        const reach = Math.max(6, Math.min(0.5 * size.metres * scale, size.pixels / 2));
        if (scale > 0 && dx * dx + dy * dy <= reach * reach) found.push([k, depth, dx * dx + dy * dy]);
      }
    }
    if (!found.length) return null;
    const front = found.reduce((least, [, depth]) => Math.min(least, depth), Infinity);
    const slack = front + 2 * scene.spacing_m + 8 * eye.metresPerPixel;
    const best = found.filter(([, depth]) => depth <= slack).reduce((a, b) => (b[2] < a[2] ? b : a));
    return { index: best[0], depth: best[1] };
  }

  // Whether no point of a block can lie near the ray through a pixel.
  misses(eye, corner, axes, side, across, down, reach) {
    const middle = corner.map((value, k) => value + side / 2 * (axes[k][0] + axes[k][1] + axes[k][2]));
    const radius = side * 0.8660254;
    if (eye.parallel) {
      const scale = eye.focal / eye.distance;
      return Math.hypot(middle[0] * scale - across, middle[1] * scale - down) > radius * scale + reach;
    }
    if (middle[2] < -radius) return true;
    const ray = [across / eye.focal, down / eye.focal, 1], length = Math.hypot(...ray);
    const along = dot(ray, middle) / length;
    const apart = Math.sqrt(Math.max(dot(middle, middle) - along * along, 0));
    return apart > radius + reach / eye.focal * (along + radius);
  }
}
