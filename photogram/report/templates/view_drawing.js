// Drawing with WebGL 2: points into a texture, shaded by their depths, then lines and signs over them.

const LENS = `
uniform vec4 lens;      // focal length over half the width and half the height; nearest and farthest depth
uniform float parallel; // 0: in perspective; else the distance at which a parallel picture has this scale
vec4 clipped(vec3 seen) {
  float near = lens.z, far = lens.w;
  if (parallel > 0.0)
    return vec4(seen.xy * lens.xy / parallel, (2.0 * seen.z - far - near) / (far - near), 1.0);
  return vec4(seen.xy * lens.xy, (seen.z * (far + near) - 2.0 * far * near) / (far - near), seen.z);
}
`;
const DEPTH = `
uniform highp sampler2D depths;
float depthAt(ivec2 place, vec4 lens, float parallel) {
  float z = texelFetch(depths, place, 0).r;
  float near = lens.z, far = lens.w;
  return parallel > 0.0 ? near + z * (far - near) : near * far / (far - z * (far - near));
}
`;

const POINTS_VERTEX = `#version 300 es
precision highp float;
layout(location = 0) in vec4 place; // steps east, north, up within the block; sigma in steps
layout(location = 1) in vec4 look;  // red, green, blue, confidence
uniform mat3 turn;
uniform vec3 corner;
uniform float bottom, step_m, sigmaStep, unknown;
uniform int mode;
uniform vec2 range;
uniform vec3 size; // diameter in metres × focal length in pixels, smallest and largest in pixels
uniform sampler2D ramp;
${LENS}
out vec3 colour;
void main() {
  vec3 seen = corner + turn * place.xyz;
  gl_Position = clipped(seen);
  gl_PointSize = clamp(size.x / (parallel > 0.0 ? parallel : seen.z), size.y, size.z);
  float value = mode == 1 ? bottom + place.z * step_m : mode == 2 ? place.w * sigmaStep : look.a * 255.0 / 254.0;
  bool absent = mode == 2 && place.w >= unknown || mode == 3 && look.a > 0.999;
  float share = clamp((value - range.x) / (range.y - range.x), 0.0, 1.0);
  colour = mode == 0 ? look.rgb : absent ? vec3(0.5) : texture(ramp, vec2(share * 63.0 / 64.0 + 0.5 / 64.0, 0.5)).rgb;
}`;
const POINTS_FRAGMENT = `#version 300 es
precision highp float;
in vec3 colour;
out vec4 painted;
void main() {
  vec2 from = gl_PointCoord - 0.5;
  if (dot(from, from) > 0.25) discard;
  painted = vec4(colour, 1.0);
}`;

const SHADE_VERTEX = `#version 300 es
void main() { gl_Position = vec4(vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0, 0.0, 1.0); }`;
// Eye-dome lighting (Boucheny 2009): a pixel is darker the farther it lies behind its neighbours.
const SHADE_FRAGMENT = `#version 300 es
precision highp float;
uniform sampler2D colours;
uniform vec4 lens;
uniform float parallel, radius, strength;
${DEPTH}
out vec4 painted;
float shadeDepth(ivec2 place) {
  float depth = depthAt(place, lens, parallel);
  return parallel > 0.0 ? depth / parallel * 1.4427 : log2(depth);
}
void main() {
  ivec2 place = ivec2(gl_FragCoord.xy), last = textureSize(depths, 0) - 1;
  vec4 colour = texelFetch(colours, place, 0);
  if (texelFetch(depths, place, 0).r >= 1.0) { painted = colour; return; }
  float here = shadeDepth(place), behind = 0.0;
  for (int k = 0; k < 8; k++) {
    float angle = float(k) * 0.7853982;
    ivec2 beside = place + ivec2(round(radius * vec2(cos(angle), sin(angle))));
    behind += clamp(here - shadeDepth(clamp(beside, ivec2(0), last)), 0.0, 0.06);
  }
  painted = vec4(colour.rgb * exp(-strength * behind / 8.0), 1.0);
}`;

// A line is a rectangle as wide as asked for, since WebGL draws no line wider than a pixel.
const LINES_VERTEX = `#version 300 es
precision highp float;
layout(location = 0) in vec3 start;
layout(location = 1) in vec3 end;
layout(location = 2) in vec4 tint;
uniform mat3 turn;
uniform vec3 corner;
uniform vec2 screen; // width and height in pixels
uniform float width;
${LENS}
out vec4 colour;
out float depth;
void main() {
  vec3 a = corner + turn * start, b = corner + turn * end;
  if (parallel == 0.0) {
    float near = lens.z;
    if (a.z < near && b.z < near) { gl_Position = vec4(2.0, 2.0, 2.0, 1.0); return; }
    if (a.z < near) a = mix(a, b, (near - a.z) / (b.z - a.z));
    if (b.z < near) b = mix(b, a, (near - b.z) / (a.z - b.z));
  }
  vec4 from = clipped(a), to = clipped(b);
  vec2 along = (to.xy / to.w - from.xy / from.w) * screen;
  vec2 across = length(along) > 0.0 ? normalize(vec2(-along.y, along.x)) : vec2(0.0, 1.0);
  bool last = gl_VertexID > 1;
  gl_Position = last ? to : from;
  gl_Position.xy += (float(gl_VertexID & 1) * 2.0 - 1.0) * width * across / screen * gl_Position.w;
  depth = last ? b.z : a.z;
  colour = tint;
}`;
const LINES_FRAGMENT = `#version 300 es
precision highp float;
in vec4 colour;
in float depth;
uniform vec4 lens;
uniform float parallel, tolerance;
${DEPTH}
out vec4 painted;
void main() {
  bool hidden = depth > depthAt(ivec2(gl_FragCoord.xy), lens, parallel) + tolerance;
  float alpha = colour.a * (hidden ? 0.3 : 1.0);
  painted = vec4(colour.rgb * alpha, alpha);
}`;

const SIGNS_VERTEX = `#version 300 es
precision highp float;
layout(location = 0) in vec4 place; // east, north, up; shape
layout(location = 1) in vec4 tint;
uniform mat3 turn;
uniform vec3 corner;
uniform float width;
${LENS}
out vec4 colour;
flat out int shape;
out float depth;
void main() {
  vec3 seen = corner + turn * place.xyz;
  gl_Position = clipped(seen);
  gl_PointSize = width;
  colour = tint;
  depth = seen.z;
  shape = int(place.w);
}`;
const SIGNS_FRAGMENT = `#version 300 es
precision highp float;
in vec4 colour;
flat in int shape;
in float depth;
uniform vec4 lens;
uniform float parallel, tolerance, width;
${DEPTH}
out vec4 painted;
// Signed distance from the rim, in units of the sign: negative inside.
float rim(vec2 p) {
  if (shape == 1) return length(p) - 0.62;
  if (shape == 2) return max(abs(p.x), abs(p.y)) - 0.45;
  return max(abs(p.x) * 0.87 - p.y * 0.5, p.y) - 0.38;
}
void main() {
  vec2 p = (gl_PointCoord - 0.5) * 2.0;
  float away = rim(p), edge = 2.0 / width;
  if (away > 2.5 * edge) discard;
  bool hidden = depth > depthAt(ivec2(gl_FragCoord.xy), lens, parallel) + tolerance;
  float alpha = (1.0 - smoothstep(1.5 * edge, 2.5 * edge, away)) * (hidden ? 0.45 : 1.0) * colour.a;
  painted = vec4(mix(colour.rgb, vec3(1.0), smoothstep(-0.5 * edge, 0.5 * edge, away)) * alpha, alpha);
}`;

class Drawing {
  constructor(gl, scene, points, looks) {
    this.gl = gl;
    this.scene = scene;
    this.programs = {
      points: this.program(POINTS_VERTEX, POINTS_FRAGMENT),
      shade: this.program(SHADE_VERTEX, SHADE_FRAGMENT),
      lines: this.program(LINES_VERTEX, LINES_FRAGMENT),
      signs: this.program(SIGNS_VERTEX, SIGNS_FRAGMENT),
    };
    this.cloud = gl.createVertexArray();
    gl.bindVertexArray(this.cloud);
    this.attribute(0, points, 4, gl.UNSIGNED_SHORT, false);
    this.attribute(1, looks, 4, gl.UNSIGNED_BYTE, true);
    this.nothing = gl.createVertexArray();
    this.groups = new Map();
    this.ramps = Object.fromEntries(Object.entries(scene.maps).map(([name, colours]) => [name, this.ramp(colours)]));
    this.mesh = null; // of the surface, once it is shown
    this.frame = null;
    this.largest = gl.getParameter(gl.ALIASED_POINT_SIZE_RANGE)[1];
  }

  program(vertex, fragment) {
    const gl = this.gl, program = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS) && !gl.isContextLost())
        throw new Error(gl.getShaderInfoLog(shader));
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS) && !gl.isContextLost())
      throw new Error(gl.getProgramInfoLog(program));
    const at = {};
    for (let k = 0; k < gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS); k++) {
      const { name } = gl.getActiveUniform(program, k);
      at[name] = gl.getUniformLocation(program, name);
    }
    return { program, at };
  }

  attribute(location, values, size, type, normalised, stride = 0, offset = 0) {
    const gl = this.gl;
    if (values) {
      gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
      gl.bufferData(gl.ARRAY_BUFFER, values, gl.STATIC_DRAW);
    }
    gl.enableVertexAttribArray(location);
    gl.vertexAttribPointer(location, size, type, normalised, stride, offset);
  }

  ramp(colours) {
    const gl = this.gl, texture = gl.createTexture();
    const bytes = new Uint8Array(colours.flatMap(colour => [...colour, 255]));
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, colours.length, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, bytes);
    this.sample(gl.LINEAR);
    return texture;
  }

  sample(filter) {
    const gl = this.gl;
    for (const [name, value] of [["MIN_FILTER", filter], ["MAG_FILTER", filter],
      ["WRAP_S", gl.CLAMP_TO_EDGE], ["WRAP_T", gl.CLAMP_TO_EDGE]])
      gl.texParameteri(gl.TEXTURE_2D, gl[`TEXTURE_${name}`], value);
  }

  // Lines: [start, end, [red, green, blue, alpha from 0 to 255]] each, in metres of the local frame.
  setLines(name, lines, width) {
    const gl = this.gl, bytes = new ArrayBuffer(28 * lines.length);
    const numbers = new Float32Array(bytes), tints = new Uint8Array(bytes);
    lines.forEach(([start, end, tint], k) => {
      numbers.set(start, 7 * k);
      numbers.set(end, 7 * k + 3);
      tints.set(tint, 28 * k + 24);
    });
    this.group(name, bytes, { kind: "lines", count: lines.length, width });
    this.attribute(0, null, 3, gl.FLOAT, false, 28, 0);
    this.attribute(1, null, 3, gl.FLOAT, false, 28, 12);
    this.attribute(2, null, 4, gl.UNSIGNED_BYTE, true, 28, 24);
    [0, 1, 2].forEach(location => gl.vertexAttribDivisor(location, 1));
  }

  // Signs: [place, [red, green, blue, alpha], shape] each; shape 0 is a triangle, 1 a circle, 2 a square.
  setSigns(name, signs, width) {
    const gl = this.gl, bytes = new ArrayBuffer(20 * signs.length);
    const numbers = new Float32Array(bytes), tints = new Uint8Array(bytes);
    signs.forEach(([place, tint, shape], k) => {
      numbers.set([...place, shape], 5 * k);
      tints.set(tint, 20 * k + 16);
    });
    this.group(name, bytes, { kind: "signs", count: signs.length, width });
    this.attribute(0, null, 4, gl.FLOAT, false, 20, 0);
    this.attribute(1, null, 4, gl.UNSIGNED_BYTE, true, 20, 16);
  }

  group(name, bytes, facts) {
    const gl = this.gl, old = this.groups.get(name);
    if (old) {
      gl.deleteBuffer(old.buffer);
      gl.deleteVertexArray(old.array);
    }
    const group = { ...facts, array: gl.createVertexArray(), buffer: gl.createBuffer(), shown: old ? old.shown : true };
    gl.bindVertexArray(group.array);
    gl.bindBuffer(gl.ARRAY_BUFFER, group.buffer);
    gl.bufferData(gl.ARRAY_BUFFER, bytes, gl.STATIC_DRAW);
    this.groups.set(name, group);
  }

  show(name, shown) {
    if (this.groups.has(name)) this.groups.get(name).shown = shown;
  }

  // The picture that points are drawn into, as large as the canvas.
  frameOf(width, height) {
    const gl = this.gl, old = this.frame;
    if (old && old.width === width && old.height === height) return old;
    if (old) {
      gl.deleteFramebuffer(old.target);
      gl.deleteTexture(old.colours);
      gl.deleteTexture(old.depths);
    }
    const frame = { width, height, target: gl.createFramebuffer(), colours: gl.createTexture(), depths: gl.createTexture() };
    gl.bindFramebuffer(gl.FRAMEBUFFER, frame.target);
    for (const [texture, format, place] of [[frame.colours, gl.RGBA8, gl.COLOR_ATTACHMENT0],
      [frame.depths, gl.DEPTH_COMPONENT24, gl.DEPTH_ATTACHMENT]]) {
      gl.bindTexture(gl.TEXTURE_2D, texture);
      gl.texStorage2D(gl.TEXTURE_2D, 1, format, width, height);
      this.sample(gl.NEAREST);
      gl.framebufferTexture2D(gl.FRAMEBUFFER, place, gl.TEXTURE_2D, texture, 0);
    }
    return this.frame = frame;
  }

  // Draw a share of the points of every block, and all else. `look` says how: mode, background, sizes.
  draw(eye, look, share) {
    const gl = this.gl, { width, height } = gl.canvas, ratio = height / eye.height;
    const { right, up, forward } = eye.axes();
    const view = {
      lens: [2 * eye.focal / eye.width, 2 * eye.focal / eye.height, ...look.depths],
      parallel: eye.parallel ? eye.distance : 0,
      rows: [right, up, forward],
      from: eye.position(),
      ratio,
    };
    const frame = this.frameOf(width, height);
    gl.bindFramebuffer(gl.FRAMEBUFFER, frame.target);
    gl.viewport(0, 0, width, height);
    gl.clearColor(...look.background, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    if (look.surface) this.mesh.draw(look, view);
    if (look.cloud) this.drawPoints(eye, look, view, share);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.viewport(0, 0, width, height);
    this.shade(frame, view, look);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    for (const group of this.groups.values()) if (group.shown && group.count) this.drawGroup(group, view, look);
    gl.disable(gl.BLEND);
  }

  use(program, view) {
    const gl = this.gl, { at } = program;
    gl.useProgram(program.program);
    gl.uniform4fv(at.lens, view.lens);
    gl.uniform1f(at.parallel, view.parallel);
    return at;
  }

  // The rows of the eye's axes, times a scale, in the order of columns that WebGL asks for.
  turn(view, scale) {
    return [0, 1, 2].flatMap(k => view.rows.map(row => row[k] * scale));
  }

  drawPoints(eye, look, view, share) {
    const gl = this.gl, { scene } = this, at = this.use(this.programs.points, view);
    const diameter = look.size.metres / Math.sqrt(share);
    const smallest = view.ratio * Math.max(1, Math.min(2.4 * look.pointScale, 5) / Math.sqrt(Math.max(share, 0.2)));
    gl.uniformMatrix3fv(at.turn, false, this.turn(view, scene.step_m));
    gl.uniform3f(at.size, diameter * eye.focal * view.ratio, smallest, Math.min(look.size.pixels * view.ratio, this.largest));
    gl.uniform1f(at.step_m, scene.step_m);
    gl.uniform1f(at.sigmaStep, scene.sigma_step_m);
    gl.uniform1f(at.unknown, scene.unknown);
    gl.uniform1i(at.mode, ["colour", "height", "sigma", "confidence"].indexOf(look.mode));
    gl.uniform2f(at.range, ...look.range);
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, this.ramps[look.mode] || this.ramps.height);
    gl.uniform1i(at.ramp, 0);
    gl.bindVertexArray(this.cloud);
    gl.enable(gl.DEPTH_TEST);
    const side = 65536 * scene.step_m;
    for (const [east, north, up, first, count] of scene.blocks) {
      const place = [east * side, north * side, up * side];
      const offset = place.map((value, k) => value - view.from[k]);
      gl.uniform3fv(at.corner, view.rows.map(row => dot(row, offset)));
      gl.uniform1f(at.bottom, place[2] + scene.origin_map_m[2]);
      gl.drawArrays(gl.POINTS, first, Math.ceil(count * share));
    }
    gl.disable(gl.DEPTH_TEST);
  }

  shade(frame, view, look) {
    const gl = this.gl, at = this.use(this.programs.shade, view);
    this.depths(at, frame);
    gl.activeTexture(gl.TEXTURE1);
    gl.bindTexture(gl.TEXTURE_2D, frame.colours);
    gl.uniform1i(at.colours, 1);
    gl.uniform1f(at.radius, Math.max(1, 1.4 * view.ratio));
    gl.uniform1f(at.strength, look.mode === "colour" ? 60 : 110);
    gl.bindVertexArray(this.nothing);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }

  depths(at, frame) {
    const gl = this.gl;
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, frame.depths);
    gl.uniform1i(at.depths, 0);
  }

  drawGroup(group, view, look) {
    const gl = this.gl, at = this.use(this.programs[group.kind], view);
    this.depths(at, this.frame);
    gl.uniformMatrix3fv(at.turn, false, this.turn(view, 1));
    gl.uniform3fv(at.corner, view.rows.map(row => -dot(row, view.from)));
    gl.uniform1f(at.width, group.width * view.ratio);
    gl.uniform1f(at.tolerance, look.tolerance);
    gl.bindVertexArray(group.array);
    if (group.kind === "lines") {
      gl.uniform2f(at.screen, gl.canvas.width, gl.canvas.height);
      gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, group.count);
    } else {
      gl.drawArrays(gl.POINTS, 0, group.count);
    }
  }
}
