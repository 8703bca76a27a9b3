// Drawing of the surface: the mesh with the orthophoto on it, hatched where nobody has measured it.

const MESH_VERTEX = `#version 300 es
precision highp float;
layout(location = 0) in float above; // steps above the lowest height; the number of the corner says where it is
uniform mat3 turn;
uniform vec3 corner;
uniform int columns;
uniform float spacing, step_m, bottom;
uniform vec2 picture_m, range;
${LENS}
out vec2 place;
out float share;
void main() {
  float column = float(gl_VertexID % columns), row = float(gl_VertexID / columns);
  vec3 seen = corner + turn * vec3(column * spacing, -row * spacing, above * step_m);
  gl_Position = clipped(seen);
  place = vec2(column, row) * spacing / picture_m;
  share = (bottom + above * step_m - range.x) / (range.y - range.x);
}`;
const MESH_FRAGMENT = `#version 300 es
precision highp float;
in vec2 place;
in float share;
uniform sampler2D picture, ramp;
uniform int kind; // of the squares: ${MEASURED} measured, ${WALL} walls, ${INTERPOLATED} interpolated
uniform bool byHeight;
uniform float ratio;
uniform vec3 wallTone, groundTone;
out vec4 painted;
void main() {
  vec3 colour = byHeight ? texture(ramp, vec2(clamp(share, 0.0, 1.0) * 63.0 / 64.0 + 0.5 / 64.0, 0.5)).rgb
    : texture(picture, place).rgb;
  float stripe = mod((gl_FragCoord.x + gl_FragCoord.y) / ratio, 9.0);
  if (kind == ${INTERPOLATED}) colour = stripe < 3.5 ? groundTone : mix(vec3(dot(colour, vec3(0.3, 0.59, 0.11))), groundTone, 0.35);
  if (kind == ${WALL}) colour = wallTone;
  painted = vec4(colour, 1.0);
}`;

class Mesh {
  constructor(drawing, surface, ready) {
    const { gl } = drawing;
    Object.assign(this, { drawing, gl, surface, program: drawing.program(MESH_VERTEX, MESH_FRAGMENT), loaded: false });
    this.array = gl.createVertexArray();
    gl.bindVertexArray(this.array);
    drawing.attribute(0, surface.steps, 1, gl.UNSIGNED_SHORT, false);
    const { index, parts } = surface.triangles();
    this.parts = parts;
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, index, gl.STATIC_DRAW);
    gl.bindVertexArray(null);
    const image = new Image();
    image.onload = () => { this.load(image); ready(); };
    image.onerror = () => fault("The orthophoto cannot be shown", "This file is damaged: make it again with photogram view.");
    image.src = `data:image/jpeg;base64,${document.getElementById("orthophoto").textContent.trim()}`;
  }

  // The orthophoto as a texture, no larger than this graphics processor takes.
  load(image) {
    const gl = this.gl, most = gl.getParameter(gl.MAX_TEXTURE_SIZE), shrunk = Math.min(1, most / Math.max(image.width, image.height));
    const canvas = document.createElement("canvas");
    [canvas.width, canvas.height] = [Math.max(1, Math.floor(image.width * shrunk)), Math.max(1, Math.floor(image.height * shrunk))];
    if (shrunk < 1) canvas.getContext("2d").drawImage(image, 0, 0, canvas.width, canvas.height);
    this.picture = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, this.picture);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, gl.RGBA, gl.UNSIGNED_BYTE, shrunk < 1 ? canvas : image);
    gl.generateMipmap(gl.TEXTURE_2D);
    this.drawing.sample(gl.LINEAR);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR_MIPMAP_LINEAR);
    const finer = gl.getExtension("EXT_texture_filter_anisotropic");
    if (finer) gl.texParameterf(gl.TEXTURE_2D, finer.TEXTURE_MAX_ANISOTROPY_EXT, 4);
    this.loaded = true;
  }

  draw(look, view) {
    if (!this.loaded) return;
    const { gl, surface, drawing } = this, { scene } = drawing, at = drawing.use(this.program, view);
    const tone = name => colourOf(name).map(value => value / 255);
    gl.uniformMatrix3fv(at.turn, false, drawing.turn(view, 1));
    gl.uniform3fv(at.corner, view.rows.map(row => dot(row, surface.first.map((value, k) => value - view.from[k]))));
    gl.uniform1i(at.columns, surface.columns);
    gl.uniform1f(at.spacing, surface.spacing);
    gl.uniform1f(at.step_m, scene.surface.step_m);
    gl.uniform1f(at.bottom, scene.surface.low_map_m);
    gl.uniform2f(at.picture_m, ...scene.surface.picture_m);
    gl.uniform2f(at.range, ...scene.height);
    gl.uniform1i(at.byHeight, look.mode === "height" ? 1 : 0);
    gl.uniform1f(at.ratio, view.ratio);
    gl.uniform3f(at.wallTone, ...tone("--wall"));
    gl.uniform3f(at.groundTone, ...tone("--unmeasured"));
    for (const [unit, texture, name] of [[0, this.picture, "picture"], [1, drawing.ramps.height, "ramp"]]) {
      gl.activeTexture(gl.TEXTURE0 + unit);
      gl.bindTexture(gl.TEXTURE_2D, texture);
      gl.uniform1i(at[name], unit);
    }
    gl.bindVertexArray(this.array);
    gl.enable(gl.DEPTH_TEST);
    for (const [kind, first, count] of this.parts) {
      gl.uniform1i(at.kind, kind);
      gl.drawElements(gl.TRIANGLES, count, gl.UNSIGNED_INT, 4 * first);
    }
    gl.disable(gl.DEPTH_TEST);
  }
}
