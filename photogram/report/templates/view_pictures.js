// Small pictures of photographs, and which of them shows a place.

class Pictures {
  constructor(scene) {
    this.scene = scene;
    this.encoded = JSON.parse(document.getElementById("pictures").textContent);
    this.some = Object.keys(this.encoded).length > 0;
  }

  source(name) { return this.encoded[name] ? `data:image/jpeg;base64,${this.encoded[name]}` : null; }

  // Where a photograph shows a place: shares of its width and height, null where it does not. The corners' rays span the
  // picture; what distortion does between them is left out.
  within(photograph, place) {
    const { centre_m: centre, rays: [a, b, , d] } = photograph, to = place.map((value, k) => value - centre[k]);
    const right = b.map((value, k) => value - a[k]), down = d.map((value, k) => value - a[k]);
    const whole = determinant(a, right, down);
    const depth = determinant(to, right, down) / whole;
    if (!(depth > 0)) return null;
    const [u, v] = [determinant(a, to, down) / whole / depth, determinant(a, right, to) / whole / depth];
    return u >= 0 && u <= 1 && v >= 0 && v <= 1 ? [u, v] : null;
  }

  // The photograph with a picture that shows a place nearest to its middle.
  best(place) {
    let best = null;
    for (const photograph of this.scene.photographs) {
      const at = this.encoded[photograph.name] ? this.within(photograph, place) : null;
      const away = at ? Math.hypot(at[0] - 0.5, at[1] - 0.5) : Infinity;
      if (at && (!best || away < best.away)) best = { photograph, at, away };
    }
    return best;
  }
}

function determinant(a, b, c) {
  return a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0]) + a[2] * (b[0] * c[1] - b[1] * c[0]);
}
