// The eye: it looks at a target, in metres east, north and up of the local origin, and is turned about it. Azimuth is the
// direction that is up on the screen, clockwise from north; tilt is 0 straight down and 90° at the horizon.

const FIELD_OF_VIEW = Math.PI / 4;

class Eye {
  constructor() {
    this.target = [0, 0, 0];
    this.azimuth = 0;
    this.tilt = 0;
    this.distance = 1;
    this.parallel = false;
    this.width = this.height = 1;
    this.nearest = 0;
    this.farthest = Infinity;
    this.box = [[-Infinity, -Infinity, -Infinity], [Infinity, Infinity, Infinity]];
  }

  // Keep the target within the survey: nobody gets lost in the sky.
  confine() {
    this.target = this.target.map((value, k) => clamp(value, this.box[0][k], this.box[1][k]));
  }

  // focal length in pixels of the page
  get focal() { return 0.5 * this.height / Math.tan(FIELD_OF_VIEW / 2); }

  get metresPerPixel() { return this.distance / this.focal; }

  axes() {
    const [sa, ca] = [Math.sin(this.azimuth), Math.cos(this.azimuth)];
    const [st, ct] = [Math.sin(this.tilt), Math.cos(this.tilt)];
    return { right: [ca, -sa, 0], up: [ct * sa, ct * ca, st], forward: [st * sa, st * ca, -ct] };
  }

  position() {
    const { forward } = this.axes();
    return this.target.map((value, k) => value - this.distance * forward[k]);
  }

  // Right, up and forward of the eye, in metres.
  seen(point) {
    const from = this.position(), { right, up, forward } = this.axes();
    const offset = point.map((value, k) => value - from[k]);
    return [dot(right, offset), dot(up, offset), dot(forward, offset)];
  }

  // Pixel of the page and depth of a point; null behind the eye.
  project(point) {
    const [x, y, depth] = this.seen(point);
    if (!this.parallel && depth < this.distance * 1e-4) return null;
    const scale = this.focal / (this.parallel ? this.distance : depth);
    return [this.width / 2 + x * scale, this.height / 2 - y * scale, depth];
  }

  // Turn by pixels of the page; the horizon stops it.
  turn(dx, dy) {
    this.azimuth += dx * 0.006;
    this.tilt = clamp(this.tilt - dy * 0.006, 0, Math.PI / 2);
  }

  // Move the target over level ground so that it follows the pointer.
  pan(dx, dy) {
    const { right } = this.axes(), scale = this.metresPerPixel;
    const ahead = [Math.sin(this.azimuth), Math.cos(this.azimuth), 0];
    const along = dy * scale / Math.max(Math.cos(this.tilt), 0.3);
    this.target = this.target.map((value, k) => value - dx * scale * right[k] + along * ahead[k]);
    this.confine();
  }

  // Come nearer to a place by a factor below one, or go away from it: it stays at its pixel, and is never passed.
  zoomAbout(place, factor) {
    let limited = clamp(this.distance * factor, this.nearest, this.farthest) / this.distance;
    const depth = this.seen(place)[2];
    if (!this.parallel && limited < 1) limited = Math.min(1, Math.max(limited, depth > 0 ? this.nearest / depth : 1));
    this.target = place.map((value, k) => value + limited * (this.target[k] - value));
    this.distance *= limited;
    this.confine();
  }

  // Put the target on what is seen in the middle, without changing the picture.
  rest(depth) {
    const { forward } = this.axes(), from = this.position();
    if (!this.parallel) {
      this.distance = clamp(depth, this.nearest, this.farthest);
      this.target = from.map((value, k) => value + this.distance * forward[k]);
    } else {
      this.target = from.map((value, k) => value + depth * forward[k]);
    }
  }

  // Stand so that all points are seen, for the directions that are set; margins in pixels of the page.
  fit(points, margin) {
    const low = [0, 1, 2].map(k => Math.min(...points.map(p => p[k])));
    const high = [0, 1, 2].map(k => Math.max(...points.map(p => p[k])));
    this.target = low.map((value, k) => (value + high[k]) / 2);
    const room = [this.width - margin.left - margin.right, this.height - margin.top - margin.bottom];
    for (let pass = 0; pass < 3; pass++) {
      let [near, far] = [this.nearest, this.farthest];
      let box = null;
      for (let step = 0; step < 40; step++) {
        this.distance = Math.sqrt(near * far);
        const seen = points.map(p => this.project(p));
        box = seen.includes(null) ? null : boxOf(seen);
        const inside = box && box[2] - box[0] < room[0] && box[3] - box[1] < room[1];
        if (inside) far = this.distance; else near = this.distance;
      }
      this.distance = far;
      box = boxOf(points.map(p => this.project(p)));
      const middle = [margin.left + room[0] / 2, margin.top + room[1] / 2];
      this.slide(middle[0] - (box[0] + box[2]) / 2, middle[1] - (box[1] + box[3]) / 2);
      this.filled = (box[3] - box[1]) / room[1]; // share of the height
    }
  }

  // Move the target in the plane of the picture.
  slide(dx, dy) {
    const { right, up } = this.axes(), scale = this.metresPerPixel;
    this.target = this.target.map((value, k) => value - dx * scale * right[k] + dy * scale * up[k]);
  }

  state() {
    return { target: [...this.target], azimuth: this.azimuth, tilt: this.tilt, distance: this.distance };
  }

  // Go a share of the way from one state to another, the shorter way round.
  between(from, to, share) {
    const turn = Math.atan2(Math.sin(to.azimuth - from.azimuth), Math.cos(to.azimuth - from.azimuth));
    this.target = from.target.map((value, k) => value + share * (to.target[k] - value));
    this.azimuth = from.azimuth + share * turn;
    this.tilt = from.tilt + share * (to.tilt - from.tilt);
    this.distance = from.distance * (to.distance / from.distance) ** share;
  }
}

function dot(a, b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

function clamp(value, low, high) { return Math.min(Math.max(value, low), high); }

function boxOf(pixels) {
  const x = pixels.map(p => p[0]), y = pixels.map(p => p[1]);
  return [Math.min(...x), Math.min(...y), Math.max(...x), Math.max(...y)];
}
