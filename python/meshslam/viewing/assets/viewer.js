"use strict";
// A map in 3-D: z up, metres, matrices column by column.
function makeViewer(scene, stage) {
  const canvas = stage.querySelector("canvas");
  const gl = canvas.getContext("webgl2", { antialias: true, alpha: true, premultipliedAlpha: true });
  if (!gl) return null;

  // vectors and matrices
  const sub = (a, b) => a.map((v, i) => v - b[i]);
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const unit = (a) => { const n = Math.hypot(...a) || 1; return a.map((v) => v / n); };
  const times = (a, b) => {
    const out = new Float32Array(16);
    for (let c = 0; c < 4; c++) for (let r = 0; r < 4; r++) for (let k = 0; k < 4; k++) out[4 * c + r] += a[4 * k + r] * b[4 * c + k];
    return out;
  };
  const lookFrom = (eye, target) => {
    const back = unit(sub(eye, target)), right = unit(cross([0, 0, 1], back)), up = cross(back, right);
    return [right[0], up[0], back[0], 0, right[1], up[1], back[1], 0, right[2], up[2], back[2], 0, -dot(right, eye), -dot(up, eye), -dot(back, eye), 1];
  };
  const perspective = (fov, aspect, near, far) => {
    const f = 1 / Math.tan(fov / 2);
    return [f / aspect, 0, 0, 0, 0, f, 0, 0, 0, 0, (far + near) / (near - far), -1, 0, 0, 2 * far * near / (near - far), 0];
  };

  // data
  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  const topologies = scene.faces.map((text) => new Uint32Array(bytes(text).buffer));
  const path = new Float32Array(bytes(scene.path).buffer), frusta = new Float32Array(bytes(scene.frusta).buffer);
  const objects = scene.objects.map((o) => {
    const packed = new Int16Array(bytes(o.vertices).buffer), count = packed.length / 3, m = o.matrix;
    const place = new Float32Array(packed.length), normal = new Float32Array(packed.length), known = new Float32Array(2 * count).fill(-1);
    for (let i = 0; i < count; i++) for (let r = 0; r < 3; r++)
      place[3 * i + r] = (m[4 * r] * packed[3 * i] + m[4 * r + 1] * packed[3 * i + 1] + m[4 * r + 2] * packed[3 * i + 2]) / 1000 + m[4 * r + 3];
    const faces = topologies[o.faces], at = (i) => [place[3 * i], place[3 * i + 1], place[3 * i + 2]];
    for (let f = 0; f < faces.length; f += 3) {
      const a = at(faces[f]), n = cross(sub(at(faces[f + 1]), a), sub(at(faces[f + 2]), a));
      for (let k = 0; k < 3; k++) for (let r = 0; r < 3; r++) normal[3 * faces[f + k] + r] += n[r];
    }
    if (o.sigma) bytes(o.sigma).forEach((v, i) => { known[2 * i] = v / 1000; });
    if (o.seen) bytes(o.seen).forEach((v, i) => { known[2 * i + 1] = v; });
    const low = [Infinity, Infinity, Infinity], high = low.map((v) => -v);
    place.forEach((v, i) => { low[i % 3] = Math.min(low[i % 3], v); high[i % 3] = Math.max(high[i % 3], v); });
    return { ...o, place, normal, known, index: faces, centre: [m[3], m[7], m[11]], low, high };
  });

  // programs
  const program = (vertex, fragment) => {
    const made = gl.createProgram();
    for (const [kind, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, "#version 300 es\nprecision highp float;\n" + source);
      gl.compileShader(shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
      gl.attachShader(made, shader);
    }
    gl.linkProgram(made);
    return made;
  };
  const SURE_M = 0.02, UNSURE_M = 0.2;
  const meshes = program(`
    layout(location = 0) in vec3 place; layout(location = 1) in vec3 normal; layout(location = 2) in vec2 known;
    uniform mat4 view; out vec3 n, p; out vec2 k;
    void main() { n = normal; p = place; k = known; gl_Position = view * vec4(place, 1.0); }`, `
    in vec3 n, p; in vec2 k; uniform vec3 colour, eye, prior; uniform int by; uniform vec2 range; out vec4 pixel;
    void main() {
      vec3 base = colour;
      float t = clip01(log(max(k.x, 1e-4) / range.x) / log(range.y / range.x));
      if (by == 1) base = k.x < 0.0 ? prior : t < 0.5 ? mix(vec3(.10, .56, .52), vec3(.96, .80, .38), 2.0 * t) : mix(vec3(.96, .80, .38), vec3(.72, .20, .42), 2.0 * t - 1.0);
      if (by == 2) base = mix(prior, colour, k.y < 0.0 ? 0.0 : smoothstep(0.35, 0.65, k.y));
      vec3 flatly = normalize(cross(dFdx(p), dFdy(p)));
      vec3 m = normalize(mix(normalize(n), flatly, 0.55)), e = normalize(eye - p);
      float sky = 0.5 + 0.5 * m.z, sun = max(dot(m, normalize(vec3(.35, .25, .9))), 0.0), front = max(dot(m, e), 0.0);
      vec3 lit = base * (0.28 + 0.27 * sky + 0.30 * sun + 0.25 * front) + vec3(.10) * pow(front, 8.0);
      pixel = vec4(lit, 1.0);
    }`.replace("void main", "float clip01(float v) { return clamp(v, 0.0, 1.0); }\nvoid main"));
  const lines = program(`
    layout(location = 0) in vec2 corner; layout(location = 1) in vec3 a; layout(location = 2) in vec3 b;
    uniform mat4 view; uniform vec2 size; uniform float width; out vec3 p;
    void main() {
      vec4 s = view * vec4(a, 1.0), t = view * vec4(b, 1.0);
      float near = 0.02;
      vec4 u = s.w < near && t.w > near ? mix(s, t, (near - s.w) / (t.w - s.w)) : s;
      vec4 v = t.w < near && s.w > near ? mix(t, s, (near - t.w) / (s.w - t.w)) : t;
      vec2 along = (v.xy / v.w - u.xy / u.w) * size;
      along = length(along) > 1e-6 ? normalize(along) : vec2(1.0, 0.0);
      gl_Position = corner.x < 0.5 ? u : v;
      p = corner.x < 0.5 ? a : b;
      gl_Position.xy += corner.y * width * vec2(-along.y, along.x) / size * gl_Position.w;
    }`, `
    in vec3 p; uniform vec4 colour; uniform vec3 middle; uniform float reach; out vec4 pixel;
    void main() { float o = colour.a * (1.0 - smoothstep(0.4 * reach, reach, distance(p, middle))); pixel = vec4(colour.rgb * o, o); }`);
  const uniform = (made, name) => gl.getUniformLocation(made, name);

  // buffers
  const attribute = (location, data, size, divisor = 0, stride = 0, offset = 0) => {
    gl.bindBuffer(gl.ARRAY_BUFFER, data);
    gl.enableVertexAttribArray(location);
    gl.vertexAttribPointer(location, size, gl.FLOAT, false, stride, offset);
    gl.vertexAttribDivisor(location, divisor);
  };
  const buffer = (data) => {
    const made = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, made);
    gl.bufferData(gl.ARRAY_BUFFER, data, gl.STATIC_DRAW);
    return made;
  };
  for (const o of objects) {
    o.array = gl.createVertexArray();
    gl.bindVertexArray(o.array);
    attribute(0, buffer(o.place), 3);
    attribute(1, buffer(o.normal), 3);
    attribute(2, buffer(o.known), 2);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, o.index, gl.STATIC_DRAW);
  }
  const corners = buffer(new Float32Array([0, -1, 0, 1, 1, -1, 1, 1]));
  const segments = (ends) => {
    const array = gl.createVertexArray(), data = buffer(new Float32Array(ends));
    gl.bindVertexArray(array);
    attribute(0, corners, 2);
    attribute(1, data, 3, 1, 24, 0);
    attribute(2, data, 3, 1, 24, 12);
    return { array, count: ends.length / 6 };
  };
  const pathEnds = [], frustumEnds = [], gridEnds = [];
  for (let i = 0; i + 3 < path.length; i += 3) pathEnds.push(...path.subarray(i, i + 6));
  for (let f = 0; f < frusta.length; f += 15) {
    const point = (k) => [...frusta.subarray(f + 3 * k, f + 3 * k + 3)];
    for (const [a, b] of [[0, 1], [0, 2], [0, 3], [0, 4], [1, 2], [2, 3], [3, 4], [4, 1]]) frustumEnds.push(...point(a), ...point(b));
  }
  // extent of what there is to see
  const points = objects.flatMap((o) => [0, 1, 2, 3, 4, 5, 6, 7].map((k) => [0, 1, 2].map((r) => (k >> r & 1 ? o.high : o.low)[r])));
  for (let i = 0; i < path.length; i += 3) points.push([...path.subarray(i, i + 3)]);
  if (!points.length) points.push([0, 0, 0]);
  const low = [0, 1, 2].map((r) => Math.min(...points.map((p) => p[r]))), high = [0, 1, 2].map((r) => Math.max(...points.map((p) => p[r])));
  const middle = low.map((v, r) => (v + high[r]) / 2), radius = Math.max(4, Math.hypot(...sub(high, low)) / 2);
  const cell = [1, 2, 5, 10, 20, 50, 100, 200, 500].find((c) => 3 * radius / c < 60) || 1000, half = Math.ceil(1.6 * radius / cell) * cell;
  const gx = Math.round(middle[0] / cell) * cell, gy = Math.round(middle[1] / cell) * cell, gz = scene.ground;
  for (let v = -half; v <= half + 1e-6; v += cell) gridEnds.push(gx + v, gy - half, gz, gx + v, gy + half, gz, gx - half, gy + v, gz, gx + half, gy + v, gz);
  const pathLine = segments(pathEnds), frustumLine = segments(frustumEnds), gridLine = segments(gridEnds);

  // standpoint
  const heading = path.length > 3 ? Math.atan2(path[path.length - 2] - path[1], path[path.length - 3] - path[0]) : 0;
  const FOV = 0.7;
  const seen = { target: middle, yaw: 0, pitch: 0, distance: 10, by: "object" };
  // from this direction, the nearest standpoint that sees all points: |x - sx| <= tx (d - z) and |y - sy| <= ty (d - z)
  const fitted = (yaw, pitch) => {
    const c = Math.cos(pitch), back = [c * Math.cos(yaw), c * Math.sin(yaw), Math.sin(pitch)];
    const right = unit(cross([0, 0, 1], back)), up = cross(back, right), ty = 0.82 * Math.tan(FOV / 2);
    const slopes = [0.9 * Math.tan(FOV / 2) * (canvas.clientWidth / canvas.clientHeight || 1), ty];
    const bounds = [right, up].map((axis, i) => [1, -1].map((sign) =>
      points.reduce((most, p) => { const q = sub(p, middle); return Math.max(most, sign * dot(q, axis) + slopes[i] * dot(q, back)); }, -Infinity)));
    const shift = bounds.map(([a, b]) => (a - b) / 2), needed = Math.max(...bounds.map(([a, b], i) => (a + b) / 2 / slopes[i]));
    const target = middle.map((v, r) => v + shift[0] * right[r] + shift[1] * up[r]), slide = (target[2] - gz) / back[2];
    return { target: target.map((v, r) => v - slide * back[r]), yaw, pitch, distance: needed + slide };
  };
  const standpoints = {
    start: () => fitted(heading + Math.PI - 0.5, 0.5),
    top: () => fitted(heading - Math.PI / 2, 1.5533),
    camera: () => {
      const eye = path.length ? [...path.subarray(0, 3)] : middle, reach = 8;
      return { target: [eye[0] + reach * Math.cos(heading), eye[1] + reach * Math.sin(heading), eye[2] - 0.8], yaw: heading + Math.PI, pitch: 0.12, distance: reach + 2 };
    },
  };
  const eyeOf = () => {
    const c = Math.cos(seen.pitch);
    return [c * Math.cos(seen.yaw), c * Math.sin(seen.yaw), Math.sin(seen.pitch)].map((v, r) => seen.target[r] + seen.distance * v);
  };

  // drawing
  const names = stage.querySelector("#names"), key = stage.querySelector("#key");
  const tags = objects.map((o) => {
    const tag = document.createElement("span");
    tag.textContent = o.id;
    tag.style.background = `rgb(${o.colour.map((v) => Math.round(255 * v)).join(" ")})`;
    return names.appendChild(tag);
  });
  const themed = (name) => {
    const text = getComputedStyle(document.documentElement).getPropertyValue(name).trim();
    return [1, 3, 5].map((i) => parseInt(text.slice(i, i + 2), 16) / 255);
  };
  const drawLines = (what, colour, width, middlePoint, reach, view) => {
    if (!what.count) return;
    gl.useProgram(lines);
    gl.bindVertexArray(what.array);
    gl.uniformMatrix4fv(uniform(lines, "view"), false, view);
    gl.uniform2f(uniform(lines, "size"), canvas.width, canvas.height);
    gl.uniform1f(uniform(lines, "width"), width * (window.devicePixelRatio || 1));
    gl.uniform4f(uniform(lines, "colour"), ...colour);
    gl.uniform3f(uniform(lines, "middle"), ...middlePoint);
    gl.uniform1f(uniform(lines, "reach"), reach);
    gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, what.count);
  };
  const draw = () => {
    waiting = false;
    const dense = window.devicePixelRatio || 1, width = canvas.clientWidth, height = canvas.clientHeight;
    if (canvas.width !== Math.round(width * dense) || canvas.height !== Math.round(height * dense)) {
      canvas.width = Math.round(width * dense);
      canvas.height = Math.round(height * dense);
    }
    const eye = eyeOf(), near = Math.max(0.05, seen.distance / 50), far = seen.distance + 6 * radius + 50;
    const view = times(perspective(FOV, width / height, near, far), lookFrom(eye, seen.target));
    gl.viewport(0, 0, canvas.width, canvas.height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    gl.disable(gl.BLEND);
    gl.useProgram(meshes);
    gl.uniformMatrix4fv(uniform(meshes, "view"), false, view);
    gl.uniform3f(uniform(meshes, "eye"), ...eye);
    gl.uniform3f(uniform(meshes, "prior"), ...themed("--prior"));
    gl.uniform1i(uniform(meshes, "by"), ["object", "sigma", "seen"].indexOf(seen.by));
    gl.uniform2f(uniform(meshes, "range"), SURE_M, UNSURE_M);
    for (const o of objects) {
      gl.uniform3f(uniform(meshes, "colour"), ...(seen.by === "seen" ? themed("--seen") : o.colour));
      gl.bindVertexArray(o.array);
      gl.drawElements(gl.TRIANGLES, o.index.length, gl.UNSIGNED_INT, 0);
    }
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    gl.depthMask(false);
    drawLines(gridLine, [...themed("--soft"), 0.35], 0.5, [gx, gy, gz], half, view);
    drawLines(frustumLine, [...themed("--path"), 0.45], 0.6, middle, 1e9, view);
    drawLines(pathLine, [...themed("--path"), 1], 1.3, middle, 1e9, view);
    gl.depthMask(true);
    const places = objects.map((o, i) => {
      const p = [o.centre[0], o.centre[1], o.high[2], 1], c = [0, 1, 3].map((r) => p.reduce((sum, v, k) => sum + view[4 * k + r] * v, 0));
      return { tag: tags[i], depth: c[2], x: (0.5 + 0.5 * c[0] / c[2]) * width, y: (0.5 - 0.5 * c[1] / c[2]) * height - 6 };
    });
    const kept = [];
    for (const p of places.sort((a, b) => a.depth - b.depth)) {  // the nearest first
      p.tag.hidden = p.depth < near || kept.some((k) => Math.abs(k.x - p.x) < 22 && Math.abs(k.y - p.y) < 15);
      if (!p.tag.hidden) kept.push(p);
      p.tag.style.transform = `translate(${p.x.toFixed(1)}px, ${p.y.toFixed(1)}px) translate(-50%, -100%)`;
    }
  };
  let waiting = false;
  const refresh = () => { if (!waiting) { waiting = true; requestAnimationFrame(draw); } };

  // hands
  const turn = (dx, dy) => { seen.yaw -= 0.006 * dx; seen.pitch = Math.min(1.5533, Math.max(-0.2, seen.pitch + 0.006 * dy)); };
  const move = (dx, dy) => {
    const scale = 2 * seen.distance * Math.tan(FOV / 2) / canvas.clientHeight, s = Math.sin(seen.yaw), c = Math.cos(seen.yaw);
    const up = Math.max(Math.sin(seen.pitch), 0.35);
    seen.target = [seen.target[0] + scale * (s * dx - c * dy / up), seen.target[1] + scale * (-c * dx - s * dy / up), seen.target[2]];
  };
  const zoom = (factor) => { seen.distance = Math.min(20 * radius, Math.max(1.5, seen.distance * factor)); };
  const down = new Map();
  canvas.addEventListener("pointerdown", (e) => { down.set(e.pointerId, e); canvas.setPointerCapture(e.pointerId); });
  for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, (e) => down.delete(e.pointerId));
  canvas.addEventListener("pointermove", (e) => {
    const before = down.get(e.pointerId);
    if (!before) return;
    const dx = e.clientX - before.clientX, dy = e.clientY - before.clientY;
    if (down.size === 2) {
      const other = [...down.values()].find((p) => p.pointerId !== e.pointerId);
      const span = (p) => Math.hypot(p.clientX - other.clientX, p.clientY - other.clientY) || 1;
      zoom(span(before) / span(e));
      move(dx / 2, dy / 2);
    } else if (e.buttons & 2 || e.shiftKey) move(dx, dy);
    else turn(dx, dy);
    down.set(e.pointerId, e);
    refresh();
  });
  canvas.addEventListener("contextmenu", (e) => e.preventDefault());
  canvas.addEventListener("wheel", (e) => {
    e.preventDefault();
    zoom(Math.exp(Math.min(60, Math.max(-60, e.deltaY)) * 0.004));
    refresh();
  }, { passive: false });
  canvas.addEventListener("keydown", (e) => {
    const step = { ArrowLeft: [-25, 0], ArrowRight: [25, 0], ArrowUp: [0, 25], ArrowDown: [0, -25] }[e.key];
    if (step) (e.shiftKey ? move : turn)(...step);
    else if (e.key === "+" || e.key === "-") zoom(e.key === "+" ? 0.85 : 1.18);
    else return;
    e.preventDefault();
    refresh();
  });
  new ResizeObserver(refresh).observe(canvas);
  window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", refresh);

  const colourBy = (what) => {
    seen.by = what;
    key.innerHTML = {
      object: "",
      sigma: `${100 * SURE_M} cm<i style="background:linear-gradient(90deg,rgb(26 143 133),rgb(245 204 97),rgb(184 51 107))"></i>${100 * UNSURE_M} cm, 1 σ of a vertex`,
      seen: '<i class=dot style="background:var(--seen)"></i>seen<i class=dot style="background:var(--prior)"></i>the category’s prior',
    }[what];
    refresh();
  };
  const standAt = (where) => { Object.assign(seen, standpoints[where]()); refresh(); };
  const lookAt = (id) => {
    const found = objects.find((o) => o.id === id);
    if (found) { seen.target = [...found.centre]; seen.distance = Math.min(seen.distance, 11); refresh(); }
  };
  standAt("start");
  return { colourBy, standAt, lookAt };
}
