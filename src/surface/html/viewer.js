
"use strict";
(() => {
  const at = id => document.getElementById(id);
  const canvas = at("view"), scene = JSON.parse(at("scene").textContent);
  const say = text => { at("view-note").hidden = false; at("view-note").textContent = text; };
  const bytes = text => Uint8Array.from(atob(text), c => c.charCodeAt(0));

  // The surface: 8 bytes a vertex, three coordinates of 16 bits and an octahedral normal.
  const surfaceVertex = `#version 300 es
    in vec3 point; in vec2 folded; uniform mat4 place; uniform mat3 turn; uniform vec3 scale, center;
    out vec3 normal; out float height;
    void main() {
      vec3 n = vec3(folded, 1.0 - abs(folded.x) - abs(folded.y));
      float under = max(-n.z, 0.0);
      n.xy -= vec2(n.x < 0.0 ? -under : under, n.y < 0.0 ? -under : under);
      normal = turn * (n / scale);
      height = point.z;
      gl_Position = place * vec4((point - center) * scale, 1.0);
    }`;
  const surfacePixel = `#version 300 es
    precision highp float;
    in vec3 normal; in float height; uniform float cut; uniform vec3 outside, inside; out vec4 color;
    void main() {
      if (height > cut) discard;
      vec3 n = normalize(normal);
      vec3 body = outside;
      if (!gl_FrontFacing) { n = -n; body = inside; }
      float key = max(dot(n, normalize(vec3(-0.45, 0.6, 0.7))), 0.0);
      float sky = 0.5 + 0.5 * n.y;
      float shine = pow(max(dot(n, normalize(vec3(-0.25, 0.33, 0.92))), 0.0), 40.0);
      float fill = max(dot(n, normalize(vec3(0.8, 0.1, 0.5))), 0.0);
      color = vec4(body * (0.26 + 0.54 * key + 0.22 * fill + 0.22 * sky) + 0.10 * shine, 1.0);
    }`;
  // A line's piece is a strip some pixels wide, a little nearer than the surface it lies on.
  const lineVertex = `#version 300 es
    in vec4 from, to; uniform mat4 place; uniform vec3 scale, center; uniform vec2 window; uniform float wide, chosen, cut;
    out float bright;
    void main() {
      bool one = chosen > 0.0 && from.w == chosen;
      bright = one ? 1.0 : 0.0;
      vec4 a = place * vec4((from.xyz - center) * scale, 1.0), b = place * vec4((to.xyz - center) * scale, 1.0);
      vec2 along = (b.xy / b.w - a.xy / a.w) * window;
      float far = length(along);
      along = far > 0.0 ? along / far : vec2(1.0, 0.0);
      vec4 here = (gl_VertexID & 1) == 0 ? a : b;
      float side = gl_VertexID < 2 ? -1.0 : 1.0;
      float half_width = wide * (one ? 2.2 : 1.0);
      here.xy += vec2(-along.y, along.x) * side * half_width / window * here.w;
      here.z -= (one ? 0.006 : 0.004) * here.w;
      gl_Position = from.w == 0.0 || from.z > cut ? vec4(2.0, 2.0, 2.0, 1.0) : here;
    }`;
  const linePixel = `#version 300 es
    precision highp float;
    in float bright; uniform vec3 line, lit; out vec4 color;
    void main() { color = vec4(bright > 0.5 ? lit : line, 1.0); }`;

  const gl = canvas.getContext("webgl2", { antialias: true, alpha: true });
  if (!gl) { say("This browser does not draw WebGL 2: the surface cannot be shown here. All else on this page holds."); return; }
  const program = (vertex, pixel) => {
    const made = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, pixel]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
      gl.attachShader(made, shader);
    }
    gl.linkProgram(made);
    if (!gl.getProgramParameter(made, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(made));
    const place = new Map();
    return { made, at: name => { if (!place.has(name)) place.set(name, gl.getUniformLocation(made, name)); return place.get(name); } };
  };
  const buffer = (kind, data) => {
    const made = gl.createBuffer();
    gl.bindBuffer(kind, made);
    gl.bufferData(kind, data, gl.STATIC_DRAW);
    return made;
  };
  const attribute = (of, name, size, type, normalized, stride, offset, divisor) => {
    const where = gl.getAttribLocation(of.made, name);
    gl.enableVertexAttribArray(where);
    gl.vertexAttribPointer(where, size, type, normalized, stride, offset);
    gl.vertexAttribDivisor(where, divisor);
  };

  let surface, strokes, surfaceArray, lineArray, corners, pieces;
  const prepare = () => {
    surface = program(surfaceVertex, surfacePixel);
    strokes = program(lineVertex, linePixel);
    surfaceArray = gl.createVertexArray();
    gl.bindVertexArray(surfaceArray);
    buffer(gl.ARRAY_BUFFER, bytes(scene.vertices));
    attribute(surface, "point", 3, gl.UNSIGNED_SHORT, false, 8, 0, 0);
    attribute(surface, "folded", 2, gl.BYTE, true, 8, 6, 0);
    const triangles = bytes(scene.triangles);
    buffer(gl.ELEMENT_ARRAY_BUFFER, triangles);
    corners = triangles.length / 4;
    lineArray = gl.createVertexArray();
    gl.bindVertexArray(lineArray);
    const lines = bytes(scene.lines);
    buffer(gl.ARRAY_BUFFER, lines);
    attribute(strokes, "from", 4, gl.UNSIGNED_SHORT, false, 8, 0, 1);
    attribute(strokes, "to", 4, gl.UNSIGNED_SHORT, false, 8, 8, 1);
    pieces = Math.max(lines.length / 8 - 1, 0);
    gl.bindVertexArray(null);
    gl.enable(gl.DEPTH_TEST);
  };
  prepare();

  // Everything is drawn in a ball of radius 1.
  const [sx, sy, sz] = scene.size, tall = sz * scene.stretch;
  const radius = 0.5 * Math.hypot(sx, sy, tall) || 1;
  const unit = scene.step / radius;
  const scale = [unit, unit, unit * scene.stretch];
  const center = [sx, sy, sz].map(s => 0.5 * s / scene.step);
  const home = { yaw: -0.62, pitch: 0.56, zoom: 1 };
  let view = { ...home }, chosen = 0, showLines = true, cut = 1;
  let turning = !matchMedia("(prefers-reduced-motion: reduce)").matches;
  const dark = matchMedia("(prefers-color-scheme: dark)");

  const draw = () => {
    const ratio = Math.min(devicePixelRatio || 1, 2);
    const wide = Math.max(Math.round(canvas.clientWidth * ratio), 1), high = Math.max(Math.round(canvas.clientHeight * ratio), 1);
    if (canvas.width !== wide || canvas.height !== high) { canvas.width = wide; canvas.height = high; }
    const [cy, sny, cp, snp] = [Math.cos(view.yaw), Math.sin(view.yaw), Math.cos(view.pitch), Math.sin(view.pitch)];
    // Rows: right, up, towards the viewer.
    const rows = [[cy, sny, 0], [-sny * snp, cy * snp, cp], [sny * cp, -cy * cp, snp]];
    // At zoom 1 the body fills the window whichever way it is turned about its height: the upright cylinder around it does.
    const far = 5, aspect = wide / high, near = far - 1.5, back = far + 1.5;
    const across = 0.5 * Math.hypot(sx, sy) / radius, half = 0.5 * tall / radius, [c, s] = [Math.cos(home.pitch), Math.sin(home.pitch)];
    const ends = [[across, half], [across, -half], [-across, half], [-across, -half]];
    const up = Math.max(...ends.map(([d, z]) => Math.abs(z * c - d * s) / (far - d * c - z * s)));
    const right = across / Math.sqrt((far - half * s) ** 2 - (across * c) ** 2);
    const f = view.zoom * 0.95 * Math.min(1 / up, aspect / right);
    const a = (back + near) / (near - back), b = 2 * back * near / (near - back);
    const place = new Float32Array(16);
    for (let k = 0; k < 3; k++) {
      place[4 * k] = rows[0][k] * f / aspect;
      place[4 * k + 1] = rows[1][k] * f;
      place[4 * k + 2] = rows[2][k] * a;
      place[4 * k + 3] = -rows[2][k];
    }
    place[14] = -far * a + b;
    place[15] = far;
    const turn = new Float32Array(9);
    for (let r = 0; r < 3; r++) for (let c = 0; c < 3; c++) turn[3 * c + r] = rows[r][c];
    gl.viewport(0, 0, wide, high);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    const limit = cut >= 1 ? 70000 : cut * sz / scene.step;
    const common = of => {
      gl.useProgram(of.made);
      gl.uniformMatrix4fv(of.at("place"), false, place);
      gl.uniform3fv(of.at("scale"), scale);
      gl.uniform3fv(of.at("center"), center);
      gl.uniform1f(of.at("cut"), limit);
    };
    common(surface);
    gl.uniformMatrix3fv(surface.at("turn"), false, turn);
    gl.uniform3fv(surface.at("outside"), [0.86, 0.80, 0.70]);
    gl.uniform3fv(surface.at("inside"), [0.62, 0.48, 0.44]);
    gl.bindVertexArray(surfaceArray);
    gl.drawElements(gl.TRIANGLES, corners, gl.UNSIGNED_INT, 0);
    if (showLines && pieces > 0) {
      common(strokes);
      gl.uniform2fv(strokes.at("window"), [wide, high]);
      gl.uniform1f(strokes.at("wide"), 1.1 * ratio);
      gl.uniform1f(strokes.at("chosen"), chosen);
      gl.uniform3fv(strokes.at("line"), [0.62, 0.10, 0.08]);
      gl.uniform3fv(strokes.at("lit"), dark.matches ? [0.35, 0.75, 1.0] : [0.0, 0.36, 0.75]);
      gl.bindVertexArray(lineArray);
      gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, pieces);
    }
  };

  let waiting = false, before = 0, seen = true;
  new IntersectionObserver(entries => { seen = entries.at(-1).isIntersecting; ask(); }).observe(canvas);
  const frame = now => {
    waiting = false;
    if (turning) view.yaw += Math.min(now - before, 100) * 0.0003;
    before = now;
    if (!gl.isContextLost()) draw();
    if (turning && seen) ask();
  };
  const ask = () => { if (!waiting) { waiting = true; requestAnimationFrame(frame); } };
  const press = (button, on) => button.setAttribute("aria-pressed", String(on));
  const setTurning = on => { turning = on; press(at("turn"), on); ask(); };
  const limits = () => {
    view.pitch = Math.min(Math.max(view.pitch, -1.57), 1.57);
    view.zoom = Math.min(Math.max(view.zoom, 0.3), 40);
    ask();
  };

  const fingers = new Map();
  canvas.addEventListener("pointerdown", e => { canvas.setPointerCapture(e.pointerId); fingers.set(e.pointerId, e); setTurning(false); });
  const lift = e => fingers.delete(e.pointerId);
  canvas.addEventListener("pointerup", lift);
  canvas.addEventListener("pointercancel", lift);
  canvas.addEventListener("pointermove", e => {
    const old = fingers.get(e.pointerId);
    if (!old) return;
    if (fingers.size === 1) {
      view.yaw -= (e.clientX - old.clientX) * 0.008;
      view.pitch += (e.clientY - old.clientY) * 0.008;
    } else {
      const other = [...fingers.values()].find(f => f.pointerId !== e.pointerId);
      const apart = p => Math.hypot(p.clientX - other.clientX, p.clientY - other.clientY);
      view.zoom *= apart(e) / Math.max(apart(old), 1);
    }
    fingers.set(e.pointerId, e);
    limits();
  });
  canvas.addEventListener("wheel", e => {
    e.preventDefault();
    view.zoom *= Math.exp(-e.deltaY * (e.deltaMode ? 0.05 : 0.0015));
    limits();
  }, { passive: false });
  canvas.addEventListener("keydown", e => {
    const step = { ArrowLeft: [0.1, 0, 1], ArrowRight: [-0.1, 0, 1], ArrowUp: [0, 0.1, 1], ArrowDown: [0, -0.1, 1], "+": [0, 0, 1.15], "=": [0, 0, 1.15], "-": [0, 0, 1 / 1.15] }[e.key];
    if (!step) return;
    e.preventDefault();
    setTurning(false);
    view.yaw += step[0];
    view.pitch += step[1];
    view.zoom *= step[2];
    limits();
  });
  at("turn").addEventListener("click", () => setTurning(!turning));
  at("lines").addEventListener("click", () => { showLines = !showLines; press(at("lines"), showLines); ask(); });
  const slide = () => {
    cut = at("cut").value / 1000;
    const height = scene.floor + cut * sz;
    at("cut-at").textContent = cut >= 1 ? "nothing cut" : height.toPrecision(4);
    ask();
  };
  at("cut").addEventListener("input", slide);
  at("reset").addEventListener("click", () => { view = { ...home }; at("cut").value = 1000; slide(); });
  for (const button of document.querySelectorAll("[data-contour]")) button.addEventListener("click", () => {
    const number = Number(button.dataset.contour);
    chosen = chosen === number ? 0 : number;
    for (const other of document.querySelectorAll("[data-contour]")) press(other, Number(other.dataset.contour) === chosen);
    ask();
  });
  canvas.addEventListener("webglcontextlost", e => e.preventDefault());
  canvas.addEventListener("webglcontextrestored", () => { prepare(); ask(); });
  dark.addEventListener("change", ask);
  new ResizeObserver(ask).observe(canvas);
  slide();
  setTurning(turning);
})();
